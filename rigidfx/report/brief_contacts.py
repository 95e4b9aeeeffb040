"""Does a contact close and open again within a few steps of a given Δt?

Then impulses and the motion afterwards hold, as momenta and energy are exact at any Δt. The forces
in between are means over steps: their peak, and that of stresses, is not resolved. How long a
contact presses is measured as that half of a sine which has its impulse I and its peak F, of the
length π I/(2 F): a series of blows that follow one another counts as one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from rigidfx.base.warning import warn
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["BriefContacts"]

FEW = 5.0  # steps: half a sine sampled by fewer loses more than a tenth of its peak
RESOLVED = 20  # steps of an impact whose peak is known to a few per cent
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

    def __init__(self, scene: Scene, given: bool) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
            given: Whether Δt is given, and nothing chooses it by its error.
        """
        self._comm, self._waits = scene.comm, given
        self._closed: dict[str, _Closed] = {}
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report.

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
                self._say(title, past)
                return

    def _say(self, title: str, past: _Closed) -> None:
        """Warn, and look no more."""
        self._waits = False
        steps = "one step" if past.steps == 1 else f"{past.steps} steps"
        warn(
            self._comm,
            f"Contact '{title}' closed at t = {past.since:.6g} s and opened again within {steps}: "
            f"Δt does not resolve this impact. Its impulse, {past.impulse:.3g} N s, and the motion "
            f"afterwards hold; the peak of its force ({past.peak:.3g} N here, a mean over a step) "
            "and of stresses does not. With "
            f"Δt ≤ {past.duration / RESOLVED:.2g} s it takes {RESOLVED} steps; if the next run "
            "warns again, it is shorter still. Accuracy or StepControl find the Δt by themselves.",
        )
