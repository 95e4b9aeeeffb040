"""Curved cells that the geometry would turn inside out: gmsh's optimiser ended Python over them."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.domain.cell_quality import volume

gmsh = pytest.importorskip("gmsh")
alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")


def bracket(gmsh, spline=0.006):
    """Add an extruded bracket with an elliptical fillet inside and a small spline edge [m]."""
    occ = gmsh.model.occ
    long, high, thick, wide = 0.15, 0.12, 0.02, 0.04
    half_axes = 0.03, 0.012

    def at(x, z):
        return occ.addPoint(x, 0, z)

    corners = [at(0, 0), at(long, 0), at(long, thick - spline)]
    through = [at(long - 0.15 * spline, thick - 0.3 * spline)]
    through.append(at(long - 0.6 * spline, thick - 0.2 * spline))
    end = at(long - spline, thick)
    centre = at(thick + half_axes[0], thick + half_axes[1])
    low, up = at(thick + half_axes[0], thick), at(thick, thick + half_axes[1])
    top = [at(thick, high), at(0, high)]
    edges = [
        occ.addLine(corners[0], corners[1]),
        occ.addLine(corners[1], corners[2]),
        occ.addSpline([corners[2], *through, end]),
        occ.addLine(end, low),
        occ.addEllipseArc(up, centre, up, low),
        occ.addLine(up, top[0]),
        occ.addLine(top[0], top[1]),
        occ.addLine(top[1], corners[0]),
    ]
    face = occ.addPlaneSurface([occ.addCurveLoop(edges)])
    occ.extrude([(2, face)], 0, wide, 0)
    occ.remove([(0, centre)])
    occ.synchronize()


@alone
def test_a_bracket_with_a_small_spline_edge(tmp_path):
    """It ended Python by SIGABRT. Few cells are straighter now; more cells leave none of them."""
    path = tmp_path / "bracket.step"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        bracket(gmsh)
        gmsh.write(str(path))
    finally:
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
        gmsh.finalize()
    exact = rf.list_cad(path).volumes[0].measure
    told = r"(\d+) of (\d+) cells would be inside out.*by up to (\S+) m, .*\(size; .*per_circle=24"
    with pytest.warns(rf.RigidfxWarning, match=told) as warned:
        part = rf.read_cad(path, size=0.02, order=2)
    bad, cells, off = map(float, re.search(told, str(warned[0].message)).groups())
    assert 0 < bad < 0.02 * cells
    assert off == pytest.approx(0.0012, rel=0.1)
    assert volume(part.mesh) == pytest.approx(exact, rel=5e-4)
    x = part.mesh.geometry.x
    fillet = (x[:, 0] > 0.02 + 1e-6) & (x[:, 0] < 0.05 - 1e-6) & (x[:, 2] > 0.02 + 1e-6)
    ellipse = ((x[fillet, 0] - 0.05) / 0.03) ** 2 + ((x[fillet, 2] - 0.032) / 0.012) ** 2
    assert np.count_nonzero(abs(ellipse - 1) < 1e-6) > 4  # sound cells are as curved as before
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        near = rf.read_cad(path, size=0.02, order=2, per_circle=24)
    assert volume(near.mesh) == pytest.approx(exact, rel=1e-6)


@alone
def test_a_thin_shell(tmp_path):
    """Edges through the wall follow its two faces; only few of the cells have to be straighter."""
    path = tmp_path / "shell.step"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        occ.cut([(3, occ.addSphere(0, 0, 0, 30))], [(3, occ.addSphere(0, 0, 0, 29))])  # mm
        occ.synchronize()
        gmsh.write(str(path))
        gmsh.model.add("torus")
        occ.addTorus(0, 0, 0, 40, 4)
        occ.synchronize()
        gmsh.write(str(tmp_path / "torus.step"))
    finally:
        gmsh.finalize()
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
