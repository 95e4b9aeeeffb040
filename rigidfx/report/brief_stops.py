"""Does a blow on a stop of a joint, or by a cable that goes taut, last for too few steps?

Impulse, energy and the motion afterwards hold at any Δt. The force is a mean over a step: its peak
is not resolved in a short blow. A mass m on a stop k swings back in half a period π √(m/k). With a
strong damper c the force begins with c v and falls. The
impulse between two steps over the change of the joint's rate between them is m, as far as nothing
else acts.

Does a run resolve the blows of its contacts: do steps, and do cells?

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
from math import inf, pi, sqrt
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects import Contact, SpringDamper
from rigidfx.effects.contacts.layer_times import own_time, resolved_time
from rigidfx.effects.joints.elements import Blow
from rigidfx.report.report import Look, Report
from rigidfx.scene.scene import Scene

__all__ = ["RESOLVED", "BriefContacts", "BriefStops", "rounded_down"]

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


@dataclass
class _Struck:
    """A blow on a stop or by a cable, as long as it is looked at.

    Attributes:
        since: Start of its first step [s].
        before: Rate of the coordinate in the step before, or the first one if there is none
            [rad/s, m/s].
        steps: Its steps.
        longest: The longest of these [s].
        impulse: Impulse since the middle of that step, of its effort [N s, N m s].
        force: The same of its force [N s].
        peak: Largest effort in a step [N, N m].
        rate: Rate of the coordinate in the last step.
        last: Impulse of its second half.
        k: Stiffness of the stop or cable.
        c: Its damping.
    """

    since: float
    before: float
    steps: int
    longest: float
    impulse: float
    force: float
    peak: float
    rate: float
    last: float
    k: float
    c: float


class BriefStops(Look):
    """Looks at the stops and cables of reports; warns once."""

    remembered: ClassVar[Remembered] = same("_waits", "_struck", "_rates", "_closed", "_most")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report."""
        self._comm, self._waits = scene.comm, True
        cables = (spring for spring in scene.named(SpringDamper) if spring.pulls_only)
        self._cables = {cable.title: cable for cable in cables}
        self._struck: dict[str, _Struck] = {}
        self._rates: dict[str, float] = {}  # in the last step in which a stop was open
        self._closed: set[str] = set()
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report.

        Args:
            report: The next one.
        """
        if not (self._waits and (report.joints.blows or self._cables)):
            return
        self._most = max(self._most, report.momentum_scale)
        for title, now in {**report.joints.blows, **self._taut(report)}.items():
            known = title in self._rates
            if now.pressed and not known:
                self._closed.add(title)
            if now.effort > 0 and title not in self._closed:
                self._closed.add(title)
                began = report.t - report.dt, self._rates.get(title, now.rate)
                missing = 0.0 if known else -0.5 * now.effort * report.dt
                law = now.stop.stiffness, now.stop.damping
                blow = _Struck(*began, 0, 0.0, missing, 0.0, 0.0, 0.0, 0.0, *law)
                self._struck[title] = blow
            if now.effort == 0:
                self._closed.discard(title)
                self._rates[title] = now.rate
            if title not in self._struck:
                continue
            blow = self._struck[title]
            blow.rate, blow.last = now.rate, 0.5 * now.effort * report.dt
            if now.effort > 0:
                blow.steps += 1
                blow.longest = max(blow.longest, report.dt)
                blow.impulse += now.effort * report.dt
                blow.force += now.force * report.dt
                blow.peak = max(blow.peak, now.effort)
            if now.effort == 0 or 2 * blow.steps > RESOLVED:
                self._judge(title, self._struck.pop(title))

    def _taut(self, report: Report) -> dict[str, Blow]:
        """How cables act in a step, by their titles."""
        found = {}
        for title, cable in self._cables.items() if report.step else ():
            own = report.spring_dampers[title]
            ends = own.length - own.rate * report.dt, own.length
            before, after = (cable.beyond(length) for length in ends)
            found[title] = Blow(cable, own.force, own.force, own.rate, 2 * before > after)
        return found

    def end(self) -> None:
        """Judge the blows that are not over."""
        for title, blow in self._struck.items():
            self._judge(title, blow)

    def _judge(self, title: str, blow: _Struck) -> None:
        """Warn of a blow whose steps are too long, or that no second step shows."""
        change, k, c = abs(blow.before - blow.rate), blow.k, blow.c
        mass = (blow.impulse - blow.last) / change if change else 0.0
        short = pi * sqrt(max(mass, 0.0) / k) if k else inf
        if mass > 0 and c * c > k * mass:  # the force falls from c v on, by c/m - k/c in a time
            short = min(short, 1 / (c / mass - k / c))
        alone = not change and title not in self._rates
        enough = blow.longest * RESOLVED <= 2 * short  # half as many lose a tenth of the peak
        told = alone or (short > 0 and not enough)
        if not self._waits or not told or blow.force <= WORTH_A_WARNING * self._most:
            return
        self._waits = False
        how = "went taut" if title in self._cables else "was struck"
        peak = f"the peak of its force or torque ({blow.peak:.3g} here, a mean over a step)"
        warn(
            self._comm,
            f"{title} {how} in the only step of the run, which does not show how long the blow is: "
            f"{peak} may be higher. Take shorter steps."
            if alone
            else f"{title} {how} at t = {blow.since:.6g} s, in a blow of some {short:.2g} s: Δt "
            f"does not resolve it. Its impulse and the motion afterwards hold; {peak} does not. "
            f"With Δt ≤ {rounded_down(short / RESOLVED):.2g} s the peak is found to a few per "
            "cent; a smaller `stiffness` makes blows longer.",
        )
