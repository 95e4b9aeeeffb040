"""Parts named rigid never wake: it is said, once, what that does to the motion."""

from __future__ import annotations

from math import pi
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.decide.advice import Advice
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.memory.memory import Memory
from rigidfx.decide.named_parts import NamedParts
from rigidfx.report.report import Report
from rigidfx.shadow.motion import Strained

__all__ = ["Withholding"]


class Withholding:
    """Compares what named parts withhold with what wakes other cells.

    By a budget of the motion it is the part of the compliance that they take, and no strain, which
    is compared. What is exceeded in one step is said once the motion has not grown for as long as
    it has gone on, or at the end of the run: then it has been seen how all moves.
    """

    remembered: ClassVar[Remembered] = same("_told", "_shared")

    def __init__(
        self, comm: MPI.Intracomm, criterion: Criterion, named: NamedParts, memory: Memory
    ) -> None:
        """Nothing has been looked at.

        Args:
            comm: Communicator of the mesh.
            criterion: What the user states.
            named: The parts.
            memory: What the policy remembers.
        """
        self._comm, self._criterion, self._named, self._memory = comm, criterion, named, memory
        self._told: set[str] = set()
        self._shared: set[str] = set()  # those whose part in the whole structure is known

    @property
    def waits(self) -> bool:
        """Whether there are parts of which nothing has been said."""
        return not self._told.issuperset(self._named.names)

    def look(self, seen: Observation, strained: Strained) -> None:
        """Take note of what cells would strain in a step that has been solved. Collective.

        They are there before anything has been observed, unlike bodies that are found: nothing
        counts until then, and of strains that add up none until a stroke is known.

        Args:
            seen: The state before it.
            strained: What each owned cell of some parts would strain, over what wakes it.
        """
        ratio, memory = strained.ratio, self._memory
        memory.compliance.look(strained.withheld)
        if self._criterion.lacking is not None:
            return
        if strained.by_rates:
            moved = bool(np.isfinite(memory.strokes.time))
            if seen.t <= self._criterion.since or (self._criterion.relative and not moved):
                return
            ratio = ratio if moved else strained.rate
        named = self._named
        apart = {body.name: body.cells for body in seen.bodies if body.name in named.apart}
        held = {named.names[n - 1]: cells for n, cells in seen.state.clamped.items()}
        parts = {**named.cells, **apart, **held}
        largest = np.array([ratio[own].max(initial=0.0) for own in parts.values()])
        self._comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        for name, exceeded in zip(parts, largest, strict=True):
            if exceeded > 1:
                memory.compliance.exceeds(name, float(exceeded), seen.t)

    def follow(self, seen: Observation, report: Report, last: bool) -> None:
        """Take note of a step that was accepted, and say what there is to say.

        Args:
            seen: The state after it.
            report: What it did.
            last: Whether it is the last of the run.
        """
        if seen.energies is not None and self._named.count:
            kept = sum(body.frozen.strain for body in seen.bodies)
            strain = report.strain + report.springs + report.contact + kept
            self._memory.compliance.add(seen.energies[0], strain, seen.t)
        compliance = self._memory.compliance
        if not (last or compliance.settled):
            return
        advice = Advice(self._comm, self._criterion, self._memory.said)
        if seen.share is not None:  # until then it is an upper bound
            for name in self._exceeding(seen.t):
                if name not in self._shared:
                    self._shared.add(name)
                    compliance.shares(name, seen.share(name))
        for name in self._exceeding(seen.t):
            self._told.add(name)
            at = compliance.exceeded.get(name)
            advice.of_named(name, at, compliance.taken(name), compliance.vibrates(name))

    def _exceeding(self, t: float) -> list[str]:
        """Parts that withhold too much by t [s], and of which nothing has been said."""
        compliance, most = self._memory.compliance, self._criterion.lacking
        if most is None:
            return [name for name in compliance.exceeded if name not in self._told]
        period = self._memory.signals.period() if compliance.names else np.nan
        out = []
        for name in compliance.names:
            off = compliance.taken(name)
            if compliance.vibrates(name) and period > 0:
                off *= max(1.0, pi * t / period)  # phases drift apart
            if off > most and name not in self._told:
                out += [name]
        return out
