"""The only mutable physics: displacement, velocity, rigid bodies, time.

This module alone writes them: a step by `advance`, a switch by `group`, `take_out` and
`move`, a support that begins by `kick`, a static preload by `place`.
"""

from collections.abc import Iterable, Mapping, Set
from itertools import count
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.errors import together
from rigidfx.base.remembered import FIELD, ON_DOFS, ByObject, Remembered, same
from rigidfx.base.sealed import read_only
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.effects import InitialVelocity, Preload
from rigidfx.effects.initial import agree_with_support, given_velocity
from rigidfx.mechanics.bodies import BODIES, Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.scene.scene import Scene


class Snapshot(NamedTuple):
    """The part of a state that a step changes."""

    t: float  # time [s]
    u: Array  # displacement at all local dofs [m]
    v: Array  # velocity there [m/s]
    bodies: Bodies  # the rigid bodies
    changes: int  # number of the last write into the state


class State:
    """Displacement and velocity of all nodes, and the rigid bodies, at one time.

    Attributes:
        t: Time [s].
        u: Displacement [m].
        v: Velocity [m/s].
        bodies: Rigid bodies that move freely.
        clamped: Owned cells of each named part that a support moves, by the part's number.
        notes: Memory of effects from step to step, by their identity.
        path_rates: Rates of supports' paths at the end of the last step, of each owned dof [m/s],
            NaN where none is known; None before a step with a support that moves.
        changes: Number of the last write into it; no two writes have the same.
        X: Reference positions of the local nodes, shape (nodes, 3) [m].

    Between outputs u and v of nodes inside bodies lag behind; `rebuild` brings them up to date.
    """

    remembered: ClassVar[Remembered] = same("t") | {
        "u": FIELD,
        "v": FIELD,
        "bodies": BODIES,
        "notes": ByObject(),
        "path_rates": ON_DOFS,
    }

    def __init__(self, scene: Scene) -> None:
        """The state at rest in the reference configuration at t = 0."""
        self.t = 0.0
        self.u = fem.Function(scene.space, name="displacement")
        self.v = fem.Function(scene.space, name="velocity")
        self.bodies = Bodies.of_each(())
        self.clamped: Mapping[int, Indices] = {}
        self.X: Array = read_only(scene.space.tabulate_dof_coordinates())
        self.notes: dict[int, Any] = {}
        self.path_rates: Array | None = None
        self._writes, self.changes = count(1), 0
        self._places: tuple[int, Bodies, Array] | None = (
            None  # and the write and bodies they are of
        )
        self._following: tuple[Indices, ...] = ()

    # What is asked ------------------------------------------------------------------------------

    def positions(self, nodes: Ints) -> Array:
        """Positions of owned nodes, also of those inside bodies, shape (nodes, 3) [m]."""
        x = np.asarray(self.X[nodes] + self.u.x.array.reshape(-1, 3)[nodes])
        if len(self.bodies):
            body, coordinates, displacement = self.bodies.of.holding(len(self.X))
            inside = np.flatnonzero(body[nodes] >= 0)
            held = nodes[inside]
            moved = (coordinates[held][:, None] @ self.bodies.moved[body[held]])[:, 0]
            x[inside] = self.X[held] + (displacement[held] + moved)
        return x

    @property
    def places(self) -> Array:
        """Positions of all owned nodes, found once for a state, shape (nodes, 3) [m]."""
        known = self._places
        if known is None or known[0] != self.changes or known[1] is not self.bodies:
            x = self.positions(np.arange(self.u.function_space.dofmap.index_map.size_local))
            self._places = known = self.changes, self.bodies, read_only(x)
        return known[2]

    def velocities(self, nodes: Ints) -> Array:
        """Velocities of owned nodes, also of those inside bodies, shape (nodes, 3) [m/s]."""
        v = np.array(self.v.x.array.reshape(-1, 3)[nodes])
        if len(self.bodies):
            body, coordinates, _ = self.bodies.of.holding(len(self.X))
            inside = np.flatnonzero(body[nodes] >= 0)
            of = body[nodes[inside]]
            v[inside] = (coordinates[nodes[inside], None] @ self.bodies.pose_rate[of])[:, 0]
        return v

    @property
    def stored(self) -> float:
        """Energy that the bodies keep for their release [J]."""
        return self.bodies.stored

    def gap(self, bodies: Iterable[Body], at: Iterable[npt.NDArray[Any]]) -> float:
        """Largest difference of velocities between bodies and some of their nodes here [m/s]."""
        v, largest = self.v.x.array.reshape(-1, 3), 0.0
        for body, some in zip(bodies, at, strict=True):
            own = body.velocities[some]
            apart = np.linalg.norm(v[body.data.nodes[some]] - own, axis=1)
            largest = max(largest, float(apart.max(initial=0.0)))
        return largest

    def interface_mismatch(self) -> float:
        """Largest difference of velocities where flexible cells meet bodies [m/s]. Collective.

        Zero with a lumped mass, whose nodes have one velocity each.
        """
        all_nodes = (np.arange(body.nodes.size) for body in self.bodies.of.records)
        beside = map(np.setdiff1d, all_nodes, self._following)
        gap = self.gap(self.bodies, beside)
        return self.v.function_space.mesh.comm.allreduce(gap, op=MPI.MAX)

    def body_numbers(self) -> Indices:
        """For each owned cell the number of the body or clamped part it is in, else 0."""
        numbers = np.zeros(self.u.function_space.mesh.topology.index_map(3).size_local, np.int32)
        for body in self.bodies.of.records:
            numbers[body.cells] = body.number
        for number, cells in self.clamped.items():
            numbers[cells] = number
        return numbers

    def bent(
        self, wanted: Bools | None = None
    ) -> tuple[fem.Function, fem.Function, Bools, list[tuple[fem.Function, float]]]:
        """Strains of bodies with shapes: their shape at the freeze, and Φ e there. Collective.

        Displacement of that shape and the motion in its frame [m], at those of the owned nodes that
        are wanted (all if None) and at ghosts, which owned cells are in these bodies, and
        displacements whose strains of second order come on top, or are taken away.
        """
        V, curves = self.u.function_space, list[tuple[fem.Function, float]]()
        shape, motion = fem.Function(V), fem.Function(V)
        cells = np.zeros(shape.function_space.mesh.topology.index_map(3).size_local, dtype=bool)
        for body in self.bodies:
            data = body.data
            if data.shapes is not None:
                at = slice(None) if wanted is None else np.flatnonzero(wanted[data.nodes])
                nodes = data.nodes[at]
                shape.x.array.reshape(-1, 3)[nodes] = data.displacement[at]
                stretched = data.shapes.bent(body.stretched[0], at)
                if (own := data.shapes.selves) is not None:
                    more, fields = own.strained(body.motion.q)
                    stretched += more[at]
                    for field, sign in fields:
                        curves.append((fem.Function(V), sign))
                        q = np.pad(field, (0, len(data.shapes) - field.size))
                        curves[-1][0].x.array.reshape(-1, 3)[nodes] = data.shapes.bent(q, at)
                motion.x.array.reshape(-1, 3)[nodes] = stretched
                cells[data.cells] = True
        for made in (shape, motion, *(curve for curve, _ in curves)):
            made.x.scatter_forward()
        return shape, motion, cells, curves

    @property
    def levels(self) -> npt.NDArray[np.uint8]:
        """Level of each owned cell: 0 flexible, 1 in a body with shapes, 2 rigid."""
        levels = np.where(self.body_numbers() > 0, np.uint8(2), np.uint8(0))
        for body in self.bodies.of.records:
            if body.shapes is not None:
                levels[body.cells] = 1
        return levels

    # What a step writes -------------------------------------------------------------------------

    def advance(
        self,
        t: float,
        dofs: Ints,
        d: Array,
        v: Array,
        bodies: Bodies,
        attached: Ints,
        displacement: Array,
    ) -> None:
        """Keep the result of a step that ends at t [s]. Collective.

        Owned dofs of nodes that took part have increments d [m] and velocities v [m/s]. Dofs of the
        bodies' nodes among them, attached, are put exactly where the bodies are, by a displacement
        [m], as increments would add up rounding.
        """
        self._wrote()
        self.u.x.array[dofs] += d
        self.v.x.array[dofs] = v
        self.bodies, self.t = bodies, t
        self.u.x.array[attached] = displacement
        self._scatter()

    def rebuild(self) -> None:
        """Set displacement and velocity of the nodes inside bodies from their motions. Collective.

        With a consistent mass velocities at the interface stay: the flexible cells' side of it has
        a velocity of its own.
        """
        if not len(self.bodies):
            return
        u, v = (f.x.array.reshape(-1, 3) for f in (self.u, self.v))
        for body, own in zip(self.bodies, self._following, strict=True):
            nodes = body.data.nodes
            u[nodes] = body.displacement
            v[nodes[own]] = body.velocities[own]
        self._scatter()

    def _wrote(self) -> None:
        """Count a write."""
        self.changes = next(self._writes)

    # What the start of a run, supports and switches write ----------------------------------------

    def place(self, u: Array) -> None:
        """Set the displacement of a static preload at all local dofs [m]."""
        self._wrote()
        self.u.x.array[:] = u

    def snapshot(self) -> Snapshot:
        """The changes of a step or a `shift`, to be taken back by `restore`."""
        u, v = self.u.x.array.copy(), self.v.x.array.copy()
        return Snapshot(self.t, u, v, self.bodies, self.changes)

    def restore(self, kept: Snapshot) -> None:
        """Be again the state when that was taken."""
        self.t, self.bodies, self.changes = kept.t, kept.bodies, kept.changes
        self.u.x.array[:], self.v.x.array[:] = kept.u, kept.v

    def shift(self, dofs: Ints, d: Array) -> None:
        """Move owned dofs [m] to look at forces elsewhere; `restore` ends that. Collective."""
        self._wrote()
        self.u.x.array[dofs] += d
        self.u.x.scatter_forward()

    def move(self, v: Array) -> None:
        """Set a velocity at all local dofs, or at the owned ones [m/s]. Collective."""
        self._wrote()
        self.v.x.array[: v.size] = v
        self.v.x.scatter_forward()

    def follow_paths(self, held: Ints, rates: Array) -> None:
        """Keep rates of supports' paths at the end of a step, those of no other dof."""
        self.path_rates = np.full(self.u.x.array.size, np.nan)
        self.path_rates[held] = rates

    def forget_paths(self) -> None:
        """Keep no rates of paths, as an impact gives others."""
        self.path_rates = None

    def kick(self, dofs: Ints, dv: Array, bodies: Bodies) -> None:
        """Change velocities of owned dofs [m/s], and those of the bodies. Collective."""
        self._wrote()
        self.v.x.array[dofs] += dv
        self.bodies = bodies
        self.v.x.scatter_forward()

    def group(self, bodies: Bodies) -> None:
        """Set the bodies, or their velocities; the caller decides on their nodes."""
        self._wrote()
        self.bodies = bodies

    def clamp(self, clamped: Mapping[int, Indices]) -> None:
        """Say which owned cells of each named part a support moves, by the part's number."""
        self.clamped = clamped

    def take_out(self, numbers: Set[int]) -> list[Body]:
        """Remove bodies, which are returned; their nodes get their displacement. Collective."""
        self._wrote()
        gone = [body for body in self.bodies if body.data.number in numbers]
        self.bodies = Bodies.of_each(
            body for body in self.bodies if body.data.number not in numbers
        )
        u = self.u.x.array.reshape(-1, 3)
        for body in gone:
            u[body.data.nodes] = body.displacement
        self.u.x.scatter_forward()
        return gone

    def follow(self, following: tuple[Indices, ...]) -> None:
        """Say for each body which of its nodes have its velocity: see `DofLayout.following`."""
        self._following = following

    def _scatter(self) -> None:
        self.u.x.scatter_forward()
        self.v.x.scatter_forward()


def initial_velocity(scene: Scene, x: Array, dt: float, start: float) -> Array:
    """Velocity at the start per local node with ghosts, shape (nodes, 3) [m/s]. Collective.

    Nodes are at places x [m]; Δt [s] is the scale for supports that are known by their path only,
    effects that act at the start, just after t = 0, begin there. Without an `InitialVelocity` it is
    the spin of a `Preload`, if that has one. `SceneError` if a given velocity is not finite, or
    contradicts a support; without one a support simply begins to move its nodes.
    """
    if not scene.named(InitialVelocity):
        spun = [preload.velocities(scene, x) for preload in scene.named(Preload)]
        return spun[0] if spun else np.zeros_like(x)
    X = scene.space.tabulate_dof_coordinates()
    v = given_velocity(scene, x)
    for support, nodes in scene.supports:
        if not support.acts(start):
            continue
        wanted = together(
            scene.comm,
            f"{type(support).__name__} on '{support.where}'",
            lambda s=support, at=nodes: s.velocities_at(0.0, dt, X[at], x[at]),  # type: ignore[misc]
        )
        agree_with_support(scene, v, support, nodes, wanted)
    return v
