"""Nodes that are moved along a path."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import is_function, numbers, shown
from rigidfx.base.types import Array
from rigidfx.effects.fields import PlaceAndTime, of_place, values_at
from rigidfx.effects.supports.path_velocity import GuidedSupport, PathAndVelocity
from rigidfx.effects.supports.support import Support

__all__ = ["PrescribedMotion"]


@dataclass(frozen=True)
class PrescribedMotion(GuidedSupport):
    """Moves the nodes of a named set along a given path, from where they are at its start.

    Attributes:
        displacement: Function t → three components of the displacement [m], or function x, t of
            reference positions of shape (3, n) too, which gives shape (3, n); only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s], of the same arguments; by a one-sided second-order
            difference if None. It is used at the start of the motion and after each breakpoint.
            A wrong derivative is an error: path and velocity are compared at one node.
    """

    displacement: PlaceAndTime = field(kw_only=True)
    velocity: PlaceAndTime | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window, components and functions.

        Raises:
            SceneError: If displacement or velocity is not a function.
        """
        super().__post_init__()
        for name in ("displacement", "velocity"):
            f = getattr(self, name)
            if not is_function(f) and not (name == "velocity" and f is None):
                raise SceneError(
                    f"PrescribedMotion on '{self.where}': {name} must be a function of t, "
                    f"got {shown(f)}."
                )
        if self.velocity is not None and of_place(self.velocity) == self.uniform:
            raise SceneError(
                f"PrescribedMotion on '{self.where}': displacement and velocity must be functions "
                "of the same arguments, t or x, t."
            )

    @cached_property
    def uniform(self) -> bool:  # type: ignore[override]
        """Whether all its nodes move alike: the path is a function of time alone."""
        return not of_place(self.displacement)

    def displacements_at(self, t: float, X: Array) -> Array:
        """The path of some points at t, shape (3,) or (points, 3) [m]."""
        return self.displacement_at(t) if self.uniform else values_at(self.displacement, X, t)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """The velocity of some points just after t, shape (3,) or (points, 3) [m/s]."""
        if self.uniform:
            return self.velocity_at(t, dt)
        if self.velocity is not None:
            return values_at(self.velocity, X, t)
        h = 1e-3 * dt
        u0, u1, u2 = (self.displacements_at(t + k * h, X) for k in range(3))
        return np.asarray((4 * u1 - 3 * u0 - u2) / (2 * h))

    def displacement_at(self, t: float) -> Array:
        """The given path at t, of all nodes."""
        path: Any = self.displacement
        return numbers(path(t))

    def velocity_at(self, t: float, dt: float) -> Array:
        """The given velocity at t, or the difference quotient of the path just after t."""
        if self.velocity is not None:
            velocity: Any = self.velocity
            return numbers(velocity(t))
        h = 1e-3 * dt
        u0, u1, u2 = u = [self.displacement_at(t + k * h) for k in range(3)]
        for given in u:
            if given.shape != (3,):
                return given  # which is told by its name where it is looked at
        return np.asarray((4 * u1 - 3 * u0 - u2) / (2 * h))

    def same_motion(self, other: Support) -> bool:
        """The same path and the same velocity, given by the same functions."""
        return (
            isinstance(other, PrescribedMotion)
            and other.displacement == self.displacement
            and other.velocity == self.velocity
        )

    @property
    def path_and_velocity(self) -> PathAndVelocity | None:
        """Path and given velocity, of the held components; None without such a velocity."""
        if self.velocity is None:
            return None
        if not self.uniform:
            X = self._points[:1]
            return PathAndVelocity(
                lambda t: self.displacements_at(t, X)[0],
                lambda t: self.velocities_at(t, 1.0, X, X)[0],
                self.axes,
            )
        velocity: Any = self.velocity
        return PathAndVelocity(self.displacement_at, lambda t: numbers(velocity(t)), self.axes)

    def signal(self, t: float, dt: float) -> Array:
        """The velocity, while it acts."""
        some = np.zeros((1, 3)) if self.uniform else self._points
        if not self.acts(t):
            return np.zeros(some.size)
        return np.asarray(
            np.broadcast_to(self.velocities_at(t, dt, some, some), some.shape)
        ).ravel()
