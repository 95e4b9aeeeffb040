"""Nodes that are moved along a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import numbers
from rigidfx.effects.base import Vector
from rigidfx.effects.support import Support

__all__ = ["PrescribedMotion"]

AGREES = 1e-2  # of a velocity: difference from a quotient of the path
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements


@dataclass(frozen=True)
class PrescribedMotion(Support):
    """Moves the nodes of a named set along a given path, from where they are at its start.

    Attributes:
        displacement: Function t → three components of the displacement [m]; only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s]; by a one-sided second-order difference if None. It is
            used where the motion begins and after each breakpoint.
    """

    moves: ClassVar[bool] = True

    displacement: Callable[[float], Vector] = field(kw_only=True)
    velocity: Callable[[float], Vector] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window, components and functions.

        Raises:
            SceneError: If displacement or velocity is not a function.
        """
        super().__post_init__()
        for name in ("displacement", "velocity"):
            f = getattr(self, name)
            if not callable(f) and not (name == "velocity" and f is None):
                raise SceneError(
                    f"PrescribedMotion on '{self.where}': {name} must be a function of t, "
                    f"got {f!r}."
                )

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """The given path at t."""
        return numbers(self.displacement(t))

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The given velocity at t, or the difference quotient of the path just after t."""
        if self.velocity is not None:
            return numbers(self.velocity(t))
        return self._quotient(t, 1e-3 * dt)

    def _quotient(self, t: float, h: float) -> npt.NDArray[np.float64]:
        """One-sided difference quotient of the path, of second order in h [s]."""
        u0, u1, u2 = (self.displacement_at(t + k * h) for k in range(3))
        return np.asarray((4 * u1 - 3 * u0 - u2) / (2 * h))

    def contradiction(self, t: float) -> str:
        """In what the given velocity contradicts the path just after t; "" if in nothing.

        The time in which a path changes is not known: the velocity is right if a difference
        quotient over any of several spans comes near it.

        Args:
            t: Time [s].
        """
        if self.velocity is None:
            return ""
        v = self.velocity_at(t, 1.0)
        size = np.abs(self.displacement_at(t)).max()
        quotients = []
        for h in 10.0 ** -np.arange(1, 10):
            q = self._quotient(t, h)
            noise = ROUNDING * (size + np.abs(q).max() * h) / h
            if np.abs(q - v).max() <= AGREES * np.abs(v).max() + noise:
                return ""
            quotients.append(q)
        off = [np.abs(a - b).max() for a, b in pairwise(quotients)]
        q = quotients[int(np.argmin(off))]  # where two spans agree best
        return f"at t = {t:g} s its velocity is {v} m/s, and its path moves by {q} m/s"

    def same_motion(self, other: Support) -> bool:
        """The same path and the same velocity, given by the same functions."""
        return (
            isinstance(other, PrescribedMotion)
            and other.displacement == self.displacement
            and other.velocity == self.velocity
        )

    def check(self, scene: Any) -> None:
        """See whether path and velocity can be used, and go together at the start and at kinks."""
        super().check(scene)
        together(scene.comm, f"{self.owner}: its path or velocity", self._check_velocity)

    def _check_velocity(self) -> None:
        for t in sorted({self.start, *(t for t in self.breakpoints if t > 0)}):
            wrong = self.contradiction(t) if t < self.until else ""
            if wrong:
                raise SceneError(
                    f"PrescribedMotion on '{self.where}': {wrong}. Give the path's derivative, or "
                    "no velocity at all."
                )

    def signal(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The velocity, while it acts."""
        return np.asarray(self.velocity_at(t, dt)) if self.acts(t) else np.zeros(3)
