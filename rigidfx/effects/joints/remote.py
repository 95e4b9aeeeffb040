"""Remote points of mean or rigid faces, and effects there: docs/theory/joints.md#remote-points.

The joints of a division know where points are: they are among the vectors of `Linkage`, ends of
springs and mean places of sets too. `RemoteNodes` shows them as `rigidfx.effects.nodes` shows
nodes, `Points` are the actions on them. Forces are an array over all vectors, shape (vectors, 3)
[N]; a tangent is a list of rows, columns and values, to which each action adds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import WHOLE, Effect
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.sides import Grounded, Surface, check_sides, side_of
from rigidfx.effects.joints.vectors import Vector, motion_at, value_at
from rigidfx.mechanics.rigid_body import BodyMotion, RigidBody

SMALL = 0.02  # radius of gyration over the size of the face; 1e-3 drowns low modes in rounding
Heed = Callable[[Action, str], Callable[..., Any]]
Held = TypeVar("Held", bound="OnFace")
RemoteTangent = list[tuple[Ints, Ints, Array]]


@dataclass(frozen=True)
class RemotePoint:
    """A place of a face, three directions if anything turns, and its arm from the middle [m]."""

    place: Vector
    middle: Vector
    arm: Array
    directions: tuple[Vector, ...]

    def on_mesh(self, scene: Any) -> Array:
        """The place before any `InitialDisplacement`, shape (3,) [m]. Collective."""
        return value_at(scene, self.place, scene.space.tabulate_dof_coordinates())


class OnFace(Effect):
    """An effect that may act at a point of a face, with fields `where` and `at`."""

    places: ClassVar[tuple[type, ...]] = (str, Surface)
    turns: ClassVar[bool] = False  # whether it acts on directions too
    remote: ClassVar[RemotePoint]  # its point, once a scene has placed it
    where: Any
    at: Any
    checks: ClassVar[Checks] = {"at": vector}

    def __post_init__(self) -> None:
        """Raise `SceneError` if a place is no point, or of no face."""
        super().__post_init__()
        if self.at is not None and self.face is None:
            raise SceneError(
                f"{self.owner}: at is the place of a remote point of a MeanFace or a RigidFace. "
                "Give one of these in place of the set, or leave at out."
            )

    @property
    def face(self) -> Surface | None:
        """The face that it acts on; None if that is a set of cells or nodes."""
        return self.where if isinstance(self.where, Surface) else None

    @property
    def follows(self) -> bool:
        """Whether the motion of its point changes its force there."""
        return not self.is_dead

    @property
    def sides(self) -> Sequence[Surface]:
        """The faces that it takes hold of, as those of joints."""
        return () if self.face is None else (self.face,)

    @property
    def owner(self) -> str:
        """Its name in messages, and where it acts."""
        return f"{self.kind} on {self.face.name if self.face else repr(self.where or WHOLE)}"

    def placed(self: Held, scene: Any) -> Held:
        """The effect with its point on the mesh; raise `SceneError` if it is far. Collective."""
        if (face := self.face) is None:
            return self
        side = side_of(scene, self.owner, face)
        assert not isinstance(side, Grounded)
        point = side.centre if self.at is None else np.asarray(self.at, dtype=np.float64)
        check_sides(scene, self.owner, (face,), (side,), point)
        directions = tuple(side.direction(e) for e in np.eye(3)) if self.turns else ()
        place, middle = side.place(point), side.place(side.centre)
        arm = place.start - middle.start
        return self.with_point(RemotePoint(place, middle, arm, directions))

    def with_point(self: Held, remote: RemotePoint) -> Held:
        """The effect with a point that was found before."""
        return self._with(remote=remote)


@dataclass(frozen=True)
class BodySide:
    """The body of a carried mass [kg] as a side; finds the body by its name."""

    name: str
    mass: float
    size: ClassVar[float] = np.inf

    def place(self, point: Array) -> Vector:
        """The origin of the body."""
        return Vector(start=point, is_place=True, holder=self)

    def direction(self, a: Array) -> Vector:
        """A direction of the body, whose frame is that of space at the start."""
        return Vector(start=a, holder=self, arm=a)

    def within(self, scene: Any, bodies: Sequence[RigidBody]) -> tuple[int, Array, Array] | None:
        """The number of the body, its centre and second moments; None if there is none."""
        numbers = [k for k, body in enumerate(bodies) if body.name == self.name]
        return (numbers[0], np.zeros(3), np.eye(3)) if numbers else None


def tie(name: str, remote: RemotePoint, mass: float) -> Pieces:
    """Averages and rows of the tie between a face and the body of a mass, of this name."""
    body: Any = BodySide(name, mass)
    pieces = Pieces(remote.place.face, body, remote.place.start, np.eye(3)[0])
    pieces.hold(("point", "axis", "turn"))
    return pieces


def body_of(
    effect: Any, scene: Any, x: Array, v: Array, number: int
) -> tuple[RigidBody, BodyMotion]:
    """Data and motion of the body of a `PointMass`, as the nodes of its face move. Collective.

    Owned nodes are at x [m] and move with v [m/s], shape (nodes, 3) each.
    """
    remote, m = effect.remote, float(effect.mass)
    place = remote.place
    moving = [motion_at(scene, vector, x, v) for vector in (place, *remote.directions)]
    now, rates = np.asarray(moving).swapaxes(0, 1)
    R = now[1:].T
    omega = 0.5 * np.cross(now[1:], rates[1:]).sum(axis=0)
    nodes, places, extent = np.empty(0, np.int32), np.empty((0, 3)), place.face.size
    inertia = 2 / 3 * m * (SMALL * extent) ** 2 * np.eye(3)
    mass = effect.title, nodes, nodes, places, places, m, inertia
    data = RigidBody(*mass, now[0], number, given=True, extent=extent)
    return data, BodyMotion(now[0].copy(), R, rates[0], R.T @ omega)


@dataclass(frozen=True)
class RemoteMotion:
    """An iterate, or with increments of zero a state."""

    places: Array  # where all averages are at the start of the step, shape (averages, 3) [m]
    moved: Array  # their increments, likewise
    dt: float  # length of the step [s]; of no meaning in statics

    def after(self, share: float) -> Array:
        """Where averages are after a part of the step [m]."""
        return self.places + share * self.moved


def at_rest(p: Array) -> RemoteMotion:
    """A state of averages at p."""
    return RemoteMotion(p, np.zeros_like(p), 1.0)


class RemoteNodes:
    """Some averages, its ends, as nodes: see `Nodes`; arrays are equal on all ranks."""

    def __init__(
        self, structure: Structure, ends: Sequence[Vector], rest: Array | float = 0.0
    ) -> None:
        """See some averages as nodes, which are at `rest` without displacement [m]."""
        self.ends, self._rest = tuple(ends), rest
        self.weights = np.ones(len(self.ends))
        self.share = 1.0 if structure.static else 0.5
        self._at = slice(0, len(self.ends))

    def number(self, first: int) -> int:
        """Give the first one its number among all vectors; the number after the last one."""
        self._at = slice(first, first + len(self.ends))
        return self._at.stop

    def far(self) -> float:
        """Largest coordinate of one of them at the start of a run [m]."""
        return float(max(np.abs(end.start).max() for end in self.ends))

    def positions(self, at: RemoteMotion) -> Array:
        """Positions, or directions, shape (nodes, 3) [m]."""
        return at.places[self._at]

    def displacement(self, at: RemoteMotion) -> Array:
        """Displacements from `rest`, likewise [m]."""
        return np.asarray(at.places[self._at] - self._rest)

    def moved(self, motion: RemoteMotion) -> Array:
        """Increments at an iterate, likewise [m]."""
        return motion.moved[self._at]

    start = displacement

    def add(self, force: Array, forces: Array) -> None:
        """Add forces on them, shape (nodes, 3) [N]."""
        forces[self._at] += force

    def stiffen(self, blocks: Array, tangent: RemoteTangent) -> None:
        """Add the stiffness of each by itself, shape (nodes, 3, 3) [N/m]."""
        self.couple(np.einsum("nij,nm->nimj", blocks, np.eye(len(blocks))), tangent)

    def couple(self, blocks: Array, tangent: RemoteTangent) -> None:
        """Add the derivative of forces on each by each, shape (nodes, 3, nodes, 3) [N/m]."""
        n = 3 * len(self.ends)
        numbers = 3 * self._at.start + np.arange(n)
        tangent.append((np.repeat(numbers, n), np.tile(numbers, n), blocks.ravel()))


class Points:
    """Actions whose `nodes` are remote; their averages come after those of the joints."""

    def __init__(self, actions: Sequence[Action], heed: Heed = getattr) -> None:
        """Find their methods, which `heed` makes functions that keep a user's exceptions."""
        self.actions = tuple(actions)
        self.rounding = sum(action.rounding for action in actions)
        methods = "resist", "stiffen", "taken", "stored", "accept"
        self._calls = {name: [heed(action, name) for action in actions] for name in methods}

    def number(self, first: int) -> list[Vector]:
        """The averages of all actions, whose first one has this number."""
        for action in self.actions:
            first = action.nodes.number(first)
        return [end for action in self.actions for end in action.nodes.ends]

    def resist(self, motion: RemoteMotion, forces: Array) -> None:
        """Add resistances to forces on all averages, shape (averages, 3) [N]."""
        for resist in self._calls["resist"]:
            resist(motion, forces)

    def stiffness(self, motion: RemoteMotion) -> csr_array:
        """Their derivatives by all averages, shape (3 · averages,) * 2 [N/m]."""
        none, size = np.empty(0, np.int64), 3 * len(motion.places)
        tangent: RemoteTangent = [(none, none, np.empty(0))]
        for stiffen in self._calls["stiffen"]:
            stiffen(motion, tangent)
        row, column, value = map(np.concatenate, zip(*tangent, strict=True))
        return csr_array((value, (row, column)), shape=(size, size))

    def work(self, motion: RemoteMotion) -> tuple[float, list[tuple[str, float]]]:
        """Work of loads in the step, and loss by each damper with its kind [J]."""
        energies = [take(motion) for take in self._calls["taken"]]
        taken = list(zip(self.actions, energies, strict=True))
        done = -sum(energy for action, energy in taken if not action.dissipates)
        return done, [(a.kind, energy) for a, energy in taken if a.dissipates and energy]

    def accept(self) -> None:
        """Let actions remember the step."""
        for accept in self._calls["accept"]:
            accept()

    def stored(self, at: RemoteMotion) -> float:
        """Energy of springs in a state [J]."""
        return float(sum(stored(at) for stored in self._calls["stored"]))
