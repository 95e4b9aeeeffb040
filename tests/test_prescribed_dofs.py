"""Dofs that supports hold: which, how they move, their reactions, and impacts where they begin.

Run as a script under mpirun, this file reports what the ranks find.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np
import parallel
import pytest
from mpi4py import MPI
from runs import prepared
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.effects import Support
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion
from rigidfx.step.system.rigid_motion import free_to_move
from rigidfx.step.system.supports import PrescribedDofs, impose_velocity

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])
NOWHERE = np.zeros(3 * 5 * 3 * 2)  # m; displacement of the bar below
EPS = float(np.finfo(float).eps)
SOLVED = 1e-13  # relative, by conjugate gradients to rounding


def near(points):
    """Marker of vertices at some of the points."""
    return lambda x: (np.abs(x.T[:, None] - np.array(points)) < 1e-9).all(axis=-1).any(axis=-1)


@functools.cache
def domain():
    """A bar of 4 x 2 x 1 unit cells with names for some points and cells."""
    out = rf.box((0, 0, 0), (4, 2, 1), (4, 2, 1)).with_cells("right", lambda x: x[0] > 3 - 1e-9)
    places = {
        "one point": [(0, 0, 0)],
        "two points": [(0, 0, 0), (4, 2, 1)],
        "three in line": [(0, 0, 0), (2, 0, 0), (4, 0, 0)],
        "three points": [(0, 0, 0), (4, 0, 0), (0, 2, 0)],
    }
    for name, points in places.items():
        out = out.with_vertices(name, near(points))
    return out


def made(*effects, **options):
    return rf.Scene(domain(), MATERIAL, effects, **options)


def prescribed_by(*supports, driven=None):
    """The dofs of a scene with these supports, and positions and axes of those held."""
    scene = made(*supports)
    dofs = PrescribedDofs(scene, supports, driven)
    held = np.flatnonzero(dofs.mask)
    X = scene.space.tabulate_dof_coordinates()[held // 3].round()
    return dofs, X, held % 3


def path(t):
    """A displacement whose one-sided differences of second order are exact."""
    return (1.0 + 2.0 * t, 3.0 * t**2, -(t**2) + t)


def other_path(t):
    return (7.0, -5.0 * t, 4.0 * t**2)


# Which dofs, and how they move -----------------------------------------------------------------


@pytest.mark.parametrize("components", ["x", "yz", "zx", "xyz"])
def test_components_of_the_nodes_of_a_set_are_held(components):
    """Four cells along y1 and z of one: ten nodes, and no dof but theirs."""
    dofs, X, axis = prescribed_by(rf.Fixed("y1", components))
    assert dofs.mask.sum() == 10 * len(components)
    assert set(X[:, 1]) == {2.0}
    assert {"xyz"[k] for k in axis} == set(components)


def test_each_dof_moves_by_the_path_of_its_support():
    """Two supports may share nodes if they hold different components of them."""
    dofs, X, axis = prescribed_by(
        rf.PrescribedMotion("x0", "xy", displacement=path),
        rf.PrescribedMotion("y0", "z", displacement=other_path),
    )
    first = axis < 2
    assert (X[first, 0] == 0).all()
    assert (X[~first, 1] == 0).all()
    assert (first.sum(), (~first).sum()) == (2 * 6, 10)
    t0, t1 = 0.5, 1.25
    moved = np.subtract(path(t1), path(t0)), np.subtract(other_path(t1), other_path(t0))
    wanted = np.where(first, moved[0][axis], moved[1][axis])
    assert np.abs(dofs.increments(t0, t1, NOWHERE) - wanted).max() <= 10 * EPS
    speed = np.array([2.0, 6.0 * t0, 1 - 2.0 * t0]), np.array([0.0, -5.0, 8.0 * t0])
    wanted = np.where(first, speed[0][axis], speed[1][axis])
    # A difference quotient over a thousandth of the step loses three digits.
    assert np.abs(dofs.velocities(t0, 0.1, NOWHERE) - wanted).max() <= 1e6 * EPS


def test_a_velocity_that_is_given_is_taken():
    """Beyond the start it need not be the derivative of the path, which counts in steps."""
    support = rf.PrescribedMotion("x0", "yz", displacement=path, velocity=lambda t: (2.0, t, 1.0))
    dofs, _, axis = prescribed_by(support)
    assert dofs.velocities(2.0, 0.1, NOWHERE).tolist() == np.where(axis == 1, 2.0, 1.0).tolist()
    assert dofs.increments(0.0, 2.0, NOWHERE).tolist() == np.where(axis == 1, 12.0, -2.0).tolist()


def test_nodes_of_a_driven_body_move_with_its_support():
    """In all components, also where the support itself holds one only."""
    nodes = np.array([3, 4, 7], dtype=np.int32)
    supports = rf.Fixed("x0", "z"), rf.PrescribedMotion("x1", "x", displacement=path)
    dofs, _, _ = prescribed_by(*supports, driven={1: nodes})
    found = np.zeros(dofs.mask.size)
    found[dofs.mask] = dofs.increments(0.0, 2.0, NOWHERE)
    for c, wanted in enumerate(np.subtract(path(2.0), path(0.0))):
        assert found[3 * nodes + c] == pytest.approx(wanted)


# Reactions -------------------------------------------------------------------------------------


def test_reactions_are_resultants_about_the_origin():
    """By the name of the set; a dof that two supports hold counts for the first."""
    supports = (
        rf.Fixed("x0", "xy"),
        rf.Fixed("y0"),
        rf.Fixed("x0", "z"),  # its force is added to that of the first
    )
    dofs, X, axis = prescribed_by(*supports)
    rng = np.random.default_rng(1)
    forces, x = rng.standard_normal(axis.size), X + rng.standard_normal(X.shape)
    found, moments = dofs.reactions(forces, x)
    vectors = forces[:, None] * np.eye(3)[axis]
    on_x0 = X[:, 0] == 0
    # Both hold the edge between them: its x and y are the first's, its z that of y0, named second.
    of_first = on_x0 & ((axis < 2) | (X[:, 1] > 0))
    assert set(found) == set(moments) == {"x0", "y0"}
    for name, mine in (("x0", of_first), ("y0", ~of_first)):
        assert np.abs(found[name] - vectors[mine].sum(axis=0)).max() <= 100 * EPS
        moment = np.cross(x[mine], vectors[mine]).sum(axis=0)
        assert np.abs(moments[name] - moment).max() <= 100 * EPS


# What happens where a support begins -----------------------------------------------------------


class Impact:
    """A random state before and after a support takes velocities over.

    Attributes:
        run: The run.
        prescribed: Velocities of the held dofs [m/s].
        before, after: Velocities at the rows and of the bodies, and the kinetic energy.
        changed: Whether a velocity changed.
    """

    def __init__(self, run, prescribed):
        self.run, stepper = run, run.stepper
        state, scene = stepper.state, stepper.scene
        own, common = np.random.default_rng(scene.comm.rank), np.random.default_rng(100)
        state.group(
            Bodies.of_each(
                Body(
                    data,
                    BodyMotion(
                        data.origin,
                        Rotation.from_rotvec(common.standard_normal(3)).as_matrix(),
                        *common.standard_normal((2, 3)),
                    ),
                )
                for data in state.bodies.of.records
            )
        )
        v = own.standard_normal((scene.owned_nodes, 3))
        for body in state.bodies:
            v[body.data.nodes] = body.velocities
        state.move(v.reshape(-1))
        self.layout, self.mass = stepper.system.layout, stepper.system.mass
        self.before = self._look()
        self.prescribed = prescribed(state.v.x.array[: v.size][stepper.prescribed.mask])
        self.changed = self.impose()
        self.after = self._look()

    def impose(self):
        stepper = self.run.stepper
        changes = impose_velocity(
            stepper.scene, stepper.state, self.mass, self.layout, self.prescribed
        )
        return changes is not None

    def _look(self):
        stepper = self.run.stepper
        state = stepper.state
        v = state.v.x.array[self.layout.rows.dofs].copy()
        return v, state.bodies.rates, stepper.measure().kinetic

    @property
    def held(self):
        """For each row, whether it is held."""
        return self.layout.prescribed[self.layout.rows.dofs]

    def impulse(self):
        """M Δv at the rows, and the resultant of that with mẍ of each body, (bodies, 6)."""
        rows, comm = self.layout.rows, self.run.stepper.scene.comm
        dv, p = rows.vector(), rows.vector()
        dv.array[:] = self.after[0] - self.before[0]
        self.mass.mult(dv, p)
        nodal = p.array_r.copy()
        dv.destroy()
        p.destroy()
        sums = []
        for k, (body, at) in enumerate(
            zip(self.run.stepper.state.bodies, self.layout.attached, strict=True)
        ):
            f = nodal.reshape(-1, 3)[rows.positions(body.data.nodes[at])]
            lever = body.data.offsets[at] @ body.motion.R.T
            on_nodes = np.r_[f.sum(axis=0), np.cross(lever, f).sum(axis=0)]
            six = self.after[1][k] - self.before[1][k]
            R, length = body.motion.R, body.data.length
            own = np.r_[body.data.mass * six[:3], R @ body.data.inertia @ R.T @ six[3:] / length]
            sums.append(comm.allreduce(on_nodes) + own)
        return nodal, np.reshape(sums, (-1, 6))


SUPPORTS = {
    "face": [rf.Fixed("x0")],
    "by component": [rf.Fixed("x0", "xz")],
    "point": [rf.Fixed("one point")],
    "moving": [rf.PrescribedMotion("x0", "xy", displacement=path), rf.Fixed("y0", "z")],
}


def impact_errors(name, mass, rigid):
    """Relative errors of what holds in any impact on these supports. Collective."""
    body = [rf.Rigid("right")] if rigid and name != "moving" else []
    scene = made(*SUPPORTS[name], *body, mass=mass)
    moves = name == "moving"

    def largest(values):
        return scene.comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)

    with prepared(scene) as run:
        impact = Impact(run, lambda v: np.cos(np.arange(v.size)) if moves else 0 * v)
        nodal, resultants = impact.impulse()
        held = impact.held
        (v0, six0, T0), (v1, six1, T1) = impact.before, impact.after
        own = impact.layout.massive.repeat(3)[impact.layout.rows.dofs]
        mean = (v0 + v1)[held] / 2
        work = scene.sum(nodal[held] @ mean)
        lost = 0.5 * scene.sum(nodal @ (v1 - v0)) + 0.5 * np.sum(
            (six1 - six0) * np.einsum(
                "kij,kj->ki", run.stepper.state.bodies.mass_blocks, six1 - six0
            )
        )  # fmt: skip
        again = impact.impose()
        return {
            "held": largest(v1[held] - impact.prescribed),
            "momentum of other nodes": largest(nodal[own & ~held]) / largest(nodal),
            "momenta of bodies": largest(resultants) / largest(nodal),
            "work of the impulse": abs(T1 - T0 - work) / T0,
            "Carnot": 0.0 if moves else abs(T0 - T1 - lost) / T0,
            "gained": 0.0 if moves else max(T1 - T0, 0.0),
            "again": largest(run.stepper.state.v.x.array[impact.layout.rows.dofs] - v1)
            if again
            else 0.0,
            "others": largest((v1 - v0)[~held]),
            "lost": (T0 - T1) / T0,
            "changed": impact.changed,
        }


@MASSES
@pytest.mark.parametrize("rigid", [False, True], ids=["flexible", "with a body"])
@pytest.mark.parametrize("name", SUPPORTS)
def test_impact(name, rigid, mass):
    """The impulse acts on held dofs only, by a projection: Carnot's theorem tells what is lost."""
    errors = impact_errors(name, mass, rigid)
    assert_impact(errors, mass, name)


