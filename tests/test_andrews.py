"""Andrews' squeezing mechanism, of `demos/benchmarks/known/andrews.py`: the published angle."""

from __future__ import annotations

import pytest
from known.andrews import CRANK
from known.machines import angle_of_crank


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:9 of the rows of joints follow from others")  # it is plane
def test_the_crank_turns_as_it_is_published():
    """The error falls with Δt², so that two runs tell the limit to the digits published."""
    coarse, fine = angle_of_crank(150), angle_of_crank(300)
    assert fine == pytest.approx(CRANK, rel=1e-3)
    assert (4 * fine - coarse) / 3 == pytest.approx(CRANK, rel=1e-5)
