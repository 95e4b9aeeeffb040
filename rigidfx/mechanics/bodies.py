"""The rigid bodies of a run as arrays: their data and their motions.

All arrays begin with an axis over the bodies, so that a step with many of them takes as many calls
of NumPy as one with a single body.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.mesh_order import MeshOrder
from rigidfx.base.remembered import Each, Kind, Record
from rigidfx.base.taken import read_only, seal
from rigidfx.mechanics.rigid_body import Body, BodyMotion, Frozen, RigidBody, at_rest
from rigidfx.mechanics.rotation import UNIT_SKEWS, skew

__all__ = ["BODIES", "TRANSLATIONS", "Bodies", "Ensemble", "times"]

Array = npt.NDArray[np.float64]


# How a body's twelve numbers depend on its translation, see `Increments.L`.
TRANSLATIONS = np.eye(12, 6) * (np.arange(6) < 3)


class Ensemble:
    """The constant data of the bodies of a division.

    Attributes:
        records: The bodies' data, one by one.
        mass: m, shape (bodies,) [kg].
        inertia: J about the centres of mass, shape (bodies, 3, 3) [kg m²].
        excess: The part of J due to lumped masses only, shape (bodies, 3, 3) [kg m²].
        excessive: Whether there is any.
        length: ℓ, shape (bodies,) [m].
        square_length: ℓ², shape (bodies, 1, 1) [m²].
        frames: The part of `Increments.L` that does not turn, shape (bodies, 12, 6).
        stored: Energy that they keep for their release [J].
        frozen: Rows r and Rᵀ = I at the freeze, shape (bodies, 4, 3) [m, 1].
        skews: v times them is -v̂/ℓ, row by row; shape (bodies, 3, 9) [1/m].
    """

    def __init__(self, records: Sequence[RigidBody]) -> None:
        """Stack the bodies' data."""
        self.records = tuple(records)
        self.mass = np.array([body.mass for body in records], dtype=np.float64)
        self.inertia = np.reshape([body.inertia for body in records], (-1, 3, 3))
        self.excess = np.reshape([body.excess for body in records], (-1, 3, 3))
        self.excessive = bool(self.excess.any())
        self._holding: tuple[npt.NDArray[np.int32], Array, Array] | None = None
        self.stored = float(sum(body.frozen.energy for body in records))
        self.frozen = np.reshape([[body.origin, *np.eye(3)] for body in records], (-1, 4, 3))
        self.length = np.array([body.length for body in records], dtype=np.float64)
        self.square_length = (self.length**2)[:, None, None]
        self.skews = UNIT_SKEWS / -self.length[:, None, None]
        self.frames = np.tile(TRANSLATIONS, (self.mass.size, 1, 1))
        seal(self)

    def __len__(self) -> int:
        """Number of bodies."""
        return len(self.records)

    def holding(self, count: int) -> tuple[npt.NDArray[np.int32], Array, Array]:
        """Which of the first nodes are bodies', found once.

        Args:
            count: Number of nodes.

        Returns:
            Number of each node's body, -1 if it has none, its body-fixed [1, V] and its
            displacement at the freeze, shapes (nodes,), (nodes, 4) [1, m] and (nodes, 3) [m].
        """
        if self._holding is None:
            body, coordinates = np.full(count, -1, dtype=np.int32), np.zeros((count, 4))
            displacement = np.zeros((count, 3))
            for k, record in enumerate(self.records):
                body[record.nodes] = k
                coordinates[record.nodes, 0] = 1.0
                coordinates[record.nodes, 1:] = record.offsets
                displacement[record.nodes] = record.displacement
            self._holding = body, coordinates, displacement
        return self._holding

    @property
    def at_rest(self) -> Bodies:
        """The bodies where they were frozen, without velocity."""
        return Bodies.of_each(Body(body, at_rest(body)) for body in self.records)


