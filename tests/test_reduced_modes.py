"""Modes of reduced parts beside those of their flexible twins."""

from functools import partial

import numpy as np
import pytest
from parallel import check_the_same, report
from test_reduced import SOFT
from test_reduced_joints import bars
from test_reduced_statics import CASES, CLAMP, bar

import rigidfx as rf

# What is pulled is stiffer by that than its shapes know, at a percent.
pytestmark = pytest.mark.filterwarnings("ignore:Reduced 'half'. at t:rigidfx.RigidfxWarning")

ALONG = rf.Traction("x1", (1e5, 200.0, 300.0))
PULSE = rf.Traction("x1", (100.0, 200.0, 300.0), time=lambda t: 1.0 if 0.3 < t < 0.301 else 0.0)
ACROSS = rf.Traction("x1", (0, 300.0, -200.0), time=PULSE.time)
CARRIED = rf.PointMass(rf.MeanFace("x1"), 3.0, at=(1.2, 0.2, 0))
CASES = {
    "free end": (bar, [CLAMP, PULSE, ACROSS], ["end"], False),
    "held half": (bar, [CLAMP, PULSE, ACROSS], ["half"], False),
    "all of it": (bar, [CLAMP, PULSE, ACROSS], [None], False),
    "nothing acts": (bar, [CLAMP], ["half"], False),
    "pulled": (bar, [CLAMP, ALONG], ["half"], True),
    "carried mass": (bar, [CLAMP, PULSE, CARRIED], ["half"], False),
    "hinged": (partial(bars, thrown=False), CASES["hinged"][1], ["A", "B"], False),
}


def found(case, parts, count=3):
    made, effects, _, loaded = CASES[case]
    scene = made(*effects, *map(rf.Reduced, parts))
    return rf.modes(scene, count, about=[*rf.static(scene, 2)][-1] if loaded else None)


@pytest.mark.filterwarnings("ignore:Scene. first-order")
@pytest.mark.parametrize("case", CASES)
def test_modes_are_those_of_the_flexible_twin(case):
    """Within 0.1 %; the masses that take part, too, of modes of one frequency together."""
    own, twin = (found(case, parts) for parts in (CASES[case][2], []))
    assert len(own) >= 3
    assert own.rigid == twin.rigid == 0
    np.testing.assert_allclose(own.frequencies[:3], twin.frequencies[:3], rtol=1e-3)
    assert own.effective_mass[:2].sum(axis=0) == pytest.approx(
        twin.effective_mass[:2].sum(axis=0), abs=1e-3 * twin.mass
    )


@pytest.mark.parametrize("force", [5e3, 1e4])
def test_modes_about_a_bent_part_are_those_of_its_twin(force):
    """Cells that a bend of 5 % had left stretched made the first one 4.8 % too high."""
    domain, first = rf.box((0, 0, 0), (1.0, 0.05, 0.02), (12, 2, 1)), []
    for parts in ([rf.Reduced()], []):
        effects = [CLAMP, rf.Traction("x1", (0, 0, force / 20)), *parts]
        scene = rf.Scene(domain, SOFT, effects, element="enhanced")
        first.append(rf.modes(scene, 1, about=[*rf.static(scene, 4)][-1]).frequencies[0])
    assert first[0] == pytest.approx(first[1], rel=1e-3)


FACE = rf.MeanFace("x1")
UNSPANNED = {  # effects, parts, how many modes are asked for, and numbers of those that parts lack
    "thrown": ([PULSE], "half", 4, [4]),
    "a spring on nodes": ([CLAMP, rf.Spring("x1", 4e4)], "half", 4, [3, 4]),
    "a spring on a face": ([CLAMP, rf.Spring(FACE, 4e4, at=(1.2, 0, 0))], None, 4, [3, 4]),
    "a strut": ([CLAMP, rf.SpringDamper("ground", FACE, 4e4, at_a=(1, 2, 0))], None, 4, [3, 4]),
    "one of two equal ones": ([CLAMP, PULSE], "half", 3, [4]),
}


@pytest.mark.parametrize("case", UNSPANNED)
def test_modes_that_shapes_do_not_span_are_told(case):
    """Errors of 8 to 477 % where joints or springs hold a face were silent."""
    effects, part, count, lacking = UNSPANNED[case]
    scene = bar(*effects, rf.Reduced(part))
    with pytest.warns(rf.RigidfxWarning, match="do not span modes") as caught:
        own = rf.modes(scene, count)
    twin = rf.modes(bar(*effects), 4).frequencies
    (text,) = (str(w.message) for w in caught if "do not span" in str(w.message))
    numbers, near = text.split("modes ")[1].split(", which have ")
    assert [*map(int, numbers.split(","))] == lacking
    for k, f in zip(lacking, map(float, near.split(" Hz")[0].split(",")), strict=True):
        assert f == pytest.approx(twin[k - 1], rel=0.02)
    rest = [k for k in range(len(own)) if k + 1 not in lacking]
    np.testing.assert_allclose(own.frequencies[rest], twin[rest], rtol=0.01)


def test_a_description_says_which_model_has_the_periods():
    effects = CLAMP, PULSE, ACROSS
    scene = bar(*effects, rf.Reduced("half"))
    assert "of the reduced model as it begins" in scene.describe()
    lacking = bar(CLAMP, PULSE, rf.Reduced("half")).describe()
    assert "of the reduced model, which lacks some near" in lacking
    assert "of the reduced model" not in bar(*effects).describe()
    np.testing.assert_allclose(rf.periods(scene), rf.periods(bar(*effects)), rtol=1e-3)


def _found():
    """What is the same on any number of ranks."""
    return [found(case, ["half"]).frequencies[:3].tolist() for case in ("held half", "pulled")]


@pytest.mark.parallel
def test_modes_are_the_same_on_two_ranks():
    check_the_same(__file__, 2, _found())


if __name__ == "__main__":
    report(_found())
