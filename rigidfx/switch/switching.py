"""The controlled run (Fig. 2): observe a window, freeze what qualifies, release at changes.

    steps of a window → qualify → find_regions → assign_bodies → integrator.regroup → Event

A change of a load or of a support releases all bodies, and a new window begins. Changes of Δt, of
numerical damping or of the output release nothing.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base.errors import RigidfxWarning, SceneError, together
from rigidfx.decide.back_off import BackOff
from rigidfx.decide.clusters import NONE, CellGraph, find_regions
from rigidfx.decide.criterion import Release, StrainRate
from rigidfx.decide.decision import assign_bodies, qualify
from rigidfx.decide.load_changes import Changes
from rigidfx.decide.window import Record, Window
from rigidfx.report.events import Event
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.step.stepper import Integrator, StepResult

__all__ = ["Switching"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

MARGIN = 1.25  # an automatic window in longest periods
FEWEST = 8  # steps of an automatic window
PLANNED = "planned"  # reason of a release at a given time


class Switching:
    """Decides, step by step, what becomes rigid or flexible, and has it done.

    Attributes:
        closeness: How close the decisions of the last step were: the least |e/tol - 1| of any
            cell; NaN if it ended no window.
    """

    def __init__(
        self, scene: Scene, criterion: StrainRate, integrator: Integrator, timeline: Timeline
    ) -> None:
        """Find the cells that the criterion names. Collective.

        Args:
            scene: The problem.
            criterion: What the user states.
            integrator: What advances the scene.
            timeline: Where steps end; planned releases are added to it.

        Raises:
            SceneError: If a name is unknown, or the mesh was distributed without ghost cells.
        """
        self._scene, self._criterion, self._integrator = scene, criterion, integrator
        self._resolution = timeline.resolution
        timeline.stop_at(criterion.breakpoints)
        self._graph = CellGraph(scene)
        special = np.full(self._graph.owned, np.inf)
        for name, tol in criterion.tolerances.items():
            cells = scene.owned_cells(name, "StrainRate (tolerances)")
            special[cells] = np.minimum(special[cells], tol)
        self._tol = np.where(np.isfinite(special), special, criterion.tol)
        self._never = np.zeros(self._graph.owned, dtype=bool)
        for name in criterion.never:
            self._never[scene.owned_cells(name, "StrainRate (never)")] = True
        for release in criterion.releases:
            if release.where is not None:
                scene.owned_cells(release.where, "Release")
        loaded = {r.body for r in scene.named(fx.Resultant)}
        rigid = scene.named(fx.Rigid)
        self._alone = {r.name for r in rigid if r.given or r.name in loaded}
        self._always = {
            r.name: scene.owned_cells(r.where, "Rigid") for r in rigid if r.name not in self._alone
        }
        self._next_number = len(rigid) + 1
        self._changes = Changes(scene, criterion.load_change, timeline)
        self._record = Record(scene)
        self._back_off = BackOff(self._graph.owned, criterion.patience)
        self._warned: set[str] = set()
        self._begin(0.0)
        self.closeness = np.nan

    def _begin(self, t: float) -> None:
        """Begin a new window at t [s], or when observation does."""
        self._window = Window(self._graph.owned, max(t, float(self._criterion.since)))

    # The run ------------------------------------------------------------------------------------

    def before(self, dt: float) -> list[Event]:
        """What has to be released before a step of length dt [s]. Collective."""
        if all(body.name in self._alone for body in self._integrator.state.bodies):
            return []
        middle = self._integrator.state.t + dt / 2
        changed = self._changes.ahead(middle)
        if not changed:
            return []
        self._changes.remember(middle)
        events = self._release(f"{changed} changes", self._everything())
        if events:
            self._restart()
        return events

    def after(self, result: StepResult, report: Report) -> list[Event]:
        """What is released and frozen after a step. Collective.

        Args:
            result: The step.
            report: What a user's condition is given.
        """
        state = self._integrator.state
        self.closeness = np.nan
        if state.t > self._criterion.since + self._resolution:
            assert result.strain_rates is not None
            self._window.add(*result.strain_rates)
            self._record.add(state, self._changes.observe(state.t))
        changed = self._changes.declared(state.t)
        events = []
        if changed:
            self._restart()
            events += self._release("a load or a support changes", self._everything())
        for release in self._criterion.releases:
            asked, cells = self._ask(release, report)
            if asked:
                changed = True
                events += self._release(asked, cells)
        if changed:
            self._begin_anew(state.t)
        elif self._window_ends():
            self._check_tolerance(result)
            events += self._freeze()
        return events

    def _restart(self) -> None:
        self._record.restart()
        self._begin_anew(self._integrator.state.t)

    def _begin_anew(self, t: float) -> None:
        """Begin a new window at t [s] and forget those before it."""
        self._back_off.restart()
        self._begin(t)

    def _window_ends(self) -> bool:
        """Whether the window has its length. Collective."""
        t, criterion = self._integrator.state.t, self._criterion
        length = t - self._window.begin
        if t <= criterion.since + self._resolution or t >= criterion.until - self._resolution:
            return False
        if criterion.window == "auto":
            if self._window.steps < FEWEST:
                return False
            return bool(length + self._resolution >= MARGIN * self._record.period())
        if length + self._resolution < criterion.window:
            return False
        period = self._record.period()
        if criterion.window < period:
            self._warn(
                f"the window of observation, {criterion.window:.3g} s, is shorter than the longest "
                f"period seen, {period:.3g} s: cells may qualify at the turn of a vibration. Take "
                f"window ≥ {period:.3g}, or 'auto'."
            )
        return True

    def _check_tolerance(self, result: StepResult) -> None:
        noise = self._integrator.strain_error / result.dt
        comm = self._scene.comm
        least = comm.allreduce(self._tol[self._tol > 0].min(initial=np.inf), op=MPI.MIN)
        if least < noise:
            self._warn(
                f"the tolerance {least:.3g} 1/s is below what the end of Newton's "
                f"iteration may leave in the strain rates, {noise:.3g} 1/s: decisions are at "
                "random. Take a larger tolerance or a larger Δt."
            )

    def _warn(self, message: str) -> None:
        """Warn once of each thing, on rank 0."""
        kind = message.split(",")[0]
        if kind not in self._warned and self._scene.comm.rank == 0:
            warnings.warn(f"StrainRate: {message}", RigidfxWarning, stacklevel=2)
        self._warned.add(kind)

    # Decisions ----------------------------------------------------------------------------------

    def _freeze(self) -> list[Event]:
        """Freeze what has qualified in the window. Collective."""
        integrator, graph = self._integrator, self._graph
        flexible = integrator.flexible
        able, self.closeness = qualify(self._window.worst, self._tol, flexible, graph.comm)
        able = self._back_off.lasting(able, integrator.state.t - self._window.begin)
        existing = self._numbers()
        barred = self._never | (~flexible & (existing == NONE)) | self._chained()
        self._begin(integrator.state.t)
        reason = f"strain rates in a window that ended at {integrator.state.t:.6g} s"
        event = self._regroup("freeze", reason, able, existing, barred)
        if event is not None:
            self._changes.remember(integrator.state.t)
        return [event] if event is not None else []

    def _everything(self) -> Bools:
        return np.ones(self._graph.owned, dtype=bool)

    def _ask(self, release: Release, report: Report) -> tuple[str, Bools]:
        """Why a record releases now, "" if it does not, and which owned cells. Collective."""
        state, comm = self._integrator.state, self._scene.comm
        reason, names = "", None
        if any(abs(t - state.t) <= self._resolution for t in release.times):
            reason = PLANNED
        elif release.when is not None:
            condition = release.when
            answer = together(comm, "Release: its condition", lambda: _answer(condition, report))
            answer = comm.bcast(answer)
            if answer:
                reason, names = "condition", None if answer is True else answer
        cells = self._everything()
        if not reason:
            return reason, cells
        if release.where is not None:
            cells = np.zeros_like(cells)
            cells[self._scene.owned_cells(release.where, "Release")] = True
        if names is not None:
            known = {body.name: body for body in state.bodies}
            unknown = [name for name in names if name not in known]
            if unknown:
                raise SceneError(
                    f"Release: its condition names the body '{unknown[0]}'; there are "
                    f"{sorted(known) or 'none'}."
                )
            of_bodies = np.zeros_like(cells)
            for name in names:
                of_bodies[known[name].cells] = True
            cells &= of_bodies
        return reason, cells

    def _release(self, reason: str, cells: Bools) -> list[Event]:
        """Release owned cells from their bodies; what is left of these stays rigid. Collective."""
        numbers = self._numbers()
        always = np.zeros_like(cells)
        for own in self._always.values():
            always[own] = True
        leaving = cells & (numbers != NONE) & ~always
        touched = np.unique(numbers[leaving]).tolist()
        touched = sorted({k for part in self._scene.comm.allgather(touched) for k in part})
        if not touched:
            return []
        # What is left of a body is a new find, but for cells that are rigid always.
        able = np.isin(numbers, touched) & ~leaving
        existing = np.where(np.isin(numbers, touched), NONE, numbers)
        first = max((body.number for body in self._integrator.state.bodies), default=0) + 1
        for k, own in enumerate(self._always.values()):
            inside = own[np.isin(numbers[own], touched)]
            existing[inside] = first + k
        barred = ~able & (existing == NONE)
        event = self._regroup("release", reason, able, existing, barred)
        return [event] if event is not None else []

    def _regroup(
        self,
        kind: Literal["freeze", "release"],
        reason: str,
        able: Bools,
        existing: npt.NDArray[np.int64],
        barred: Bools,
    ) -> Event | None:
        """Find the bodies and have them made. Collective."""
        regions = find_regions(self._graph, able, existing, barred, self._criterion.min_cells)
        sizes = {body.number: body.size for body in self._integrator.state.bodies}
        parts, self._next_number = assign_bodies(
            regions, self._numbers(), sizes, self._always, self._next_number, self._scene.comm
        )
        event = self._integrator.regroup(parts, self._alone, kind, reason)
        rigid, t = self._numbers() != NONE, self._integrator.state.t
        hasty = self._back_off.switched(rigid, t, counts=reason != PLANNED)
        if self._scene.comm.allreduce(hasty, op=MPI.LOR):
            self._warn(
                "bodies are released again and again, sooner than they were observed: their cells "
                "have to qualify for longer and longer now (patience). Take a longer window, a "
                "larger load_change, or look at the conditions of Release."
            )
        return event

    def _numbers(self) -> npt.NDArray[np.int64]:
        """For each owned cell the number of the body it is in and may leave or grow, or NONE."""
        numbers = np.full(self._graph.owned, NONE, dtype=np.int64)
        for body in self._integrator.state.bodies:
            if body.name not in self._alone:
                numbers[body.cells] = body.number
        return numbers

    def _chained(self) -> Bools:
        """Owned cells at nodes that supports hold, or that bodies of their own hold. Collective."""
        nodes = self._integrator.supported_nodes.copy()
        for body in self._integrator.state.bodies:
            if body.name in self._alone:
                nodes[body.nodes] = True
        return self._graph.touching(self._graph.nodes_with_ghosts(nodes))


def _answer(condition: Any, report: Report) -> bool | list[str]:
    """What a user's condition says: True, False or names of bodies."""
    answer = condition(report)
    if isinstance(answer, (bool, np.bool_)):
        return bool(answer)
    if isinstance(answer, str):
        return [answer]
    if isinstance(answer, Iterable):
        names = list(answer)
        if all(isinstance(name, str) for name in names):
            return names
    raise SceneError(
        f"Release: its condition must give True, False or names of bodies, got {answer!r}."
    )
