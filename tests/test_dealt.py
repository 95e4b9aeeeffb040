"""Flexible cells that bodies leave to one rank are dealt out: the same motion, until their release.

Run as a script under mpirun, this file integrates its scene and reports what it finds.
"""

from pathlib import Path
from unittest.mock import patch

import numpy as np
import parallel
import pytest

import rigidfx as rf
from rigidfx.coupling import dealt_rows
from rigidfx.step import stepper

EFFECTS = Path(__file__).parent / "effects_on_ranks.py"
TOLERANCE = 1e-9  # relative to the largest number of a column
FREEZE, RELEASE, AGAIN, END = 0.4, 0.8, 1.2, 1.4  # s


def _bar():
    """A bar that tumbles; its stiff three quarters freeze, and are released."""
    domain = rf.box((0, 0, 0), (12, 1, 1), (12, 1, 1), cell="tetrahedron")
    domain = domain.with_cells("stiff", lambda x: x[0] <= 9 + 1e-9)
    domain = domain.with_cells("soft", lambda x: x[0] >= 9 - 1e-9)
    return rf.Scene(
        domain,
        {
            "stiff": rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1.0),
            "soft": rf.NeoHooke(E=2e3, nu=0.3, rho=1.0),
        },
        [
            rf.InitialVelocity(angular=(0.1, 0.4, 0.9), linear=(0.3, 0.0, 0.1)),
            rf.Pressure("x1", 20.0),
            rf.KelvinVoigt(0.01),
            rf.Spring("x1", 30.0),
        ],
        order=2,
        mass="consistent",
        probes={"tip": (12.0, 0.5, 0.5)},
    )


def _criterion():
    """All that is stiff freezes, is released and freezes again."""
    return rf.StrainRate(
        1e3,
        window=FREEZE,
        until=AGAIN + 0.1,
        never=["soft"],
        wake="none",
        release=rf.Release(at=RELEASE),
    )


def _history():
    """Numbers of each step, which divisions had cells dealt, and how often they were dealt anew."""
    made, dealt = [], []

    class Dealing(dealt_rows.Dealing):
        def rows(self, layout, loaded):
            rows = super().rows(layout, loaded)
            made.append(rows is not None)
            if rows is not None and rows.cells not in dealt:
                dealt.append(rows.cells)
            return rows

    rows = []
    with patch.object(stepper, "Dealing", Dealing), patch.object(dealt_rows, "FEW", 1):
        for r in rf.simulate(_bar(), 0.1, END, rigidify=_criterion(), progress=False):
            rows.append([
                r.t, r.unknowns, r.kinetic, r.strain, r.springs, *r.linear_momentum,
                *r.angular_momentum, *r.probes["tip"], r.energy - r.work_of_loads,
            ])  # fmt: skip
    return {"rows": rows, "dealt": made, "times": len(dealt)}


@pytest.fixture(scope="module")
def alone():
    return parallel.run(__file__, 1, timeout=300)


@pytest.mark.parallel
def test_dealt_between_freeze_and_release(alone):
    """On several ranks only, once for all freezes, and the motion is that of one rank."""
    several = parallel.run(__file__, 3, timeout=300)
    assert not any(alone["dealt"])
    assert several["dealt"] == [False, True, False, True]
    assert several["times"] == 1
    one, other = np.array(alone["rows"]), np.array(several["rows"])
    assert len(np.unique(one[:, 1])) == 2  # flexible, frozen, and flexible again
    apart = np.abs(other - one).max(axis=0) / np.abs(one).max(axis=0)
    assert (apart <= TOLERANCE).all()


@pytest.mark.parallel
def test_dealt_with_every_effect():
    """Springs, contacts, pressure, damping and supports, with a rigid part in the middle or not.

    The copies are those of the flexible cells, or of the rigid ones, too.
    """
    runs = (1, "dealt"), (2, "dealt"), (2, "dealt", "all")
    one, *several = (
        np.array(parallel.run(EFFECTS, n, 300, "consistent", *how)) for n, *how in runs
    )
    for each in several:
        assert (np.abs(each - one).max(axis=0) <= TOLERANCE * np.abs(one).max(axis=0)).all()


if __name__ == "__main__":
    parallel.report(_history())
