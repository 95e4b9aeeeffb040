"""The rigid bodies of a partition as arrays: their data and their motions.

All arrays begin with an axis over the bodies, so that a step with many of them takes as many calls
of NumPy as one with a single body.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.rigid_body import BodyMotion, RigidBody
from rigidfx.mechanics.rotation import UNIT_SKEWS

__all__ = ["TRANSLATIONS", "Ensemble", "Motions", "poses", "times"]

Array = npt.NDArray[np.float64]


# How a body's twelve numbers depend on its translation, see `Increments.L`.
TRANSLATIONS = np.eye(12, 6) * (np.arange(6) < 3)


class Ensemble:
    """What does not change of the bodies of a layout.

    Attributes:
        mass: m, shape (bodies,) [kg].
        inertia: J about the centres of mass, shape (bodies, 3, 3) [kg m²].
        length: ℓ, shape (bodies,) [m].
        square_length: ℓ², shape (bodies, 1, 1) [m²].
        frames: The part of `Increments.L` that does not turn, shape (bodies, 12, 6).
        skews: v times them is -v̂/ℓ, row by row; shape (bodies, 3, 9) [1/m].
    """

    def __init__(self, bodies: Sequence[RigidBody]) -> None:
        """Stack the bodies' data."""
        self.mass = np.array([body.mass for body in bodies], dtype=np.float64)
        self.inertia = np.reshape([body.inertia for body in bodies], (-1, 3, 3))
        self.length = np.array([body.length for body in bodies], dtype=np.float64)
        self.square_length = (self.length**2)[:, None, None]
        self.skews = UNIT_SKEWS / -self.length[:, None, None]
        self.frames = np.tile(TRANSLATIONS, (self.mass.size, 1, 1))
        self._last: tuple[tuple[BodyMotion, ...], Motions] | None = None

    def moving(self, motions: tuple[BodyMotion, ...]) -> Motions:
        """These motions as arrays; one step after another asks for the same."""
        if self._last is None or self._last[0] is not motions:
            self._last = motions, Motions(self, motions)
        return self._last[1]


class Motions:
    """Motions of the bodies of an ensemble.

    Attributes:
        of: The bodies' data.
        pose: Rows r and Rᵀ, shape (bodies, 4, 3) [m, 1]: a node is at [1, V] times them.
        R: Rotations since the freeze, shape (bodies, 3, 3).
        velocity: ṙ, shape (bodies, 3) [m/s].
        angular_velocity_body: W, angular velocities in the bodies' frames, shape (bodies, 3)
            [rad/s].
    """

    def __init__(self, ensemble: Ensemble, motions: Sequence[BodyMotion]) -> None:
        """Stack the motions.

        Args:
            ensemble: Data of the bodies.
            motions: Their motions.
        """
        self.of = ensemble
        self.pose = poses(motions)
        self.R = self.pose[:, 1:].swapaxes(1, 2)
        self.velocity = np.reshape([m.velocity for m in motions], (-1, 3))
        self.angular_velocity_body = np.reshape([m.angular_velocity_body for m in motions], (-1, 3))

    def __len__(self) -> int:
        """Number of bodies."""
        return len(self.pose)

    @property
    def r(self) -> Array:
        """Positions of the centres of mass, shape (bodies, 3) [m]."""
        return self.pose[:, 0]

    @property
    def angular_velocity(self) -> Array:
        """ω = R W in space, shape (bodies, 3) [rad/s]."""
        return times(self.R, self.angular_velocity_body)

    @cached_property
    def momentum(self) -> Array:
        """Momenta m ṙ, shape (bodies, 3) [kg m/s]."""
        return self.of.mass[:, None] * self.velocity

    @cached_property
    def own_momentum(self) -> Array:
        """J W in the bodies' frames, shape (bodies, 3) [kg m²/s]."""
        return times(self.of.inertia, self.angular_velocity_body)

    @cached_property
    def angular_momentum(self) -> Array:
        """π = R J W about the centres of mass, shape (bodies, 3) [kg m²/s]."""
        return times(self.R, self.own_momentum)

    @cached_property
    def rotated_inertia(self) -> Array:
        """J Rᵀ, shape (bodies, 3, 3) [kg m²]."""
        return self.of.inertia @ self.R.swapaxes(1, 2)

    @property
    def kinetic(self) -> float:
        """Σ ½ m ṙ·ṙ + ½ W·J W [J]."""
        turning = np.vdot(self.own_momentum, self.angular_velocity_body)
        return 0.5 * float(np.vdot(self.momentum, self.velocity) + turning)

    @cached_property
    def momentum_scale(self) -> float:
        """Σ |m ṙ| + |π|/ℓ [kg m/s]."""
        rotational = np.linalg.norm(self.angular_momentum, axis=1) / self.of.length
        return float(np.linalg.norm(self.momentum, axis=1).sum() + rotational.sum())


def poses(motions: Sequence[BodyMotion]) -> Array:
    """`Motions.pose` of motions."""
    return np.reshape([[motion.r, *motion.R.T] for motion in motions], (-1, 4, 3))


def times(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector, shapes (n, 3, 3) and (n, 3)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
