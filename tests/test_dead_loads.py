"""What dead loads and resultants do to nodes and bodies: powers, work, weights, times.

All are measured against nodal forces by the trapezoidal rule, exact for loads on equal hexahedra.
Run as a script under mpirun, this file reports the errors that the ranks find.
"""

from __future__ import annotations

import functools

import numpy as np
import parallel
import pytest
from mpi4py import MPI
from runs import prepared
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.base.errors import SceneError
from rigidfx.effects import motion as effects
from rigidfx.effects.motion import Forces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.mechanics.rigid_body import Body, BodyMotion
from rigidfx.step.equations.actions import Actions

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
SIZE = (4, 2, 1)
Q = np.array([1.0, -2.0, 0.5])
POINT = 3.0  # kg at one corner
GIVEN = {"mass": 30.0, "inertia": np.diag([5.0, 6.0, 7.0])}
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])
ROUNDING = 1e-14  # of sums over some ten nodes
TIME = rf.Table([0.0, 2.0], [0.0, 4.0])


@functools.cache
def domain():
    """Two cells at the left, four at the right, two flexible ones between them."""
    return (
        rf.box((0, 0, 0), SIZE, SIZE)
        .with_cells("left", lambda x: x[0] < 1 + 1e-9)
        .with_cells("right", lambda x: x[0] > 2 - 1e-9)
        .with_cells("tip", lambda x: x[0] > 3 - 1e-9)
        .with_vertices("corner", lambda x: np.isclose(x.sum(axis=0), 7.0))
    )


def made(bodies, *effects, **options):
    """The scene with a mass at a corner."""
    parts = [rf.Rigid(name, **data) for name, data in bodies.items()]
    effects = [rf.PointMass("corner", POINT), *parts, *effects]
    return rf.Scene(domain(), MATERIAL, effects, **options)


def positions(scene):
    """Whole numbers, those of the owned nodes."""
    return scene.space.tabulate_dof_coordinates()[: scene.owned_nodes].round()


PARTITIONS = {
    "flexible": {},
    "one body": {"right": {}},
    "two bodies": {"left": {}, "right": {}},
}


def per_volume(low, high):
    """Volume of nodes in a box of unit cells, or their area where one side of it is zero."""

    def weights(X):
        out = np.ones(len(X))
        for x, a, b in zip(X.T, low, high, strict=True):
            out *= (x == a) if a == b else 0.5 * ((x >= a) & (x < b)) + 0.5 * ((x > a) & (x <= b))
        return out

    return weights


def shared(low, high):
    """Equal parts of 1 for the nodes in a box."""
    count = np.prod(np.subtract(high, low) + 1)
    return lambda X: np.all([low <= X, high >= X], axis=(0, 2)) / count


def at_corner(X):
    return shared(SIZE, SIZE)(X)


RIGHT = (2, 0, 0), SIZE
LOADS = {
    "Traction": (rf.Traction("x1", tuple(Q)), per_volume((4, 0, 0), SIZE)),
    "Traction along": (rf.Traction("y0", tuple(Q)), per_volume((0, 0, 0), (4, 0, 1))),
    "Traction in all": (
        rf.Traction("y0", tuple(Q), total=True),
        lambda X: per_volume((0, 0, 0), (4, 0, 1))(X) / 4,
    ),
    "BodyForce": (rf.BodyForce(tuple(Q)), per_volume((0, 0, 0), SIZE)),
    "BodyForce on a body": (rf.BodyForce(tuple(Q), "right"), per_volume(*RIGHT)),
    "BodyForce on a part": (rf.BodyForce(tuple(Q), "tip"), per_volume((3, 0, 0), SIZE)),
    "Gravity": (
        rf.Gravity(tuple(Q)),
        lambda X: 2.0 * per_volume((0, 0, 0), SIZE)(X) + POINT * at_corner(X),
    ),
    "Gravity on a body": (
        rf.Gravity(tuple(Q), "right"),
        lambda X: 2.0 * per_volume(*RIGHT)(X) + POINT * at_corner(X),
    ),
    "NodalForce": (rf.NodalForce("y0", tuple(Q)), shared((0, 0, 0), (4, 0, 1))),
    "NodalForce on cells": (rf.NodalForce("right", tuple(Q)), shared(*RIGHT)),
    "NodalForce on a vertex": (rf.NodalForce("corner", tuple(Q)), at_corner),
}


