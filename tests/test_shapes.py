"""Shapes of reduced parts: static responses, Ritz vectors, shapes, on one rank and on several."""

import numpy as np
import pytest
from parallel import report as tell
from parallel import run as mpirun
from scipy.linalg import eigh

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.shapes import solver
from rigidfx.shapes.orthonormal import Basis
from rigidfx.shapes.part import Part
from rigidfx.shapes.patterns import patterns
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.ritz import ritz, shapes_of
from rigidfx.state import State

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=8000.0)
EPS = float(np.finfo(np.float64).eps)


class Built:
    """A block with all that shapes of it take; `destroy` frees it."""

    def __init__(self, *effects, n=(4, 2, 2), size=(1.0, 0.5, 0.4), moved=None, **how):
        far = min(0.5, 1 - 1 / n[0])
        domain = rf.box((0, 0, 0), size, n).with_cells("half", lambda x: x[0] > far - 1e-9)
        domain = domain.with_cells("block", lambda x: x[0] > -1)
        self.scene = rf.Scene(domain, STEEL, effects, **how)
        self.state = State(self.scene)
        if moved is not None:
            self.state.place(moved(*self.scene.space.tabulate_dof_coordinates().T).T.ravel())
        self.forces = InternalForces(self.scene, self.state.u)
        acting = self.scene.acting(0.0)
        self.responses = Responses(self.scene, self.forces, self.state, acting)
        self.X = self.scene.space.tabulate_dof_coordinates()[: self.scene.owned_nodes]
        own = np.arange(self.scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        nodes = np.arange(len(self.X), dtype=np.int32)
        self.part = Part(self.responses, self.forces.cells(own), nodes, "block")
        self.ends = np.array(size)

    def part_beyond(self, x):
        """The part of the cells beyond a plane, one rank only."""
        dofmap = self.scene.space.dofmap.list
        own = np.flatnonzero((self.X[dofmap, 0] > x - 1e-9).all(axis=1)).astype(np.int32)
        return Part(self.responses, self.forces.cells(own), np.unique(dofmap[own]), "end")

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


KINDS = {
    "free": ([], {}),
    "clamped": ([rf.Fixed("x0")], {}),
    "rolling": ([rf.Fixed("x0", components="x")], {}),
    "second": ([], {"order": 2, "n": (2, 1, 1)}),
    "consistent": ([], {"mass": "consistent"}),
}


@pytest.fixture(params=KINDS)
def built(request):
    effects, how = KINDS[request.param]
    made = Built(*effects, **how)
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
    vectors, _ = ritz(r, (F, 2))
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


def test_stresses_of_a_free_state_turn_with_it():
    """A bent bar that nothing holds: rotations have stiffness, deflections are still exact."""

    def bent(x, y, z):
        return 0.05 * np.stack([-2 * x * (z - 0.2), 0 * y, x**2])

    made = Built(moved=bent)
    r, F = made.responses, made.pushed()
    K = r.dot(r.motions, made.part.times_stiffness(r.motions))
    shapes, exact = shapes_of(made.part, r, F), r.solve(F)
    Omega, D = shapes.stiffness, r.dot(shapes.modes, r.inertia(shapes.modes))
    assert np.abs(K).max() > 0.01 * (np.diag(Omega) / np.diag(D)).min()
    assert np.abs(r.dot(r.motions, r.inertia(exact))).max() < 1e-12 * np.abs(exact).max()
    deflections = shapes.modes @ np.linalg.solve(shapes.stiffness, r.dot(shapes.modes, F))
    assert np.abs(deflections - exact).max() < 1e-10 * np.abs(exact).max()
    f = made.part.times_stiffness(exact) - r.balanced(F)
    assert np.abs(r.balanced(f)).max() < 1e-10
    made.destroy()


def angle(responses, F, exact):
    """Sine of the angle between forces in balance and the span of others."""
    Q = np.linalg.qr(F.reshape(-1, F.shape[2]))[0]
    f = responses.balanced(exact[:, :, None]).ravel()
    return np.linalg.norm(f - Q @ (Q.T @ f)) / np.linalg.norm(f)


UP = np.array([0.0, 0.0, 1.0])


def blow(t, length=0.02):
    """A blow from t = 0 on."""
    return np.sin(np.pi * t / length) ** 2 if 0 < t < length else 0.0


def jerks(t):
    """Two motions, the later one in another direction."""
    return 0, blow(t - 0.7), blow(t - 0.3)


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ([rf.Traction("x1", (0, 0, 2.0), time=lambda t: np.sin(7 * t)), rf.Gravity()], 1),
        ([rf.Fixed("x0"), rf.Traction("x1", (0, 0, 2.0)), rf.Gravity()], 2),
        ([rf.Fixed("x0"), rf.Pressure("z1", 3.0, since=0.5), rf.Traction("x1", UP, until=0)], 1),
        ([rf.Traction("z1", lambda x, t: np.outer(UP, np.exp(-((x[0] - t) ** 2) / 0.08)))], 5),
        ([rf.PrescribedMotion("x0", displacement=lambda t: (0, 0, t * t))], 1),
        ([rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=lambda t: t * t)], 2),
        ([rf.Fixed("x0"), rf.Traction("x1", UP, time=lambda t: float(0.611 < t < 0.612))], 1),
        ([rf.Fixed("x0"), rf.Traction("x1", lambda t: (0, blow(t - 0.2), blow(t - 0.6)))], 2),
        ([rf.Fixed("x0"), rf.BodyForce(lambda t: (0, 0, blow(t - 0.455)))], 1),
        ([rf.PrescribedMotion("x0", displacement=jerks)], 2),
        ([rf.Fixed("x0"), rf.Traction("x1", lambda t: (0, 0, 0))], 0),
    ],
    ids=[
        *("free", "held", "pressed", "passing", "moved", "turned"),
        *("hit", "struck twice", "thrust", "jerked twice", "none"),
    ],
)
def test_patterns(effects, expected):
    made = Built(*effects)
    F = patterns(made.responses, made.state, 1.0)
    assert F.shape[2] == expected
    made.destroy()


