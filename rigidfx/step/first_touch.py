"""When a contact will close: the step before ends there.

Nothing in a step tells of an obstacle that it runs into at its end. So the first touch is foreseen,
from the gaps at constant velocity, and ends a step as a breakpoint does, after which Δt by its
error begins with short ones. That holds for a contact that has been open for some steps: where
something rattles or rests, steps do not change.
"""

from __future__ import annotations

from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Contact
from rigidfx.step.stepper import Stepper

__all__ = ["FirstTouch"]

SETTLED = 4  # steps that a contact has been open before its next touch is a first one
LEAST = 1e-2  # of a step: shorter ones are not worth it, at its start or its end


class FirstTouch:
    """Shortens steps that would run into an obstacle."""

    remembered: ClassVar[Remembered] = same("_open")

    def __init__(self, stepper: Stepper) -> None:
        """Keep the stepper."""
        self._stepper = stepper
        self._any = bool(stepper.scene.named(Contact))
        self._open: dict[str, int] = {}  # steps that each contact has been open

    def before(self, target: float) -> float:
        """End of the next step, or the first touch before it [s]. Collective.

        Args:
            target: Where the step is to end [s].
        """
        if not self._any:
            return target
        t = self._stepper.state.t
        dt, first = target - t, target
        for title, after in self._stepper.closing(dt).items():
            self._open[title] = self._open.get(title, SETTLED) + 1 if after >= 0 else 0
            if self._open[title] > SETTLED and LEAST * dt < after < (1 - LEAST) * dt:
                first = min(first, t + after)
        control = self._stepper.control
        if first < target and control is not None:
            control.expect(first)
        return first
