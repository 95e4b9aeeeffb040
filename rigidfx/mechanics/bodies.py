"""The bodies of a run as arrays: their data and their motions.

All arrays begin with an axis over the bodies, so that a step with many of them takes as many calls
of NumPy as one with a single body. Below, m is the largest number of shapes of a body (`shapes`),
which is zero where all are rigid, and n = 4 + 3 m.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from rigidfx.base.remembered import Kind, MeshOrder, Record
from rigidfx.base.sealed import read_only, seal
from rigidfx.base.types import Array, Indices
from rigidfx.mechanics.rigid_body import Body, BodyMotion, Frozen, RigidBody
from rigidfx.mechanics.rotation import UNIT_SKEWS, skew
from rigidfx.mechanics.shapes import SelfStresses, Shapes, ShapesOfBodies, times

# How a body's twelve numbers depend on its translation, see `Increments.L`.
TRANSLATIONS = np.eye(12, 6)
TRANSLATIONS[:, 3:] = 0.0


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
        frames: The part of `Increments.L` that does not turn, shape (bodies, 3 n, 6 + m).
        stored: Energy that bodies keep for their release, but for U₀ of those that deform [J].
        strained: U₀, the strain energy at the freeze of those that deform [J].
        frozen: The pose at the freeze, shape (bodies, n, 3) [m, 1].
        shapes: Those of the bodies; None if all are rigid.
        columns: 6 + m, the largest number of unknowns of a body.
        known: Which of these each body has, shape (bodies, 6 + m): not those that supports give.
        unknowns: Number of unknowns of each body, shape (bodies,).
        undeformed: q of bodies that are not deformed, shape (bodies, m).
        skews: v times them is -v̂/ℓ, row by row; shape (bodies, 3, 9) [1/m].
    """

    def __init__(self, records: Sequence[RigidBody]) -> None:
        self.records = tuple(records)
        self.mass = np.array([body.mass for body in records], dtype=np.float64)
        self.inertia = np.reshape([body.inertia for body in records], (-1, 3, 3))
        self.excess = np.reshape([body.excess for body in records], (-1, 3, 3))
        self.excessive = bool(self.excess.any())
        self._holding: tuple[Indices, Array, Array] | None = None
        kept = (b.frozen.energy if b.shapes is None else b.frozen.vibration for b in records)
        self.stored = float(sum(kept))
        self.strained = np.array([b.frozen.strain if b.shapes else 0.0 for b in records])
        deform = any(body.shapes is not None for body in records)
        self.shapes = ShapesOfBodies([body.shapes for body in records]) if deform else None
        m = 0 if self.shapes is None else self.shapes.most
        self.columns = 6 + m
        self.known = np.ones((len(self.records), self.columns), dtype=bool)
        if self.shapes is not None:
            self.known[:, 6:] = self.shapes.known & ~self.shapes.given
            self.known[self.shapes.held, :6] = False
        self.unknowns = self.known.sum(axis=1)
        self.undeformed = np.zeros((len(self.records), m))
        self.frozen = np.zeros((len(self.records), 4 + 3 * m, 3))
        frames = [[body.origin, *np.eye(3)] for body in records]
        self.frozen[:, :4] = np.reshape(frames, (-1, 4, 3))
        self.length = np.array([body.length for body in records], dtype=np.float64)
        self.square_length = (self.length**2)[:, None, None]
        self.skews = UNIT_SKEWS / -self.length[:, None, None]
        self.frames = np.zeros((self.mass.size, 12 + 9 * m, self.columns))
        self.frames[:, :12, :6] = TRANSLATIONS
        seal(self)

    def __len__(self) -> int:
        return len(self.records)

    def holding(self, count: int) -> tuple[Indices, Array, Array]:
        """Which of the first nodes are bodies', found once, and how they sit in them.

        Number of each node's body, -1 if it has none, shape (nodes,), its body-fixed [1, V], shape
        (nodes, 4) [1, m], and its displacement at the freeze, shape (nodes, 3) [m].
        """
        if self._holding is None:
            body, n = np.full(count, -1, dtype=np.int32), self.frozen.shape[1]
            coordinates, displacement = np.zeros((count, n)), np.zeros((count, 3))
            for k, record in enumerate(self.records):
                body[record.nodes] = k
                coordinates[record.nodes, : 4 + 3 * record.deforms_by] = record.coordinates()
                displacement[record.nodes] = record.displacement
            self._holding = body, coordinates, displacement
        return self._holding

    @property
    def at_rest(self) -> Bodies:
        """The bodies where they were frozen, without velocity."""
        none = np.zeros((len(self), 3)), np.zeros((len(self), 3))
        return Bodies(self, self.frozen[:, :4], *none)


