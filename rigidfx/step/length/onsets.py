"""Steps that are shortened because the load at their middle differs from its mean.

A step evaluates loads at its middle. The jerk of the motion shows this error for smooth loads, but
not for a load that jumps or begins after the middle. So loads that are functions of the user's are
evaluated at five times before a step. If Simpson's means of five and three samples differ by more
than `tol` of the change of the load so far, or if the mean differs from the value at the middle by
more than 1/20 of it, bisection finds the longest step without such a difference. A step ends just
after a jump, and Δt starts anew there.

Time windows, kinks of a `Table` and `breakpoints` are known without this. A sine of two steps a
period may be zero at all middles and in all means, and is missed.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from rigidfx.base.errors import together
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.scene.scene import Scene
from rigidfx.step.length.given import Given, given_loads

__all__ = ["Onset", "Onsets"]

CLOSE = 1e-5  # of a step, to which bisection finds its end


class Onset(NamedTuple):
    """Time t [s] at which a step has to end.

    `jumps` if a load jumps just before it, `led` if that is the velocity of a support's path.
    """

    t: float
    jumps: bool = False
    led: bool = False


class Onsets:
    """Finds such times among the loads of a scene that are functions of the user's."""

    remembered: ClassVar[Remembered] = same() | {"_loads": PART}

    def __init__(self, scene: Scene) -> None:
        """Collect these loads. Collective."""
        self._comm, self._loads = scene.comm, given_loads(scene)

    def within(self, t: float, end: float, shortest: float, tol: float) -> Onset | None:
        """Time at which a step has to end early; None if it may be whole. Collective.

        Args:
            t: Start of the step [s].
            end: Its end [s].
            shortest: Length that is always short enough [s].
            tol: Error of a load's mean that does not matter, over its change so far.

        Raises:
            SceneError: On every rank, if a load's function fails on any, or gives two values.
        """
        if not self._loads:
            return None

        def first() -> Onset | None:
            found = [_end_of(given, t, end, shortest, tol) for given in self._loads]
            return min((onset for onset in found if onset), default=None)

        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        return self._comm.bcast(together(self._comm, "A load", first))


def _end_of(given: Given, t: float, end: float, shortest: float, tol: float) -> Onset | None:
    """Where a step has to end for the sake of one load; None if it has not."""
    if given.off(t, end, tol) <= 1:
        return None
    good, last = t, end
    while last - good > CLOSE * (end - t):
        middle = (good + last) / 2
        good, last = (middle, last) if given.off(t, middle, tol) <= 1 else (good, middle)
    jumps = given.jumps(good, last)
    return Onset(min(max(last if jumps else good, t + shortest), end), jumps, given.led and jumps)
