"""Parts named `Reduced` beside parts that are found, and what else names of parts take."""

from functools import cache

import numpy as np
import pytest

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1000.0)
DT = 1e-3
CRITERIA = {
    "local": {"rigidify": rf.StrainRate(1e-2, 0.02)},
    "all": {"rigidify": rf.StrainRate(1e-2, 0.02, wake="all")},
    "accuracy": {"accuracy": rf.Accuracy(0.1, at=["end"])},
}


def bar(*effects):
    """A free bar that two blows bend; damping brings it to rest in between."""
    domain = rf.box((0, 0, 0), (3.0, 0.2, 0.2), (24, 2, 2))
    domain = domain.with_cells("middle", lambda x: (x[0] > 0.99) & (x[0] < 2.01))
    domain = domain.with_cells("centre", lambda x: (x[0] > 1.24) & (x[0] < 1.76))
    domain = domain.with_cells("rest", lambda x: x[0] > 1.49)
    blows = (
        rf.Traction("x1", (0, 0, 2e3), until=0.02),
        rf.Traction("x1", (0, 1e5, 0), since=0.2, until=0.22),
    )
    damping = rf.StiffnessDamping(0.6, frequency=30.0)
    return rf.Scene(domain, SOFT, [*blows, damping, *effects], probes={"end": (3, 0, 0)})


@cache
def flexible_end():
    """Where the end of the flexible twin is at last."""
    *_, twin = rf.simulate(bar(), DT, 0.25, progress=False)
    return twin.probes["end"]


@pytest.mark.filterwarnings("ignore:Scene. first-order cells lock")
@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_named_part_stays_and_the_rest_is_found_and_wakes(criterion):
    """Cells beside it become bodies that bend or wake; it keeps its shapes, and energy is kept."""
    largest, off, booked, found, shapes = 0.0, 0.0, None, [], 0
    for report in rf.simulate(
        bar(rf.Reduced("middle")), DT, 0.25, progress=False, **CRITERIA[criterion]
    ):
        body = next(body for body in report.bodies if body.name == "middle")
        assert body.shapes == 18
        others = [body for body in report.bodies if body.name != "middle"]
        found.append(len(others))
        shapes += sum(body.shapes for body in others)
        booked = report.energy if booked is None else booked + report.supplied
        off, largest = max(off, abs(report.energy - booked)), max(largest, report.energy)
    assert off < 1e-11 * largest
    assert np.abs(report.probes["end"] - flexible_end()).max() < 0.02 * np.abs(flexible_end()).max()
    if criterion != "accuracy":  # which gains nothing here
        assert max(found) > 0
        first = found.index(max(found))
        assert shapes > 0 if criterion == "local" else min(found[first:]) == 0


def two_bars(*effects):
    domain = rf.box((0, 0, 0), (1.0, 0.2, 0.5), (8, 2, 5))
    domain = domain.with_cells("ends", lambda x: (x[2] < 0.21) | (x[2] > 0.29))
    bars = domain.with_cells("bars", lambda x: (x[2] < 0.11) | (x[2] > 0.39))
    load = rf.Traction("x1", (0, 1e4, 0), until=0.01)
    return bars, rf.Scene(bars, SOFT, [load, *effects], probes={"end": (1, 0, 0)})


@pytest.mark.filterwarnings("ignore:Scene. first-order cells lock")
def test_pieces_are_bodies_each_and_files_read_them_as_reduced(tmp_path):
    """`each=False` has one body of both, which shapes deform alike."""
    ends = []
    for each, count in ((True, 2), (None, 2), (False, 1)):
        bars, scene = two_bars(rf.Reduced("bars", each=each))
        *_, report = rf.simulate(scene, DT, 0.02, progress=False)
        assert len(report.bodies) == count
        ends.append(report.probes["end"])
        if each:
            rf.write_bodies(tmp_path / "bodies.json", scene, report)
            _, parts = rf.read_bodies(tmp_path / "bodies.json", bars)
            assert [(type(part), part.name) for part in parts] == [
                (rf.Reduced, "bars 1"),
                (rf.Reduced, "bars 2"),
            ]
    assert np.abs(ends - ends[0]).max() < 1e-3 * np.abs(ends[0]).max()


@pytest.mark.filterwarnings("ignore:Scene. first-order cells lock")
def test_a_release_leaves_named_parts_as_they_are():
    """It is of cells that are found rigid."""
    release = [rf.Release(at=0.15)]
    criterion = rf.StrainRate(1e-2, 0.02, release=release)
    run = rf.simulate(bar(rf.Reduced("middle")), DT, 0.21, rigidify=criterion, progress=False)
    counts = {round(report.t, 6): [body.name for body in report.bodies] for report in run}
    assert len(counts[0.149]) == 3
    assert counts[0.151] == ["middle"]


@pytest.mark.parametrize(
    "criterion",
    [
        {"rigidify": rf.StrainRate(1e-2, 0.02, tolerances={"centre": 1.0})},
        {"rigidify": rf.StrainRate(1e-2, 0.02, never="middle")},
        {"accuracy": rf.Accuracy(0.1, never="centre")},
    ],
    ids=["tolerance", "never", "accuracy"],
)
def test_sets_in_a_reduced_part_are_refused_and_sets_beyond_it_are_not(criterion):
    """Nothing that a criterion says of cells of a named part alone would count."""
    inside, beyond = (bar(rf.Reduced(name)) for name in ("middle", "rest"))
    with pytest.raises(rf.SceneError, match=r"'(centre|middle)' lies in Reduced on 'middle'"):
        next(rf.simulate(inside, DT, 0.25, progress=False, **criterion))
    next(rf.simulate(beyond, DT, 0.25, progress=False, **criterion))
