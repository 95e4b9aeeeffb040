"""Does the path of a support, or of an obstacle, jump?

Of a jump by J a step makes the velocity 2 J/Δt, which alternates in sign from then on. Halving the
interval halves the change of kinks and steep slopes, and not that of a jump. A smooth path takes
one to three more values for that. An obstacle that jumps does no harm where it stays clear of the
nodes; else the step works against all of the jump, and no shorter step changes that.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered
from rigidfx.base.types import Array
from rigidfx.base.uncaught import by_users
from rigidfx.effects import Contact, Touch
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.supports import PrescribedDofs
from rigidfx.step.watches.judge import Attempt, WarnsOnce

Path = Callable[[float], Array]

HALVINGS = 20  # of a step: a path that takes a millionth of it for its way jumps
NEGLIGIBLE = 0.5**HALVINGS  # of a cell's size: a ramp's gain there, if it moves a cell in a step
ROUNDING = 64 * float(np.finfo(np.float64).eps)  # of a displacement
REMEDY = (
    "Let the path take some steps for its way, and name the instants of its kinks by its attribute "
    "breakpoints."
)


class PathWatch(WarnsOnce):
    """Looks at paths that move; warns once."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered

    def __init__(self, scene: Scene) -> None:
        """Begin before the first step. Collective."""
        super().__init__(scene.comm)
        self._least = 2 * NEGLIGIBLE * scene.mean_cell_size

    def _jump(
        self, owner: str, path: Path, at_ends: Path, t0: float, t1: float
    ) -> tuple[float, float] | None:
        """See `jump_of`; its function of the owner fails by name. Collective."""
        look = partial(jump_of, path, at_ends, t0, t1, self._least)
        return by_users(self._comm, owner, "path", look)


class Jumps(PathWatch):
    """Looks at the paths of supports, step by step; warns once."""

    remembered: ClassVar[Remembered] = PathWatch.remembered

    def __init__(self, scene: Scene, prescribed: Callable[[], PrescribedDofs]) -> None:
        """Begin before the first step, with the dofs that supports hold in each. Collective."""
        super().__init__(scene)
        self._prescribed = prescribed

    def accept(self, attempt: Attempt) -> None:
        """Look at the paths of supports that move. Collective."""
        held, (t0, dt) = self._prescribed(), (attempt.t, attempt.dt)
        for support in held.active:
            if not (support.moves and self.waits):
                continue
            at_ends = partial(held.path_at, support)  # values that the step has had
            if jump := self._jump(support.owner, support.path_at, at_ends, t0, t0 + dt):
                t, size = jump
                self.say(
                    f"{type(support).__name__} on '{support.where}': its path jumps by "
                    f"{size:.3g} m at t = {t:.6g} s. The nodes get a velocity of "
                    f"{2 * size / dt:.3g} m/s, twice the jump over Δt, that alternates in sign "
                    f"from then on, and shorter steps make it larger. {REMEDY}"
                )


class JumpingObstacles(PathWatch):
    """Looks at the paths of obstacles in steps in which they press; warns once."""

    remembered: ClassVar[Remembered] = PathWatch.remembered

    def __init__(self, scene: Scene, touches: Callable[[], Mapping[str, Touch]]) -> None:
        """Begin with a function of the touches of the last attempt, by titles. Collective."""
        super().__init__(scene)
        every = ((c, c.against) for c in scene.named(Contact))
        self._moving = [(c, o) for c, o in every if not c.keeps_apart and o.path is not None]
        self._touches = touches

    def accept(self, attempt: Attempt) -> None:
        """Look at paths of obstacles that press in the step. Collective."""
        touches = self._touches() if self._moving and self.waits else {}
        for contact, obstacle in self._moving:
            touch, path = touches.get(contact.title), obstacle.displacement
            if touch is None or not (touch.pressing and self.waits):
                continue
            if jump := self._jump(contact.owner, path, path, attempt.t, attempt.end):
                t, size = jump
                self.say(
                    f"{contact.owner}: the path of the {obstacle.kind} jumps by {size:.3g} m at "
                    f"t = {t:.6g} s, where nodes touch it: that step gives the structure "
                    f"{touch.work:.3g} J by it, and {touch.energy:.3g} J are stored in the contact "
                    f"at its end, at {touch.penetration:.3g} m of penetration, however short steps "
                    f"are. {REMEDY}"
                )


def jump_of(
    path: Path, at_ends: Path, t0: float, t1: float, least: float
) -> tuple[float, float] | None:
    """When [s] and by how much [m] a path jumps, if by half of its way from t0 to t1 or more.

    Values at the ends of that, shape (n,) [m], are given, and its way is more than a least one [m];
    exceptions go through.
    """
    u0, u1 = at_ends(t0), at_ends(t1)
    way = float(np.abs(u1 - u0).max())
    if not way > max(least, ROUNDING * float(np.abs(u1).max())):
        return None
    for _ in range(HALVINGS):
        t = 0.5 * (t0 + t1)
        if not t0 < t < t1:
            break
        u = path(t)
        if np.abs(u - u0).max() >= np.abs(u1 - u).max():
            t1, u1 = t, u
        else:
            t0, u0 = t, u
        if not np.abs(u1 - u0).max() > 0.5 * way * (1 + 1e-9):
            return None
    return t1, float(np.abs(u1 - u0).max())
