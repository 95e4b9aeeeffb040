"""Does a run resolve the blows of its contacts: do steps, and do cells?

A blow that is over within few steps has the right impulse, and the motion afterwards holds, as
momenta and energy are exact at any Δt. The forces in between are means over steps: their peak, and
that of stresses, is not resolved. How long a contact presses is measured as that half of a sine
which has its impulse I and the peak F of `Touch.resolved`, of the length π I/(2 F): a series of
blows that follow one another counts as one of them. A contact that stays closed, as under a weight,
has the impulse of the steps in which the force is above half of its peak so far. The Δt that is
named resolves that duration and the contact's own time (`own_time`). A run that ends in a blow,
while its force still grows, knows the latter alone.

In short steps nodes of the surface ring on the penalty, and the peak of the force is theirs. Then
the run names that of `Touch.resolved`.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context
from math import pi
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects import Contact
from rigidfx.effects.contacts.layer_times import own_time, resolved_time
from rigidfx.report.look import Look
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["RESOLVED", "WORTH_A_WARNING", "BriefContacts", "rounded_down"]

RESOLVED = 10  # steps of half a sine whose peak is known to some 3 %; half as many lose a tenth
RINGS = 1.1  # times the resolved peak: a peak that is worth a word
WORTH_A_WARNING = 0.01  # of the largest Σ m|v| so far: impulse of an impact that matters


@dataclass
class _Closed:
    """A contact while it is closed.

    Attributes:
        since: When it has closed [s].
        steps: Steps in which it has pressed with more than half of its peak.
        longest: The longest of these [s].
        blow: Sum of its nodal impulses in them [N s].
        impulse: The same in all steps [N s].
        peak: Largest force in a step [N].
        resolved: Largest of its means over the time that the mesh resolves [N].
        now: Its mean in the last step [N].
    """

    since: float
    steps: int
    longest: float
    blow: float
    impulse: float
    peak: float
    resolved: float
    now: float

    @property
    def duration(self) -> float:
        """Length of half a sine of this impulse and resolved peak [s]."""
        return 0.5 * pi * self.blow / self.resolved


class BriefContacts(Look):
    """Looks at the contacts of reports; warns once of steps, and once of cells."""

    remembered: ClassVar[Remembered] = same("_waits", "_listens", "_closed", "_most")

    def __init__(self, scene: Scene, given: bool) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
            given: Whether Δt is given, and nothing chooses it by its error.
        """
        self._scene, self._waits, self._listens = scene, given, True
        self._closed: dict[str, _Closed] = {}
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report. Collective.

        Args:
            report: The next one.
        """
        if not (self._waits or self._listens):
            return
        self._most = max(self._most, report.momentum_scale)
        for title, touch in report.touches.items():
            if touch.pressing > 0:
                begun = report.t - report.dt
                closed = self._closed.setdefault(title, _Closed(begun, 0, *6 * [0.0]))
                closed.impulse += touch.pressing * report.dt
                closed.peak = max(closed.peak, touch.pressing)
                if 2 * touch.resolved > closed.resolved:
                    closed.steps += 1
                    closed.longest = max(closed.longest, report.dt)
                    closed.blow += touch.pressing * report.dt
            if touch.resolved > 0:  # also for a while after it has opened
                closed = self._closed[title]
                closed.now = touch.resolved
                closed.resolved = max(closed.resolved, touch.resolved)
            elif (past := self._closed.pop(title, None)) is not None:
                self._judge(title, past, "opened again")

    def end(self) -> None:
        """Judge contacts that are still closed; of those that press ever more, blows. Collective.

        A blow changes a momentum, at most to its opposite; what holds a load has more impulse.
        """
        for title, closed in self._closed.items():
            ended = closed.now < closed.resolved
            brief = 2 * closed.steps <= RESOLVED and closed.impulse <= 2 * self._most
            if ended or brief:
                self._judge(
                    title,
                    closed,
                    "past its peak" if ended else "pressed until the run ended,",
                    ended,
                )

    def _judge(self, title: str, past: _Closed, how: str, ended: bool = True) -> None:
        """Warn of a blow that steps do not resolve, or of a peak of nodes that ring. Collective.

        Args:
            title: Of the contact.
            past: Its steps.
            how: The end of the blow, or of what is known of it.
            ended: Whether the force has had its peak.
        """
        if past.impulse <= WORTH_A_WARNING * self._most:
            return
        contact = next(c for c in self._scene.named(Contact) if c.title == title)
        told = f"Contact '{title}' closed at t = {past.since:.6g} s and {how}"
        over = f"{resolved_time(self._scene, contact):.2g} s"
        own = own_time(self._scene, contact)
        lasts = past.duration if ended else own
        dt = rounded_down(min(lasts, own) / RESOLVED)
        if self._waits and lasts <= 0.5 * RESOLVED * past.longest and past.longest > dt:
            self._waits = self._listens = False
            steps = "one step" if past.steps == 1 else f"{past.steps} steps"
            warn(
                self._scene.comm,
                f"{told} within {steps}: Δt does not resolve this impact. Its impulse, "
                f"{past.impulse:.3g} N s, and the motion afterwards hold; the peak of its force "
                f"({past.peak:.3g} N here, a mean over a step) and of stresses does not. With Δt ≤ "
                f"{dt:.2g} s, a tenth of the half period of the layer of cells behind the contact, "
                "or of a rigid part, on its stiffness, or less, shorter steps change the peak of "
                f"touch.resolved, the force's mean over {over}, by a few per cent at most; smaller "
                "cells may change it more. StepControl and Accuracy shorten steps at impacts; the "
                "error afterwards is not estimated.",
            )
        elif ended and self._listens and past.peak > RINGS * past.resolved:
            self._listens = False
            warn(
                self._scene.comm,
                f"{told}: the peak of its force, {past.peak:.3g} N, lasts for less than its cells "
                "resolve, as nodes of the surface ring on the contact. Take that of "
                f"touch.resolved, {past.resolved:.3g} N: a mean over {over}, in which a wave "
                "crosses four layers of nodes. Smaller cells resolve shorter blows.",
            )


def rounded_down(dt: float) -> float:
    """The largest number of two digits that is not above a given one > 0."""
    return float(Context(prec=2, rounding=ROUND_FLOOR).create_decimal_from_float(dt))