class Motion:
    """Any motion of the nodes and bodies of a run.

    Attributes:
        bodies: In any pose.
        v: Velocity of all owned nodes, those of bodies by theirs, shape (nodes, 3) [m/s].
    """

    def __init__(self, run):
        scene, common = run.stepper.scene, np.random.default_rng(100)
        own = np.random.default_rng(scene.comm.rank)
        self.bodies = Bodies.of_each(
            Body(
                data,
                BodyMotion(
                    common.standard_normal(3),
                    Rotation.from_rotvec(common.standard_normal(3)).as_matrix(),
                    *common.standard_normal((2, 3)),
                ),
            )
            for data in run.stepper.state.bodies.of.records
        )
        self.v = own.standard_normal((scene.owned_nodes, 3))
        for data, motion in ((b.data, b.motion) for b in self.bodies):
            omega = motion.R @ motion.angular_velocity_body
            lever = data.offsets @ motion.R.T
            self.v[data.nodes] = motion.velocity + np.cross(omega, lever)


class Loads:
    """What an action does. Collective."""

    def __init__(self, structure, action, t=0.0):
        self.structure = structure
        forces = Forces.none(structure.rows.vector(), structure.bodies.pose)
        action.set_time(t, 0.1)
        action.load(forces)
        self.nodal = forces.nodes.copy()
        self.moments, self.torques = map(structure.scene.sum, (forces.moments, forces.torques))
        forces.vector.destroy()

    def power(self, motion):
        """Power in a motion [W]. Collective."""
        structure = self.structure
        total = structure.scene.sum(np.vdot(self.nodal, motion.v[structure.rows.nodes]))
        for body, moments, torque in zip(motion.bodies, self.moments, self.torques, strict=True):
            moved, R = body.motion, body.motion.R
            omega = R @ moved.angular_velocity_body
            # columns of ω × (R V) for the unit vectors V
            spin = np.cross(omega, R.T).T
            total += moments[0] @ moved.velocity + np.sum(spin.T * moments[1:]) + torque @ omega
        return float(total)


def bound(run, load, t=0.0):
    """What a load does in the structure of a run. Collective."""
    structure = run.stepper.system.structure
    return Loads(structure, load.bind(structure), t)


def power_errors(bodies, mass):
    """Relative errors of the powers of all loads, by name. Collective."""
    errors = {}
    with prepared(made(bodies, mass=mass)) as run:
        scene, motion = run.stepper.scene, Motion(run)
        X = positions(scene)
        for name, (load, weights) in LOADS.items():
            each = weights(X) * (motion.v @ Q)
            scale = scene.sum(np.abs(each).sum())
            wanted = scene.sum(each.sum())
            errors[name] = abs(bound(run, load).power(motion) - wanted) / scale
    return errors


def gravity_error(bodies, mass):
    """Relative error of (power of gravity) = g · (linear momentum). Collective."""
    with prepared(made(bodies, mass=mass)) as run:
        motion = Motion(run)
        run.stepper.state.group(motion.bodies)
        run.stepper.state.move(motion.v.reshape(-1))
        measures = run.stepper.measure()
        power = bound(run, rf.Gravity(tuple(Q))).power(motion)
        return abs(power - Q @ measures.linear_momentum) / measures.momentum_scale


