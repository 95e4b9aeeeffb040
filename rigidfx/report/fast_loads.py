"""Do loads change faster than Δt?

A step takes a load f in its middle, which is its mean over the step as far as f is straight there.
The part that is bent is r = f - f(middle) - s (t - middle), with the slope s that fits best, and

    Σ Δt mean |r|   of   Σ Δt mean |f|

is (ωΔt)²/24 in a vibration of ω. Means are taken at Gauss's five points, whose distances have no
common divisor: no vibration looks straight in them. Of the path of a support, and of a motor that
prescribes a motion, f is the velocity.
"""

from __future__ import annotations

from math import pi
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import SceneError, together
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects import Motor
from rigidfx.report.brief_stops import RESOLVED, rounded_down
from rigidfx.report.report import Look, Report
from rigidfx.scene.scene import Scene
from rigidfx.step.length.given import SMOOTH, Given, given_loads, is_given
from rigidfx.step.watches.alternation import WORTH_A_WARNING as NOTHING
from rigidfx.step.watches.jumps import Jumps

__all__ = ["FastLoads"]


POINTS, WEIGHTS = np.polynomial.legendre.leggauss(RESOLVED // 2)


class FastLoads(Look):
    """Looks at loads that are functions; warns at the end."""

    remembered: ClassVar[Remembered] = same("_waits", "_t", "_missed", "_whole", "_worst")

    def __init__(self, scene: Scene, jumps: Jumps, given: bool) -> None:
        """Begin before the first report. Collective.

        Args:
            scene: The problem.
            jumps: Tells where paths jump.
            given: Whether Δt is given; else steps are chosen by what loads will be.
        """
        self._comm, self._jumps = scene.comm, jumps
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
        """See `Look`."""
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
        """See `Look`."""
        whole = np.where(self._whole > self._least, self._whole, np.inf)
        for k in np.flatnonzero(self._missed > SMOOTH * whole):
            load, (_, start, dt) = self._loads[k], self._worst[k]
            if load.led and not self._jumps.waits:
                continue
            period = _period(load, start, dt, min(start + 3 * dt, self._t))
            part, short = min(self._missed[k] / whole[k], 1.0), min(period / RESOLVED, 0.5 * dt)
            kind = "velocity" if load.led else "value"
            warn(
                self._comm,
                f"{load.owner}: its {kind} changes faster than Δt = {dt:.3g} s, near t = "
                f"{start:.6g} s within some {period:.2g} s. A step takes it in its middle, and "
                f"misses {part:.0%} of it. Take Δt ≤ {rounded_down(short):.2g} s, "
                "a tenth of that, or StepControl; where it jumps or has kinks, since, until and "
                "rf.Table end steps there.",
            )


def _parts(load: Given, start: float, dt: float) -> tuple[float, float]:
    """What a step misses of a load, and the whole, times its length."""
    values = np.stack([load.at(start + 0.5 * dt * (1 + x), dt) for x in POINTS])
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
