"""Steps whose length follows from their error: estimate, length, breakpoints, objections."""

from collections.abc import Sequence
from math import isnan, sqrt
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import StepError
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.base.warning import warn
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.points import far_apart, find_probes, parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import StepControl, Timeline
from rigidfx.state import State
from rigidfx.step.length.controller import Controller, Moves, RunError
from rigidfx.step.length.given import Breakpoints, Onsets
from rigidfx.step.length.led import Led
from rigidfx.step.length.time_error import Blows, Elsewhere, TimeError
from rigidfx.step.system.system import System
from rigidfx.step.watches.judge import Attempt, WarnsOnce

NODES = 32  # of its own choice
ROUNDING = 1e-9  # of a probe's weights of nodes, which add up to one


class Tracked:
    """Some probes, and nodes far from each other of the connected parts that these belong to.

    A body's nodes have its motion. A node of a support is at its place at the end of each step.
    After a kink of the path its velocity, 2 Δu/Δt - v, alternates from step to step, which would
    count as an error. So such nodes have the mean velocity of a step at both ends.

    Attributes:
        asked: Number of the points that are asked for, the first of all: the probes, or all nodes
            if there are none.
        count: Number of all points.
        nodes: Owned nodes, of whose motion that of points is a weighted sum.
    """

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        """Find the points. Collective."""
        self._scene, probes = scene, find_probes(scene) if names else {}
        points = [probes[name] for name in names]
        own = np.concatenate([np.empty(0, np.int64), *(p.nodes for p in points)])
        nodes, places = far_apart(scene, NODES, _parts_of(scene, own) if names else None)
        self.count, self.asked = len(points) + NODES, len(points) or NODES
        self.nodes: Ints = np.concatenate([own, nodes]).astype(np.int64)
        of = np.repeat(np.arange(len(points)), [p.nodes.size for p in points])
        self._sums = np.zeros((self.count, self.nodes.size))
        self._sums[np.concatenate([of, len(points) + places]), np.arange(self.nodes.size)] = (
            np.concatenate([*(p.weights for p in points), np.ones(nodes.size)])
        )
        self._X = scene.space.tabulate_dof_coordinates()[self.nodes]
        self._dofs = 3 * self.nodes[:, None] + np.arange(3)
        self._body: Ints = np.full(self.nodes.size, -1)
        self._a: Array = np.zeros((self.nodes.size, 4))  # their coordinates in bodies
        self._free: Ints = np.empty(0, np.int64)  # those that take part in a step ...
        self._rows: Ints = np.empty((0, 3), np.int64)  # ... and where in its increments
        self._held: Bools = np.zeros(self._X.shape, dtype=bool)
        self._bodies: tuple[object, ...] = ()
        self._led = Led(scene)

    def bind(self, system: System, bodies: Bodies) -> bool:
        """Find the points in a division; whether there are other bodies than before."""
        before, self._bodies = self._bodies, bodies.of.records
        self._body[:] = -1
        self._a = np.zeros((self.nodes.size, bodies.pose.shape[1]))
        for k, body in enumerate(bodies.of.records):
            inside, place = _found(body.nodes, self.nodes)
            a = body.coordinates(place)
            self._body[inside] = k
            self._a[inside, : a.shape[1]] = a
        known, place = _found(system.layout.rows.nodes, self.nodes)
        taking = self._body[known] < 0
        self._free = known[taking]
        self._rows = 3 * place[taking, None] + np.arange(3)
        self._held = system.layout.prescribed[self._dofs]
        return [*map(id, before)] != [*map(id, self._bodies)]

    @property
    def led(self) -> bool:
        """Whether supports hold or move all points that are asked for. Collective."""
        weights = np.abs(self._sums[: self.asked])
        return float(self._scene.sum((weights @ ~self._held).sum())) < ROUNDING

    def motion(self, system: System, state: State, dt: float) -> tuple[Array, ...]:
        """Velocities and displacements at both ends of a solved step of Δt [s]. Collective.

        And velocities about the led motion, shape (points, 3) each [m/s, m/s, m, m, m/s, m/s].
        """
        free, inside = self._free, self._body >= 0
        local: Array = np.zeros((6, self.nodes.size, 3))
        v0, v1, before, moved, *about = local
        v0[:] = v1[:] = state.v.x.array[self._dofs]
        before[:] = moved[:] = state.u.x.array[self._dofs]
        d = system.d.array_r[self._rows]
        v1[free] = 2 / dt * d - v0[free]
        moved[free] += d
        v0[self._held] = v1[self._held] = (v0[self._held] + v1[self._held]) / 2
        if inside.any():
            increments, k = system.prolongation.increments, self._body[inside]
            a, ends = self._a[inside, None], (increments.start, increments.end)
            for v, u, bodies in zip((v0, v1), (before, moved), ends, strict=True):
                v[inside] = (a @ bodies.pose_rate[k])[:, 0]
                u[inside] = (a @ bodies.pose[k])[:, 0] - self._X[inside]
        local[4:], x = local[:2], np.zeros((len(state.X), 3))
        led = self._led.rates(system, state.u.x.array, state.t, dt)
        for v, rates, back in zip(about, led, (dt * (v0 + v1) / 2, 0.0), strict=False):
            x[self.nodes] = self._X + moved - back
            v -= np.where(self._held, 0.0, self._led.motions(x, self.nodes) @ rates)
        return tuple(np.asarray(self._scene.sum(self._sums @ local)))


