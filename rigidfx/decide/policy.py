"""The controlled run (Fig. 2): observe a window, freeze quiet cells, release at changes.

    steps of a window → qualify → find_clusters → plan_bodies → Decision

Bodies without shapes are released by any change of a load or of a support, or by the user alone.
Bodies that grow lose the cells that their shapes do not follow. Then a new window begins. Changes
of Δt, of numerical damping or of the output release nothing.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import shown
from rigidfx.base.remembered import PART, Remembered
from rigidfx.base.types import Array, Bools
from rigidfx.base.warning import warn
from rigidfx.decide.bodies import Decision, NamedParts, Planner, paying, qualify
from rigidfx.decide.clusters import NONE, CellGraph
from rigidfx.decide.memory import BackOff, ContactChanges, LoadChanges, Memory, Signals, Window
from rigidfx.decide.rules import Observation, judged_cells
from rigidfx.decide.settings import Criterion, Release
from rigidfx.effects import Contact, Touch
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.report.ledger import Rigidity
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

PLANNED = "planned"  # reason of a release at a given time
ASKED = "checked: a condition"


class Releases:
    """The releases that a criterion records."""

    def __init__(self, scene: Scene, releases: Sequence[Release], timeline: Timeline) -> None:
        """Look the sets of cells up. Collective.

        Raises:
            SceneError: If the name of a set is unknown.
        """
        self._comm, self._timeline = scene.comm, timeline
        owned = scene.owned_cells(None, "Release").size
        self._pairs: list[tuple[Release, Bools]] = []
        for release in releases:
            cells = np.zeros(owned, dtype=bool)
            cells[scene.owned_cells(release.where, "Release")] = True
            self._pairs.append((release, cells))

    @property
    def repeat(self) -> bool:
        """Whether there is a condition that has steps solved again."""
        return any(release.repeat for release, _ in self._pairs)

    def asked(
        self, t: float, report: Report, bodies: Sequence[RigidBody], before: bool = False
    ) -> tuple[list[str], Bools | None]:
        """Why cells are released at t [s], and which owned ones; None if none are. Collective.

        A user's condition gets the report, before the step is accepted if so. One that fails, or
        names a body that there is not, is a SceneError.
        """
        reasons: list[str] = []
        released: Bools | None = None
        for release, cells in self._pairs:
            asked = cells
            if before and not release.repeat:
                continue
            if not before and any(self._timeline.same(t, planned) for planned in release.times):
                reason = PLANNED
            elif release.when is None:
                continue
            else:
                asking = partial(_answer, release.when, report)
                own = together(self._comm, "Release: its condition", asking)
                if not (answer := self._comm.bcast(own)):  # that of rank 0
                    continue
                reason = "condition"
                if answer is not True:
                    asked = cells & _cells_of(answer, bodies, cells.size)
            reasons += [reason] if reason not in reasons else []
            released = asked if released is None else released | asked
        return reasons, released


def _cells_of(names: Iterable[str], bodies: Sequence[RigidBody], count: int) -> Bools:
    """Owned cells of named bodies.

    Raises:
        SceneError: If there is no such body.
    """
    known = {body.name: body for body in bodies}
    cells = np.zeros(count, dtype=bool)
    for name in names:
        if name not in known:
            raise SceneError(
                f"Release: its condition names the body '{name}'; there are "
                f"{sorted(known) or 'none'}."
            )
        cells[known[name].cells] = True
    return cells


def _answer(condition: Any, report: Report) -> bool | list[str]:
    """The answer of a user's condition: True, False or names of bodies."""
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
        f"Release: its condition must give True, False or names of bodies, got {shown(answer)}."
    )


