"""Bodies written to a file, and a run that begins with them.

Run as a script under mpirun, this file writes the bodies it finds to a path, begins a run with them
and reports their cells and what the run ends with.
"""

import json
import sys
from pathlib import Path

import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf

COMM = MPI.COMM_WORLD
MATERIAL = rf.StVenantKirchhoff(E=300.0, nu=0.3, rho=2.0)

pytestmark = pytest.mark.skipif(COMM.size > 1, reason="starts its own mpirun")


def bar():
    return rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1)).with_cells("end", lambda x: x[0] >= 6 - 1e-9)


def scene(domain, *effects):
    return rf.Scene(domain, MATERIAL, [rf.Traction("x1", (0.0, 0.1, 0.0)), *effects])


def found(path):
    """A run at whose first window all but the end becomes rigid."""
    problem = scene(bar())
    criterion = rf.StrainRate(1e9, 0.4, never="end", wake="none")
    reports = list(rf.simulate(problem, 0.1, 2.0, rigidify=criterion))
    rf.write_bodies(path, problem, reports[-1])
    return reports


def test_the_file_says_what_the_bodies_are(tmp_path):
    report = found(tmp_path / "deep" / "bodies.json")[-1]
    content = json.loads((tmp_path / "deep" / "bodies.json").read_text())
    assert content["t"] == report.t
    assert content["cells"] == 8
    (body,) = content["bodies"]
    assert body["mass"] == pytest.approx(2.0 * 6.5, rel=1e-14)  # lumped: half a cell at the face
    assert sorted(body["cells"]) == body["cells"]
    assert len(body["cells"]) == 6
    assert np.allclose(np.asarray(body["interface_nodes"])[:, 0], 6.0)
    assert len(body["interface_nodes"]) == 4
    assert np.allclose(body["centre"], report.bodies[0].centre)
    assert np.linalg.eigvalsh(body["inertia"])[0] > 0


def test_a_run_from_the_file_equals_one_with_the_set_named(tmp_path):
    found(tmp_path / "bodies.json")
    domain, rigid = rf.read_bodies(tmp_path / "bodies.json", bar())
    named = bar().with_cells("rest", lambda x: x[0] <= 6 + 1e-9)
    runs = [
        [r.energy for r in rf.simulate(problem, 0.1, 1.0)]
        for problem in (scene(domain, *rigid), scene(named, rf.Rigid("rest")))
    ]
    assert runs[0] == pytest.approx(runs[1], rel=1e-12)


def test_interface_nodes_can_be_placed(tmp_path):
    """In the reference shape, and where the body has taken them."""
    thrown = rf.InitialVelocity(linear=(0.5, 0.0, 0.0), angular=(0.2, 0.5, 1.0))
    problem = scene(bar(), rf.Rigid("end"), thrown)
    *_, last = rf.simulate(problem, 0.1, 1.0)
    rf.write_bodies(tmp_path / "bodies.json", problem, last)
    (body,) = json.loads((tmp_path / "bodies.json").read_text())["bodies"]
    nodes, offsets = (np.array(body[f"interface_{of}"]) for of in ("nodes", "offsets"))
    now = body["centre"] + offsets @ np.transpose(body["orientation"])
    X, u = last.state.X, last.state.u.x.array.reshape(-1, 3)
    for reference, position in zip(nodes, now, strict=True):
        k = np.argmin(np.linalg.norm(X - reference, axis=1))
        assert np.allclose(X[k] + u[k], position, atol=1e-12)
    assert np.linalg.norm(now - nodes, axis=1).min() > 0.3


def test_given_masses_come_back(tmp_path):
    """Though the body has turned: the inertia is that of its own frame."""
    inertia = np.diag([3.0, 4.0, 5.0])
    turning = rf.InitialVelocity(angular=(0.0, 0.0, 1.0))
    problem = scene(bar(), rf.Rigid("end", mass=99.0, inertia=inertia), turning)
    *_, last = rf.simulate(problem, 0.1, 0.7)
    rf.write_bodies(tmp_path / "bodies.json", problem, last)
    _, (rigid,) = rf.read_bodies(tmp_path / "bodies.json", bar())
    assert rigid.mass == 99.0
    assert np.allclose(rigid.inertia, inertia, atol=1e-12)


def test_names_stand_for_what_they_stood_for(tmp_path):
    """A part may be found again, and a set of the user's stays what it is."""
    found(tmp_path / "bodies.json")
    content = json.loads((tmp_path / "bodies.json").read_text())
    content["bodies"][0]["name"] = "end"
    (tmp_path / "grown.json").write_text(json.dumps(content))
    domain, (grown,) = rf.read_bodies(tmp_path / "grown.json", bar())
    assert grown.where == "end found"
    assert domain.sets["end", 3].entities.size == 2
    domain, (part,) = rf.read_bodies(tmp_path / "bodies.json", bar())
    assert part.where == "body 1"
    problem = scene(domain, part)
    *_, last = rf.simulate(problem, 0.1, 0.1)
    rf.write_bodies(tmp_path / "again.json", problem, last)
    assert rf.read_bodies(tmp_path / "again.json", bar())[1][0].where == "body 1"


def read_again(path):
    """Cells of the body that a file names, and the energy at the end of a run begun with it."""
    found(path)
    domain, rigid = rf.read_bodies(path, bar())
    reports = list(rf.simulate(scene(domain, *rigid), 0.1, 1.0))
    content = json.loads(path.read_text())
    return {"cells": content["bodies"][0]["cells"], "energy": reports[-1].energy}


@pytest.mark.parallel
def test_ranks_write_and_read_the_same_file(tmp_path):
    alone = read_again(tmp_path / "alone.json")
    together = parallel.run(__file__, 2, 600, str(tmp_path / "together.json"))
    assert together["cells"] == alone["cells"]
    assert together["energy"] == pytest.approx(alone["energy"], rel=1e-9)


if __name__ == "__main__":
    parallel.report(read_again(Path(sys.argv[1])))
