"""The inventory of bodies: which cells are flexible, form bodies, or go with a support.

Run as a script under mpirun, this file reports divisions and what is refused.
"""

from __future__ import annotations

import functools

import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.errors import SceneError
from rigidfx.decide.decision import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion
from rigidfx.scene.timeline import Timeline
from rigidfx.state import State
from rigidfx.step.system.supports import supports_of
from rigidfx.switch.exchange import freeze
from rigidfx.switch.inventory import check_clamps, divide

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])
COMM = MPI.COMM_WORLD

# Sets of cells along a bar of 6 x 2 x 1 unit cells, by the interval of x.
PARTS = {"left": (0, 2), "next": (2, 3), "over": (1, 3), "middle": (3, 4), "right": (5, 6)}
POINTS = {
    "two": [(0, 0, 0), (0, 2, 0)],
    "line": [(0, 0, 0), (0, 1, 0), (0, 2, 0)],
    "spread": [(0, 0, 0), (0, 2, 0), (2, 1, 1)],
    "one of left": [(2, 2, 1)],
}


def near(points):
    """Marker of vertices at some of the points."""
    return lambda x: (np.abs(x.T[:, None] - np.array(points)) < 1e-9).all(axis=-1).any(axis=-1)


@functools.cache
def domain():
    out = rf.box((0, 0, 0), (6, 2, 1), (6, 2, 1))
    for name, (a, b) in PARTS.items():
        out = out.with_cells(name, lambda x, a=a, b=b: (x[0] > a - 1e-9) & (x[0] < b + 1e-9))
    for name, points in POINTS.items():
        out = out.with_vertices(name, near(points))
    return out


def path(t):
    return (0.1 * t, 0.0, 0.0)


def rising(t):
    return (0.0, 0.0, 0.1 * t)


class Case:
    """A scene and its state, about to be divided at a time."""

    def __init__(self, *effects, **options):
        self.scene = rf.Scene(domain(), MATERIAL, effects, **options)
        self.state = State(self.scene)
        self.forces = InternalForces(self.scene, self.state.u)

    def divide(self, t=0.0, found=()):
        active = supports_of(self.scene.acting(t))
        return divide(self.scene, self.forces, self.state, active, found)

    def frozen(self, low, high, name, number, named=()):
        """A body of the cells in an interval of x, as a decision finds it."""
        cells = np.concatenate(
            [self.scene.owned_cells(n, "") for n, (a, b) in PARTS.items() if low <= a and b <= high]
        )
        cells = np.unique(cells).astype(np.int32)
        x = self.state.X[: self.scene.owned_nodes, 0]
        nodes = np.flatnonzero((x > low - 1e-9) & (x < high + 1e-9)).astype(np.int32)
        what = PlannedBody(cells, nodes, name, number, named)
        return freeze(self.scene, self.forces, self.state, what)


def flat(cells):
    """Cells by subdomain id as one sorted list; None stays."""
    return None if cells is None else np.sort(np.concatenate([*cells.values()]))


def counts(case, division):
    """Cells of each kind over all ranks, and whether each cell is of one kind. Collective."""
    flexible, driven = flat(division.flexible), flat(division.driven_cells)
    bodies = {b.data.name: b.data.cells for b in division.bodies}
    every = [flexible, *bodies.values(), *([] if driven is None else [driven])]
    owned = case.scene.mesh.topology.index_map(3).size_local
    whole = np.array_equal(np.sort(np.concatenate(every)), np.arange(owned))

    def total(own):
        return COMM.allreduce(int(own.size))

    return {
        "flexible": total(flexible),
        "bodies": {name: total(cells) for name, cells in bodies.items()},
        "sizes": {b.data.name: b.data.size for b in division.bodies},
        "numbers": [b.data.number for b in division.bodies],
        "driven": None if driven is None else total(driven),
        "driven nodes": {str(k): total(n) for k, n in division.driven_nodes.items()},
        "clamped": {str(k): total(c) for k, c in division.clamped.items()},
        "whole": COMM.allreduce(whole, op=MPI.LAND),
    }


def kinds(flexible, bodies, numbers=None, driven=None, driven_nodes=None, clamped=None):
    """What `counts` says of a division."""
    return {
        "flexible": flexible,
        "bodies": bodies,
        "sizes": bodies,
        "numbers": list(range(1, len(bodies) + 1)) if numbers is None else numbers,
        "driven": driven,
        "driven nodes": driven_nodes or {},
        "clamped": clamped or {},
        "whole": True,
    }


