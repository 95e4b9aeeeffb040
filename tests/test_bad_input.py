"""Bad input: refused with the same error on every rank, and no rank is left waiting.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.errors import SceneError, StepError
from rigidfx.domain.domain import Domain, EntitySet, kept

COMM = MPI.COMM_WORLD
STEEL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)


def _box(cell="hexahedron"):
    return rf.box((0, 0, 0), (4, 1, 1), (4, 2, 2), cell)


def _run(*effects, material=STEEL, dt=0.1, t_end=0.5, **options):
    for _ in rf.simulate(rf.Scene(_box(), material, effects, **options), dt, t_end):
        pass


def _dragged(cell):
    """A mesh with one vertex dragged through its neighbours, near one end only."""
    mesh = _box(cell).mesh
    x = mesh.geometry.x
    x[np.linalg.norm(x - [1, 0.5, 0.5], axis=1) < 1e-9] += [1.7, 0.1, 0.0]
    return mesh


def _squashed():
    mesh = _box("tetrahedron").mesh
    mesh.geometry.x[:, 1] = 0.0
    return mesh


def _path(name):
    """A file that cannot be read; made by this file's own location, which all ranks agree on."""
    return Path(__file__).resolve().parent / name


def _circle(t):
    return (np.cos(t), np.sin(t), 0.0)


def _nan_on_one_rank(t):
    """A load that ceases to be finite on the last rank only."""
    last = COMM.rank == COMM.size - 1
    return (np.nan if last and t > 0.2 else 1.0, 0.0, 0.0)


def _velocity_on_one_rank(X):
    return np.full_like(X, np.inf if COMM.rank == 0 else 0.0)


EMPTY = np.empty(0, np.int32)
CUBE = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
L_POINTS = np.array([[i, j, k] for k in (0, 1) for j in (0, 1, 2) for i in (0, 1, 2)], dtype=float)
FAR = np.array([3.0, 0.0, 0.0])
HINGED = np.array([[0, 1, 3, 4, 9, 10, 12, 13], [4, 5, 7, 8, 13, 14, 16, 17]])


def _arrays(points, cells, *more):
    """`from_arrays` with everything on rank 0."""
    mine = slice(None) if COMM.rank == 0 else slice(0)
    return rf.from_arrays(np.asarray(points)[mine], np.asarray(cells)[mine], *more)


def _preloaded(domain, *loads, until=0.1):
    """Statics of a mesh that is held where x = 0."""
    domain = domain.with_facets("end", lambda x: np.abs(x[0]) < 1e-9)
    effects = [rf.Fixed("end"), rf.Preload(loads or [rf.Gravity()])]
    for _ in rf.simulate(rf.Scene(domain, STEEL, effects), 0.1, until):
        pass


# name: (what is done, error, part of its message)
def _fails_on_one_rank(value, since=-1.0):
    """A function of time (or place) that raises on the last rank only, after a while."""

    def function(t):
        if COMM.rank == COMM.size - 1 and np.max(t) > since:
            raise KeyError("lost")
        return value

    return function