def assert_impact(errors, mass, name):
    assert errors["changed"]
    assert errors["held"] <= 4 * EPS
    for what in ("momentum of other nodes", "momenta of bodies", "work of the impulse", "Carnot"):
        assert errors[what] <= SOLVED, what
    assert errors["gained"] == 0.0
    assert errors["again"] <= 4 * EPS
    if name != "moving":
        assert errors["lost"] > 1e-4
    # A lumped mass couples nothing; a consistent one hands the blow on.
    assert errors["others"] == 0.0 if mass == "lumped" else errors["others"] > 1e-3


@MASSES
def test_nodes_that_move_with_their_support_meet_no_impact(mass):
    """Nothing changes, not even by rounding."""
    with prepared(made(rf.Fixed("x0", "xz"), rf.Rigid("right"), mass=mass)) as run:
        impact = Impact(run, lambda v: v.copy())
        assert not impact.changed
        assert np.array_equal(impact.before[0], impact.after[0])
        assert np.array_equal(impact.before[1], impact.after[1])


# Which motions are left ------------------------------------------------------------------------


def normal(*directions):
    """A stiffness against motion in some directions."""
    return sum(np.outer(n, n) for n in np.asarray(directions, float))


HOLD = {
    "nothing": ([], False),
    "a face": ([rf.Fixed("x0")], True),
    "a face in two components": ([rf.Fixed("x0", "xy")], False),
    "a face in one component": ([rf.Fixed("x0", "x")], False),
    "a slide": ([rf.Fixed("x0", "x"), rf.Fixed("y0", "y")], False),
    "three planes": ([rf.Fixed(f"{c}0", c) for c in "xyz"], True),
    "a ball joint": ([rf.Fixed("one point")], False),
    "a hinge": ([rf.Fixed("two points")], False),
    "three points in line": ([rf.Fixed("three in line")], False),
    "three points": ([rf.Fixed("three points")], True),
    "three points on a plane": ([rf.Fixed("three points", "z")], False),
    "a face on springs": ([rf.Spring("x0", 3.0)], True),
    "a point on a spring": ([rf.Spring("one point", 3.0)], False),
    "a hinge and a spring": ([rf.Fixed("two points"), rf.Spring("three points", 1e-9)], True),
    "points held and on a spring": (
        [rf.Fixed("three points", "z"), rf.Spring("two points", normal((1, 0, 0), (0, 1, 0)))],
        True,
    ),
    "a spring that leaves a turn": (
        [rf.Fixed("three points", "z"), rf.Spring("one point", normal((1, 0, 0), (0, 1, 0)))],
        False,
    ),
    "a spring that leaves a way": (
        [rf.Fixed("three points", "z"), rf.Spring("two points", normal((0, 1, 0)))],
        False,
    ),
    "a moving face": ([rf.PrescribedMotion("x0", displacement=path)], True),
}


def excludes(name):
    """Whether supports and springs leave no rigid motion. Collective."""
    scene = made(*HOLD[name][0])
    return free_to_move(scene, PrescribedDofs(scene, scene.named(Support))) == ""


@pytest.mark.parametrize("name", HOLD)
def test_rigid_motions_that_are_left(name):
    assert excludes(name) == HOLD[name][1]


# On several ranks ------------------------------------------------------------------------------

CASES = list(itertools.product(["by component", "point", "moving"], ["lumped", "consistent"]))


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [3])
def test_on_several_ranks(ranks):
    """The body at the right spans some, and the point that is held is one rank's."""
    found = parallel.run(__file__, ranks, timeout=300)
    for (name, mass), errors in zip(CASES, found["impacts"], strict=True):
        assert_impact(errors, mass, name)
    assert found["excludes"] == {name: wanted for name, (_, wanted) in HOLD.items()}


if __name__ == "__main__":
    results = {
        "impacts": [impact_errors(name, mass, rigid=True) for name, mass in CASES],
        "excludes": {name: excludes(name) for name in HOLD},
    }
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(results)
