"""When a contact will close: the step before ends just short of that, as at a breakpoint.

After it Δt by its error begins with short steps; a body gets the shapes that these resolve. At
constant velocity gaps close after τ, and after τ₋ at the start of the step before, of the length h.
With a constant acceleration they close after

    s = 2τ/(1 + √(1 + 2kτ)) ,    k = (1 - (2τ + h)/(2τ₋ - h))/h ,

or after 2τ if they turn before, where a contact has been open for some steps.
"""

from math import inf, sqrt
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Contact
from rigidfx.effects.nodes import Instant
from rigidfx.step.length.time_error import SETTLED
from rigidfx.step.stepper import Stepper

LEAST = 1e-2  # of a step: shorter ones are not worth it, at its start or its end


class FirstTouch:
    """Shortens steps that would run into an obstacle."""

    remembered: ClassVar[Remembered] = same("_open", "_told")

    def __init__(self, stepper: Stepper) -> None:
        self._stepper = stepper
        self._any = bool(stepper.scene.named(Contact))
        self._open: dict[str, int] = {}  # steps that each contact has been open
        self._told: dict[str, tuple[float, float]] = {}  # t and τ of the step before [s]

    def before(self, target: float) -> float:
        """Where the next step is to end, or the first touch before that [s]. Collective."""
        if not self._any:
            return target
        state, system = self._stepper.state, self._stepper.system
        t, v = state.t, state.v.x.array[system.layout.rows.dofs]
        dt, first, now = target - t, target, Instant(state.bodies, t=t)
        for title, closes in system.actions.closing(v, dt, now).items():
            self._open[title] = self._open.get(title, SETTLED) + 1 if closes >= 0 else 0
            after = self._sharper(title, t, closes)
            if self._open[title] > SETTLED and LEAST * dt < after < dt:
                first = min(first, t + after * (1 - LEAST**3))  # nothing presses by rounding
        control = self._stepper.control
        if first < target and control is not None:
            control.expect(first)
        return first

    def _sharper(self, title: str, t: float, after: float) -> float:
        """Time until a contact closes, by that at constant velocity now and a step before [s]."""
        t_before, before = self._told.get(title, (t, inf))
        self._told[title] = t, after
        h = t - t_before
        if not (0 < after < inf and h / 2 < before < inf and h > 0):
            return after
        k = (1 - (2 * after + h) / (2 * before - h)) / h
        return 2 * after / (1 + sqrt(max(1 + 2 * k * after, 0.0)))