def work_error():
    """Relative error of the work of all loads on bodies in a step of any size. Collective."""
    loads = [load for load, _ in LOADS.values()]
    resultant = rf.Resultant("left", force=(1.0, 2.0, 3.0), torque=(-2.0, 1.0, 4.0))
    with prepared(made(PARTITIONS["two bodies"], resultant)) as run:
        scene, structure = run.stepper.scene, run.stepper.system.structure
        actions = Actions(structure, [*loads, resultant], [*loads, resultant])
        actions.set_time(0.0, 0.1)
        X = positions(scene)
        start = Motion(run).bodies
        six = np.random.default_rng(7).standard_normal((len(start), 6))
        increments = Increments(Step(start, 0.1), six)
        work = 0.0
        for a, b in zip(start, increments.end, strict=True):
            moved = b.positions - a.positions
            work += sum(w(X[a.data.nodes]) @ (moved @ Q) for _, w in LOADS.values())
        wanted = scene.sum(work)
        k = [body.name for body in start.of.records].index("left")
        wanted += resultant.force_at(0.0) @ six[k, :3]
        wanted += resultant.torque_at(0.0) @ six[k, 3:] / start.of.length[k]
        still = structure.rows.vector()
        found = scene.sum(actions.work(effects.Motion(still, increments, 0.1)))
        still.destroy()
        actions.destroy()
        return abs(found - wanted) / abs(wanted)


def findings():
    """Errors of everything that ranks share. Collective."""
    return {
        "power": {
            f"{name}, {mass}": max(power_errors(bodies, mass).values())
            for name, bodies in PARTITIONS.items()
            for mass in ("lumped", "consistent")
        },
        "gravity": {
            mass: gravity_error({"left": {}, "right": GIVEN}, mass)
            for mass in ("lumped", "consistent")
        },
        "work": work_error(),
        "refused": MPI.COMM_WORLD.allgather(refusal_of_one_rank()),
    }


def refusal_of_one_rank():
    """What this rank is told where a function of time fails on the last one only. Collective."""
    comm = MPI.COMM_WORLD

    def value(t):
        if t > 0.5 and comm.rank == comm.size - 1:
            raise ZeroDivisionError("no such force")
        return tuple(Q)

    load = rf.NodalForce("x1", value)
    with prepared(made({})) as run:
        actions = Actions(run.stepper.system.structure, [load], [load])
        try:
            actions.set_time(1.0, 0.1)
        except SceneError as error:
            return str(error)
        finally:
            actions.destroy()
    return None


# Forces ----------------------------------------------------------------------------------------


@MASSES
@pytest.mark.parametrize("partition", PARTITIONS)
def test_power_is_that_of_the_nodal_forces(partition, mass):
    """However nodes and bodies move and bodies are turned; a node of a body counts once."""
    for name, error in power_errors(PARTITIONS[partition], mass).items():
        assert error <= ROUNDING, name


@MASSES
@pytest.mark.parametrize(
    "bodies",
    [{"right": {}}, {"right": GIVEN}, {"left": GIVEN, "right": {"mass": 1.0}}],
    ids=["computed", "given", "two given"],
)
def test_gravity_pulls_at_whatever_has_inertia(bodies, mass):
    """Its power in any motion is g · L, given masses and point masses included."""
    assert gravity_error(bodies, mass) <= ROUNDING


@MASSES
def test_gravity_on_a_part_of_a_body_of_given_mass(mass):
    """Half of its cells have half of its mass, half a metre from the centre."""
    with prepared(made({"right": GIVEN}, mass=mass)) as run:
        forces = bound(run, rf.Gravity(tuple(Q), where="tip"))
    assert np.abs(forces.moments[0, 0] - 15.0 * Q).max() <= 15 * ROUNDING
    wanted = np.outer([7.5, 0.0, 0.0], Q)
    assert np.abs(forces.moments[0, 1:] - wanted).max() <= 100 * ROUNDING
    assert not forces.nodal.any()


def test_work_on_bodies_is_that_on_their_nodes():
    """In a step that turns them by angles of one and more; a torque works along θ."""
    assert work_error() <= 10 * ROUNDING


