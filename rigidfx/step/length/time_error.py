"""Error of time integration in a step: of motions, of motions elsewhere, and of impulses.

docs/theory/time_steps.md#the-error-of-a-step has d by the jerks ĵ and accelerations â, (1) to (3),
errors elsewhere, (4), and blows, (5). Means are of fewer differences while there are fewer. If the
jerk is ĵ now, it is ω â a quarter of a period away. Errors of a vibration add up to √2 Σ d, of a
steady rotation to Σ d.
"""

from collections.abc import Mapping, Sequence
from math import exp, inf, nan, sqrt
from typing import ClassVar, NamedTuple

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Contact, Touch
from rigidfx.scene.points import met, parts_of_nodes
from rigidfx.scene.scene import Scene

DIFFERENCES = 3  # that ĵ is the mean of: two let a ringing from step to step through
TURN = 3.0  # over ω, the time in which squares fade: half a period
LONGER = 4.0  # times a step: the force in one so long tells nothing of that at its ends, but is
# next to nothing where it gives less than this step: a step that ends at a touch may press a little
SETTLED = 4  # steps that a contact has been open before it closes anew, and with a blow


class TimeError:
    """Estimates the error of displacements that each step makes at some points.

    Attributes:
        jerk: ĵ of the step that was looked at last, shape (points, 3) [m/s³]; NaN where unknown.
        swinging: Root mean square of the jerk over a turn, shape (points,) [m/s³]; NaN likewise.
    """

    remembered: ClassVar[Remembered] = same("_times", "_a", "_squares", "_patient")

    def __init__(self, points: int) -> None:
        """Nothing is known of some points."""
        self.jerk: Array = np.full((points, 3), nan)
        self.swinging: Array = self.jerk[:, 0]
        # Of the last steps: their middles [s], accelerations there, shape (steps, points, 3).
        self._times: tuple[float, ...] = ()
        self._a: Array = np.empty((0, points, 3))
        self._squares = 0.0, 0.0  # ∫ Σ |ĵ|² dt and ∫ Σ |â|² dt
        self._patient = False
        self._next: tuple[tuple[float, ...], Array, tuple[float, float]]
        self._next = self._times, self._a, self._squares

    def forget(self) -> None:
        """Something has happened that accelerations before do not know of."""
        self._times, self._a, self._patient = (), self._a[:0], False

    def switched(self) -> None:
        """Bodies have changed: jerks are no errors until three differences are known.

        Cells that wake ring from step to step, and only the mean of three is blind to it.
        """
        self.forget()
        self._patient = True

    @property
    def young(self) -> bool:
        """Whether three differences are not known yet, since something began anew."""
        return not self._patient and len(self._times) <= DIFFERENCES

    @property
    def omega(self) -> float:
        """ω [1/s]; zero while nothing has moved."""
        of_j, of_a = self._squares
        return sqrt(of_j / of_a) if of_a > 0 else 0.0

    def look(self, v0: Array, v1: Array, t: float, dt: float) -> Array:
        """Error of each point in a step that has been solved, shape (points,) [m]; NaN if unknown.

        It begins at t with v0 and ends after dt with v1, shape (points, 3) [s, m/s].
        """
        times = (*self._times[-DIFFERENCES:], t + dt / 2)
        a: Array = np.concatenate([self._a[-DIFFERENCES:], ((v1 - v0) / dt)[None]])
        self._next, differences = (times, a, self._squares), len(times) - 1
        if differences <= (DIFFERENCES - 1) * self._patient:
            self.jerk, self.swinging = np.full_like(v0, nan), np.full(len(v0), nan)
            return self.swinging
        j = np.diff(a, axis=0) / np.diff(times)[:, None, None]
        self.jerk, mean = _mean(j), _mean(a)
        jerks, accelerations = ((x**2).sum(axis=1) for x in (self.jerk, mean))
        of_j, of_a = self._squares
        kept = exp(-self.omega * dt / TURN)
        of_j, of_a = of_j * kept + jerks.sum() * dt, of_a * kept + accelerations.sum() * dt
        self._next = times, a, (float(of_j), float(of_a))
        self.swinging = np.sqrt((jerks + (of_j / of_a if of_a > 0 else 0.0) * accelerations) / 2)
        return dt**3 / 12 * self.swinging

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._times, self._a, self._squares = self._next


def _mean(values: Array) -> Array:
    """Repeated mean of two among some values: ¼, ½, ¼ of three."""
    while len(values) > 1:
        values = (values[1:] + values[:-1]) / 2
    return np.asarray(values[0])


