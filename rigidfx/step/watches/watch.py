"""Observers of attempts that become steps.

All of it is in one list of the stepper, and takes notice in one call: an attempt that is not
accepted leaves no trace anywhere.
"""

from __future__ import annotations

from typing import Any, ClassVar

import dolfinx.mesh as dmesh
import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import Cells
from rigidfx.step.watches.judge import Attempt

__all__ = ["Measuring", "WarnsOnce", "Watch", "name_of_cell"]


class Watch:
    """Looks at each attempt that becomes a step."""

    def bind(self, flexible: Cells) -> None:
        """Look at these cells from now on.

        Args:
            flexible: Flexible owned cells by subdomain id.
        """

    def refresh(self) -> None:
        """Be as one that a checkpoint has brought back: forget all but `remembered`."""

    def accept(self, attempt: Attempt) -> None:
        """Take note that an attempt becomes a step; the state is that at its start. Collective.

        Args:
            attempt: The forms' u₀ and u₁ hold its ends.
        """


class Measuring(Watch):
    """Has an indicator measure each step."""

    remembered: ClassVar[Remembered] = {}

    def __init__(self, indicator: Indicator) -> None:
        """Take the indicator over."""
        self._indicator = indicator

    def bind(self, flexible: Cells) -> None:
        """See `Watch`."""
        self._indicator.bind(flexible)

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        self._indicator.measure(attempt.dt)


class WarnsOnce(Watch):
    """Looks for something that a user should know, and says it once.

    Attributes:
        waits: Whether nothing has been found yet.
    """

    remembered: ClassVar[Remembered] = same("waits")

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Begin before the first step.

        Args:
            comm: Communicator of the mesh.
        """
        self._comm = comm
        self.waits = True

    def say(self, message: str) -> None:
        """Warn on rank 0, and look no more."""
        self.waits = False
        warn(self._comm, message)


def name_of_cell(comm: MPI.Intracomm, mesh: Any, cell: int | None) -> str:
    """Name of a cell in a message; of several, that which comes first. Collective.

    Args:
        comm: Communicator of the mesh.
        mesh: The mesh.
        cell: An owned cell, None on ranks that do not own it.
    """
    mine: Any = None
    if cell is not None:
        number = int(mesh.topology.original_cell_index[cell])
        middle = dmesh.compute_midpoints(mesh, 3, np.array([cell], np.int32))[0]
        mine = number, middle.tolist()
    number, X = min(found for found in comm.allgather(mine) if found is not None)
    return f"cell {number} of the mesh around X = ({X[0]:.6g}, {X[1]:.6g}, {X[2]:.6g}) m"
