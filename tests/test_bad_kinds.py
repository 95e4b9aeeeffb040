"""Input of the wrong kind or shape: refused by name, where it used to be cast into something else.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import refusals
import ufl
from dolfinx import fem
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.errors import SceneError

COMM = MPI.COMM_WORLD
SOFT = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
CUBE = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
ONE = np.arange(8)[None]
TETS = np.array([[0, 1, 3, 7], [0, 1, 5, 7]])


def _box():
    return rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))


def _scene(*effects, material=SOFT, domain=None, **options):
    return rf.Scene(domain or _box(), material, effects, **options)


def _run(*effects, **options):
    for _ in rf.simulate(_scene(*effects, **options), 0.1, 0.3):
        pass


def _arrays(points, cells, *more):
    mine = slice(None) if COMM.rank == 0 else slice(0)
    return rf.from_arrays(points[mine], cells[mine], *more)


def _moved(displacement, velocity=None, **window):
    return rf.PrescribedMotion("x0", displacement=displacement, velocity=velocity, **window)


def _path(t):
    return (0.1 * t, 0.0, 0.0)


def _speed(t):
    return (0.1, 0.0, 0.0)


def _kinked(t):
    return (max(t - 0.2, 0.0), 0.0, 0.0)


_kinked.breakpoints = (0.2,)


def _own(values):
    return rf.Hyperelastic(rho=1.0, W=lambda C, mu: C[0, 0] * mu, values=values)


def _later(wrong):
    """A path that is sound at first."""
    return _moved(lambda t: wrong if t > 0.15 else (0.0, 0.0, 0.0))


def _breaking(breakpoints):
    def factor(t):
        return 1.0

    factor.breakpoints = breakpoints
    return rf.Gravity(time=factor)


# name: (what is done, part of the message)
CASES = {
    # Sets of cells
    "boolean mask as cells": (
        lambda: _box().with_cell_set("a", np.array([True, False])),
        "whole numbers, got bool of shape (2,). Of a mask, take np.flatnonzero",
    ),
    "cells beyond 32 bits": (lambda: _box().with_cell_set("a", [2**32]), "no cell 4294967296"),
    # Markers
    "marker of whole numbers": (
        lambda: _box().with_cells("a", lambda x: (x[0] < 2).astype(int)),
        "The marker of 'a' must give a boolean for each point",
    ),
    # Arrays
    "points in a plane": (
        lambda: _arrays(CUBE[:, :2], ONE),
        "points must be real numbers of shape",
    ),
    "point that is not finite": (lambda: _arrays(CUBE + np.inf, ONE), "points must be finite"),
    "points that are masked": (
        lambda: _arrays(np.ma.masked_equal(CUBE, 1.0), ONE),
        "from_arrays: some of the points are masked",
    ),
    "tetrahedra of eight corners": (lambda: _arrays(CUBE, ONE, "tetrahedron"), "(n, 4)"),
    "a cell twice": (lambda: _arrays(CUBE, np.repeat(ONE, 2, axis=0)), "cell 0 is there 2 times"),
    "a cell twice in another order": (
        lambda: _arrays(CUBE, np.vstack([TETS, TETS[:1, [1, 3, 0, 2]]]), "tetrahedron"),
        "cell 0 is there 2 times",
    ),
    "no cells": (lambda: _arrays(CUBE, ONE[:0]), "there are no cells"),
    "kind of cell that is a list": (lambda: _arrays(CUBE, ONE, ["hexahedron"]), "cell must be"),
    # What functions give
    "pressure that is a text": (lambda: _run(rf.Pressure("x1", lambda t: "1")), "it is nan"),
    "initial velocity of texts": (
        lambda: _run(rf.InitialVelocity(function=lambda X: X.astype(str))),
        "it gives no real numbers",
    ),
    "load function that is complex": (
        lambda: _run(rf.Gravity(lambda t: (0, 0, 1j))),
        "three finite components are expected, got what is no array of real numbers",
    ),
    "path that later gives two numbers": (
        lambda: _run(_later((0.1, 0.2))),
        "its path or velocity is not three finite numbers but [0.1 0.2]",
    ),
    "breakpoints that are no list": (lambda: _breaking(0.5), "breakpoints of time must be a list"),
    # Numbers
    "parameters in a list": (lambda: _own([("mu", 3)]), "values must be a dict of names"),
    "probes in a dict": (
        lambda: rf.StepControl(0.1, at={"tip": 2.0}, largest=0.1),
        "at must be names of probes, got {'tip': 2.0}",
    ),
    "masked cells": (
        lambda: _box().with_cell_set("a", np.ma.array([0, 1], mask=[0, 1])),
        "Some are masked; take compressed()",
    ),
    # Motions
    "velocity of another path": (
        lambda: _scene(_moved(_path, lambda t: (0.2, 0, 0))),
        "at t = 0 s its velocity is [0.2 0.  0. ] m/s, and its path moves by [0.1",
    ),
    "velocity that is late for its kink": (
        lambda: _scene(_moved(_kinked, lambda t: (1.0 if t > 0.2 else 0.0, 0, 0))),
        "at t = 0.2 s its velocity is",
    ),
    # Names
    "rigid part called like a found one": (
        lambda: _scene(
            rf.Rigid("part 2"), domain=_box().with_cells("part 2", lambda x: x[0] < 1.5)
        ),
        "'part 2' is what a part that is found is called",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_is_refused(name):
    action, message = CASES[name]
    with pytest.raises(SceneError) as caught:
        action()
    assert message in str(caught.value)


def _ten_nodes():
    """Two tetrahedra of ten nodes, with their edges' in VTK's order; one edge is curved."""
    corners = [*CUBE[[0, 1, 2, 4]], (1, 1, 1)]
    points, cells, number = list(map(np.asarray, corners)), [], {}
    for cell in ((0, 1, 2, 3), (1, 2, 3, 4)):
        row = list(cell)
        for i, j in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)):
            edge = frozenset((cell[i], cell[j]))
            if edge not in number:
                number[edge] = len(points)
                points.append((points[cell[i]] + points[cell[j]]) / 2)
            row.append(number[edge])
        cells.append(row)
    points[cells[0][4]] = points[cells[0][4]] + (0, -0.1, 0)
    return np.array(points, float), np.array(cells)


def test_order_of_nodes_on_edges():
    """Those of VTK and of gmsh are taken, and any other: nodes tell by their places."""
    points, cells = _ten_nodes()
    for order in (list(range(10)), [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]):
        mesh = _arrays(points, cells[:, order], "tetrahedron").mesh
        volume = mesh.comm.allreduce(fem.assemble_scalar(fem.form(1.0 * ufl.dx(mesh))))
        assert volume == pytest.approx(0.5 + 0.1 / 6)  # 1/6 and 1/3, and what the curved edge adds


def test_what_is_right_is_taken():
    """Neighbours of the cases above that are sound."""
    assert _box().with_cell_set("a", np.array([0], dtype=np.uint8)).sets["a", 3].entities.size == 1
    rf.from_arrays(CUBE.astype(np.float32), ONE.astype(np.uint16))
    rf.from_arrays(CUBE.astype(int).tolist(), ONE.tolist())
    rf.from_arrays(CUBE, TETS, "tetrahedron")
    _scene(_moved(_path, _speed))
    _scene(_moved(_path, _speed), rf.PrescribedMotion("y0", displacement=_path, velocity=_speed))
    _scene(_moved(_kinked, lambda t: (1.0 if t >= 0.2 else 0.0, 0, 0)))
    fast = 2 * np.pi * 3e4  # a path of 30 kHz
    _scene(
        _moved(
            lambda t: (1e-6 * np.sin(fast * t), 0, 0),
            lambda t: (1e-6 * fast * np.cos(fast * t), 0, 0),
        )
    )
    _run(rf.Gravity(lambda t: [0, 0, np.float32(-1)], time=lambda t: np.array(0.5)))
    assert rf.Traction("x1", (Fraction(1, 2), 1, 2)).intensity(0.0).tolist() == [0.5, 1, 2]
    assert rf.Gravity((0, 0, 1), time=lambda t: t < 1).intensity(0.5)[2] == 1.0  # a switch
    whole = np.ma.array([1.0, 2, 3])
    assert rf.Traction("x1", whole).intensity(0.0).tolist() == [1, 2, 3]
    assert rf.Gravity(time=np.poly1d([2.0, 1.0])).intensity(1.0)[2] == pytest.approx(-3 * 9.81)


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    """The same cases on two ranks: the same message on both, and no rank waits for the other."""
    refusals.check_on_two_ranks(__file__, CASES)


if __name__ == "__main__":
    refusals.on_each_rank({name: action for name, (action, _) in CASES.items()})