class Bodies:
    """The rigid bodies at an instant, a value: nothing changes them, and arrays are read-only.

    Attributes:
        of: Their constant data.
        pose: Rows r and Rᵀ, shape (bodies, 4, 3) [m, 1]: a node is at [1, V] times them.
        R: Rotations since the freeze, shape (bodies, 3, 3).
        velocity: ṙ, shape (bodies, 3) [m/s].
        angular_velocity_body: W, angular velocities in the bodies' frames, shape (bodies, 3)
            [rad/s].
    """

    def __init__(
        self, of: Ensemble, pose: Array, velocity: Array, angular_velocity_body: Array
    ) -> None:
        """Take arrays over, from then on not to be changed."""
        self.of, self.pose = of, read_only(np.ascontiguousarray(pose))
        self.R = self.pose[:, 1:].swapaxes(1, 2)
        self.velocity = read_only(np.ascontiguousarray(velocity))
        self.angular_velocity_body = read_only(angular_velocity_body)

    @classmethod
    def of_each(cls, bodies: Iterable[Body]) -> Bodies:
        """These bodies, in this order."""
        each = tuple(bodies)
        motions = [body.motion for body in each]
        return cls(
            Ensemble([body.data for body in each]),
            np.reshape([[m.r, *m.R.T] for m in motions], (-1, 4, 3)),
            np.reshape([m.velocity for m in motions], (-1, 3)),
            np.reshape([m.angular_velocity_body for m in motions], (-1, 3)),
        )

    def moving(self, velocity: Array, angular_velocity_body: Array) -> Bodies:
        """These bodies in the same pose with other velocities, shapes (bodies, 3)."""
        return Bodies(self.of, self.pose, velocity, angular_velocity_body)

    def with_six(self, six: Array) -> Bodies:
        """These bodies in the same pose with other velocities, ṙ and ℓω, shape (bodies, 6)."""
        W = times(self.R.swapaxes(1, 2), six[:, 3:] / self.of.length[:, None])
        return self.moving(six[:, :3], W)

    def __len__(self) -> int:
        """Number of bodies."""
        return len(self.of)

    def __iter__(self) -> Iterator[Body]:
        """The bodies one by one."""
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Body:
        """One of the bodies."""
        motion = BodyMotion(self.r[k], self.R[k], self.velocity[k], self.angular_velocity_body[k])
        return Body(self.of.records[k], motion)

    @property
    def r(self) -> Array:
        """Positions of the centres of mass, shape (bodies, 3) [m]."""
        return self.pose[:, 0]

    @property
    def angular_velocity(self) -> Array:
        """ω = R W in space, shape (bodies, 3) [rad/s]."""
        return times(self.R, self.angular_velocity_body)

    @property
    def six(self) -> Array:
        """Velocities of the centres and ℓω, shape (bodies, 6) [m/s]."""
        return np.hstack([self.velocity, self.of.length[:, None] * self.angular_velocity])

    @property
    def pose_rate(self) -> Array:
        """Rate of the pose, shape (bodies, 4, 3) [m/s, 1/s]."""
        turning = -skew(self.angular_velocity_body) @ self.R.swapaxes(1, 2)
        return np.concatenate([self.velocity[:, None], turning], axis=1)

    @property
    def mass_blocks(self) -> Array:
        """Mass matrices of ṙ and ℓω in space, shape (bodies, 6, 6) [kg]."""
        return np.reshape([body.mass_block for body in self], (-1, 6, 6))

    @property
    def given_mass_blocks(self) -> Array:
        """Those of bodies whose mass is given, zero for the others, shape (bodies, 6, 6) [kg]."""
        given = np.array([body.given for body in self.of.records], dtype=bool)
        return self.mass_blocks * given[:, None, None]

    @property
    def stored(self) -> float:
        """Energy that the bodies keep for their release [J]."""
        return self.of.stored

    @cached_property
    def moved(self) -> Array:
        """Change of the pose since the freeze, shape (bodies, 4, 3) [m, 1].

        [1, V] times it is a node's displacement since then, so rounded as that is: a body that has
        not moved is at rest, and strains nothing beside it.
        """
        return read_only(self.pose - self.of.frozen)

    @cached_property
    def momentum(self) -> Array:
        """Momenta m ṙ, shape (bodies, 3) [kg m/s]."""
        return read_only(self.of.mass[:, None] * self.velocity)

    @cached_property
    def own_momentum(self) -> Array:
        """J W in the bodies' frames, shape (bodies, 3) [kg m²/s]."""
        return read_only(times(self.of.inertia, self.angular_velocity_body))

    @cached_property
    def angular_momentum(self) -> Array:
        """π = R J W about the centres of mass, shape (bodies, 3) [kg m²/s]."""
        return read_only(times(self.R, self.own_momentum))

    @cached_property
    def rotated_inertia(self) -> Array:
        """J Rᵀ, shape (bodies, 3, 3) [kg m²]."""
        return read_only(self.of.inertia @ self.R.swapaxes(1, 2))

    @property
    def kinetic(self) -> float:
        """Σ ½ m ṙ·ṙ + ½ W·J W [J]."""
        turning = np.vdot(self.own_momentum, self.angular_velocity_body)
        return 0.5 * float(np.vdot(self.momentum, self.velocity) + turning)

    @property
    def kinetic_of_each(self) -> Array:
        """Kinetic energy ½ m ṙ·ṙ + ½ W·J W of each, shape (bodies,) [J]."""
        translation = (self.momentum * self.velocity).sum(axis=1)
        return 0.5 * (translation + (self.own_momentum * self.angular_velocity_body).sum(axis=1))

    @property
    def kinetic_excess(self) -> Array:
        """Kinetic energy that each has only because masses are lumped, shape (bodies,) [J]."""
        W = self.angular_velocity_body
        return 0.5 * (W * times(self.of.excess, W)).sum(axis=1)

    @cached_property
    def momentum_scale(self) -> float:
        """Σ |m ṙ| + |π|/ℓ [kg m/s]."""
        rotational = np.linalg.norm(self.angular_momentum, axis=1) / self.of.length
        return float(np.linalg.norm(self.momentum, axis=1).sum() + rotational.sum())


class _Bodies(Kind):
    """The bodies of a run, as a checkpoint keeps them: data over cells and nodes, and motions."""

    def __init__(self) -> None:
        """Describe their data."""
        frozen = Record(Frozen, "nodes", ["velocities"])
        arrays = "offsets", "displacement"
        self._data = Each(Record(RigidBody, "nodes", arrays, ["cells"], {"frozen": frozen}))

    def part(self, value: Any, order: MeshOrder) -> Any:
        """See `Kind`."""
        motions = value.pose, value.velocity, value.angular_velocity_body
        return self._data.part(value.of.records, order), motions

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        """See `Kind`."""
        data = self._data.whole(value.of.records, [own for own, _ in parts], orders)
        return data, parts[0][1]

    def own(self, whole: Any, order: MeshOrder) -> Bodies:
        """See `Kind`."""
        data, motions = whole
        return Bodies(Ensemble(self._data.own(data, order)), *motions)


BODIES = _Bodies()


def times(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector, shapes (n, 3, 3) and (n, 3)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
