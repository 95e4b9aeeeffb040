"""Curved cells that the geometry would turn inside out: gmsh's optimiser ended Python over them."""

import numpy as np
import pytest
from cad import session
from mpi4py import MPI

import rigidfx as rf
from rigidfx.domain.cell_quality import volume

pytest.importorskip("gmsh")
alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")


@alone
def test_a_thin_shell(tmp_path):
    """Edges through the wall follow its two faces; only few of the cells have to be straighter."""
    path = tmp_path / "shell.step"
    with session() as gmsh:
        occ = gmsh.model.occ
        occ.cut([(3, occ.addSphere(0, 0, 0, 30))], [(3, occ.addSphere(0, 0, 0, 29))])  # mm
        occ.synchronize()
        gmsh.write(str(path))
        gmsh.model.add("torus")
        occ.addTorus(0, 0, 0, 40, 4)
        occ.synchronize()
        gmsh.write(str(tmp_path / "torus.step"))
    with pytest.warns(rf.RigidfxWarning, match=r": 1?\d of \d{3} cells would be inside out"):
        shell = rf.read_cad(path, size=0.012, order=2)
    assert volume(shell.mesh) == pytest.approx(4 / 3 * np.pi * (30**3 - 29**3) * 1e-9, rel=5e-3)
    with pytest.raises(rf.SceneError, match=r"gmsh finds no mesh: .*per_circle=24"):
        rf.read_cad(tmp_path / "torus.step", size=0.02)


SCRIPT = """
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {0, 1, 0};
Point(4) = {1.43, 0, 0}; Point(5) = {0, 1.43, 0};
Circle(1) = {2, 1, 3}; Line(2) = {3, 5}; Line(3) = {5, 4}; Line(4) = {4, 2};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Transfinite Curve{1, 2, 3, 4} = 2; Transfinite Surface{1};
out[] = Extrude {0, 0, 1} { Surface{1}; Layers{1}; };
Physical Volume("body") = {out[1]};
"""


@alone
@pytest.mark.parametrize(("hexahedra", "share"), [(False, 1 / 8), (True, 1 / 2)])
def test_a_quarter_of_a_hole_near_to_a_side(tmp_path, hexahedra, share):
    """One edge goes around it: of tetrahedra, and of a brick. A share of the arc's height is left.

    The brick's det J is positive on the arc, but 0.02 of its mean.
    """
    script = SCRIPT.replace("Layers{1};", "Layers{1}; Recombine;") if hexahedra else SCRIPT
    script += "Recombine Surface{1};" * hexahedra
    (tmp_path / "hole.geo").write_text(script)
    with pytest.warns(rf.RigidfxWarning, match=r"read_geo: .*would be inside out.*\(size"):
        part = rf.read_geo(tmp_path / "hole.geo", order=2)
    middle = np.hypot(*part.mesh.geometry.x[:, :2].T)
    chord = np.sqrt(0.5)
    assert np.sort(middle)[:2] == pytest.approx([chord + share * (1 - chord)] * 2)
