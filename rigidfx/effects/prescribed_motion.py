"""Nodes that are moved along a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Vector
from rigidfx.effects.support import Support

__all__ = ["PrescribedMotion"]


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
        return np.asarray(self.displacement(t), dtype=np.float64)

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The given velocity at t, or the difference quotient of the path just after t."""
        if self.velocity is not None:
            return np.asarray(self.velocity(t), dtype=np.float64)
        h = 1e-3 * dt
        u0, u1, u2 = (self.displacement_at(t + k * h) for k in range(3))
        return np.asarray((4 * u1 - 3 * u0 - u2) / (2 * h))

    def same_motion(self, other: Support) -> bool:
        """The same path given by the same function."""
        return isinstance(other, PrescribedMotion) and other.displacement == self.displacement

    def signal(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The velocity, while it acts."""
        return np.asarray(self.velocity_at(t, dt)) if self.acts(t) else np.zeros(3)