RIGHT, LEFT = rf.Rigid("right"), rf.Rigid("left")
MOVED = rf.PrescribedMotion("x0", displacement=path)
DIVISIONS = {
    "flexible": ([], kinds(12, {})),
    "a body": ([LEFT], kinds(8, {"left": 4})),
    "in the order of the scene": ([RIGHT, LEFT], kinds(6, {"right": 2, "left": 4})),
    "all cells": ([rf.Rigid()], kinds(0, {"all cells": 12})),
    "beside a support": ([LEFT, rf.Fixed("x1")], kinds(8, {"left": 4})),
    "fixed": (
        [LEFT, RIGHT, rf.Fixed("x0")],
        kinds(6, {"right": 2}, [2], 4, {"0": 18}, {"1": 4}),
    ),
    "moved by the second support": (
        [RIGHT, LEFT, rf.Fixed("x1", "z", since=1.0), rf.Fixed("middle", "x"), MOVED],
        kinds(6, {"right": 2}, [1], 4, {"1": 18}, {"2": 4}),
    ),
    "clamped by three points": (
        [LEFT, rf.Fixed("spread")],
        kinds(8, {}, [], 4, {"0": 18}, {"1": 4}),
    ),
    "clamped by two supports of one motion": (
        [LEFT, MOVED, rf.PrescribedMotion("one of left", displacement=path)],
        kinds(8, {}, [], 4, {"0": 18}, {"1": 4}),
    ),
    "clamped by components": (
        [LEFT, rf.Fixed("x0", "x"), rf.Fixed("x0", "zy")],
        kinds(8, {}, [], 4, {"0": 18}, {"1": 4}),
    ),
    "two on one support": (
        [LEFT, RIGHT, rf.Fixed("z0")],
        kinds(6, {}, [], 6, {"0": 18 + 12}, {"1": 4, "2": 2}),
    ),
}


@pytest.mark.parametrize("name", DIVISIONS)
def test_division(name):
    """Each cell is flexible, of a body, or moved by a support; all is told by number."""
    effects, wanted = DIVISIONS[name]
    case = Case(*effects)
    assert counts(case, case.divide()) == wanted


@MASSES
def test_data_of_named_bodies(mass):
    """Computed, or as the scene gives them; the centre and the motion are the cells' own."""
    J = [[50.0, 2.0, 0.0], [2.0, 60.0, 0.0], [0.0, 0.0, 70.0]]
    case = Case(LEFT, rf.Rigid("right", mass=7.0), rf.Rigid("middle", inertia=J), mass=mass)
    v = np.array([1.0, 2.0, 3.0]) + np.cross([0.3, -0.2, 0.1], case.state.X)
    case.state.move(v.reshape(-1))
    left, right, middle = case.divide().bodies
    # A lumped mass counts half of the cells beside: on one side of left, on two of middle.
    volume = {"left": 4.0, "middle": 2.0} if mass == "consistent" else {"left": 5.0, "middle": 4.0}
    assert left.data.mass == pytest.approx(2 * volume["left"], rel=1e-14)
    assert middle.data.mass == pytest.approx(2 * volume["middle"], rel=1e-14)
    assert right.data.mass == 7.0
    assert np.array_equal(middle.data.inertia, J)
    assert [b.data.given for b in (left, right, middle)] == [False, True, True]
    for body in (left, right, middle):
        omega = body.motion.angular_velocity
        assert omega == pytest.approx([0.3, -0.2, 0.1], rel=1e-12)
        wanted = np.array([1.0, 2.0, 3.0]) + np.cross(omega, body.motion.r)
        assert body.motion.velocity == pytest.approx(wanted, rel=1e-12)
    assert middle.motion.r == pytest.approx([3.5, 1.0, 0.5], rel=1e-12)


def moving(body):
    """The body somewhere else."""
    return Body(body.data, BodyMotion(body.motion.r + 1, np.eye(3), np.ones(3), np.ones(3)))


def test_body_that_is_there_keeps_data_and_motion():
    """It is not frozen again, and its place is that in the scene."""
    case = Case(LEFT, RIGHT)
    first = case.divide()
    case.state.group(Bodies.of_each([moving(first.bodies[1])]))
    left, right = case.divide().bodies
    assert right.data is first.bodies[1].data
    assert right.motion.velocity.tolist() == [1.0, 1.0, 1.0]
    assert right.motion.r == pytest.approx(first.bodies[1].motion.r + 1, rel=1e-15)
    assert left.data is not first.bodies[0].data
    assert (left.data.name, left.data.number) == ("left", 1)


def test_body_whose_clamp_has_gone_is_frozen_again():
    case = Case(LEFT, rf.Fixed("x0", until=1.0))
    clamped = case.divide(0.5)
    assert len(clamped.bodies) == 0
    case.state.clamp(clamped.clamped)
    free = case.divide(1.0)
    assert [b.data.name for b in free.bodies] == ["left"]
    assert free.driven_cells is None
    assert free.driven_nodes == free.clamped == {}


def test_bodies_found_come_after_those_of_the_scene():
    """One that holds named sets stands for these, whatever it is called."""
    case = Case(LEFT, RIGHT)
    found = [
        case.frozen(0, 4, "left", 1, named=("left",)),
        case.frozen(5, 6, "part 7", 7, named=("right",)),
    ]
    division = case.divide(found=found)
    assert counts(case, division) == kinds(2, {"left": 8, "part 7": 2}, [1, 7])
    assert [b.data for b in division.bodies] == [b.data for b in found]
    division = case.divide(found=[case.frozen(3, 4, "part 3", 3)])
    assert counts(case, division) == kinds(4, {"left": 4, "right": 2, "part 3": 2}, [1, 2, 3])