def _found(among: npt.NDArray[np.integer[Any]], nodes: Ints) -> tuple[Ints, Ints]:
    """Which of some nodes are among sorted ones, and their places there."""
    place = np.searchsorted(among, nodes)
    inside = np.flatnonzero(np.isin(nodes, among))
    return inside, place[inside]


def _parts_of(scene: Scene, nodes: Ints) -> Bools:
    """Owned nodes of the connected parts that some nodes of all ranks are in. Collective."""
    of_node = parts_of_nodes(scene)
    held = np.asarray(scene.sum(np.bincount(of_node[nodes], minlength=scene.parts.count) + 0.0))
    return np.asarray(held[of_node[: scene.owned_nodes]] > 0)


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
        | same("rejected", "jumped", "_objections", "_fresh", "_led")
        | dict.fromkeys(("length", "_error", "_about", "_elsewhere"), PART)
        | dict.fromkeys(("_blows", "_run_error", "_onsets", "_breakpoints"), PART)
    )

    def __init__(self, scene: Scene, control: StepControl, timeline: Timeline) -> None:
        """Find the tracked points, and add breakpoints to a timeline. Collective."""
        super().__init__(scene.comm)
        self._scene, self._control, self._timeline = scene, control, timeline
        self._tracked = Tracked(scene, control.names)
        self._error = TimeError(self._tracked.count)
        self._about = TimeError(self._tracked.count)  # of the motion about the led one
        self._elsewhere = Elsewhere(self._tracked.asked)
        self._breakpoints, self._onsets = Breakpoints(scene, timeline), Onsets(scene)
        self._blows = Blows(scene)
        largest = min(control.most, timeline.t_end)
        least, size = min(control.least, largest), scene.mean_cell_size
        self._run_error = RunError(scene, self._tracked.count, timeline.t_end, least)
        self.length = Controller(
            float(control.tol), timeline.t_end, self._run_error, least, largest, size, control.of
        )
        self.rejected, self.jumped = 0, False
        self._objections = 0
        self._end = Moves(0.0, 0.0, 0.0)  # at the end of the step that was looked at last
        self._fresh, self._led = True, np.nan
        self._found = np.nan  # error of the step that was looked at last
        self._system: Any = None
        self._state: Any = None

    def reach(self, more: float) -> float:
        """Largest displacement that accuracy is relative to, up to the end of a solved step [m].

        That of the user, or of the points that are asked for, or a larger one that is to come.
        """
        if self._control.of is not None:
            return float(self._control.of)
        return max(self.length.displacement, self._end.displacement, more)

    def follow(self, system: System, state: State) -> None:
        """Follow the equations of a division. Collective."""
        first, self._system, self._state = self._system is None, system, state
        if self._tracked.bind(system, state.bodies):
            for error in (self._error, self._about):
                error.switched()
        if first and self._control.names and self._tracked.led:
            names = ", ".join(f"'{name}'" for name in self._control.names)
            warn(
                self._scene.comm,
                f"Supports hold or move the probes at which accuracy is asked for ({names}): no "
                "step errs there, and Δt is the longest. Name a probe that moves freely.",
            )

    def expect(self, event: float) -> None:
        """Add a time [s] as a breakpoint, as of the first touch of a contact."""
        self._breakpoints.expect(event)

    def target(self, t: float) -> float:
        """End of the step that begins at t [s]. Collective; see `Onsets.within` for errors."""
        length = self.length
        if self._fresh:
            self._fresh = False
            length.begin()
        end = self._breakpoints.end(t, length.wanted, length.longest, length.tol)
        onset = self._onsets.within(t, end, length.shortest, length.tol)
        if onset is None:
            return end
        self._breakpoints.forget()
        if onset.jumps:
            self.expect(onset.t)
        if onset.led:
            self._led = onset.t
        return onset.t

    def objection(self, attempt: Attempt) -> StepError | None:
        """An error if a step is to be repeated with a shorter Δt; None to accept it. Collective."""
        t, dt = attempt.t, attempt.dt
        v0, v1, u0, u, s0, s1 = self._tracked.motion(self._system, self._state, dt)
        self._elsewhere.look(u)
        errs = self._error.look(v0, v1, t, dt), self._about.look(s0, s1, t, dt)
        lengths = np.vstack([*errs, self._run_error.swings(u0, u, dt)])
        found, less, *swings = self._elsewhere.worth(lengths)
        self._found = float(min(found, less))
        error = self._about if less < found else self._error
        self._run_error.look(error.jerk, error.swinging, np.array(swings), error.omega, dt)
        asked = slice(self._tracked.asked)
        v0, v1, u = v0[asked], v1[asked], u[asked]
        every = np.array([u, v1, (v1 - v0) / dt])
        self._end = Moves(*map(sqrt, np.einsum("kpi,kpi->kp", every, every).max(axis=1)))
        if self._blows.any:
            touches, U = self._system.actions.touches(), self.length.displacement
            blow = self._blows.look(touches, t, dt, U, self._end.speed)
            if blow > 0:  # known in the first step of a touch, too, when jerks are not
                self._found = blow + (0.0 if isnan(self._found) else self._found)
        if attempt.final or not self.length.too_much(self._found, t, dt):
            return None
        if dt < 2 * self.length.shortest:
            if self.waits and self.length.overspends(self._found) and not self.length.begins(t):
                self.say(
                    f"StepControl: steps of {dt:.3g} s, as short as they may be, err by more than "
                    f"tol = {self.length.tol:g} allows. Take a smaller `smallest`, or a larger "
                    "tol; the report's ledger says what was reached."
                )
            return None
        self._objections += 1
        return StepError(
            f"The step from t = {t:.9g} s errs by {self._found:.3g} m, with Δt = {dt:.3g} s.",
            "Try a larger tol.",
            self.length.halvings(self._found, t, dt),
        )

    def accept(self, attempt: Attempt) -> None:
        """Accept the step that was looked at last. Collective."""
        young = self._error.young
        self._error.accept()
        self._about.accept()
        self._elsewhere.accept()
        self._blows.accept()
        if attempt.cuts:
            self.length.wanted = attempt.dt
        elif self._objections:  # it was made again, with more shapes: nothing is known of these
            self.length.begin()
        unknowns = self._system.prolongation.size
        self.length.accept(self._found, attempt.end, attempt.dt, self._end, young, unknowns)
        self.rejected, self._objections = self.rejected + self._objections, 0
        self._fresh = self._breakpoints.meets(attempt.end)
        self.jumped = self._timeline.same(attempt.end, self._led)
        if self._fresh:
            self._error.forget()
            self._about.forget()
            self._run_error.restart()
