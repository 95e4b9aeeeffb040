"""Nodes that are moved along a path."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers
from rigidfx.base.types import Array
from rigidfx.effects.fields import PlaceAndTime, of_place, values_at
from rigidfx.effects.supports.path_velocity import GuidedSupport, PathAndVelocity
from rigidfx.effects.supports.support import Support, slope_after

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

    functions: ClassVar[tuple[str, str]] = "displacement", "velocity"

    displacement: PlaceAndTime = field(kw_only=True)
    velocity: PlaceAndTime | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if window, components or functions cannot be used."""
        super().__post_init__()
        if self.velocity is not None and of_place(self.velocity) == self.uniform:
            raise SceneError(
                f"{self.owner}: displacement and velocity must be functions of the same "
                "arguments, t or x, t."
            )

    @cached_property
    def uniform(self) -> bool:  # type: ignore[override]
        """Whether all its nodes move alike: the path is a function of time alone."""
        return not of_place(self.displacement)

    def displacements_at(self, t: float, X: Array) -> Array:
        """The path of some points at t, shape (3,) or (points, 3) [m]."""
        return self._values(self.displacement, t, X)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """The given velocity of some points at t, or the slope of their path just after t."""
        if self.velocity is not None:
            return self._values(self.velocity, t, X)
        return np.asarray(slope_after(partial(self.displacements_at, X=X), t, dt))

    def _values(self, function: Any, t: float, X: Array) -> Array:
        return numbers(function(t)) if self.uniform else values_at(function, X, t)

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
        X = self.points[:1]
        return PathAndVelocity(
            lambda t: self.displacements_at(t, X).ravel(),
            lambda t: self.velocities_at(t, 1.0, X, X).ravel(),
            self.axes,
        )

    def signal(self, t: float, dt: float) -> Array:
        """The velocity, while it acts."""
        some = self.points
        if not self.acts(t):
            return np.zeros(some.size)
        velocities = self.velocities_at(t, dt, some, some)
        return np.asarray(np.broadcast_to(velocities, some.shape)).ravel()
