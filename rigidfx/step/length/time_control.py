"""Steps whose length follows from their error: estimate, length, breakpoints, objections."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import StepError
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.warning import warn
from rigidfx.scene.scene import Scene
from rigidfx.scene.step_control import StepControl
from rigidfx.scene.timeline import Timeline
from rigidfx.state import State
from rigidfx.step.length.accounts import Accounts
from rigidfx.step.length.blows import Blows
from rigidfx.step.length.elsewhere import Elsewhere
from rigidfx.step.length.fast import Fast
from rigidfx.step.length.forgetting import Forgetting
from rigidfx.step.length.onsets import Onsets
from rigidfx.step.length.step_length import Moves, StepLength
from rigidfx.step.length.time_error import TimeError
from rigidfx.step.length.tracked import Tracked
from rigidfx.step.system.system import System
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import WarnsOnce

__all__ = ["TimeControl"]

FIRST = 16  # parts of the Δt that is wanted after a breakpoint: nothing is known of the next steps
OF_WAY = 8  # parts of the way to the next breakpoint, in which something happens
# Steps that another Δt costs, PRICE n^POWER of n unknowns, as it takes a new tangent where one is
# kept: a quarter of what was measured in a compact part, twice that in a small bar. By what really
# solves Δt would depend on the ranks.
PRICE, POWER = 0.1, 0.36
STRETCH = 0.1  # by so much may a step be longer than wanted, to end at a breakpoint


class TimeControl(WarnsOnce):
    """Says where steps end, and whether one errs by too much.

    Attributes:
        length: Chooses Δt.
        rejected: Steps that were repeated for the sake of the error.
        jumped: Whether the velocity of a support's path has jumped at the end of the last step, at
            no breakpoint.
    """

    remembered: ClassVar[Remembered] = (
        WarnsOnce.remembered
        | same(
            "rejected",
            "jumped",
            "_fastest",
            "_objections",
            "_fresh",
            "_event",
            "_led",
            "_stop",
            "_step",
            "_for",
        )
        | dict.fromkeys(
            ("length", "_error", "_elsewhere", "_blows", "_forgetting", "_fast", "_onsets"), PART
        )
    )

    def __init__(self, scene: Scene, control: StepControl, timeline: Timeline) -> None:
        """Find the tracked points. Collective.

        Args:
            scene: The problem.
            control: The criterion of the user.
            timeline: Breakpoints are added to it, but for kinks that may be stepped over.
        """
        super().__init__(scene.comm)
        self._scene, self._control, self._timeline = scene, control, timeline
        self._tracked = Tracked(scene, control.names)
        self._error = TimeError(self._tracked.count)
        self._elsewhere = Elsewhere(self._tracked.asked)
        self._onsets = Onsets(scene)
        self._blows, self._fastest = Blows(scene), 0.0
        bends = scene.bends
        self._bends = np.array(list(bends)), np.array(list(bends.values()))
        self._breaks = [t for t in scene.breakpoints if t > 0 and t not in bends]
        timeline.stop_at(self._breaks)
        largest = min(control.most, timeline.t_end)
        least, size = min(control.least, largest), scene.mean_cell_size
        self.length = StepLength(
            float(control.tol), timeline.t_end, largest, least, largest, size, control.of
        )
        self._forgetting = Forgetting(scene, self._tracked.count, timeline.t_end, least)
        cuts, bounds = self._forgetting.cuts, not self._forgetting.by_frequency
        self.length.accounts = Accounts(1 + cuts.size, bounds=bounds)
        self._fast = Fast(cuts, self._tracked.count) if bounds and cuts.size else None
        self.rejected, self.jumped = 0, False
        self._objections = 0
        self._end = Moves(0.0)  # at the end of the step that was looked at last
        self._fresh, self._event, self._led = True, np.nan, np.nan
        self._stop = self._step = self._for = np.nan
        self._found = np.nan  # error of the step that was looked at last
        self._system: Any = None
        self._state: Any = None

    @property
    def tol(self) -> float:
        """The budget, over the largest displacement."""
        return self.length.tol

    def follow(self, system: System, state: State) -> None:
        """Take over the equations of a division. Collective."""
        first, self._system, self._state = self._system is None, system, state
        if self._tracked.bind(system, state.bodies):
            self._error.switched()
        if first and self._control.names and self._tracked.led:
            names = ", ".join(f"'{name}'" for name in self._control.names)
            warn(
                self._scene.comm,
                f"Supports hold or move the probes at which accuracy is asked for ({names}): no "
                "step errs there, and Δt is the longest. Name a probe that moves freely.",
            )

    def learn(
        self, energy: float, dissipated: Mapping[str, float], dt: float, tol: float | None
    ) -> None:
        """Take note of an accepted step.

        Args:
            energy: Kinetic and strain energy at its end [J].
            dissipated: Energy that each kind of damping took in it [J].
            dt: Its length [s].
            tol: Error that time integration may make from now on, over the largest displacement;
                None if that stays as it is.
        """
        self._forgetting.follow(energy, dissipated, dt)
        self.length.accounts.rates = [*map(float, self._forgetting.rates)]
        if tol is not None:
            self.length.tol = tol

    def expect(self, event: float) -> None:
        """Take a time [s] for a breakpoint, as of the first touch of a contact."""
        self._event = event

    def target(self, t: float) -> float:
        """End of the step that begins at t [s]. Collective.

        What is left up to a breakpoint is divided evenly; where a load jumps or bends before, the
        step ends there, or as soon after as steps may be short: one that is rough everywhere had
        them creep.

        Args:
            t: Time [s].

        Raises:
            SceneError: On every rank, if a load's function fails on any.
        """
        end = self._even(t)
        onset = self._onsets.within(t, end, self.tol)
        if onset is None:
            return end
        reached = max(onset.t, min(end, t + self.length.shortest))
        if onset.jumps:
            self.expect(reached)
        if onset.led:
            self._led = reached
        self._stop = np.nan  # what is left is divided anew
        return reached

    def _even(self, t: float) -> float:
        """End of the step that begins at t, if nothing happens before [s]."""
        length, timeline = self.length, self._timeline
        if self._fresh:
            self._fresh = False
            way = timeline.stop_after(t) - t
            length.begin(max(min(length.wanted / FIRST, way / OF_WAY), length.shortest))
        stop = self._stop_after(t)
        if stop != self._stop or length.wanted != self._for:
            self._stop, self._for = stop, length.wanted
            steps = max(1, ceil((stop - t) / length.wanted - STRETCH))
            if (stop - t) / steps > length.longest * (1 + 1e-9):
                steps += 1
            self._step = (stop - t) / steps
        return stop if round((stop - t) / self._step) <= 1 else t + self._step

    def _stop_after(self, t: float) -> float:
        """The next breakpoint at which a step has to end [s]."""
        stop = self._timeline.stop_after(t)
        times, changes = self._bends
        # Over a kink inside, the load at the middle is wrong by an eighth of that, in the mean.
        strong = times[changes * self.length.wanted / 8 > self.tol]
        k = int(np.searchsorted(strong, t + self._timeline.resolution, side="right"))
        return min(stop, float(strong[k])) if k < strong.size else stop

    def objection(self, attempt: Attempt) -> StepError | None:
        """An error if a step is to be repeated with a shorter Δt; None to accept it. Collective.

        Args:
            attempt: The step that has been solved.
        """
        t, dt = attempt.t, attempt.dt
        v0, v1, u = self._tracked.motion(self._system, self._state, dt)
        self._found = self._elsewhere.look(self._error.look(v0, v1, t, dt), u)
        self._forgetting.look(self._error.jerk, self._error.swinging, dt)
        if self._fast is not None:
            self._fast.look(self._elsewhere.at_asked(self._fast.swings(u, dt)), dt)
        asked = slice(self._tracked.asked)
        v0, v1, u = v0[asked], v1[asked], u[asked]
        self._end = Moves(*_longest(u, v1, (v1 - v0) / dt))
        if self._blows.any:
            self._found += self._struck(t, dt)
        if attempt.final or not self.length.too_much(self._found, t, dt):
            return None
        if dt < 2 * self.length.shortest:
            if self.waits and not self.length.begins(t):
                self.say(
                    f"StepControl: steps of {dt:.3g} s, as short as they may be, err by more than "
                    f"tol = {self.tol:g} allows. Take a smaller `smallest`, or a larger tol; the "
                    "report's ledger says what was reached."
                )
            return None
        self._objections += 1
        return StepError(
            f"The step from t = {t:.9g} s errs by {self._found:.3g} m, with Δt = {dt:.3g} s.",
            "Try a larger tol.",
            self.length.halvings(self._found, t, dt),
        )

    def _struck(self, t: float, dt: float) -> float:
        """Error of a blow in a step that has been solved, once that shows [m]. Collective."""
        touches, fastest = self._system.actions.touches(), max(self._fastest, self._end.speed)
        later = self.length.displacement / fastest if fastest > 0 else 0.0
        return self._blows.look(touches, t, dt, later)

    def accept(self, attempt: Attempt) -> None:
        """Take note that the step that was looked at last is one. Collective."""
        young = self._error.young
        self._error.accept()
        self._elsewhere.accept()
        self._blows.accept()
        self._forgetting.accept()
        if self._fast is not None:
            self._fast.accept()
            self.length.accounts.beyond = [0.0, *map(float, 2 * self._fast.amplitudes)]
        self.length.accounts.parts = [*map(float, self._forgetting.parts)]
        self._fastest = max(self._fastest, self._end.speed)
        if attempt.cuts:
            self.length.wanted = attempt.dt
        price = PRICE * self._system.equilibrium.prolongation.size**POWER
        self.length.accept(self._found, attempt.end, attempt.dt, self._end, young, price)
        self.rejected, self._objections = self.rejected + self._objections, 0
        breaks = *self._breaks, self._event
        self._fresh = any(self._timeline.same(attempt.end, b) for b in breaks)
        self.jumped = self._timeline.same(attempt.end, self._led)
        if self._fresh:
            self._error.forget()
            self._onsets.forget()


def _longest(*vectors: npt.NDArray[np.floating[Any]]) -> list[float]:
    """Length of the longest of some vectors of shape (points, 3), and of more of them."""
    every = np.array(vectors)
    return [*map(sqrt, np.einsum("kpi,kpi->kp", every, every).max(axis=1))]
