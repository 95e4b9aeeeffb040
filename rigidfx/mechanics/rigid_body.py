"""One body: its data and its motion.

A body is frozen in the configuration of an instant: Vᵢ = xᵢ - x_s are its nodes' positions relative
to the centre of mass, and x_i = r + R Vᵢ from then on; r + R (Vᵢ + Φᵢ q) if it has `shapes`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from rigidfx.base.sealed import Sealed
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.mechanics.shapes import Shapes


@dataclass(frozen=True)
class Frozen(Sealed):
    """Energy and velocities that a body keeps for its release; its offsets keep the shape."""

    nodes: Indices  # owned nodes on this rank whose velocity the freeze changed
    velocities: Array  # Rᵀ (v - v_rigid) at these nodes, shape (nodes, 3) [m/s]; equation (40)
    strain: float  # strain energy of its cells [J]
    # Kinetic energy that the freeze took out of the motion; beside a support that moves it may be
    # less than zero, with a consistent mass [J]
    vibration: float

    @property
    def energy(self) -> float:
        """Energy that the body gives back [J]."""
        return self.strain + self.vibration


NOTHING = Frozen(np.empty(0, np.int32), np.empty((0, 3)), 0.0, 0.0)


@dataclass(frozen=True)
class RigidBody(Sealed):
    """The constant data of a body."""

    name: str  # its name in reports, that of a set of cells where a `Rigid` effect named it
    cells: Indices  # owned cells on this rank, sorted
    nodes: Indices  # owned nodes on this rank, sorted
    offsets: Array  # V of these nodes in the body's frame, shape (nodes, 3) [m]
    displacement: Array  # their displacement at the freeze, shape (nodes, 3) [m]
    mass: float  # m [kg]
    inertia: Array  # J about the centre of mass in the body's frame, shape (3, 3) [kg m²]
    origin: Array  # centre of mass at the freeze, shape (3,) [m]
    number: int = 1  # its number ≥ 1, which no other body of the run has had
    size: int = 0  # number of its cells over all ranks
    named: tuple[str, ...] = ()  # sets of cells in it that are rigid always
    given: bool = False  # whether mass or inertia are given in place of those of its cells
    frozen: Frozen = NOTHING  # energy and velocities kept for its release
    # The part of J due to lumped masses only, shape (3, 3) [kg m²]
    excess: Array = field(default_factory=lambda: np.zeros((3, 3)))
    # ℓ of a rigid face whose nodes' mass is in the cells beside it, and of a carried mass, whose J
    # is next to nothing [m]; None where the body's own mass tells ℓ
    extent: float | None = None
    shapes: Shapes | None = None  # by which it deforms; None if it is rigid

    @cached_property
    def length(self) -> float:
        """ℓ = sqrt(tr J/(2 m)), the radius of gyration that scales rotations [m]."""
        if self.extent is not None:
            return self.extent
        return float(np.sqrt(np.trace(self.inertia) / (2 * self.mass)))

    @cached_property
    def mass_products(self) -> Array:
        """Σ m a aᵀ about its centre of mass, shape (n, n) [kg, kg m²]."""
        n = 4 + 3 * self.deforms_by
        out = np.zeros((n, n))
        if self.shapes is not None:
            out[1:, 1:] = self.shapes.moments.swapaxes(1, 2).reshape(n - 1, n - 1)
        out[0, 0] = self.mass
        out[1:4, 1:4] = 0.5 * np.trace(self.inertia) * np.eye(3) - self.inertia
        return out

    @property
    def deforms_by(self) -> int:
        """Number of its shapes."""
        return 0 if self.shapes is None else len(self.shapes)

    def coordinates(self, at: npt.NDArray[np.integer] | slice = slice(None)) -> Array:
        """a = [1, V, Φ₁, ..., Φ_m] of its nodes, or some, shape (nodes, 4 + 3 m) [1, m, 1]."""
        V = self.offsets[at]
        parts = [np.ones((len(V), 1)), V]
        if self.shapes is not None:
            parts.append(self.shapes.modes[at].reshape(len(V), 3 * len(self.shapes)))
        return np.concatenate(parts, axis=1)

    @property
    def is_face(self) -> bool:
        """Whether it is a rigid face: nodes without cells."""
        return self.size == 0

    @cached_property
    def inertia_ratio(self) -> float:
        """Largest ratio, about any axis, of J to that without lumping."""
        if not self.excess.any():
            return 1.0
        L = np.linalg.inv(np.linalg.cholesky(self.inertia))
        return float(1 / (1 - np.linalg.eigvalsh(L @ self.excess @ L.T)[-1]))


def _no_shapes() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class BodyMotion:
    """Pose and velocity of a body."""

    r: Array  # position of the centre of mass, shape (3,) [m]
    R: Array  # rotation since the freeze, shape (3, 3)
    velocity: Array  # ṙ, shape (3,) [m/s]
    angular_velocity_body: Array  # W, angular velocity in the body's frame, shape (3,) [rad/s]
    q: Array = field(default_factory=_no_shapes)  # coordinates of its shapes, shape (m,) [m]
    q_rate: Array = field(default_factory=_no_shapes)  # their rates, likewise [m/s]

    @property
    def angular_velocity(self) -> Array:
        """ω = R W in space [rad/s]."""
        return np.asarray(self.R @ self.angular_velocity_body)

    def velocities(self, offsets: Array) -> Array:
        """Velocities ṙ + ω × R V for offsets of shape (n, 3) [m/s]; equation (2)."""
        return np.asarray(self.velocity + np.cross(self.angular_velocity, offsets @ self.R.T))


@dataclass(frozen=True)
class Body:
    """A body at an instant: its constant data, and its pose and velocity."""

    data: RigidBody
    motion: BodyMotion

    @property
    def offsets(self) -> Array:
        """V + Φ q of its owned nodes in its frame, shape (nodes, 3) [m]."""
        offsets, shapes = self.data.offsets, self.data.shapes
        return offsets if shapes is None else offsets + shapes.bent(self.motion.q)

    @property
    def displacement(self) -> Array:
        """Displacement of its owned nodes, shape (nodes, 3) [m]; see `Bodies.moved`."""
        data, motion = self.data, self.motion
        moved = motion.r - data.origin + data.offsets @ (motion.R - np.eye(3)).T
        if data.shapes is not None:
            moved = moved + data.shapes.bent(motion.q) @ motion.R.T
        return np.asarray(data.displacement + moved)

    @property
    def velocities(self) -> Array:
        """Velocities of its owned nodes, shape (nodes, 3) [m/s]."""
        rigid, shapes = self.motion.velocities(self.offsets), self.data.shapes
        if shapes is None:
            return rigid
        return np.asarray(rigid + shapes.bent(self.motion.q_rate) @ self.motion.R.T)

    @property
    def stretched(self) -> tuple[Array, Array]:
        """e of its shapes, which it has, and its rate, each (m,) [m, m/s]."""
        assert self.data.shapes is not None
        return self.data.shapes.stretched(self.motion.q, self.motion.q_rate)

    def with_shapes(self, shapes: Shapes) -> Body:
        """The body with shapes, of which it has had the first ones; others are at q = q̇ = 0."""
        q, rate = np.zeros((2, len(shapes)))
        q[: self.motion.q.size], rate[: self.motion.q.size] = self.motion.q, self.motion.q_rate
        if self.data.shapes is not None:
            shapes = shapes.begun(q, self.data.shapes, self.motion.q)
        data = replace(self.data, shapes=shapes)
        return Body(data, replace(self.motion, q=q, q_rate=rate))


def outside(nodes: int, bodies: Iterable[RigidBody]) -> Bools:
    """Which of so many owned nodes are in none of some bodies."""
    out = np.ones(nodes, dtype=bool)
    for body in bodies:
        out[body.nodes] = False
    return out
