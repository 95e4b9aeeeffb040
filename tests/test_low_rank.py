"""A kept tangent follows contacts: the correction against a dense solve, and what it saves."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.step.newton.low_rank import LowRank

SIZE = 30  # unknowns: nine vectors of three, and three of nodes that are held in part


@pytest.fixture
def kept():
    """A definite tangent of vectors that turn, and the correction."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(SIZE, SIZE))
    A = A @ A.T + SIZE * np.eye(SIZE)

    def unknowns():
        return PETSc.Vec().createSeq(SIZE, comm=MPI.COMM_SELF)

    def solve(r, z):
        z.array[:] = np.linalg.solve(A, r.array_r)

    given = SimpleNamespace(comm=MPI.COMM_SELF, unknowns=unknowns, first_column=0, owned=SIZE)
    starts = np.r_[0:12:3, 15:30:3].astype(np.int32)  # 12, 13 and 14 are no vector
    low = LowRank(given, starts)
    Q = Rotation.random(starts.size, rng=rng).as_matrix()
    yield rng, A, low, solve, starts, Q
    low.destroy()


def pressed(rng, *nodes):
    """Stiffness of nodes that a plane presses, each in a direction of its own."""
    K = np.zeros((SIZE, SIZE))
    for node in nodes:
        n = rng.normal(size=3)
        at = slice(3 * node, 3 * node + 3)
        K[at, at] = np.outer(n, n)
    return csr_array(K)


def test_the_correction_is_the_inverse_of_the_changed_tangent(kept):
    """Contacts that close, open and turn, one of them at a node without a frame."""
    rng, A, low, solve, starts, Q = kept
    turned = np.eye(SIZE)
    for start, R in zip(starts, Q, strict=True):
        turned[start : start + 3, start : start + 3] = R
    then, r, z = pressed(rng, 1, 4), PETSc.Vec().createSeq(SIZE), PETSc.Vec().createSeq(SIZE)
    low.renewed(then)
    for now, factor, rotation in (
        (then + pressed(rng, 7), 1.0, None),
        (pressed(rng, 7, 4), 0.8, Q),
        (pressed(rng, 2), 1.0, Q),
    ):
        assert low.follow(csr_array(now), rotation, factor, 20, solve)
        T = np.eye(SIZE) if rotation is None else turned
        r.array[:] = rng.normal(size=SIZE)
        solve(r, z)
        low.mend(z)
        exact = np.linalg.solve(A + factor * T.T @ now @ T - then, r.array_r)
        assert np.allclose(z.array_r, exact, rtol=0, atol=2e-2 * np.abs(exact).max())
    r.destroy()
    z.destroy()


def test_a_corner_that_comes_and_goes_takes_few_tangents(monkeypatch):
    """Two thirds of those without the correction, or less, and the same motion."""

    def struck():
        plastic = rf.StVenantKirchhoff(E=2.4e9, nu=0.35, rho=1200.0)
        bar = rf.box((0, 0, 1e-4), (0.2, 0.1, 0.1001), (8, 4, 4))
        scene = rf.Scene(
            bar.with_facets("skin", lambda x: np.isclose(x[2], 1e-4)),
            plastic,
            [
                rf.Contact("skin", against=rf.Sphere((0.05, 0.05, -0.3), 0.3)),
                rf.InitialVelocity(linear=(0.5, 0, -2.0), angular=(3.0, 20.0, 5.0)),
            ],
        )
        *_, last = reports = list(rf.simulate(scene, 4e-5, 1.6e-3, progress=False))
        return sum(r.tangents for r in reports if r.step), last.angular_momentum

    tangents, momentum = struck()
    monkeypatch.setattr(LowRank, "follow", lambda *given: False)
    without, same = struck()
    assert 3 * tangents <= 2 * without
    assert np.allclose(momentum, same, rtol=1e-9)
