"""Results of parts with shapes: stresses, levels and tables are those of flexible cells."""

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from histories import table
from mpi4py import MPI
from parallel import check_the_same, report
from test_reduced import DT, PUSH, SOFT, T_END, bar

import rigidfx as rf

PROBES = {"inside": (0.25, 0.05, 0.1), "border": (0.5, 0.05, 0.1)}


SPUN = rf.InitialVelocity(angular=(0, 0, 3.0))
CASES = {
    "spun": ([PUSH, SPUN], {"n": (12, 2, 2)}),
    "clamped": ([PUSH, rf.Fixed("x0")], {"n": (12, 2, 2), "element": "enhanced"}),
    "second order": ([PUSH], {"n": (6, 1, 1), "order": 2}),
}


def stresses(scene):
    """Stress and strain at the probes at the end of each step, shape (steps, probes, 2, 6)."""
    reports = rf.simulate(scene, dt=DT, t_end=T_END, progress=False)
    upper = np.triu_indices(3)
    return np.array(
        [[(s.stress[upper], s.strain[upper]) for s in r.stresses.values()] for r in reports]
    )


@pytest.mark.filterwarnings("ignore:Scene. first-order cells lock")
@pytest.mark.parametrize("case", CASES)
def test_stresses_and_strains_are_those_of_the_flexible_twin(case):
    """A body that has turned far has strains in its own axes, and stresses turned with it."""
    effects, how = CASES[case]
    own, twin = (
        stresses(bar(*more, *effects, probes=PROBES, **how)) for more in ([rf.Reduced("half")], [])
    )
    largest = np.abs(twin).max(axis=(0, 1, 3), keepdims=True)
    assert (np.abs(own - twin) < 5e-3 * largest).all()


def recorded(folder, *effects):
    """The reports of a run whose files are in a folder."""
    scene = bar(PUSH, SPUN, *effects, element="enhanced", probes=PROBES)
    with rf.Recorder(scene, folder, every=10, peaks=["half"]) as recorder:
        reports = []
        for r in rf.simulate(scene, dt=DT, t_end=T_END, progress=False):
            recorder.write(r)
            reports.append(r)
    return reports


def test_files_tell_levels_shapes_and_stresses(tmp_path):
    reports, twins = recorded(tmp_path / "a", rf.Reduced("half")), recorded(tmp_path / "b")
    (body,) = reports[-1].bodies
    assert body.shapes == len(body.q) == len(body.q_rate) > 3
    assert body.stored == 0 < body.strain < reports[-1].strain
    assert reports[-1].unknowns == 3 * 6 * 9 + 6 + body.shapes
    rows = table(tmp_path / "a" / "bodies.csv")
    assert {int(row["shapes"]) for row in rows} == {body.shapes}
    assert float(rows[-1]["strain"]) == body.strain
    history, of_twin = (rf.read_history(tmp_path / run / "history.csv") for run in "ab")
    assert (history["shapes"] == body.shapes).all()
    assert not of_twin["shapes"].any()
    peaks, of_twin = history["peak_half"], of_twin["peak_half"]
    assert np.abs(peaks - of_twin).max() < 5e-3 * of_twin.max()
    own, twin = (rf.read_fields(tmp_path / run) for run in "ab")
    for name in ("von_mises", "cell_von_mises"):
        assert np.abs(own[name] - twin[name]).max() < 5e-3 * twin[name].max()
    level = own["level"][-1]
    assert (level == (own.points[own.cells].mean(axis=1)[:, 0] < 0.5)).all()
    assert not own["rigid"].any()
    assert (own["body"][-1] == level).all()
    assert twins[-1].bodies == ()


LEAF = rf.StVenantKirchhoff(E=2e6, nu=0.3, rho=1000.0)


def bent(force, *effects):
    """A bar on a soft leaf that a load bends slowly; z of its tip and the reports."""
    domain = rf.box((0, 0, 0), (1.0, 0.1, 0.1), (20, 2, 2))
    domain = domain.with_cells("leaf", lambda x: (x[0] > 0.349) & (x[0] < 0.501))
    domain = domain.with_cells("rest", lambda x: (x[0] < 0.351) | (x[0] > 0.499))
    load = rf.Traction("x1", (0, 0, force), time=lambda t: np.sin(np.pi * t / 0.2) ** 2)
    effects, materials = [rf.Fixed("x0"), load, *effects], {"leaf": LEAF, "rest": SOFT}
    scene = rf.Scene(
        domain, materials, effects, probes={"tip": (1, 0.05, 0.05)}, element="enhanced"
    )
    reports = list(rf.simulate(scene, dt=5e-3, t_end=0.1, progress=False))
    return np.array([r.probes["tip"][2] for r in reports]), reports


def test_nu_is_the_error_of_the_deflection():
    """It grows with the square of displacements, and tells what the expansion is off by."""
    (z, reports), (twin, _) = bent(4000.0, rf.Reduced()), bent(4000.0)
    nu = [r.bodies[0].nu for r in reports]
    error = np.abs(z - twin).max() / np.abs(twin).max()
    assert nu == sorted(nu)
    assert 0.5 * error < nu[-1] < 2 * error


def test_a_part_that_bends_far_is_named_once_with_its_cells():
    with pytest.warns(UserWarning, match="deforms too far") as caught:
        bent(12e3, rf.Reduced())
    (text,) = (str(w.message) for w in caught if "deforms too far" in str(w.message))
    ends = [float(x) for x in re.findall(r"[(]([-\d.e]+), [^()]*[)]", text)]
    assert 0.34 < ends[0] < ends[1] < 0.51


def _found():
    """What is the same on any number of ranks."""
    with tempfile.TemporaryDirectory() as folder:
        folder = MPI.COMM_WORLD.bcast(folder)
        recorded(Path(folder), rf.Reduced("half", shapes=4))
        history = rf.read_history(Path(folder) / "history.csv")
        MPI.COMM_WORLD.barrier()
    names = ("peak_half", "stress_inside_xx", "stress_border_xx", "shapes", "nu")
    return [history[name].tolist() for name in names]


@pytest.mark.parallel
def test_results_are_the_same_on_two_ranks():
    check_the_same(__file__, 2, _found())


if __name__ == "__main__":
    report(_found())