class Elsewhere:
    """Errors elsewhere in a structure, which travel to the points where accuracy is asked: (4).

    Jerks of modes cancel at a tip until the wave from the root arrives, but not in the mean square
    over a structure. If the points move more than others, their own error counts.
    """

    remembered: ClassVar[Remembered] = same("_moved")

    def __init__(self, asked: int) -> None:
        """Nothing has moved; accuracy is asked at so many points, the first of all."""
        self._asked = asked
        self._moved = self._next = 0.0, 0.0

    def look(self, u: Array) -> None:
        """See how far points have moved at the end of a step, shape (points, 3) [m]."""
        moved, others = self._both(np.linalg.norm(u, axis=1)[None])
        self._next = max(self._moved[0], float(moved[0])), max(self._moved[1], float(others[0]))

    def worth(self, lengths: Array) -> Array:
        """Lengths at all points, shape (n, points), as those that are asked for, shape (n,) [m]."""
        own, others = self._both(lengths)
        here, there = self._next
        return np.maximum(own, others * min(1.0, here / there)) if there > 0 else own

    def _both(self, lengths: Array) -> tuple[Array, Array]:
        """The largest at the points that are asked for, and the root mean square at others."""
        n = self._asked
        others = np.sqrt(np.sum(lengths[:, n:] ** 2, axis=1) / max(lengths.shape[1] - n, 1))
        return lengths[:, :n].max(axis=1), others

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._moved = self._next


class Blow(NamedTuple):
    """When a contact closed last after it had been open [s], and its impulse since then [N s]."""

    began: float
    impulse: float


class Forces(NamedTuple):
    """Of contacts at the middle t of a step: three components and the pressing force, by titles."""

    t: float
    dt: float
    of: Mapping[str, Array]


class Blows:
    """The error of an impulse, as the force of a contact changes within a step.

    It shows little during the contact, and grows afterwards. A step takes the force at its middle
    for the mean force, so the error of the impulse is Δt³/24 F'', about Δt/24 |F - F*| of (5). A
    body may be struck at rest, and far from the probes: so half of the contact's impulse over the
    mass is a speed, too. It counts for the time U/V after the closing of a contact that was open
    for some steps. Contacts that rest or rattle send nothing off, and do not count.

    Attributes:
        any: Whether there are contacts.
    """

    remembered: ClassVar[Remembered] = same("_known", "_open", "_last", "_fastest")

    def __init__(self, scene: Scene) -> None:
        """Nothing touches. Collective."""
        contacts = scene.named(Contact)
        self.any = bool(contacts)
        self._mass = _masses(scene, contacts) if contacts else {}
        self._known: tuple[Forces, ...] = ()  # of the last two steps
        self._next, self._speed = Forces(0.0, 0.0, {}), 0.0
        self._open: dict[str, int] = {}  # steps that each contact has been open
        self._last: dict[str, Blow] = {}  # of each contact
        self._fastest = 0.0

    def look(
        self, touches: Mapping[str, Touch], t: float, dt: float, size: float, speed: float
    ) -> float:
        """By how much a step from t of the length dt [s] errs once it shows [m].

        `size` is U, the largest displacement so far [m], `speed` the largest at its end [m/s].
        """
        self._speed = max(self._fastest, speed)
        forces = {title: np.array([*a.force, a.pressing]) for title, a in touches.items()}
        self._next, off = Forces(t + dt / 2, dt, forces), 0.0
        if len(self._known) < 2:
            return 0.0
        before, last = self._known
        way = (self._next.t - last.t) / (last.t - before.t)
        for title, force in forces.items():
            blow, mass = self._add(title, force), self._mass[title]
            fastest = max(self._speed, blow.impulse / (2 * mass))
            if fastest == 0:
                continue
            f0, f1 = (step.of.get(title, np.zeros(4)) for step in self._known)
            given = force[3] * dt
            known = all(
                step.dt <= LONGER * dt or f[3] * step.dt <= given
                for f, step in ((f0, before), (f1, last))
            )
            if known and t <= blow.began + size / fastest:
                off += float(np.abs(force - f1 - (f1 - f0) * way).max()) / (2 * mass * fastest)
        return size * dt / 12 * off

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._known, self._fastest = (*self._known[-1:], self._next), self._speed
        for title, force in self._next.of.items():
            # A step that ends at a touch may press by rounding, on some ranks and not on others.
            least = sqrt(np.finfo(np.float64).eps) * self._mass[title] * self._fastest
            closed = force[3] * self._next.dt > least
            if closed:
                self._last[title] = self._add(title, force)
            self._open[title] = 0 if closed else self._open.get(title, SETTLED) + 1

    def _add(self, title: str, force: Array) -> Blow:
        """The blow of a contact with what the step that was looked at last adds."""
        t, dt, _ = self._next
        settled = self._open.get(title, 0) > SETTLED
        begun = Blow(t + dt / 2, 0.0)
        last = begun if settled else self._last.get(title, Blow(-inf, 0.0))
        return Blow(last.began, last.impulse + dt * float(np.linalg.norm(force[:3])))


def _masses(scene: Scene, contacts: Sequence[Contact]) -> dict[str, float]:
    """Mass of the lightest part that each contact may touch, by titles [kg]. Collective."""
    of_node, n = parts_of_nodes(scene), scene.owned_nodes
    own = np.bincount(of_node[:n], scene.nodal_mass[:n], scene.parts.count)
    whole = np.asarray(scene.sum(own))
    return {contact.title: float(whole[met(scene, contact)].min()) for contact in contacts}
