"""Where steps end: on a grid of nominal steps and on every breakpoint, or as an error lets them."""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, ulp
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.instants import resolution
from rigidfx.base.taken import take_fields
from rigidfx.scene.points import check_probes, probe_names
from rigidfx.scene.scene import Scene

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
        taken = [dt for t, dt in zip(self._times, self._steps, strict=True) if t < self.t_end]
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


SHORTEST = 1e-3  # of the largest step: the smallest one, unless told otherwise
FINEST = 1e-12  # part of a displacement that rounding leaves something of


def fraction(owner: str, name: str, value: Any) -> float:
    """A user's number between zero, or what rounding leaves of one, and one as a float."""
    result = number(owner, name, value)
    if not FINEST <= result < 1:
        fine = f", and {FINEST:g} or more, as rounding errs by some of that"
        raise SceneError(
            f"{owner}: {name} must be a number between 0 and 1, such as 0.01 for one per cent"
            f"{fine if 0 < result < 1 else ''}; got {shown(value)}."
        )
    return result


@dataclass(frozen=True)
class StepControl:
    """Δt by a permitted error of displacements.

    The sum of the errors of all steps is kept below `tol` times the largest displacement so far;
    see `rigidfx.step.length.time_error` for the estimate and `rigidfx.step.length.controller` for
    the rule.

    Attributes:
        tol: Error of a run over the largest displacement so far, such as 0.01.
        at: Names of the probes whose displacements count, at each time the one with the largest
            error; some nodes far from each other if None. Other nodes of the connected part count
            by their mean square, since their errors travel to the probes.
        largest: Largest Δt [s]; required. A shorter load may be missed, unless it has a time
            window, a `Table` or `breakpoints`.
        smallest: Smallest Δt [s]; a thousandth of the largest if None.
        of: Displacement to which `tol` is relative [m]; the largest so far if None.
    """

    tol: float
    at: str | Sequence[str] | None = None
    largest: float | None = field(default=None, kw_only=True)
    smallest: float | None = field(default=None, kw_only=True)
    of: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check all values, and take them; `SceneError` if one cannot be used."""
        owner = "StepControl"
        fraction(owner, "tol", self.tol)
        if self.largest is None:
            raise SceneError(
                "StepControl: needs largest, the longest step in s that may be taken, such as "
                "StepControl(0.01, largest=0.05): what is over in less may be stepped over."
            )
        largest = positive(owner, "largest", self.largest)
        if self.smallest is not None and positive(owner, "smallest", self.smallest) > largest:
            raise SceneError(
                f"StepControl: needs smallest ≤ largest, got {shown(self.smallest)} and "
                f"{shown(self.largest)} s."
            )
        if self.of is not None:
            positive(owner, "of", self.of)
        object.__setattr__(self, "at", probe_names(owner, self.at))
        take_fields(self)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the probes that count; none if nodes of its own choice do."""
        return () if self.at is None else tuple(self.at)

    @property
    def most(self) -> float:
        """The largest Δt [s]."""
        assert self.largest is not None  # it would have been refused
        return float(self.largest)

    @property
    def least(self) -> float:
        """The smallest Δt [s]."""
        return SHORTEST * self.most if self.smallest is None else float(self.smallest)

    def check(self, scene: Scene) -> None:
        """Look its probes up."""
        check_probes("StepControl", self.names, scene)
