"""Where steps end: on a grid of nominal steps, and on every breakpoint."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from math import floor, ulp

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.instants import resolution

WIDEST = 1e100  # s, and as many parts of one: the cube of a step is a number
LEAST = 1000  # a step in numbers that lie apart there, so that it can be cut and divided


class Timeline:
    """The ends of the steps of a run.

    Attributes:
        dt: Nominal Δt at the start [s].
        least: The shortest Δt that is taken [s].
        t_end: End of the run [s].
        resolution: Times closer than this are the same [s].
    """

    def __init__(
        self, dt: float | Mapping[float, float], t_end: float, finest: float | None = None
    ) -> None:
        """Check the numbers.

        Args:
            dt: Nominal Δt [s], or one from each of several times on, the first of them 0.
            t_end: End of the run [s].
            finest: Smallest Δt [s], if steps may be shorter than nominal ones.

        Raises:
            SceneError: If one cannot be used, or time cannot resolve the steps.
        """
        steps = dict(dt) if isinstance(dt, Mapping) else {0.0: dt}
        pairs = sorted(
            (number("simulate", "a time of dt", t), number("simulate", "dt", own))
            for t, own in steps.items()
        )
        if not pairs or pairs[0][0] != 0 or not all(own > 0 for _, own in pairs):
            raise SceneError(
                "simulate: dt must be a finite number > 0, or a dict of times to such numbers "
                f"that begins with the time 0; got {shown(dt)}."
            )
        self.t_end = positive("simulate", "t_end", t_end)
        self._times, self._steps = [t for t, _ in pairs], [own for _, own in pairs]
        self.dt = self._steps[0]
        self.resolution = self._resolve(finest)
        if self.over(0.0):
            raise SceneError(
                f"simulate: a run until t_end = {self.t_end:g} s with dt = {self.dt:g} s would "
                f"have no step: times {self.resolution:.2g} s apart count as the same. Take a "
                "larger t_end, or a smaller dt."
            )
        self._stops: list[float] = [*self._times[1:], self.t_end]

    def _resolve(self, finest: float | None) -> float:
        """Times that are the same: some numbers apart, and far less than a step.

        `SceneError` if a step is as short as numbers are apart at the end of the run, or has no
        cube among the numbers.
        """
        pairs = zip(self._times, self._steps, strict=True)
        taken = [dt for t, dt in pairs if t < self.t_end]
        self.least = finest = min(taken) if finest is None else finest
        apart = ulp(self.t_end)
        if finest < LEAST * apart:
            raise SceneError(
                f"simulate: dt = {finest:g} s cannot be resolved in a run until t_end = "
                f"{self.t_end:.9g} s, where numbers are {apart:.2g} s apart. Take dt ≥ "
                f"{LEAST * apart:.2g} s, or a run of its own that begins at 0."
            )
        for dt in (finest, *taken):
            if not 1 / WIDEST <= dt <= WIDEST:
                raise SceneError(
                    f"simulate: dt = {dt:g} s is no step to compute with: its powers are beyond "
                    f"numbers. Take {1 / WIDEST:g} s ≤ dt ≤ {WIDEST:g} s, and other units of the "
                    "scene if it needs more."
                )
        return float(resolution(self.t_end, finest))

    def stop_at(self, times: Iterable[float]) -> None:
        """Add breakpoints [s]."""
        self._stops = sorted({*self._stops, *times})

    def same(self, a: float, b: float) -> bool:
        """Whether two times [s] are the same instant."""
        return abs(a - b) <= self.resolution

    def after(self, t: float) -> float:
        """A time just after t [s], at which effects that begin at t act."""
        return t + self.resolution

    def over(self, t: float) -> bool:
        """Whether the run is over at t [s]."""
        return t >= self.t_end - self.resolution

    def stop_after(self, t: float) -> float:
        """The next breakpoint, or end of the run, after t [s]."""
        return self._stops[bisect_right(self._stops, t + self.resolution)]

    def next(self, t: float) -> float:
        """End of the step that begins at t [s]."""
        k = bisect_right(self._times, t + self.resolution) - 1
        start, dt = self._times[k], self._steps[k]
        target = start + (floor((t + self.resolution - start) / dt) + 1) * dt
        stop = self.stop_after(t)
        return stop if stop <= target + self.resolution else target