def test_conjugate_gradients_are_as_exact(monkeypatch):
    """As factors are, to their tolerance."""
    for effects in ([], [rf.Fixed("x0")]):
        made = Built(*effects, n=(9, 5, 5))
        F, again = made.pushed(), Built(*effects, n=(9, 5, 5))
        exact = made.responses.solve(F)
        monkeypatch.setattr(solver, "LARGEST_FACTORS", 0)
        assert np.abs(again.responses.solve(F) - exact).max() < 1e-8 * np.abs(exact).max()
        monkeypatch.undo()
        made.destroy()
        again.destroy()


def test_parts_that_cannot_have_shapes():
    with pytest.raises(rf.SceneError, match="1 cell"):
        Built(n=(1, 1, 1))
    with pytest.raises(rf.SceneError, match="hold the whole structure"):
        Built(rf.Fixed("block"))
    made = Built(rf.Fixed("half"))
    with pytest.raises(rf.SceneError, match="supports hold all of it"):
        made.part_beyond(0.5)
    made.destroy()


def test_a_slender_part_is_stable():
    """Rounding of K u exceeds 1e-6 of the forces: the Princeton beam is reduced as it is."""
    beam = rf.box((0, 0, 0), (0.508, 0.0124, 0.0032), (10, 1, 1))
    metal = rf.StVenantKirchhoff(E=71.7e9, nu=0.31, rho=2700.0)
    given = [rf.Fixed("x0"), rf.Traction("x1", (0.0, 1e3, 1e3)), rf.Reduced()]
    scene = rf.Scene(beam, metal, given, order=2, mass="consistent")
    *_, report = rf.simulate(scene, 1e-3, 2e-3, progress=False)
    assert 0 < report.unknowns < 30


@pytest.mark.parametrize("factored", [0.0, 1e12])
def test_a_state_that_buckles(factored, monkeypatch):
    """A slender column that is compressed by a hundredth."""

    def squeezed(x, y, z):
        return np.stack([-0.01 * x, 0 * y, 0 * z])

    monkeypatch.setattr(solver, "LARGEST_FACTORS", factored)
    made = Built(rf.Fixed("x0"), n=(20, 1, 1), size=(1.0, 0.05, 0.05), moved=squeezed)
    x, y, _ = (made.X - [0, 0.025, 0]).T
    bent = np.stack([-2 * x * y, x**2, 0 * x], axis=1)[:, :, None]
    with pytest.raises(rf.SceneError, match="buckles"):
        made.responses.solve(made.pushed())
    with pytest.raises(rf.SceneError, match="buckles"):
        made.part.shapes(bent)
    made.destroy()


def found():
    made = Built(n=(5, 2, 2))
    r, F = made.responses, made.pushed()
    there, comm = np.flatnonzero(F.any(axis=(1, 2))), made.scene.comm
    counts = comm.allgather(there.size)
    units = np.zeros((len(F), 3, sum(counts), 3))  # on all of these nodes, along x, y and z
    units[there, :, sum(counts[: comm.rank]) + np.arange(there.size)] = np.eye(3)
    F = r.balanced(units.reshape(len(F), 3, -1))
    u, shapes = r.solve(F), shapes_of(made.part, r, F)
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
def test_ranks():
    alone = found()
    for one, other in zip(alone, mpirun(__file__, 3, 300), strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-9 * np.abs(one).max())


def test_bases_stay_orthonormal_where_each_vector_hardly_differs_from_earlier_ones():
    """Rounding that each one passes on, larger, would leave 3 of 1."""
    rng = np.random.default_rng(1)
    mass, vectors = rng.uniform(1.0, 2.0, (40, 3, 1)), rng.standard_normal((40, 3, 8))
    vectors[:, :, 1:] = vectors[:, :, :-1] + 1e-3 * vectors[:, :, 1:]
    images, basis = mass * vectors, Basis(40, np.asarray, lambda u: (u, mass * u))
    basis.grow(vectors, images, np.sqrt((vectors * images).sum(axis=(0, 1))), 8)
    gram = np.einsum("nak,nal->kl", basis.vectors, mass * basis.vectors)
    assert np.abs(gram - np.eye(8)).max() < 10 * EPS


if __name__ == "__main__":
    tell(found())