# What is refused -------------------------------------------------------------------------------

CHAIN = "leave a layer of flexible cells between them, or clamp all components"
REFUSED = {
    "one point": ([LEFT, rf.Fixed("one of left")], CHAIN),
    "two points": ([LEFT, rf.Fixed("two")], CHAIN),
    "three points in line": ([LEFT, rf.Fixed("line")], CHAIN),
    "two components": ([LEFT, rf.Fixed("x0", "xy")], CHAIN),
    "clamped and held in part": ([LEFT, rf.Fixed("x0"), rf.Fixed("one of left", "z")], CHAIN),
    "two motions": ([LEFT, MOVED, rf.Fixed("one of left")], CHAIN),
    "two paths": (
        [LEFT, MOVED, rf.PrescribedMotion("one of left", displacement=rising)],
        CHAIN,
    ),
    "a support on a neighbour": ([rf.Rigid("next"), rf.Fixed("one of left")], CHAIN),
}
# By a look ahead only: what the time of the support, and of the resultant, has to do with it.
LATER = {
    "two points later": ([LEFT, rf.Fixed("two", since=2.0)], CHAIN),
    "clamped and loaded": (
        [LEFT, rf.Fixed("x0", since=2.0), rf.Resultant("left", force=(1, 0, 0))],
        "Resultant: at t = 2 s a support clamps the body 'left'",
    ),
    "loaded later": (
        [LEFT, rf.Fixed("x0"), rf.Resultant("left", force=(1, 0, 0), since=3.0)],
        "Resultant: at t = 3 s a support clamps the body 'left'",
    ),
    "a given mass": (
        [rf.Rigid("left", mass=1.0), rf.Fixed("x0", since=2.0)],
        "Rigid 'left': its mass or inertia is given, and at t = 2 s",
    ),
}
ALLOWED = {
    "no support": [rf.Rigid("left", mass=1.0), rf.Resultant("left", force=(1, 0, 0))],
    "clamped": [LEFT, rf.Fixed("x0", since=2.0)],
    "loaded, then clamped": [
        LEFT,
        rf.Resultant("left", force=(1, 0, 0), until=2.0),
        rf.Fixed("x0", since=2.0),
    ],
    "another one loaded": [LEFT, RIGHT, rf.Fixed("x0"), rf.Resultant("right", force=(1, 0, 0))],
    "two motions at two times": [
        LEFT,
        rf.PrescribedMotion("x0", displacement=path, until=2.0),
        rf.Fixed("spread", since=2.0),
    ],
    "given, beside a support": [rf.Rigid("left", mass=1.0), rf.Fixed("x1")],
}


def refusal(function):
    """The message of an error, None without one."""
    try:
        function()
    except SceneError as error:
        return str(error)
    return None


def refusals(name):
    """What this rank is told by the look ahead, and by a division at the start. Collective."""
    effects, _ = (REFUSED | LATER)[name]
    case = Case(*effects)
    ahead = refusal(lambda: check_clamps(case.scene, Timeline(0.1, 10.0)))
    return ahead, refusal(case.divide)


@pytest.mark.parametrize("name", REFUSED)
def test_division_is_refused(name):
    """By a message that names the body and says what to do."""
    _, text = refusals(name)
    assert REFUSED[name][1] in text
    if REFUSED[name][1] == CHAIN:
        body = REFUSED[name][0][0].name
        assert text.startswith(f"Rigid '{body}' has nodes held by the support on '")


@pytest.mark.parametrize("name", [*LATER, *(n for n in REFUSED if n[:6] != "bodies")])
def test_look_ahead_refuses(name):
    """Before the first step, whatever the time."""
    text, _ = refusals(name)
    assert (REFUSED | LATER)[name][1] in text


@pytest.mark.parametrize("name", ALLOWED)
def test_look_ahead_lets_pass(name):
    """What does not meet in time or space; a body may be clamped whole."""
    assert refusal(lambda: check_clamps(Case(*ALLOWED[name]).scene, Timeline(0.1, 10.0))) is None


# On several ranks ------------------------------------------------------------------------------


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [3])
def test_on_several_ranks(ranks):
    """Divisions are those on one; what is refused, is so on all ranks by the same words."""
    found = parallel.run(__file__, ranks, timeout=300)
    assert found["divisions"] == {name: wanted for name, (_, wanted) in DIVISIONS.items()}
    for name, told in found["refusals"].items():
        assert len(told) == ranks
        assert all(each == told[0] for each in told)
        where = 1 if name in REFUSED else 0
        assert (REFUSED | LATER)[name][1] in told[0][where], name


def main():
    divisions = {}
    for name, (effects, _) in DIVISIONS.items():
        case = Case(*effects)
        divisions[name] = counts(case, case.divide())
    told = {name: COMM.allgather(refusals(name)) for name in REFUSED | LATER}
    if COMM.rank == 0:
        parallel.report({"divisions": divisions, "refusals": told})


if __name__ == "__main__":
    main()
