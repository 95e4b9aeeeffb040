"""Do loads, and forces of motors, joints and supports, change faster than Δt?

A step takes the mean of a load f, and what is straight in it errs by little. The rest is
r = f - f(middle) - s (t - middle), with the slope s that fits best, and Σ Δt mean |r| of
Σ Δt mean |f| is (ωΔt)²/24 in a vibration of ω. Means are taken at Gauss's five points, whose
distances have no common divisor: no vibration looks straight in them. Of the path of a support,
and of a motor that prescribes a motion, f is the velocity.

The second difference of a constraint's force, over 4, counts as alternating where it changes its
sign in two of three steps, which it does at three steps a period and less. One event in between
leaves no trace in the median. One step of four is looked at, in windows: all of them took 9 % of
the time of a slider-crank of three reduced parts.
"""

from math import pi
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import SceneError, together
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Joint, Motor, ResolvedForces, Rigid
from rigidfx.effects.joints.elements import titles_of
from rigidfx.report.advice import ADVICE, OF_ALL, RESOLVED, Adviser
from rigidfx.report.blows import rounded_down
from rigidfx.report.report import Report
from rigidfx.report.resolved_forces import resolved_part
from rigidfx.scene.scene import Scene
from rigidfx.step.length.given import SMOOTH, Given, given_loads, is_given
from rigidfx.step.watches.alternation import FIRST, WORTH_A_WARNING, Alternation
from rigidfx.step.watches.jumps import Jumps

