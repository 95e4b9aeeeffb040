"""Does a blow on a stop of a joint, or by a cable that goes taut, last for too few steps?

Impulse, energy and the motion afterwards hold at any Δt. The force is a mean over a step: its peak
is not resolved in a short blow. A mass m on a stop k swings back in half a period π √(m/k). With a
strong damper c the force begins with c v and falls. The
impulse between two steps over the change of the joint's rate between them is m, as far as nothing
else acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, sqrt
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects import SpringDamper
from rigidfx.effects.joints.elements import Blow
from rigidfx.report.brief_contacts import RESOLVED, WORTH_A_WARNING, rounded_down
from rigidfx.report.look import Look
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["BriefStops"]


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
