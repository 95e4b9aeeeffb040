"""Tolerances of cells: one for all, or a part of the largest rate so far; and those of sets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.decide.criteria.judging import judged_cells
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.criteria.relative import Relative
from rigidfx.decide.memory.memory import Memory
from rigidfx.scene.linked import linked
from rigidfx.scene.scene import Scene

__all__ = ["Tolerances"]


class Tolerances:
    """Strain rate up to which each owned cell is quiet.

    Attributes:
        comm: Communicator of the mesh.
        group: Number of the connected parts, linked by joints, that each owned cell is in.
    """

    def __init__(
        self,
        scene: Scene,
        memory: Memory,
        tol: float | Relative,
        of_sets: Mapping[str, float],
    ) -> None:
        """Find the cells that have a tolerance of their own. Collective.

        Args:
            scene: The problem.
            memory: Memory of the policy.
            tol: As of `rigidfx.decide.criteria.criterion.StrainRate`.
            of_sets: Tolerances of named sets of cells [1/s].

        Raises:
            SceneError: If a name is unknown, or a `Reduced` part has all cells of it.
        """
        self.comm, self._memory, self._tol = scene.comm, memory, tol
        self.group = linked(scene)[scene.parts.of_cell[: memory.window.worst.size]]
        self._special = np.full(memory.window.worst.size, np.inf)
        for name, own in of_sets.items():
            cells = judged_cells(scene, name, "StrainRate (tolerances)")
            self._special[cells] = np.minimum(self._special[cells], own)

    def now(self) -> Array:
        """Tolerance of each owned cell now [1/s]."""
        tol = self._tol
        of_all = tol.part * self._memory.largest if isinstance(tol, Relative) else float(tol)
        return np.where(np.isfinite(self._special), self._special, of_all)

    def observe(self, seen: Observation) -> None:
        """Remember the largest strain rate, where tolerances are parts of it. Collective.

        Args:
            seen: The run after a step.
        """
        if not isinstance(self._tol, Relative):
            return
        memory, indicator = self._memory, seen.indicator
        most = float(indicator.values[indicator.cells].max(initial=0.0))
        most = self.comm.allreduce(most, op=MPI.MAX)
        # What is at rest strains by noise, of which no part means anything.
        if memory.largest > 0 or most > seen.noise:
            memory.largest = max(memory.largest, most)
