"""Shapes of reduced parts: static responses, Ritz vectors, shapes, on one rank and on several."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from parallel import report as tell
from parallel import run as mpirun
from scipy.linalg import eigh

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.shapes.part import Part
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.ritz import ritz
from rigidfx.state import State

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=8000.0)
EPS = float(np.finfo(np.float64).eps)


class Built:
    """A block with all that shapes of it take; `destroy` frees it."""

    def __init__(self, *effects, n=(4, 2, 2), t=0.0, size=(1.0, 0.5, 0.4), cells=None, **how):
        self.scene = rf.Scene(rf.box((0, 0, 0), size, n), STEEL, effects, **how)
        self.state = State(self.scene)
        self.forces = InternalForces(self.scene, self.state.u)
        acting = self.scene.acting(t)
        self.responses = Responses(self.scene, self.forces, self.state, acting)
        self.X = self.scene.space.tabulate_dof_coordinates()[: self.scene.owned_nodes]
        own = np.arange(self.scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        nodes = np.arange(len(self.X), dtype=np.int32)
        self.part = Part(self.responses, self.forces.cells(own), nodes, "block")
        self.ends = np.array(size)

    def pushed(self):
        """Three unit forces on the far corner, shape (owned nodes, 3, 3)."""
        F = np.zeros((len(self.X), 3, 3))
        F[np.abs(self.X - self.ends).max(axis=1) < 1e-9] = np.eye(3)
        return F

    def dense(self, what):
        """The matrix of a linear map of all nodes' vectors; one rank only."""
        n = self.X.size
        return what(np.eye(n).reshape(-1, 3, n)).reshape(n, n)

    def motions(self):
        """The six rigid motions, shape (owned nodes, 3, 6)."""
        R = np.zeros((*self.X.shape, 6))
        R[:, :, :3] = np.eye(3)
        R[:, :, 3:] = np.cross(np.eye(3)[:, None], self.X).transpose(1, 2, 0)
        return R

    def destroy(self):
        self.part.destroy()
        self.responses.destroy()


@pytest.fixture(params=["free", "clamped", "rolling", "second", "consistent"])
def built(request):
    effects = {"clamped": [rf.Fixed("x0")], "rolling": [rf.Fixed("x0", components="x")]}
    how = {"second": {"order": 2, "n": (2, 1, 1)}, "consistent": {"mass": "consistent"}}
    made = Built(*effects.get(request.param, []), **how.get(request.param, {}))
    yield made
    made.destroy()


def test_responses_are_those_of_dense_matrices(built):
    """K⁺ in the metric of the mass: by all elastic modes, which LAPACK finds."""
    r, held = built.responses, built.responses.stiffness.held
    K, M = built.dense(built.part.times_stiffness), built.dense(r.inertia)
    K, M = (0.5 * (A + A.T)[np.ix_(~held, ~held)] for A in (K, M))
    squares, modes = eigh(K, M)
    elastic = squares > 1e-9 * squares[-1]
    assert elastic.size - elastic.sum() == r.motions.shape[2]
    F = built.pushed()
    f = F.reshape(-1, 3)[~held]
    exact = modes[:, elastic] @ ((modes[:, elastic].T @ f) / squares[elastic, None])
    found = r.solve(F).reshape(-1, 3)
    assert (found[held] == 0).all()
    np.testing.assert_allclose(found[~held], exact, atol=1e-10 * np.abs(exact).max())


def test_shapes_hold_the_loads_responses(built):
    """With the whole as the part: deflections under each load to 1e-10, Ω diagonal, no motion."""
    r, F = built.responses, built.pushed()
    vectors = ritz(r, F, 2)
    np.testing.assert_allclose(r.dot(vectors, r.inertia(vectors)), np.eye(6), atol=100 * EPS)
    shapes = built.part.shapes(vectors)
    Phi, Omega = shapes.modes, shapes.stiffness
    assert Phi.shape[2] == 6
    np.testing.assert_allclose(np.linalg.norm(Phi, axis=1).max(axis=0), 1, atol=100 * EPS)
    K = r.dot(Phi, built.part.times_stiffness(Phi))
    scale = np.sqrt(np.outer(np.diag(K), np.diag(K)))
    assert np.abs((K - Omega) / scale).max() < 1e-10
    squares = np.diag(Omega) / np.diag(r.dot(Phi, r.inertia(Phi)))
    assert (np.diff(squares) > 0).all()
    momenta = r.dot(r.motions, r.inertia(Phi))
    assert np.abs(momenta).max(initial=0.0) < 1e-12 * np.sqrt(r.dot(Phi, r.inertia(Phi)).max())
    deflections = Phi @ np.linalg.solve(Omega, r.dot(Phi, F))
    exact = r.solve(F)
    assert np.abs(deflections - exact).max() < 1e-10 * np.abs(exact).max()


def test_vectors_come_in_the_order_of_their_loads():
    """Responses to all loads first; the second ones are those to the first ones' inertia."""
    made = Built(rf.Fixed("x0"))
    r, F = made.responses, made.pushed()
    vectors = ritz(r, F, 2)
    for some, among in ((r.solve(F), 3), (r.solve(r.inertia(vectors[:, :, :3])), 6)):
        left = some - vectors[:, :, :among] @ r.dot(r.inertia(vectors[:, :, :among]), some)
        assert np.abs(left).max() < 1e-10 * np.abs(some).max()
    assert ritz(r, np.concatenate([F, F @ np.ones((3, 1))], axis=2), 1).shape[2] == 3
    made.destroy()


def found():
    made = Built(n=(5, 2, 2))
    r, F = made.responses, made.pushed()
    u, vectors = r.solve(F), ritz(r, F, 4)
    shapes = made.part.shapes(vectors)
    g = r.dot(F, shapes.modes)
    held = g @ np.linalg.solve(shapes.stiffness, g.T)
    rows = [
        r.dot(F, u).tolist(),
        held.tolist(),
        np.diag(shapes.stiffness)[:9].reshape(3, 3).tolist(),
    ]
    made.destroy()
    return rows


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks(ranks):
    alone = found()
    for one, other in zip(alone, mpirun(__file__, ranks, 300), strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-9 * np.abs(one).max())


if __name__ == "__main__":
    rows = found()
    if MPI.COMM_WORLD.rank == 0:
        tell(rows)
