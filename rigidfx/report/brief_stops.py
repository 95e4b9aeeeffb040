"""Does a blow on a stop of a joint last for too few steps?

Impulse, energy and the motion afterwards hold at any Δt. The force is a mean over a step: its peak
is not resolved in a short blow. A mass m on a stop k swings back in half a period π √(m/k). With a
strong damper c the force begins with c v and falls. The
impulse between two steps over the change of the joint's rate between them is m, as far as nothing
else acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects.joints.stop import Blow
from rigidfx.report.brief_contacts import RESOLVED, WORTH_A_WARNING, rounded_down
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["BriefStops"]


@dataclass
class _Struck:
    """A blow on a stop, as long as it is looked at.

    Attributes:
        since: Start of its first step [s].
        before: Rate of the coordinate in the step before [rad/s, m/s]; None if there is none.
        steps: Its steps.
        longest: The longest of these [s].
        impulse: Impulse so far, of its effort [N s, N m s].
        force: The same of its force [N s].
        peak: Largest effort in a step [N, N m].
    """

    since: float
    before: float | None
    steps: int
    longest: float
    impulse: float
    force: float
    peak: float


class BriefStops:
    """Looks at the stops of reports; warns once."""

    remembered: ClassVar[Remembered] = same("_waits", "_struck", "_rates", "_closed", "_most")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report."""
        self._comm, self._waits = scene.comm, True
        self._struck: dict[str, _Struck] = {}
        self._rates: dict[str, float] = {}  # in the last step in which a stop was open
        self._closed: set[str] = set()
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report.

        Args:
            report: The next one.
        """
        if not (self._waits and report.joints.blows):
            return
        self._most = max(self._most, report.momentum_scale)
        for title, now in report.joints.blows.items():
            if now.effort > 0 and title not in self._closed:
                self._closed.add(title)
                began = report.t - report.dt, self._rates.get(title)
                self._struck[title] = _Struck(*began, 0, 0.0, 0.0, 0.0, 0.0)
            if now.effort == 0:
                self._closed.discard(title)
                self._rates[title] = now.rate
            if (blow := self._struck.get(title)) is None:
                continue
            if now.effort > 0:
                blow.steps += 1
                blow.longest = max(blow.longest, report.dt)
                blow.impulse += now.effort * report.dt
                blow.force += now.force * report.dt
                blow.peak = max(blow.peak, now.effort)
            if now.effort == 0 or 2 * blow.steps > RESOLVED:
                self._judge(title, self._struck.pop(title), now, report.dt)

    def _judge(self, title: str, blow: _Struck, now: Blow, dt: float) -> None:
        """Warn of a blow whose steps are too long."""
        before = -now.rate if blow.before is None else blow.before  # a blow without loss
        change = abs(before - now.rate)
        mass = (blow.impulse - 0.5 * now.effort * dt) / change if change else 0.0
        k, c = now.stop.stiffness, now.stop.damping
        short = pi * sqrt(max(mass, 0.0) / k)
        if mass > 0 and c * c > k * mass:  # the force falls from c v on, by c/m - k/c in a time
            short = min(short, 1 / (c / mass - k / c))
        enough = blow.longest * RESOLVED <= 2 * short  # half as many lose a tenth of the peak
        if enough or not short > 0 or blow.force <= WORTH_A_WARNING * self._most:
            return
        self._waits = False
        warn(
            self._comm,
            f"{title} was struck at t = {blow.since:.6g} s, in a blow of some {short:.2g} s: Δt "
            "does not resolve it. Its impulse and the motion afterwards hold; the peak of its "
            f"force or torque ({blow.peak:.3g} here, a mean over a step) does not. With "
            f"Δt ≤ {rounded_down(short / RESOLVED):.2g} s the peak is found to a few per cent; a "
            "smaller `stiffness` makes blows longer.",
        )