def test_resultant_is_force_and_torque():
    """Its power is F · ṙ + T · ω of its body and nobody else's."""
    load = rf.Resultant("right", force=(1.0, 2.0, 3.0), torque=(-2.0, 1.0, 4.0), time=TIME)
    with prepared(made(PARTITIONS["two bodies"], load)) as run:
        motion = Motion(run)
        (body,) = (b for b in motion.bodies if b.data.name == "right")
        omega = body.motion.R @ body.motion.angular_velocity_body
        wanted = np.dot(load.force, body.motion.velocity) + np.dot(load.torque, omega)
        for t in (0.5, 1.0):
            power = bound(run, load, t).power(motion)
            assert power == pytest.approx(TIME(t) * wanted, rel=1e-14)
        assert bound(run, load, 0.0).power(motion) == 0.0


def test_resultant_on_a_body_that_there_is_not():
    """It does nothing: while a support clamps the body, the support bears it."""
    with prepared(made(PARTITIONS["one body"])) as run:
        assert rf.Resultant("left").bind(run.stepper.system.structure) is None
        assert rf.Resultant("right").bind(run.stepper.system.structure) is not None


# Times -----------------------------------------------------------------------------------------

KINDS = {
    "NodalForce": lambda value, **k: rf.NodalForce("x1", value, **k),
    "Traction": lambda value, **k: rf.Traction("x1", value, **k),
    "BodyForce": rf.BodyForce,
    "Gravity": rf.Gravity,
}


@pytest.mark.parametrize("kind", KINDS)
def test_force_is_value_times_factor_in_the_window(kind):
    """From the start of the window on, and no longer at its end."""
    load = KINDS[kind](lambda t: tuple(t * Q), time=TIME, since=0.25, until=1.5)
    steady = KINDS[kind](tuple(Q))
    with prepared(made(PARTITIONS["two bodies"])) as run:
        unit = bound(run, steady)
        assert max(np.abs(unit.nodal).max(), np.abs(unit.moments).max()) > 0.1
        for t, factor in ((0.24, 0), (0.25, 0.125), (1.0, 2.0), (1.49, 4.4402), (1.5, 0)):
            found = bound(run, load, t)
            for name in ("nodal", "moments"):
                wanted = factor * getattr(unit, name)
                assert np.abs(getattr(found, name) - wanted).max(initial=0.0) <= 1e-13


# The sum ---------------------------------------------------------------------------------------


def test_actions_add_up_and_begin_anew_in_each_step():
    """Dead loads are bound before they act; those that do not act add nothing."""
    early = [rf.Gravity(tuple(Q), until=1.0), rf.Traction("x0", tuple(Q), until=1.0)]
    late = [rf.NodalForce("right", tuple(Q), since=1.0)]
    with prepared(made(PARTITIONS["two bodies"])) as run:
        structure = run.stepper.system.structure
        actions = Actions(structure, [*early, *late], early)
        kinds = {0.5: ("Gravity", "Traction"), 1.0: ("NodalForce",)}
        for t, acting in ((0.5, early), (0.5, early), (1.0, late), (0.5, early)):
            actions.select(acting)
            actions.set_time(t, 0.1)
            each = [bound(run, load, t) for load in acting]
            nodal, moments = sum(f.nodal for f in each), sum(f.moments for f in each)
            assert np.abs(actions.loads.vector.array_r - nodal.reshape(-1)).max() <= ROUNDING
            assert np.abs(actions.loads.moments - moments).max() <= 100 * ROUNDING
            assert np.abs(moments).max() > 0.1
            assert actions.kinds == kinds[t]
        actions.destroy()


# On several ranks ------------------------------------------------------------------------------


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [3])
def test_on_several_ranks(ranks):
    """Powers and work are those of the nodes of all ranks; what one refuses, all do."""
    found = parallel.run(__file__, ranks, timeout=300)
    for errors in (found["power"], found["gravity"], {"work": found["work"] / 10}):
        for name, error in errors.items():
            assert error <= ROUNDING, name
    assert len(found["refused"]) == ranks
    assert len(set(found["refused"])) == 1
    assert "ZeroDivisionError: no such force" in found["refused"][0]


if __name__ == "__main__":
    results = findings()
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(results)