CASES = {
    "unknown facets": (
        lambda: _run(rf.Traction("top", (1, 0, 0))),
        SceneError,
        "no facets named 'top'",
    ),
    "tag on no cells": (
        lambda: rf.Scene(Domain(_box().mesh, [EntitySet("core", 3, EMPTY)]), {"core": STEEL}),
        SceneError,
        "stands for no cells",
    ),
    "marker of no facets": (
        lambda: _box().with_facets("far", lambda x: x[0] > 9),
        SceneError,
        "true for no facets",
    ),
    "cell without material": (
        lambda: rf.Scene(_box().with_cells("a", lambda x: x[0] < 1.5), {"a": STEEL}),
        SceneError,
        "cells have none",
    ),
    "inverted hexahedron": (lambda: Domain(_dragged("hexahedron")), SceneError, "inverted"),
    "cells without volume": (lambda: Domain(_squashed()), SceneError, "inverted or flat"),
    "load that ceases to be finite on one rank": (
        lambda: _run(rf.Traction("x1", _nan_on_one_rank)),
        SceneError,
        "at t = 0.25 s three finite",
    ),
    "masses that overflow": (
        lambda: _run(rf.PointMass("x1", 1e308)),
        SceneError,
        "masses of the nodes add up to",
    ),
    "initial velocity that is not finite on one rank": (
        lambda: _run(rf.InitialVelocity(function=_velocity_on_one_rank)),
        SceneError,
        "not finite",
    ),
    "supports in conflict": (
        lambda: _run(rf.Fixed("x0"), rf.PrescribedMotion("x0", displacement=_circle)),
        SceneError,
        "different motions of the same nodes",
    ),
    "velocity against a support": (
        lambda: _run(rf.Fixed("x0"), rf.InitialVelocity(linear=(1, 0, 0))),
        SceneError,
        "contradicts",
    ),
    "preload without supports": (
        lambda: _run(rf.Preload([rf.Gravity()])),
        SceneError,
        "rigid motion free",
    ),
    "preload of a part that is loose": (
        lambda: _preloaded(
            _arrays(np.concatenate([CUBE, CUBE + FAR]), np.arange(16).reshape(2, 8))
        ),
        SceneError,
        "rigid motion free, of the part of 1 × 1 × 1 m around (3.5, 0.5, 0.5) m",
    ),
    "preload of a part on a hinge": (
        lambda: _preloaded(_arrays(L_POINTS, HINGED)),
        SceneError,
        "rigid motion free, of the part of 1 × 1 × 1 m around (1.5, 1.5, 0.5) m",
    ),
    "preload of a load that acts later": (
        lambda: _preloaded(_box(), rf.Gravity(since=0.2)),
        SceneError,
        "Gravity on 'all cells' does not act at t = 0",
    ),
    "preload of loads that are zero": (
        lambda: _preloaded(_box(), rf.Gravity(time=np.sin)),
        SceneError,
        "its loads are zero at t = 0",
    ),
    "probe outside": (lambda: _run(probes={"p": (9, 9, 9)}), SceneError, "lies in no cell"),
    "probes of one text": (
        lambda: _run(probes={1: (0, 0, 0), "1": (1, 1, 1)}),
        SceneError,
        "the probes 1 and '1' would have the same columns 'u_1' in history.csv",
    ),
    "missing mesh file": (
        lambda: rf.read_msh(_path("nothing.msh")),
        SceneError,
        "There is no mesh file",
    ),
    "unreadable mesh file": (lambda: rf.read_msh(_path("conftest.py")), SceneError, "conftest.py"),
    "load that fails on one rank": (
        lambda: _run(rf.Gravity(_fails_on_one_rank((0, 0, 1), since=0.2))),
        SceneError,
        "failed at t = 0.25 s with KeyError",
    ),
    "path that fails on one rank": (
        lambda: _run(
            rf.PrescribedMotion("x0", displacement=_fails_on_one_rank((0, 0, 0), since=0.25))
        ),
        SceneError,
        "path failed near t = 0.3 s",
    ),
    "marker that fails on one rank": (
        lambda: _box().with_cells("some", lambda x: _fails_on_one_rank(x[0] < 2)(x)),
        SceneError,
        "The marker of 'some' failed",
    ),
    "energy without its parameters": (
        lambda: _run(material=rf.Hyperelastic(rho=1.0, W=lambda C, mu: mu * C[0, 0])),
        SceneError,
        "cannot be formed",
    ),
    "step that never converges": (
        lambda: _run(rf.Fixed("x0"), rf.Traction("x1", (1e20, 0, 0), since=0.25)),
        StepError,
        "The largest residual is at the node X = (",
    ),
}


@pytest.mark.filterwarnings("ignore:.*as a door about its hinge")
@pytest.mark.parametrize("name", CASES)
def test_is_refused(name):
    """Each with its own error and a message that says what is wrong."""
    action, error, message = CASES[name]
    refusals.check(action, message, error)


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    """The same cases on two ranks: the same message on both, and no rank waits for the other."""
    found = dict(refusals.found_on_two_ranks(__file__))
    assert found.keys() == CASES.keys()
    for name, (_, error, message) in CASES.items():
        assert found[name][0] == error.__name__, (name, found[name])
        assert message in found[name][1]


DROPPED = """
import rigidfx as rf
from rigidfx.flexible.stress import CauchyStress
from rigidfx.state import State

material = rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1.0)


def box():
    return rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1))


for line in (
    "rf.Recorder(rf.Scene(box(), material), 'out', evry=1)",
    "print(State(rf.Scene(box(), material)), on=1)",
    "print(CauchyStress(rf.Scene(box(), material)), on=1)",
    "print(next(rf.simulate(rf.Scene(box(), material), 0.1, 1.0)), on=1)",
):
    try:
        exec(line)
    except TypeError:
        continue
rf.Scene(box(), material, [rf.Rigid(3)])
"""


def test_error_while_a_mesh_is_dropped():
    """A process ends where an error meets a mesh that has no name; mpi4py 4.0 kept a lock."""
    words = [sys.executable, "-c", DROPPED]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "SceneError: Rigid: where must be" in done.stderr
    assert "SystemError" not in done.stderr


def test_meshes_go_when_nothing_is_left_of_them():
    gc.collect()
    _box()
    before = kept()
    for _ in range(3):
        _run(rf.Gravity())
    gc.collect()
    _box()
    assert kept() == before


if __name__ == "__main__":
    refusals.on_each_rank({name: action for name, (action, _, _) in CASES.items()})
