"""Does the path of a support, or of an obstacle, jump?

A step treats a change of a path as a motion. Of a jump by J it makes the velocity 2 J/Δt, which
alternates in sign from then on, and an energy that grows as 1/Δt²: no shorter step ever helps.
Halving the interval halves the change of kinks and steep slopes, and not that of a jump. That takes
values of the path between the ends of steps, so it is looked at only where a path gains twice as
much as in the step before.

An obstacle that jumps does no harm where it stays clear of the nodes. Where it lands in them, or
leaves them while they press it, the step works against all of the jump: an energy that a shorter
step does not change, and that nobody may have meant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import PART, ByObject, Remembered
from rigidfx.base.types import Array
from rigidfx.base.uncaught import by_users
from rigidfx.effects import Contact, Obstacle, Support, Touch
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import Attempt, WarnsOnce

Path = Callable[[float], Array]

SUDDEN = 2.0  # times what the path gained in the step before
HALVINGS = 20  # of a step: a path that takes a millionth of it for its way jumps
NEGLIGIBLE = 0.5**HALVINGS  # of a cell's size: a ramp's gain there, if it moves a cell in a step
ROUNDING = 64 * float(np.finfo(np.float64).eps)  # of a displacement
REMEDY = (
    "Let the path take some steps for its way, and name the instants of its kinks by its attribute "
    "breakpoints."
)


class Gains:
    """Changes of paths from step to step, and whether by a jump."""

    remembered: ClassVar[Remembered] = {"_before": ByObject()}

    def __init__(self, scene: Scene) -> None:
        """Begin before the first step. Collective."""
        self._least = 2 * NEGLIGIBLE * scene.mean_cell_size  # a jump is half of it or more
        # By identity, what each path gained in its last step, and in the attempt under way.
        self._before: dict[int, float] = {}
        self._now: dict[int, float] = {}

    def jump(
        self, owner: object, path: Path, t0: float, t1: float, u0: Array, u1: Array
    ) -> tuple[float, float] | None:
        """When [s] and by how much [m] an owner's path jumps in an attempt; None if it does not.

        The path is u₀ at the start t₀ and u₁ at the end t₁, shape (n,) [m]; its exceptions go
        through.
        """
        gain = float(np.abs(u1 - u0).max())
        least = max(self._least, ROUNDING * float(np.abs(u1).max()))
        before = self._before.get(id(owner), 0.0)
        self._now[id(owner)] = gain
        if not gain > max(SUDDEN * before, least):
            return None
        return jump_of(path, t0, t1, u0, u1)

    def accept(self) -> None:
        """Accept the last attempt as a step."""
        self._before |= self._now


class Jumps(WarnsOnce):
    """Looks at the paths of supports, step by step; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | {"_gains": PART}

    def __init__(self, scene: Scene) -> None:
        """Begin before the first step. Collective."""
        super().__init__(scene.comm)
        self._gains, self._found = Gains(scene), ""

    def look(self, support: Support, t0: float, t1: float, u0: Array, u1: Array) -> None:
        """Look at an attempt at a step of a support; exceptions of its path go through.

        Its `path_at` t₀ is u₀, and u₁ at t₁, shape (n,) [m].
        """
        if not self.waits:
            return
        jump = self._gains.jump(support, support.path_at, t0, t1, u0, u1)
        if jump is not None:
            t, size = jump
            self._found = (
                f"{type(support).__name__} on '{support.where}': its path jumps by {size:.3g} m at "
                f"t = {t:.6g} s. The nodes get a velocity of {2 * size / (t1 - t0):.3g} m/s, twice "
                "the jump over Δt, that alternates in sign from then on, and shorter steps make it "
                f"larger. {REMEDY}"
            )

    def begin(self) -> None:
        """Begin an attempt at a step: findings of the last one are forgotten."""
        self._found = ""

    def accept(self, attempt: Attempt) -> None:
        """Accept the last attempt as a step, and warn of its findings."""
        self._gains.accept()
        if self._found and self.waits:
            self.say(self._found)


class JumpingObstacles(WarnsOnce):
    """Looks at the paths of obstacles in steps in which they press; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | {"_gains": PART}

    def __init__(self, scene: Scene, touches: Callable[[], Mapping[str, Touch]]) -> None:
        """Begin before the first step; touches are those of the last attempt, by titles.

        Collective.
        """
        super().__init__(scene.comm)
        every = ((c, c.against) for c in scene.named(Contact))
        self._moving = [(c, o) for c, o in every if not c.keeps_apart and o.path is not None]
        self._touches, self._gains = touches, Gains(scene)

    def _jump(self, obstacle: Obstacle, t0: float, t1: float) -> tuple[float, float] | None:
        path = obstacle.displacement
        return self._gains.jump(obstacle, path, t0, t1, path(t0), path(t1))

    def accept(self, attempt: Attempt) -> None:
        """Look at paths of obstacles that press in the step. Collective."""
        if not self._moving:
            return
        touches, found = self._touches(), ""
        for contact, obstacle in self._moving if self.waits else ():
            touch = touches.get(contact.title)
            if touch is None:
                continue
            look = partial(self._jump, obstacle, attempt.t, attempt.end)
            jump = by_users(self._comm, contact.owner, "path", look)
            if jump is None or not touch.pressing or found:
                continue
            t, size = jump
            found = (
                f"{contact.owner}: the path of the {obstacle.kind} jumps by {size:.3g} m at t = "
                f"{t:.6g} s, where nodes touch it: that step gives the structure "
                f"{touch.work:.3g} J by it, and {touch.energy:.3g} J are stored in the contact at "
                f"its end, at {touch.penetration:.3g} m of penetration, however short steps are. "
                f"{REMEDY}"
            )
        self._gains.accept()
        if found:
            self.say(found)


def jump_of(path: Path, t0: float, t1: float, u0: Array, u1: Array) -> tuple[float, float] | None:
    """When [s] and by how much [m] a path jumps, if by half of its way from t0 to t1 or more.

    It is u₀ at t₀ and u₁ at t₁, shape (n,) [m].
    """
    half = 0.5 * np.abs(u1 - u0).max()
    for _ in range(HALVINGS):
        t = 0.5 * (t0 + t1)
        if not t0 < t < t1:
            break
        u = path(t)
        if np.abs(u - u0).max() >= np.abs(u1 - u).max():
            t1, u1 = t, u
        else:
            t0, u0 = t, u
        if not np.abs(u1 - u0).max() > half * (1 + 1e-9):
            return None
    return t1, float(np.abs(u1 - u0).max())
