"""Supports that follow a user's path, whose velocity may be given beside it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

from rigidfx.base.errors import SceneError, together
from rigidfx.effects.supports.path_velocity import PathAndVelocity
from rigidfx.effects.supports.support import Support

__all__ = ["GuidedSupport"]


@dataclass(frozen=True)
class GuidedSupport(Support):
    """Refuses a velocity that is not the derivative of the path, where a run would use it."""

    moves: ClassVar[bool] = True

    @property
    def path_and_velocity(self) -> PathAndVelocity | None:
        """Path and given velocity, of held nodes; None without such a velocity."""
        raise NotImplementedError

    def check(self, scene: Any) -> None:
        """See whether path and velocity can be used, and go together at the start and at kinks."""
        super().check(scene)
        together(scene.comm, f"{self.owner}: its path or velocity", self._check_starts)

    def check_run(self, scene: Any, t_end: float) -> None:
        """See whether path and velocity go together in a run."""
        end = min(self.until, t_end)
        both = self.path_and_velocity
        if both is not None and self.start < end:
            together(
                scene.comm,
                f"{self.owner}: its path or velocity",
                lambda: self._refuse(both.contradiction_within(self.start, end, self.breakpoints)),
            )

    def _check_starts(self) -> None:
        both = self.path_and_velocity
        if both is None:
            return
        starts = sorted({self.start, *(t for t in self.breakpoints if self.start < t < self.until)})
        for t, end in pairwise([*starts, self.until]):
            self._refuse(both.contradiction_at(t, end) if t < end else "")

    def _refuse(self, wrong: str) -> None:
        if wrong:
            raise SceneError(
                f"{self.owner}: {wrong}. Give the path's derivative, or no velocity at all."
            )
