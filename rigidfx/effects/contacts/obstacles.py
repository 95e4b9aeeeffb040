"""Obstacles: things in the way that do not deform, at rest or moving along a path.

The gap of a point is taken in a variable that is at most quadratic in its position relative to the
obstacle, so that its increment in a step is an exact product m·Δy: see docs/theory/contact.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.inputs import direction, numbers, of_time, positive, truth, vector
from rigidfx.base.taken import Checks, check_fields, take_fields
from rigidfx.base.types import Array
from rigidfx.effects.base import Vector

TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Approach:
    """How the gaps of points change in a step: g₁ = g₀ + m·Δy.

    Attributes:
        m: Directions, shape (n, 3); of length one but for curved obstacles.
        dm: Their derivatives by y₁, shape (n, 3, 3) [1/m]; zero, for all, if None.
        dg: Derivatives of g₁ by y₁, shape (n, 3).
    """

    m: Array
    dm: Array | None
    dg: Array


@dataclass(frozen=True)
class Obstacle:
    """The base of all obstacles.

    Attributes:
        path: Function t → three components of its displacement [m], for one that moves; None for
            one at rest. An attribute `breakpoints` of it names the instants of its kinks.
    """

    checks: ClassVar[Checks] = {"path": of_time}

    path: Callable[[float], Vector] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Copy the values; raise `SceneError` if one cannot be used."""
        take_fields(self)
        check_fields(self, self.checks)

    @property
    def kind(self) -> str:
        """Its name."""
        return type(self).__name__

    @property
    def breakpoints(self) -> Any:
        """Instants of the kinks of its path [s]."""
        return getattr(self.path, "breakpoints", ())

    def displacement(self, t: float) -> Array:
        """How far it has moved at t [s], shape (3,) [m]."""
        return np.zeros(3) if self.path is None else numbers(self.path(t))

    def gap(self, y: Array) -> Array:
        """Distances of points y, shape (n, 3), less its displacement; negative inside, (n,) [m]."""
        raise NotImplementedError

    def outward(self, y: Array) -> Array:
        """Directions in which the gap grows, shape (n, 3)."""
        raise NotImplementedError

    def approach(self, y0: Array, y1: Array) -> Approach:
        """How gaps change from y0 to y1, shapes (n, 3) [m]."""
        raise NotImplementedError

    def __str__(self) -> str:
        """Its kind, in words of a table."""
        return self.kind if self.path is None else f"moving {self.kind}"


@dataclass(frozen=True)
class Plane(Obstacle):
    """A plane that keeps points on the side its normal points to.

    Attributes:
        point: Any point of it [m].
        normal: Its normal, of any length.
    """

    checks: ClassVar[Checks] = Obstacle.checks | {"point": vector, "normal": direction}

    point: Vector
    normal: Vector

    @cached_property
    def _n(self) -> Array:
        return direction(self.kind, "normal", self.normal)

    def gap(self, y: Array) -> Array:
        """Distance along the normal, shape (n,) [m]."""
        return np.asarray((y - np.asarray(self.point)) @ self._n)

    def outward(self, y: Array) -> Array:
        """The normal."""
        return np.broadcast_to(self._n, y.shape)

    def approach(self, y0: Array, y1: Array) -> Approach:
        """m = n."""
        n = self.outward(y0)
        return Approach(n, None, n)


@dataclass(frozen=True)
class Round(Obstacle):
    """The common part of sphere and cylinder: a centre, a radius and an inside.

    Attributes:
        centre: Centre of the sphere, or any point of the axis [m].
        radius: Radius [m].
        inside: Whether points are kept inside instead of outside.
    """

    checks: ClassVar[Checks] = Obstacle.checks | {
        "centre": vector,
        "radius": positive,
        "inside": truth,
    }

    centre: Vector
    radius: float
    inside: bool = field(default=False, kw_only=True)

    @property
    def _sign(self) -> float:
        return -1.0 if self.inside else 1.0

    @cached_property
    def _P(self) -> Array:
        return np.eye(3)

    def _arms(self, y: Array) -> Array:
        return np.asarray((y - np.asarray(self.centre)) @ self._P)

    def gap(self, y: Array) -> Array:
        """Distance from the surface, shape (n,) [m]."""
        distance = np.linalg.norm(self._arms(y), axis=1)
        return np.asarray(self._sign * (distance - self.radius))

    def outward(self, y: Array) -> Array:
        """Directions away from centre or axis, or towards it."""
        z = self._arms(y)
        length = np.maximum(np.linalg.norm(z, axis=1, keepdims=True), TINY)
        return np.asarray(self._sign * z / length)

    def approach(self, y0: Array, y1: Array) -> Approach:
        """m = ± 2 z½/(|z₀| + |z₁|)."""
        z0, z1 = self._arms(y0), self._arms(y1)
        ends = np.linalg.norm(z0, axis=1), np.linalg.norm(z1, axis=1)
        both = np.maximum(ends[0] + ends[1], TINY)[:, None]
        m = self._sign * (z0 + z1) / both
        end = z1 / np.maximum(ends[1], TINY)[:, None]
        dm = (self._sign * self._P - m[:, :, None] * end[:, None]) / both[:, :, None]
        return Approach(m, dm, self._sign * end)


@dataclass(frozen=True)
class Sphere(Round):
    """A sphere, or a hollow one that keeps points inside."""


@dataclass(frozen=True)
class Cylinder(Round):
    """An infinite circular cylinder, or a tube that keeps points inside.

    Attributes:
        axis: Direction of its axis, of any length.
    """

    checks: ClassVar[Checks] = Round.checks | {"axis": direction}

    axis: Vector = (0.0, 0.0, 1.0)

    @cached_property
    def _P(self) -> Array:
        a = direction(self.kind, "axis", self.axis)
        return np.asarray(np.eye(3) - np.outer(a, a))
