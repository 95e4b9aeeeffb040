"""Does a run resolve its blows, on contacts, on stops of joints, and by cables that go taut?

A blow that is over within few steps has the right impulse, and the motion afterwards holds. The
forces in between are means over steps: their peak, and that of stresses, is not resolved.
"""

from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context
from math import inf, pi, sqrt
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Contact, SpringDamper
from rigidfx.effects.joints.elements import Blow
from rigidfx.report.advice import ADVICE, RESOLVED, Adviser
from rigidfx.report.report import Report
from rigidfx.report.resolved_forces import own_time, resolved_time
from rigidfx.scene.scene import Scene

STEPS, CELLS = "a blow on a contact", "the peak of a contact's force"  # rows of advice
WORTH_A_WARNING = 0.01  # of the largest Σ m|v| so far: impulse of an impact that matters


@dataclass
class _Closed:
    """A contact while it is closed."""

    since: float  # when it has closed [s]
    steps: int  # steps in which it has pressed with more than half of its peak
    longest: float  # the longest of these [s]
    blow: float  # sum of its nodal impulses in them [N s]
    impulse: float  # the same in all steps [N s]
    peak: float  # largest force in a step [N]
    resolved: float  # largest of its means over the time that the mesh resolves [N]
    now: float  # its mean in the last step [N]

    @property
    def duration(self) -> float:
        """Length of half a sine of this impulse and resolved peak [s]."""
        return 0.5 * pi * self.blow / self.resolved


class BriefContacts(Adviser):
    """Looks at the contacts of reports; advises once on steps, and once on cells.

    A contact presses for half of a sine which has its impulse I and the peak F of `Touch.resolved`,
    π I/(2 F): a series of blows counts as one. One that stays closed, as under a weight, has the
    impulse of the steps in which the force is above half of its peak so far. The Δt that is named
    resolves this and the contact's `own_time`; a run that ends while the force still grows knows
    the latter alone. In short steps the peak is that of nodes that ring on the penalty.
    """

    remembered: ClassVar[Remembered] = Adviser.remembered | same("_closed", "_most")

    def __init__(self, scene: Scene, given: bool) -> None:
        """Begin before the first report. If Δt is not given its error chooses it."""
        super().__init__(scene)
        if not given:
            self.said.add(STEPS)
        self._closed: dict[str, _Closed] = {}
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report. Collective."""
        if len(self.said) == 2:
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
        """Advise on a blow that steps do not resolve, or on nodes that ring. Collective.

        A text says how the blow `ended`, or what is known of it before its force has had its peak.
        """
        if past.impulse <= WORTH_A_WARNING * self._most:
            return
        contact = next(c for c in self._scene.named(Contact) if c.title == title)
        told = f"Contact '{title}' closed at t = {past.since:.6g} s and {how}"
        over = f"{resolved_time(self._scene, contact):.2g} s"
        own = own_time(self._scene, contact)
        lasts = past.duration if ended else own
        dt = rounded_down(min(lasts, own) / RESOLVED)
        few = 2 * lasts <= ADVICE[STEPS].bound * past.longest and past.longest > dt
        if few and STEPS not in self.said:
            self.said.add(CELLS)
            steps = "one step" if past.steps == 1 else f"{past.steps} steps"
            blow = {"impulse": past.impulse, "peak": past.peak, "dt": dt, "over": over}
            self.advise(STEPS, told=told, steps=steps, **blow)
        elif ended and CELLS not in self.said and past.peak > ADVICE[CELLS].bound * past.resolved:
            peaks = {"peak": past.peak, "resolved": past.resolved}
            self.advise(CELLS, told=told, over=over, **peaks)


def rounded_down(dt: float) -> float:
    """The largest number of two digits that is not above a given one > 0."""
    return float(Context(prec=2, rounding=ROUND_FLOOR).create_decimal_from_float(dt))


@dataclass
class _Struck:
    """A blow on a stop or by a cable, as long as it is looked at."""

    since: float  # start of its first step [s]
    # Rate of the coordinate in the step before, or the first one if there is none [rad/s, m/s]
    before: float
    steps: int  # its steps
    longest: float  # the longest of these [s]
    impulse: float  # impulse since the middle of that step, of its effort [N s, N m s]
    force: float  # the same of its force [N s]
    peak: float  # largest effort in a step [N, N m]
    rate: float  # rate of the coordinate in the last step
    last: float  # impulse of its second half
    k: float  # stiffness of the stop or cable
    c: float  # its damping


class BriefStops(Adviser):
    """Looks at the stops and cables of reports; advises once.

    A mass m on a stop k swings back in half a period π √(m/k). With a strong damper c the force
    begins with c v and falls. The impulse between two steps over the change of the joint's rate
    between them is m, as far as nothing else acts.
    """

    remembered: ClassVar[Remembered] = Adviser.remembered | same(
        "_struck", "_rates", "_closed", "_most"
    )

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        cables = (spring for spring in scene.named(SpringDamper) if spring.pulls_only)
        self._cables = {cable.title: cable for cable in cables}
        self._struck: dict[str, _Struck] = {}
        self._rates: dict[str, float] = {}  # in the last step in which a stop was open
        self._closed: set[str] = set()
        self._most = 0.0  # largest Σ m|v| so far [N s]

    def follow(self, report: Report) -> None:
        """Look at a report."""
        if self.said or not (report.joints.blows or self._cables):
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
        """Advise on a blow whose steps are too long, or that no second step shows."""
        change, k, c = abs(blow.before - blow.rate), blow.k, blow.c
        mass = (blow.impulse - blow.last) / change if change else 0.0
        short = pi * sqrt(max(mass, 0.0) / k) if k else inf
        if mass > 0 and c * c > k * mass:  # the force falls from c v on, by c/m - k/c in a time
            short = min(short, 1 / (c / mass - k / c))
        alone = not change and title not in self._rates
        enough = blow.longest * ADVICE["a blow on a `Stop` or a cable"].bound <= 2 * short
        told = alone or (short > 0 and not enough)
        if self.said or not told or blow.force <= WORTH_A_WARNING * self._most:
            return
        how = "went taut" if title in self._cables else "was struck"
        found = {"title": title, "how": how, "peak": blow.peak}
        if alone:
            self.advise("a blow on a `Stop`", **found)
        else:
            dt = rounded_down(short / RESOLVED)
            self.advise("a blow on a `Stop` or a cable", t=blow.since, short=short, dt=dt, **found)
