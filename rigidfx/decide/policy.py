"""The controlled run (Fig. 2): observe a window, freeze quiet cells, release at changes.

    steps of a window → qualify → find_clusters → plan_bodies → Decision

Cells are released where forces would strain them (`wake="local"`), or all bodies by any change of a
load or of a support (`wake="all"`), after which a new window begins. Changes of Δt, of numerical
damping or of the output release nothing. A policy changes nothing but its own memory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import together
from rigidfx.base.remembered import PART, Remembered
from rigidfx.base.types import Bools
from rigidfx.decide.advice import Advice
from rigidfx.decide.clusters import NONE, CellGraph
from rigidfx.decide.criteria.judging import (
    CHANGE,
    Criterion,
    Observation,
    judged_cells,
)
from rigidfx.decide.decision import Decision, qualify
from rigidfx.decide.memory.memory import BackOff, ContactChanges, LoadChanges, Memory, Window
from rigidfx.decide.memory.signals import Signals
from rigidfx.decide.paying import Paying
from rigidfx.decide.planner import NamedParts, Planner
from rigidfx.decide.releases import PLANNED, Releases
from rigidfx.effects import Contact, Touch
from rigidfx.report.ledger import Rigidity
from rigidfx.report.report import Report
from rigidfx.scene.points import linked, met
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

ASKED = "checked: a condition"


class Policy:
    """Decides, step by step, on rigid and flexible cells.

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
        self._scene, self._criterion, self._timeline = scene, criterion, timeline
        timeline.stop_at(criterion.breakpoints)
        self._graph = CellGraph(scene)
        self._every = np.ones(self._graph.owned, dtype=bool)
        self._never = ~self._every
        for name in criterion.never:
            self._never[judged_cells(scene, name, f"{criterion.owner} (never)")] = True
        self.releases = Releases(scene, criterion.releases, timeline)
        self.named = NamedParts(scene, self._graph, alone=criterion.wake == "local")
        self._planner = Planner(self._graph, self.named, criterion.least_cells(scene))
        change = CHANGE if criterion.load_change is None else criterion.load_change
        self.memory = Memory(
            window=self._new_window(0.0),
            signals=Signals(scene),
            back_off=BackOff(self._graph.owned, criterion.patience),
            loads=LoadChanges(scene, change, timeline),
            contacts=ContactChanges(criterion.contact_change),
            next_number=self.named.count + 1,
        )
        self._groups, self._part = linked(scene), scene.parts.of_cell[: self._graph.owned]
        watched = scene.named(Contact) if self.memory.contacts.watched else []
        self._met = {contact.title: met(scene, contact) for contact in watched}
        self._paying = Paying(self._graph, criterion, self.memory)
        rule = partial(criterion.rule, scene, timeline, self.memory)
        self.rule = together(scene.comm, f"{criterion.owner}: its rule", rule)

    @property
    def _advice(self) -> Advice:
        """Warnings, of each thing once."""
        return Advice(self._scene.comm, self._criterion, self.memory.said)

    def _new_window(self, t: float) -> Window:
        """A new window from t [s] on, or from when observation begins."""
        return Window(self._graph.owned, max(t, float(self._criterion.since)))

    def spent(self, t: float) -> tuple[float, Rigidity | None]:
        """Periods up to t [s], as far as can be told, and the error of the motion by rigidity."""
        period = self.memory.signals.period()
        return (t / period if period > 0 else 0.0), self.rule.rigidity

    # Decisions ----------------------------------------------------------------------------------

    def ahead(self, seen: Observation, middle: float) -> Decision | None:
        """Decide on a release before a step; None if there is none. Collective.

        Args:
            seen: The state before it.
            middle: Time at its midpoint [s].
        """
        if self._criterion.wake != "all" or all(b.name in self.named.apart for b in seen.bodies):
            return None
        if not (changed := self.memory.loads.ahead(middle)):
            return None
        decision = self._release(seen, f"{changed} changes", self._every)
        return replace(decision, loads_changed=True, loads_at=middle)

    def struck(
        self, seen: Observation, touches: Callable[[], Mapping[str, Touch]]
    ) -> Decision | None:
        """Decide whether contacts release bodies in a step that has been solved. Collective.

        Args:
            seen: The state before it.
            touches: Tells effects of contacts in it.

        Returns:
            The release; None if none closes or changes, or nothing can be released.
        """
        if not self._met or not seen.bodies:
            return None
        if not (changed := self.memory.contacts.changed(touches())):
            return None
        cells: Bools = self._every
        local = self._criterion.wake != "all"
        if local:
            where = np.any([self._met[title] for title in changed], axis=0)
            cells = self._with_linked(where)
        if not self._any(self._planner.free(seen) & cells):
            return None
        decision = self._release(seen, f"the contact '{changed[0]}' changes", cells)
        return decision if local else replace(decision, loads_changed=True)

    def _with_linked(self, parts: Bools) -> Bools:
        """Owned cells of connected parts, and of those that joints link with them."""
        groups = np.isin(self._groups, self._groups[parts])
        return np.asarray(groups[self._part])

    def repeated(self, seen: Observation, cells: Bools | None) -> Decision | None:
        """The release that conditions ask for before a step is solved again. Collective."""
        if cells is None or not self._any(cells & self._planner.free(seen)):
            return None
        return self._release(seen, ASKED, cells)

    def after(self, seen: Observation, report: Report) -> Decision | None:
        """Decide on a release or a freeze after a step; None if there is none. Collective.

        Args:
            seen: The state after it.
            report: The argument of a user's condition.
        """
        t = seen.t
        self.memory.contacts.follow(report.touches)
        reasons, cells = self.releases.asked(t, report, seen.bodies)
        if self._criterion.wake == "all" and self.memory.loads.declared(t):
            decision = self._release(seen, "a load or a support changes", self._every)
            return replace(decision, loads_changed=True)
        if self._criterion.wake != "all" and self.memory.loads.support_changes(t):
            return self._release(seen, "a support begins or ends", self._every)
        if cells is not None:
            return self._release(seen, ", ".join(reasons), cells)
        return self._window_decides(seen) if self.memory.window.over else None

    def outgrown(self, seen: Observation, cells: Bools, reason: str) -> Decision:
        """The release of cells of bodies that shapes do not follow, and their ring. Collective.

        Args:
            seen: The state before the step.
            cells: Owned cells that wake.
            reason: Why, in words.
        """
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

    def _window_decides(self, seen: Observation) -> Decision:
        """The decision at the end of a window; bodies stay if it fails, alike on all ranks."""
        try:
            return self._freeze(seen)
        except np.linalg.LinAlgError as error:
            self._advice.of_failure(error)
            reason = f"an estimate that failed at {seen.t:.6g} s"
            return self._planner.unchanged(reason, seen, self.memory.next_number)

    def _freeze(self, seen: Observation) -> Decision:
        """Freeze the cells that have qualified in the window. Collective."""
        memory, t = self.memory, seen.t
        flexible, tol = seen.flexible & memory.window.whole, self.rule.tol
        self._advice.of_window(memory.signals.period(), tol, seen.noise)
        qualified, closeness = qualify(memory.window.worst, tol, flexible, self._graph.comm)
        able = memory.back_off.lasting(qualified)
        existing = self._planner.numbers(seen)
        barred = self._never | (~seen.flexible & (existing == NONE)) | self._planner.chained(seen)
        reason = f"strain rates in a window that ended at {t:.6g} s"

        def plan(able: Bools, barred: Bools) -> Decision:
            number = memory.next_number
            return self._planner.plan("freeze", reason, seen, able, existing, barred, number)

        if not self._any(able & (existing == NONE) & ~barred):
            decision = self._planner.unchanged(reason, seen, memory.next_number)
        elif self._criterion.wake == "local":
            decision = self._paying.bodies(plan, seen, tol, able, barred)
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
        memory.window.add(cells, seen.rates[cells])
        self.rule.observe(seen)
        memory.signals.add(seen.state, memory.loads.observe(t))
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
                self._advice.of_haste()
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
