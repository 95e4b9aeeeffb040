"""Bodies written to a file, and a run that begins with them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf

COMM = MPI.COMM_WORLD
MATERIAL = rf.StVenantKirchhoff(E=300.0, nu=0.3, rho=2.0)

pytestmark = pytest.mark.skipif(COMM.size > 1, reason="serial; the frame's demo runs on 2 ranks")


def bar():
    return rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1)).with_cells("end", lambda x: x[0] >= 6 - 1e-9)


def scene(domain, *effects):
    return rf.Scene(domain, MATERIAL, [rf.Traction("x1", (0.0, 0.1, 0.0)), *effects])


def found(path):
    """A run at whose first window all but the end becomes rigid."""
    problem = scene(bar())
    criterion = rf.StrainRate(1e9, 0.4, never="end")
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
    assert runs[0] == runs[1]


def test_other_files_and_other_meshes_are_refused(tmp_path):
    path = tmp_path / "bodies.json"
    with pytest.raises(rf.SceneError, match="cannot be read"):
        rf.read_bodies(path, bar())
    path.write_text("{}")
    with pytest.raises(rf.SceneError, match="write_bodies"):
        rf.read_bodies(path, bar())
    found(path)
    with pytest.raises(rf.SceneError, match="8 cells, this one has 4"):
        rf.read_bodies(path, rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)))
