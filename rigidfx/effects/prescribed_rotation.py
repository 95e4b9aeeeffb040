"""Nodes that are turned about an axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import is_function, scalar, shown, vector
from rigidfx.effects.base import Vector
from rigidfx.effects.support import Array, Support

__all__ = ["PrescribedRotation"]


@dataclass(frozen=True)
class PrescribedRotation(Support):
    """Turns the nodes of a named set about a fixed axis, as they lie in the undeformed body.

    A node at X moves by (R(φ(t)) - R(φ(t₀))) (X - c) from where it is at the start t₀. Its work is
    force times path, so that energy balances whatever Δt. The velocity of its nodes is 2 Δu/Δt less
    the one before, as everywhere: it alternates about ω × r by (ωΔt)²/12 of that.

    Attributes:
        axis: Direction of the axis, of any length; the angle counts by the right hand.
        through: A point of the axis, c [m].
        angle: Function t → φ [rad], such as a `Table`; only its increments count. An attribute
            `breakpoints` of it names the instants of its kinks.
        speed: Its derivative [rad/s]; by a one-sided second-order difference if None.
    """

    moves: ClassVar[bool] = True
    uniform: ClassVar[bool] = False

    axis: Vector = field(kw_only=True)
    through: Vector = field(default=(0.0, 0.0, 0.0), kw_only=True)
    angle: Callable[[float], float] = field(kw_only=True)
    speed: Callable[[float], float] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check axis and functions.

        Raises:
            SceneError: If the axis is no direction, or angle or speed is not a function.
        """
        super().__post_init__()
        if not vector(self, "axis", self.axis).any():
            raise SceneError(f"{self.owner}: axis must be a direction, got {self.axis!r}.")
        vector(self, "through", self.through)
        for name in ("angle", "speed"):
            f = getattr(self, name)
            if not is_function(f) and not (name == "speed" and f is None):
                raise SceneError(f"{self.owner}: {name} must be a function of t, got {shown(f)}.")

    @property
    def direction(self) -> Array:
        """Unit vector along the axis."""
        axis = np.asarray(self.axis, dtype=np.float64)
        return np.asarray(axis / np.linalg.norm(axis))

    def angular_velocity(self, t: float, dt: float) -> Array:
        """ω just after t, shape (3,) [rad/s]."""
        if self.speed is not None:
            return scalar(self.speed(t)) * self.direction
        h = 1e-3 * dt
        p0, p1, p2 = (scalar(self.angle(t + k * h)) for k in range(3))
        return (4 * p1 - 3 * p0 - p2) / (2 * h) * self.direction

    def displacements_at(self, t: float, X: Array) -> Array:
        """(R - I)(X - c) of some points, shape (points, 3) [m]."""
        arms = X - np.asarray(self.through)
        turn = scalar(self.angle(t)) * self.direction
        if not np.isfinite(turn).all():
            return np.full_like(X, np.nan)  # which is told by its name where it is looked at
        return np.asarray(Rotation.from_rotvec(turn).apply(arms) - arms).reshape(-1, 3)

    def velocities_at(self, t: float, dt: float, X: Array) -> Array:
        """ω × R (X - c) of some points just after t, shape (points, 3) [m/s]."""
        now = X - np.asarray(self.through) + self.displacements_at(t, X)
        return np.cross(self.angular_velocity(t, dt), now)

    @property
    def keeps_rigid(self) -> bool:
        """Whether it acts from the start on, where parts are as they were meshed."""
        return self.since <= 0.0

    def same_motion(self, other: Support) -> bool:
        """The same angle about the same axis."""
        return (
            isinstance(other, PrescribedRotation)
            and (other.angle, other.speed) == (self.angle, self.speed)
            and np.array_equal(other.direction, self.direction)
            and not np.cross(np.subtract(other.through, self.through), self.direction).any()
        )

    def signal(self, t: float, dt: float) -> Array:
        """The angular velocity, while it acts."""
        return self.angular_velocity(t, dt) if self.acts(t) else np.zeros(3)
