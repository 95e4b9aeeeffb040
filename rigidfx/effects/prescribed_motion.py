"""Nodes that are moved along a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import is_function, numbers, shown
from rigidfx.effects.base import Vector
from rigidfx.effects.path_velocity import PathAndVelocity
from rigidfx.effects.support import Support

__all__ = ["PrescribedMotion"]


@dataclass(frozen=True)
class PrescribedMotion(Support):
    """Moves the nodes of a named set along a given path, from where they are at its start.

    Attributes:
        displacement: Function t → three components of the displacement [m]; only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s]; by a one-sided second-order difference if None. It is
            used where the motion begins and after each breakpoint, and its changes are changes of
            a load. Both are compared: there by the scene, and before a run at some instants of it.
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
            if not is_function(f) and not (name == "velocity" and f is None):
                raise SceneError(
                    f"PrescribedMotion on '{self.where}': {name} must be a function of t, "
                    f"got {shown(f)}."
                )

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """The given path at t."""
        return numbers(self.displacement(t))

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The given velocity at t, or the difference quotient of the path just after t."""
        if self.velocity is not None:
            return numbers(self.velocity(t))
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

    def check(self, scene: Any) -> None:
        """See whether path and velocity can be used, and go together at the start and at kinks."""
        super().check(scene)
        together(scene.comm, f"{self.owner}: its path or velocity", self._check_starts)

    def check_run(self, scene: Any, t_end: float) -> None:
        """See whether path and velocity go together in a run."""
        end = min(self.until, t_end)
        both = self._both
        if both is not None and self.start < end:
            together(
                scene.comm,
                f"{self.owner}: its path or velocity",
                lambda: self._refuse(both.contradiction_within(self.start, end, self.breakpoints)),
            )

    @property
    def _both(self) -> PathAndVelocity | None:
        """Path and given velocity, of the held components; None without such a velocity."""
        if self.velocity is None:
            return None
        velocity = self.velocity
        return PathAndVelocity(self.displacement_at, lambda t: numbers(velocity(t)), self.axes)

    def _check_starts(self) -> None:
        both = self._both
        if both is None:
            return
        starts = sorted({self.start, *(t for t in self.breakpoints if self.start < t < self.until)})
        for t, end in pairwise([*starts, self.until]):
            self._refuse(both.contradiction_at(t, end) if t < end else "")

    def _refuse(self, wrong: str) -> None:
        if wrong:
            raise SceneError(
                f"PrescribedMotion on '{self.where}': {wrong}. Give the path's derivative, or "
                "no velocity at all."
            )

    def signal(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The velocity, while it acts."""
        return np.asarray(self.velocity_at(t, dt)) if self.acts(t) else np.zeros(3)
