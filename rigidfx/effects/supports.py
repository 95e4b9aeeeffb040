"""Supports: nodes held where they are, or moved along a given path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers
from rigidfx.effects.base import Vector, Windowed

__all__ = ["Fixed", "PrescribedMotion", "Support"]

AGREES = 1e-2  # of a velocity: difference from a quotient of the path
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements


@dataclass(frozen=True)
class Support(Windowed):
    """Prescribes components of the motion of a named set's nodes.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        components: Which of the components x, y, z are held, for example "xz".
    """

    where: str
    components: str = "xyz"

    def __post_init__(self) -> None:
        """Check window and components.

        Raises:
            SceneError: If components is no text, empty, or names anything but x, y, z once each.
        """
        super().__post_init__()
        c = self.components
        if not isinstance(c, str) or not c or set(c) - set("xyz") or len(set(c)) != len(c):
            raise SceneError(
                f"{type(self).__name__} on '{self.where}': components must be some of 'xyz', "
                f"each once, got {c!r}."
            )

    @property
    def axes(self) -> tuple[int, ...]:
        """The held components as numbers 0, 1, 2."""
        return tuple("xyz".index(c) for c in self.components)

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """Prescribed displacement, shape (3,) [m], up to a constant of no consequence."""
        raise NotImplementedError

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """Prescribed velocity just after t, shape (3,) [m/s].

        Args:
            t: Time [s].
            dt: Time step [s], the scale of the difference quotient where one is needed.
        """
        raise NotImplementedError

    def same_motion(self, other: Support) -> bool:
        """Whether both prescribe the same motion, so that they may share nodes."""
        raise NotImplementedError


@dataclass(frozen=True)
class Fixed(Support):
    """Holds the nodes of a named set where they are when the window begins."""

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """Zero."""
        return np.zeros(3)

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """Zero."""
        return np.zeros(3)

    def same_motion(self, other: Support) -> bool:
        """Two fixed supports never disagree."""
        return isinstance(other, Fixed)


@dataclass(frozen=True)
class PrescribedMotion(Support):
    """Moves the nodes of a named set along a given path, from where they are at its start.

    Attributes:
        displacement: Function t → three components of the displacement [m]; only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s]; by a one-sided second-order difference if None. It is
            used where the motion begins and after each breakpoint.
    """

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