class Bodies:
    """The bodies at an instant, a value: nothing changes them, and arrays are read-only.

    Attributes:
        of: Their constant data.
        pose: Rows r, Rᵀ and q_k Rᵀ of each shape, shape (bodies, n, 3) [m, 1]: a node is at
            a = [1, ξ, Φ₁, ..., Φ_m] times them.
        R: Rotations since the freeze, shape (bodies, 3, 3).
        velocity: ṙ, shape (bodies, 3) [m/s].
        angular_velocity_body: W, angular velocities in the bodies' frames, shape (bodies, 3)
            [rad/s].
        q: Coordinates of the shapes, shape (bodies, m) [m].
        q_rate: Their rates, likewise [m/s].
    """

    def __init__(
        self,
        of: Ensemble,
        frame: Array,
        velocity: Array,
        angular_velocity_body: Array,
        q: Array | None = None,
        q_rate: Array | None = None,
    ) -> None:
        """Keep arrays. The frame is r and Rᵀ, shape (bodies, 4, 3) [m, 1]; q is zero if None."""
        self.of, self.frame = of, read_only(np.ascontiguousarray(frame))
        self.R = self.frame[:, 1:].swapaxes(1, 2)
        self.velocity = read_only(np.ascontiguousarray(velocity))
        self.angular_velocity_body = read_only(angular_velocity_body)
        self.q = of.undeformed if q is None else read_only(q)
        self.q_rate = of.undeformed if q_rate is None else read_only(q_rate)

    @classmethod
    def of_each(cls, bodies: Iterable[Body]) -> Bodies:
        """These bodies, in this order."""
        each = tuple(bodies)
        motions = [body.motion for body in each]
        of = Ensemble([body.data for body in each])
        q, rate = np.zeros((2, len(each), of.columns - 6))
        for k, motion in enumerate(motions):
            q[k, : motion.q.size], rate[k, : motion.q.size] = motion.q, motion.q_rate
        return cls(
            of,
            np.reshape([[m.r, *m.R.T] for m in motions], (-1, 4, 3)),
            np.reshape([m.velocity for m in motions], (-1, 3)),
            np.reshape([m.angular_velocity_body for m in motions], (-1, 3)),
            q,
            rate,
        )

    def moving(
        self, velocity: Array, angular_velocity_body: Array, q_rate: Array | None = None
    ) -> Bodies:
        """These bodies in the same pose with other ṙ [m/s], W [rad/s] and q̇ [m/s], or their q̇."""
        rate = self.q_rate if q_rate is None else q_rate
        return Bodies(self.of, self.frame, velocity, angular_velocity_body, self.q, rate)

    def with_rates(self, rates: Array) -> Bodies:
        """These bodies in the same pose with other `rates`, shape (bodies, 6 + m)."""
        W = times(self.R.swapaxes(1, 2), rates[:, 3:6] / self.of.length[:, None])
        return self.moving(rates[:, :3], W, rates[:, 6:])

    def __len__(self) -> int:
        return len(self.of)

    def __iter__(self) -> Iterator[Body]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Body:
        data, frame = self.of.records[k], (self.r[k], self.R[k])
        deforming = (values[k, : data.deforms_by] for values in (self.q, self.q_rate))
        motion = BodyMotion(*frame, self.velocity[k], self.angular_velocity_body[k], *deforming)
        return Body(data, motion)

    @cached_property
    def pose(self) -> Array:
        """See the class."""
        if self.of.shapes is None:
            return self.frame
        shaped = self.q[:, :, None, None] * self.frame[:, None, 1:]
        return read_only(np.concatenate([self.frame, shaped.reshape(len(self), -1, 3)], axis=1))

    @property
    def drifted(self) -> Array:
        """Way of the centres of mass in frames that are held, shape (bodies, 3) [m]."""
        if self.of.shapes is None:
            return np.zeros((len(self), 3))
        return np.asarray(np.einsum("bkc,bk->bc", self.of.shapes.drift, self.q))

    @property
    def r(self) -> Array:
        """Positions of the centres of mass, shape (bodies, 3) [m]."""
        return self.frame[:, 0]

    @property
    def angular_velocity(self) -> Array:
        """ω = R W in space, shape (bodies, 3) [rad/s]."""
        return times(self.R, self.angular_velocity_body)

    @property
    def rates(self) -> Array:
        """Velocities of the centres, ℓω, and rates of shapes, shape (bodies, 6 + m) [m/s]."""
        turning = self.of.length[:, None] * self.angular_velocity
        return np.hstack([self.velocity, turning, self.q_rate])

    @cached_property
    def pose_rate(self) -> Array:
        """Rate of the pose, shape (bodies, n, 3) [m/s, 1/s]."""
        back = self.R.swapaxes(1, 2)
        turning = -skew(self.angular_velocity_body) @ back
        out = np.concatenate([self.velocity[:, None], turning], axis=1)
        if self.of.shapes is None:
            return read_only(out)
        shaped = self.q[:, :, None, None] * turning[:, None]
        shaped = shaped + self.q_rate[:, :, None, None] * back[:, None]
        return read_only(np.concatenate([out, shaped.reshape(len(self), -1, 3)], axis=1))

    @property
    def mass_blocks(self) -> Array:
        """Mass matrices of `rates`, shape (bodies, 6 + m, 6 + m) [kg]."""
        out = np.zeros((len(self), self.of.columns, self.of.columns))
        out[:, :3, :3] = self.of.mass[:, None, None] * np.eye(3)
        out[:, 3:6, 3:6] = self.R @ self.rotated_inertia / self.of.square_length
        if (shapes := self.of.shapes) is not None:
            at = shapes.some
            B = self.R[at] @ shapes.coupling(self.weighted) / self.of.length[at, None, None]
            out[at, 3:6, 6:], out[at, 6:, 3:6] = B, B.swapaxes(1, 2)
            out[at, 6:, 6:] = shapes.mass
        return out

    @property
    def led_mass_blocks(self) -> Array:
        """The same by unknowns, as centres of mass in frames that are held follow the shapes."""
        out, shapes = self.mass_blocks, self.of.shapes
        if shapes is not None and shapes.held.any():
            drift = shapes.drift @ self.R.swapaxes(1, 2)
            led = self.of.mass[:, None, None] * drift
            out[:, 6:, :3] += led
            out[:, :3, 6:] += led.swapaxes(1, 2)
            out[:, 6:, 6:] += led @ drift.swapaxes(1, 2)
        return out

    @property
    def given_mass_blocks(self) -> Array:
        """Those of bodies whose mass is given, zero for the others, shape (bodies, 6, 6) [kg]."""
        given = np.array([body.given for body in self.of.records], dtype=bool)
        return self.mass_blocks * given[:, None, None]

    @property
    def stored(self) -> float:
        """Energy that the bodies keep for their release [J]."""
        return self.of.stored

    @property
    def strain(self) -> float:
        """Strain energy U(q) of the bodies that deform [J]."""
        return float(self.strain_of_each.sum())

    @property
    def strain_of_each(self) -> Array:
        """U(q) of each body, zero of one that is rigid, shape (bodies,) [J]."""
        out = np.zeros(len(self))
        if (shapes := self.of.shapes) is not None:
            out[shapes.some] = self.of.strained[shapes.some] + shapes.energy(self.q[shapes.some])
        return out

    @cached_property
    def moved(self) -> Array:
        """Change of the pose since the freeze, shape (bodies, n, 3) [m, 1].

        a times it is a node's displacement since then, so rounded as that is: a body that has
        not moved is at rest, and strains nothing beside it.
        """
        return read_only(self.pose - self.of.frozen)

    @cached_property
    def momentum(self) -> Array:
        """Momenta m ṙ, shape (bodies, 3) [kg m/s]."""
        return read_only(self.of.mass[:, None] * self.velocity)

    @cached_property
    def weighted(self) -> Array:
        """See `ShapesOfBodies`; nothing where no body has shapes."""
        shapes = self.of.shapes
        return read_only(np.zeros(0) if shapes is None else shapes.weighted(self.q[shapes.some]))

    @cached_property
    def stretched(self) -> Array:
        """e(q) of shapes, shape (bodies, m) [m]."""
        if (shapes := self.of.shapes) is None or shapes.relieved is None:
            return self.q
        out = self.q.copy()
        out[shapes.some] = shapes.stretched(self.q[shapes.some])
        return read_only(out)

    @cached_property
    def momenta_of_shapes(self) -> tuple[Array, Array]:
        """Of bodies with shapes, what these add to J W [kg m²/s], and their p [kg m/s]."""
        if (shapes := self.of.shapes) is None:
            return read_only(np.zeros((0, 3))), read_only(np.zeros((0, 0)))
        W, rates = self.angular_velocity_body[shapes.some], self.q_rate[shapes.some]
        found = shapes.momenta(self.q[shapes.some], W, rates, self.weighted)
        return read_only(found[0]), read_only(found[1])

    @cached_property
    def own_momentum(self) -> Array:
        """J W, with B q̇, in the bodies' frames, shape (bodies, 3) [kg m²/s]."""
        own = times(self.of.inertia, self.angular_velocity_body)
        if self.of.shapes is not None:
            own[self.of.shapes.some] += self.momenta_of_shapes[0]
        return read_only(own)

    @cached_property
    def angular_momentum(self) -> Array:
        """π = R (J W + B q̇) about the centres of mass, shape (bodies, 3) [kg m²/s]."""
        return read_only(times(self.R, self.own_momentum))

    @cached_property
    def inertia(self) -> Array:
        """J of the bodies as they are deformed, shape (bodies, 3, 3) [kg m²]."""
        if (shapes := self.of.shapes) is None:
            return self.of.inertia
        out = self.of.inertia.copy()
        out[shapes.some] += shapes.added_inertia(self.q[shapes.some], self.weighted)
        return read_only(out)

    @cached_property
    def rotated_inertia(self) -> Array:
        """J Rᵀ, shape (bodies, 3, 3) [kg m²]."""
        return read_only(self.inertia @ self.R.swapaxes(1, 2))

    @property
    def kinetic(self) -> float:
        """Σ ½ m ṙ·ṙ + ½ w·A w [J]."""
        turning = np.vdot(self.own_momentum, self.angular_velocity_body)
        if self.of.shapes is not None:
            turning += np.vdot(self.momenta_of_shapes[1], self.q_rate[self.of.shapes.some])
        return 0.5 * float(np.vdot(self.momentum, self.velocity) + turning)

    @property
    def kinetic_of_each(self) -> Array:
        """Kinetic energy ½ m ṙ·ṙ + ½ w·A w of each, shape (bodies,) [J]."""
        twice = (self.momentum * self.velocity).sum(axis=1)
        twice = twice + (self.own_momentum * self.angular_velocity_body).sum(axis=1)
        if (shapes := self.of.shapes) is not None:
            twice[shapes.some] += (self.momenta_of_shapes[1] * self.q_rate[shapes.some]).sum(axis=1)
        return np.asarray(0.5 * twice)

    @property
    def kinetic_excess(self) -> Array:
        """Kinetic energy that each has only because masses are lumped, shape (bodies,) [J]."""
        W = self.angular_velocity_body
        return 0.5 * (W * times(self.of.excess, W)).sum(axis=1)

    @property
    def elastic_scale(self) -> float:
        """Size of the elastic forces of shapes [N]."""
        if (shapes := self.of.shapes) is None:
            return 0.0
        return float(np.linalg.norm(shapes.force + times(shapes.stiffness, self.q[shapes.some])))

    @cached_property
    def momentum_scale(self) -> float:
        """Σ |m ṙ| + |π|/ℓ [kg m/s]."""
        rotational = np.linalg.norm(self.angular_momentum, axis=1) / self.of.length
        return float(np.linalg.norm(self.momentum, axis=1).sum() + rotational.sum())


class _Bodies(Kind):
    """The bodies of a run, as a checkpoint keeps them: data over cells and nodes, and motions."""

    _frozen = Record(Frozen, "velocities")
    _shapes = Record(Shapes, "modes", "images", selves=Record(SelfStresses, "fields"))
    _over = "offsets", "displacement"
    _data = Record(RigidBody, *_over, cells="cells", frozen=_frozen, shapes=_shapes)

    def part(self, value: Any, order: MeshOrder) -> Any:
        motions = value.frame, value.velocity, value.angular_velocity_body, value.q, value.q_rate
        data = [self._data.part(one, order) for one in value.of.records]
        return [data, super().part(motions, order)]

    def own(self, whole: Any, order: MeshOrder) -> Bodies:
        data, motions = whole
        return Bodies(Ensemble(tuple(self._data.own(one, order) for one in data)), *motions)


BODIES = _Bodies()
