"""Does a contact close and open again within a few steps of a given Δt?

Then impulses and the motion afterwards hold, as momenta and energy are exact at any Δt. The forces
in between are means over steps: their peak, and that of stresses, is not resolved. How long a
contact presses is measured as that half of a sine which has its impulse I and its peak F, of the
length π I/(2 F): a series of blows that follow one another counts as one of them.

The Δt that is named resolves that duration, and the contact's own time, which no blow of a node or
of a part that is named rigid falls below: the peaks of six impacts at that Δt differ from those at
half of it by 0.5 to 4 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context
from math import pi
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects import Contact
from rigidfx.effects.contacts.own_time import own_time
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["BriefContacts"]

FEW = 5.0  # steps: half a sine sampled by fewer loses more than a tenth of its peak
RESOLVED = 10  # steps of an impact, or of the contact's own time, whose peak is known to some 3 %
WORTH_A_WARNING = 0.01  # of the largest Σ m|v| so far: impulse of an impact that matters


@dataclass
class _Closed:
    """A contact while it is closed.

    Attributes:
        since: When it has closed [s].
        steps: Steps in which it has pressed.
        longest: The longest of these [s].
        impulse: Sum of its nodal impulses [N s].
        peak: Largest force in a step [N].
    """

    since: float
    steps: int
    longest: float
    impulse: float
    peak: float

    @property
    def duration(self) -> float:
        """Length of half a sine of this impulse and peak [s]."""
        return 0.5 * pi * self.impulse / self.peak


class BriefContacts:
    """Looks at the contacts of reports; warns once."""

    remembered: ClassVar[Remembered] = same("_waits", "_closed", "_most")

    def __init__(self, scene: Scene, given: bool) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
            given: Whether Δt is given, and nothing chooses it by its error.
        """
        self._scene, self._waits = scene, given
        self._closed: dict[str, _Closed] = {}
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report. Collective.

        Args:
            report: The next one.
        """
        if not self._waits:
            return
        self._most = max(self._most, report.momentum_scale)
        for title, touch in report.touches.items():
            if touch.pressing > 0:
                begins = _Closed(report.t - report.dt, 0, 0.0, 0.0, 0.0)
                now = self._closed.setdefault(title, begins)
                now.steps += 1
                now.longest = max(now.longest, report.dt)
                now.impulse += touch.pressing * report.dt
                now.peak = max(now.peak, touch.pressing)
                continue
            past = self._closed.pop(title, None)
            if past is None or past.duration > FEW * past.longest:
                continue
            if past.impulse > WORTH_A_WARNING * self._most:
                self._judge(title, past)

    def _judge(self, title: str, past: _Closed) -> None:
        """Warn and look no more, unless Δt is short enough for the contact's own time."""
        contact = next(c for c in self._scene.named(Contact) if c.title == title)
        own = own_time(self._scene, contact)
        dt = _rounded_down(min(past.duration, own) / RESOLVED)
        if past.longest <= dt:
            return
        self._waits = False
        steps = "one step" if past.steps == 1 else f"{past.steps} steps"
        warn(
            self._scene.comm,
            f"Contact '{title}' closed at t = {past.since:.6g} s and opened again within {steps}: "
            f"Δt does not resolve this impact. Its impulse, {past.impulse:.3g} N s, and the motion "
            f"afterwards hold; the peak of its force ({past.peak:.3g} N here, a mean over a step) "
            f"and of stresses does not. With Δt ≤ {dt:.2g} s the peak is found to a few per cent: "
            "a tenth of the half period of the contact's lightest node, or rigid part, on its "
            "stiffness, or less. StepControl and Accuracy shorten steps at impacts; the error "
            "afterwards is not estimated.",
        )


def _rounded_down(dt: float) -> float:
    """The largest number of two digits that is not above a given one > 0."""
    return float(Context(prec=2, rounding=ROUND_FLOOR).create_decimal_from_float(dt))
