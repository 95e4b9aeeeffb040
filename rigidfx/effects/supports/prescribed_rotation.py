"""Nodes that are turned about an axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import direction, scalar, shown, vector
from rigidfx.base.types import Array
from rigidfx.effects.base import Vector
from rigidfx.effects.supports.path_velocity import GuidedSupport, PathAndVelocity
from rigidfx.effects.supports.support import Support, slope_after

__all__ = ["PrescribedRotation"]


@dataclass(frozen=True)
class PrescribedRotation(GuidedSupport):
    """Rotates the nodes of a named set about a fixed axis, from their positions at its start.

    In a step from t₀ to t₁ a node at x moves by (R(φ(t₁) - φ(t₀)) - I) (x - c), with c
    a point of the axis. Its work is force times path, so energy balances for any Δt. The velocity
    of its nodes is 2 Δu/Δt minus the one before, as at all nodes: it alternates about ω × r with
    the relative amplitude (ωΔt)²/12. Reactions do not, but for vibrating parts: `ResolvedForces`.

    Attributes:
        axis: Direction of the axis, of any length; the angle counts by the right hand.
        through: A point of the axis, c [m].
        angle: Function t → φ [rad], such as a `Table`; only its increments count. An attribute
            `breakpoints` of it names the instants of its kinks.
        speed: Its derivative [rad/s]; by a one-sided second-order difference if None. Both are
            compared, as the path and the velocity of a `PrescribedMotion` are.
    """

    uniform: ClassVar[bool] = False
    functions: ClassVar[tuple[str, str]] = "angle", "speed"

    axis: Vector = field(kw_only=True)
    through: Vector = field(default=(0.0, 0.0, 0.0), kw_only=True)
    angle: Callable[[float], float] = field(kw_only=True)
    speed: Callable[[float], float] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if axis or functions cannot be used."""
        super().__post_init__()
        direction(self, "axis", self.axis)
        vector(self, "through", self.through)

    @property
    def direction(self) -> Array:
        """Unit vector along the axis."""
        return direction(self, "axis", self.axis)

    def _asked(self, name: str, t: float) -> float:
        """Angle or speed at t."""
        given = getattr(self, name)(t)
        value = scalar(given)
        if not isfinite(value):
            raise SceneError(
                f"{self.owner}: at t = {t:g} s {name} must be a finite number, got {shown(given)}."
            )
        return value

    def angular_velocity(self, t: float, dt: float) -> Array:
        """ω just after t, shape (3,) [rad/s]."""
        if self.speed is not None:
            return self._asked("speed", t) * self.direction
        return slope_after(partial(self._asked, "angle"), t, dt) * self.direction

    @property
    def path_and_velocity(self) -> PathAndVelocity | None:
        """The angle and the given speed, as vectors along the axis."""
        speed, axis = self.speed, self.direction
        if speed is None:
            return None
        return PathAndVelocity(
            lambda t: scalar(self.angle(t)) * axis,
            lambda t: scalar(speed(t)) * axis,
            (0, 1, 2),
            "rad",
        )

    def displacements_at(self, t: float, X: Array) -> Array:
        """(R - I)(X - c) of some points, shape (points, 3) [m]."""
        return self._turned(self._asked("angle", t), X)

    def increments_of(self, t0: float, t1: float, X: Array, x: Array) -> Array:
        """(R(φ₁ - φ₀) - I)(x - c) of some points, shape (points, 3) [m]."""
        return self._turned(self._asked("angle", t1) - self._asked("angle", t0), x)

    def _turned(self, angle: float, x: Array) -> Array:
        arms = x - np.asarray(self.through)
        turn = Rotation.from_rotvec(angle * self.direction)
        return np.asarray(turn.apply(arms) - arms).reshape(-1, 3)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """ω × (x - c) of some points just after t, shape (points, 3) [m/s]."""
        return np.cross(self.angular_velocity(t, dt), x - np.asarray(self.through))

    @property
    def keeps_rigid(self) -> bool:
        """True: a rotation strains nothing."""
        return True

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
