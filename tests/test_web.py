"""A run as one HTML file: what a browser reads in it is what the recorder has written."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.plot import web

pytest.importorskip("pyvista")
pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="one rank is enough")


def record(folder, order=1, cell="hexahedron", **how):
    """Four steps of a turning bar, a third of which is rigid."""
    bar = rf.box((0, 0, 0), (3, 1, 1), (3, 1, 1), cell)
    bar = bar.with_cells("head", lambda x: x[0] < 1 + 1e-9)
    effects = [rf.InitialVelocity(angular=(0.2, 1.0, 0.1)), rf.Rigid("head")]
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    mass = "consistent" if cell == "tetrahedron" else "lumped"
    scene = rf.Scene(bar, material, effects, order=order, mass=mass)
    with rf.Recorder(scene, folder, every=1, **how) as recorder:
        for report in rf.simulate(scene, 0.1, 0.4, progress=False):
            recorder.write(report)


def parts(path):
    """Text of the file, its description and its arrays, as a browser reads them."""
    text = path.read_text(encoding="utf-8")
    about, data = (
        re.search(rf'<script type="[\w/]+" id="{name}">(.*?)</script>', text, re.S)[1]
        for name in ("about", "data")
    )
    about, raw = json.loads(about), zlib.decompress(base64.b64decode(data))
    arrays, start = {}, 0
    for of in about["arrays"]:
        array = np.frombuffer(raw, of["kind"], of["length"], start)
        assert start % array.itemsize == 0  # or JavaScript refuses it
        arrays[of["name"]], start = array, start + array.nbytes
    assert start == len(raw)
    return text, about, arrays


def volume(corners):
    """Of a closed surface of triangles, shape (triangles, 3, 3); 0 for one that is open."""
    a, b, c = np.moveaxis(corners, 1, 0)
    assert np.abs(np.cross(b - a, c - a).sum(axis=0)).max() < 1e-5
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_file_has_motion_levels_and_stresses(tmp_path):
    record(tmp_path, stress=True)
    path = web(tmp_path, title="a <b> & c")
    assert path == tmp_path / "motion.html"
    text, about, arrays = parts(path)
    assert "<title>a &lt;b&gt; &amp; c</title>" in text
    assert not re.search(r"\{\{|https?:|\bsrc=|\bimport\b", text)  # it is whole, and offline
    fields, times = rf.read_fields(tmp_path), len(about["times"])
    assert about["times"] == fields.times.tolist()
    X, triangles = arrays["points"].reshape(-1, 3), arrays["triangles"].reshape(-1, 3)
    assert volume(X[triangles]) == pytest.approx(3.0, rel=1e-6)
    motion = about["step"] * arrays["motion"].reshape(times, -1, 3)
    node = [int(np.linalg.norm(fields.points - x, axis=1).argmin()) for x in X]
    assert np.abs(motion - fields["displacement"][:, node]).max() <= 0.5001 * about["step"]
    assert about["step"] < 1e-4 * np.abs(motion).max()

    of = {field["name"]: field for field in about["fields"]}
    assert list(of) == ["level", "displacement", "velocity", "von_mises", "cell_von_mises"]
    assert of["level"]["labels"] == ["flexible", "reduced", "rigid"]
    level = arrays["level"].reshape(times, -1) / 65535 * 2
    assert level[-1, arrays["owners"]].tolist() == pytest.approx(
        [2.0 * (X[t].max(axis=0)[0] < 1.01) for t in triangles]
    )
    stress = arrays["von_mises"].reshape(times, -1) / 65535 * of["von_mises"]["top"]
    factor = {"Pa": 1.0, "kPa": 1e-3}[of["von_mises"]["unit"]]
    assert stress == pytest.approx(factor * fields["von_mises"][:, node], abs=stress.max() / 65535)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_second_order_surfaces_have_all_of_their_nodes(tmp_path, cell):
    record(tmp_path, order=2, cell=cell)
    _, about, arrays = parts(web(tmp_path, frames=2, scale="auto"))
    assert about["times"] == pytest.approx([0.0, 0.4])
    X, triangles = arrays["points"].reshape(-1, 3), arrays["triangles"].reshape(-1, 3)
    assert len(X) == 7 * 3 * 3 - 5  # all but the five within the bar
    assert volume(X[triangles]) == pytest.approx(3.0, rel=1e-6)
    edges = X[arrays["lines"].reshape(-1, 2)]  # of the box
    assert np.linalg.norm(np.ptp(edges, axis=1), axis=1).sum() == pytest.approx(20.0, rel=1e-6)