class Policy:
    """Decides, step by step, on rigid cells and flexible ones.

    Attributes:
        named: Parts that are rigid always.
        memory: Memory of the policy.
        releases: Those that a user asks for.
        rule: Says which cells are quiet, and which bodies are not.
    """

    remembered: ClassVar[Remembered] = dict.fromkeys(("memory", "rule"), PART)

    def __init__(self, scene: Scene, criterion: Criterion, timeline: Timeline) -> None:
        """Find the cells that the criterion names. Collective.

        Args:
            scene: The problem.
            criterion: The criterion of the user.
            timeline: Where steps end; planned releases are added to it.

        Raises:
            SceneError: If a name is unknown or in a `Reduced` part, or the mesh was distributed
                without ghost cells.
        """
        self._criterion, self._timeline = criterion, timeline
        planned = {t for release in criterion.releases for t in release.times}
        timeline.stop_at(tuple(sorted(planned)))
        self._graph = CellGraph(scene)
        self._every = np.ones(self._graph.owned, dtype=bool)
        self._never = ~self._every
        for name in criterion.never:
            self._never[judged_cells(scene, name, f"{criterion.owner} (never)")] = True
        self.releases = Releases(scene, criterion.releases, timeline)
        self.named = NamedParts(scene, self._graph, alone=criterion.grows)
        self._planner = Planner(self._graph, self.named, criterion.least_cells(scene))
        every = criterion.follows_loads
        self.memory = Memory(
            window=self._new_window(0.0),
            signals=Signals(scene),
            back_off=BackOff(self._graph.owned, criterion.patience),
            loads=LoadChanges(scene, timeline, criterion.change, every),
            contacts=ContactChanges(criterion.change),
            next_number=self.named.count + 1,
        )
        self._touches = self.memory.contacts.watched and bool(scene.named(Contact))
        rule = partial(criterion.rule, scene, timeline, self.memory)
        self.rule = together(scene.comm, f"{criterion.owner}: its rule", rule)

    def _new_window(self, t: float) -> Window:
        """A new window from t [s] on, or from when observation begins."""
        return Window(self._graph.owned, max(t, float(self._criterion.since)))

    def spent(self, t: float) -> tuple[float, Rigidity | None]:
        """Periods up to t [s], as far as can be told, and the error of the motion by rigidity."""
        period = self.memory.signals.period()
        return (t / period if period > 0 else 0.0), self.rule.rigidity

    # Decisions ----------------------------------------------------------------------------------

    def ahead(self, seen: Observation, middle: float) -> Decision | None:
        """The release before a step by loads at its midpoint [s]; None without. Collective."""
        if all(body.name in self.named.apart for body in seen.bodies):
            return None
        if not (changed := self.memory.loads.ahead(middle)):
            return None
        decision = self._release(seen, f"{changed} changes", self._every)
        return replace(decision, loads_changed=True, loads_at=middle)

    def struck(
        self, seen: Observation, touches: Callable[[], Mapping[str, Touch]]
    ) -> Decision | None:
        """The release by contacts in a step that has been solved; None without. Collective."""
        if not self._touches or not seen.bodies:
            return None
        if not (changed := self.memory.contacts.changed(touches())):
            return None
        if not self._any(self._planner.free(seen)):
            return None
        decision = self._release(seen, f"the contact '{changed[0]}' changes", self._every)
        return replace(decision, loads_changed=True)

    def repeated(self, seen: Observation, cells: Bools | None) -> Decision | None:
        """The release that conditions ask for before a step is solved again. Collective."""
        if cells is None or not self._any(cells & self._planner.free(seen)):
            return None
        return self._release(seen, ASKED, cells)

    def after(self, seen: Observation, report: Report) -> Decision | None:
        """The release or freeze after a step; None if there is none. Collective."""
        self.memory.contacts.follow(report.touches)
        reasons, cells = self.releases.asked(seen.t, report, seen.bodies)
        if changed := self.memory.loads.declared(seen.t):
            decision = self._release(seen, changed, self._every)
            return replace(decision, loads_changed=self._criterion.follows_loads)
        if cells is not None:
            return self._release(seen, ", ".join(reasons), cells)
        return self._freeze(seen) if self.memory.window.over else None

    def outgrown(self, seen: Observation, cells: Bools, reason: str) -> Decision:
        """The release of cells that shapes do not follow, and their ring. Collective."""
        above = cells & self._planner.free(seen)
        leaving = self._graph.touching(self._graph.largest_at_nodes(above.astype(np.float64)) > 0)
        decision = self._release(seen, reason, leaving)
        return replace(decision, woken=np.flatnonzero(above).astype(np.int32))

    def _window_ends(self, seen: Observation) -> bool:
        """Whether the window has its length. Collective."""
        t, resolution = seen.t, self._timeline.resolution
        if t >= self._criterion.until - resolution:
            return False
        over = t - self.memory.window.start + resolution >= self.rule.length()
        return bool(self._graph.comm.allreduce(bool(over), op=MPI.LAND))

    def _freeze(self, seen: Observation) -> Decision:
        """Freeze the cells that have qualified in the window. Collective."""
        memory, t = self.memory, seen.t
        flexible, tol = seen.flexible & memory.window.whole, self.rule.tol
        self._warn_of_window(tol, seen.noise)
        qualified, closeness = qualify(memory.window.worst, tol, flexible, self._graph.comm)
        able = memory.back_off.lasting(qualified)
        existing = self._planner.numbers(seen)
        barred = self._never | (~seen.flexible & (existing == NONE)) | self._planner.chained(seen)
        reason = f"strain rates in a window that ended at {t:.6g} s"

        def plan(able: Bools, barred: Bools) -> Decision:
            number = memory.next_number
            return self._planner.plan("freeze", reason, seen, able, existing, barred, number)

        if self._criterion.grows and self._criterion.patience > 1:
            # Parts have to have cost as much as their switches.
            decision = paying(plan, memory, seen, able, barred, self._graph.comm)
        else:
            decision = plan(able, barred)
        return replace(decision, qualified=qualified, closeness=closeness, loads_at=t)

    def _release(self, seen: Observation, reason: str, cells: Bools) -> Decision:
        """Release owned cells from their bodies; the other cells stay rigid. Collective."""
        return self._planner.release(seen, reason, cells, self.memory.next_number)

    def _any(self, cells: Bools) -> bool:
        """Whether there are any on any rank. Collective."""
        return bool(self._graph.comm.allreduce(bool(cells.any()), op=MPI.LOR))

    # Memory -------------------------------------------------------------------------------------

    def observe(self, seen: Observation) -> None:
        """Record a step that was accepted. Collective."""
        memory, t, cells = self.memory, seen.t, seen.indicator.cells
        if t <= self._criterion.since + self._timeline.resolution:
            return
        memory.window.add(cells, seen.indicator.values[cells])
        self.rule.observe(seen)
        memory.signals.add(seen.stepper.state, memory.loads.observe(t))
        memory.signals.rest_since(memory.loads.resting_since)
        memory.window.over = self._window_ends(seen)
        if memory.window.over:
            self.rule.window_ends(seen, seen.flexible & memory.window.whole)

    def applied(self, decision: Decision, seen: Observation, changed: bool) -> None:
        """Record the outcome of a decision. Collective."""
        memory, t = self.memory, seen.t
        memory.next_number, freezes = decision.next_number, decision.kind == "freeze"
        if decision.qualified is not None:
            memory.back_off.window_ended(decision.qualified, t - memory.window.start)
        if changed:
            memory.contacts.remember()
            rigid = self._planner.numbers(seen) != NONE
            memory.window.whole &= rigid | ~memory.back_off.rigid
            hasty = memory.back_off.switched(rigid, t, counts=decision.reason != PLANNED)
            if self._graph.comm.allreduce(hasty, op=MPI.LOR):
                self._say(
                    "bodies are released again and again, sooner than they were observed: their "
                    "cells have to qualify for longer and longer now (patience). "
                    f"{self._criterion.remedy}"
                )
        if decision.loads_at is not None and (changed or not freezes):
            memory.loads.remember(decision.loads_at)
        if decision.loads_at is not None and not changed and not freezes:
            return  # only bodies that are rigid always: a load that goes on changing ends nothing
        if decision.loads_changed:
            memory.signals.restart()
        if decision.woken is not None:
            return
        if not freezes:
            memory.back_off.restart()
        memory.window = self._new_window(t)

    # Warnings -----------------------------------------------------------------------------------

    def _warn_of_window(self, tol: Array, noise: float) -> None:
        """Warn of a window shorter than a period, and of a tolerance below noise. Collective."""
        window, period = self._criterion.window, self.memory.signals.period()
        # Where forces wake cells, those that have qualified at the turn of a vibration wake again.
        if not isinstance(window, str) and window < period and not self._criterion.grows:
            self._say(
                f"the window of observation, {window:.3g} s, is shorter than the longest "
                f"period seen, {period:.3g} s: cells may qualify at the turn of a vibration. Take "
                f"window ≥ {period:.3g}, or 'auto'."
            )
        least = self._graph.comm.allreduce(tol[tol > 0].min(initial=np.inf), op=MPI.MIN)
        if least < noise:
            self._say(
                f"the tolerance {least:.3g} 1/s is below what the end of Newton's "
                f"iteration may leave in the strain rates, {noise:.3g} 1/s: decisions are at "
                "random. Take a larger tolerance or a larger Δt."
            )

    def _say(self, message: str) -> None:
        """Warn on rank 0, of each thing once: of that before the first comma."""
        kind = message.split(",")[0]
        if kind not in self.memory.said:
            self.memory.said.add(kind)
            warn(self._graph.comm, f"{self._criterion.owner}: {message}")