NOTHING = WORTH_A_WARNING  # of the largest force or way: next to none, or rounding
PAUSE = 48  # steps that are not looked at between two windows
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(RESOLVED // 2)


class AlternatingForces(Adviser):
    """Looks at the forces of constraints; advises after half of a run, or at its end."""

    remembered: ClassVar[Remembered] = Adviser.remembered | same(
        "_t", "_dt", "_inertia", "_last", "_waits", "_most", "_resolved", "_swings"
    )

    def __init__(self, scene: Scene, motion: Alternation, t_end: float) -> None:
        """Begin before the first report, with where the motion goes back and forth. Collective."""
        super().__init__(scene)
        self._motion, self._half = motion, 0.5 * t_end
        rigid = [scene.owned_cells(r.where, r.owner) for r in scene.named(Rigid) if not r.deforms]
        held = np.unique(np.concatenate([np.empty(0, np.int32), *rigid])).size
        flexible = scene.sum(float(scene.mesh.topology.index_map(3).size_local - held)) > 0
        self._joints = [joint.title for joint in scene.named(Joint)]
        motors = [found for found in titles_of(scene) if found[0].is_load]
        self._motors = [(motor.joint, title) for motor, title in motors]
        self._supports = list(dict.fromkeys(support.where for support, _ in scene.supports))
        of = *(joint.owner for joint in scene.named(Joint)), *(f"'{w}'" for w in self._supports)
        self._idle = dict.fromkeys(self._supports, np.full(3, np.nan))
        self._names = [title for _, title in self._motors]
        self._names += [f"{kind} of {name}" for kind in ("force", "moment") for name in of]
        turns = [motor.acts_along == "angle" for motor, _ in motors]
        turns += [kind for kind in (False, True) for _ in of]
        self._units = np.where(turns, "N m", "N")
        self._looks = bool(flexible and self._names and not scene.named(ResolvedForces))
        low, high = scene.box_of(scene.start_places)
        self._scales = np.where(turns, np.max(high - low), 1.0)  # of moments [m]
        self._t = self._dt = self._inertia = 0.0  # largest Σ m|v| over a step [N]
        self._last: list[Array] = []  # forces of steps of one length
        self._waits = 0  # steps that are not looked at before the next window
        self._most, self._resolved, self._swings = np.zeros((3, len(self._names)))

    def follow(self, report: Report) -> None:
        """Take the forces of constraints in a step."""
        if not self._looks or self.said or not report.step:
            return
        if abs(report.dt - self._dt) > NOTHING * self._dt or report.events or report.impact:
            self._judge()
        self._t, self._dt = report.t, report.dt
        self._inertia = max(self._inertia, report.momentum_scale / report.dt)
        if self._waits:
            self._waits -= 1
            return
        self._last.append(self._forces_in(report))
        if len(self._last) == 4 * FIRST:
            self._judge()
            self._waits = PAUSE
            if report.t > self._half:
                self._tell()

    def end(self) -> None:
        """Judge the last window, and advise."""
        self._judge()
        self._tell()

    def _forces_in(self, report: Report) -> Array:
        """Forces of constraints in a step, NaN of those that do not act, shape (names, 3)."""
        joints, reactions = report.joints, (report.reactions, report.reaction_moments)
        efforts = [joints[name].efforts.get(title, np.nan) for name, title in self._motors]
        out = [np.array([effort, 0.0, 0.0]) for effort in efforts]
        for kind, held in zip(("force", "moment"), reactions, strict=True):
            out += [getattr(joints[name], kind) for name in self._joints]
            known = {**self._idle, **held}
            out += [known[name] for name in self._supports]
        return np.array(out)

    def _judge(self) -> None:
        """Keep peaks, and how far forces go back and forth, in a window."""
        if self.said or not self._last:
            return
        now = np.array(self._last).reshape(len(self._last), 3 * self._most.size)
        for kept, forces in ((self._most, now), (self._resolved, resolved_part(now))):
            sizes = np.linalg.norm(forces.reshape(-1, kept.size, 3), axis=2)
            np.fmax(kept, np.nanmax(sizes, axis=0, initial=0.0), out=kept)
        rests = np.diff(now, 2, axis=0) / 2**2
        for k in range(0, len(rests) - FIRST + 1, 2 * FIRST):
            some = rests[k : k + 2 * FIRST]
            turns = (some[1:] * some[:-1] < 0).sum(axis=0)
            swings = np.median(np.abs(some), axis=0) * (3 * turns >= 2 * (len(some) - 1))
            self._swings = np.fmax(self._swings, np.linalg.norm(swings.reshape(-1, 3), axis=1))
        self._last = []

    def _tell(self) -> None:
        """Advise on forces of which a twentieth goes back and forth.

        A hundredth of the largest force matters nowhere, but for motors, which are sized by theirs;
        neither does what is next to nothing beside that, or beside Σ m|v| in a step.
        """
        largest = (self._resolved / self._scales).max(initial=0.0)
        driven = np.arange(len(self._names)) < len(self._motors)
        least = np.where(driven, OF_ALL**2, OF_ALL) * largest
        least = np.maximum(least, NOTHING * self._inertia)
        bound = ADVICE["a force goes back and forth"].bound * self._resolved
        found = np.flatnonzero(self._swings > np.maximum(bound, least * self._scales))
        if self.said or not (found.size and self._motion.waits):
            return
        first, *others = found  # motors before joints and supports
        names = ", ".join(self._names[k] for k in others)
        self.advise(
            "a force goes back and forth",
            t=self._t,
            dt=self._dt,
            name=self._names[first],
            unit=self._units[first],
            swing=self._swings[first],
            peak=self._most[first],
            resolved=self._resolved[first],
            others=f" (likewise {names})" if names else "",
        )


class FastLoads(Adviser):
    """Looks at loads that are functions; advises at the end."""

    remembered: ClassVar[Remembered] = same("_waits", "_t", "_missed", "_whole", "_worst")

    def __init__(self, scene: Scene, jumps: Jumps, given: bool) -> None:
        """Begin before the first report; a Δt that is not given follows loads. Collective."""
        super().__init__(scene)
        self._jumps = jumps
        self._loads: list[Given] = []
        if given:
            motors = [Given(m, scene, m.drive) for m in scene.named(Motor) if is_given(m)]
            self._loads = [*given_loads(scene), *motors]
        self._waits, self._t = bool(self._loads), 0.0
        self._begin = min((x.start for x in self._loads), default=0.0)  # of the first to act [s]
        self._missed, self._whole = np.zeros((2, len(self._loads)))
        self._worst = np.zeros((len(self._loads), 3))  # step: missed, its start [s] and length [s]
        rests = NOTHING * scene.mean_cell_size  # a way that is next to none, or rounding
        self._least = np.array([x.led * rests for x in self._loads])

    def follow(self, report: Report) -> None:
        """Add what a step misses of each load. Collective."""
        if not self._waits or report.t <= self._begin:
            return
        self._t, before = report.t, report.t - report.dt
        try:
            found = together(
                self._comm, "A load", lambda: [_parts(x, before, report.dt) for x in self._loads]
            )
        except SceneError:  # of a function, which the next step tells
            self._waits = False
            return
        for k, (missed, whole) in enumerate(self._comm.bcast(found)):
            self._missed[k] += missed
            self._whole[k] += whole
            if missed > self._worst[k, 0]:
                self._worst[k] = missed, before, report.dt

    def end(self) -> None:
        """Advise on loads of which steps have missed much."""
        whole = np.where(self._whole > self._least, self._whole, np.inf)
        for k in np.flatnonzero(self._missed > SMOOTH * whole):
            load, (_, start, dt) = self._loads[k], self._worst[k]
            if load.led and not self._jumps.waits:
                continue
            period = _period(load, start, dt, min(start + 3 * dt, self._t))
            part, short = min(self._missed[k] / whole[k], 1.0), min(period / RESOLVED, 0.5 * dt)
            kind = "velocity" if load.led else "value"
            found = {"kind": kind, "dt": dt, "t": start, "period": period, "number": part}
            self.advise(
                "a load or path changes faster than Δt",
                owner=load.owner,
                short=rounded_down(short),
                **found,
            )


def _parts(load: Given, start: float, dt: float) -> tuple[float, float]:
    """What a step misses of a load, and the whole, times its length; asked thrice if it stays."""
    times = start + 0.5 * dt * (1 + POINTS)
    first, *others = (load.at(t, dt) for t in times[::2])
    if all(np.array_equal(first, value) for value in others):
        return 0.0, float(dt * np.linalg.norm(first, axis=-1) @ load.weights)
    values = np.empty((len(times), *first.shape))
    values[::2], values[1::2] = [first, *others], [load.at(t, dt) for t in times[1::2]]
    slope = np.tensordot(WEIGHTS * POINTS / (WEIGHTS @ POINTS**2), values, 1)
    bent = values - values[len(POINTS) // 2] - POINTS[:, None, None] * slope
    missed, whole = (0.5 * dt * WEIGHTS @ np.linalg.norm(f, axis=-1) for f in (bent, values))
    return float(missed @ load.weights), float(whole @ load.weights)


def _period(load: Given, start: float, dt: float, last: float) -> float:
    """2π/ω [s] of a vibration that changes as fast, ω² ∫ (f - f̄)² dt = ∫ ḟ² dt.

    That is from two steps before one until the last time, each in a hundred parts.
    """
    begin = max(start - 2 * dt, 0.0)
    times, apart = np.linspace(begin, last, round(RESOLVED**2 * (last - begin) / dt), retstep=True)
    values = np.stack([load.at(t, dt) for t in times[:-1]])
    by = ((values - values.mean(axis=0)) ** 2).sum(axis=(0, 2)) @ load.weights
    rate = (np.diff(values, axis=0) ** 2).sum(axis=(0, 2)) @ load.weights / apart**2
    return float(2 * pi * np.sqrt(by / rate)) if rate > 0 else dt
