"""The part of a tangent that may jump from one iterate to the next: the stiffness of contacts.

It has entries at few unknowns. So it is known apart from the rest of the tangent, and a tangent
that is kept can follow it (`rigidfx.step.newton.low_rank`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_array, csr_array

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Action
from rigidfx.effects.motion import Motion, Tangent
from rigidfx.step.equations.heeded import Heeded

__all__ = ["Jumping"]


class Jumping:
    """The actions whose derivatives may jump."""

    def __init__(self, contacts: Sequence[Action], heeded: Heeded, comm: MPI.Intracomm) -> None:
        """Find them.

        Args:
            contacts: Contacts that act.
            heeded: Calls them.
            comm: Ranks that take part.
        """
        self._comm = comm
        self._outdated = heeded.calls(contacts, "outdated")
        self._stiffen = heeded.calls(contacts, "stiffen")

    def outdated(self) -> bool:
        """Whether a derivative has jumped since `entries`, or a tangent, took it. Collective."""
        if not self._outdated:
            return False
        here = any(outdated() for outdated in self._outdated)
        return bool(self._comm.allreduce(here, op=MPI.LOR))

    def entries(self, motion: Motion, prolongation: Prolongation) -> csr_array | None:
        """Their part of the tangent at the last iterate; None if there are none. Collective.

        Args:
            motion: The iterate.
            prolongation: Map between unknowns and dofs.

        Returns:
            Shape (unknowns, unknowns), equal on all ranks [N/m].
        """
        if not self._outdated:
            return None
        found = _Entries(prolongation)
        tangent = Tangent(found, prolongation)
        for stiffen in self._stiffen:
            stiffen(motion, tangent)
        found.add_bodies(tangent.blocks)
        return found.on_all_ranks()


class _Entries:
    """Takes entries in place of a `CondensedMatrix`."""

    def __init__(self, prolongation: Prolongation) -> None:
        self._p = prolongation
        self._parts: list[tuple[Ints, Ints, Array]] = []

    def add_nodal(self, nodes: Indices, blocks: Array) -> None:
        """Add to the diagonal blocks of free nodes of this rank, shape (nodes, 3, 3)."""
        places = self._p.layout.rows.positions(nodes)
        self._add(self._p.numbers.reshape(-1, 3)[places], blocks)

    def add_coupling(self, entries: csr_array) -> None:
        """Add entries that are equal on all ranks."""
        if self._p.comm.rank == 0:
            own = coo_array(entries)
            self._parts.append((*own.coords, own.data))

    def add_bodies(self, blocks: Array) -> None:
        """Add this rank's part of the bodies' blocks, shape (bodies, 6 + m, 6 + m)."""
        self._add(self._p.body_columns, blocks)

    def _add(self, numbers: Ints, blocks: Array) -> None:
        rows, columns = np.broadcast_arrays(numbers[:, :, None], numbers[:, None, :])
        known = (rows >= 0) & (columns >= 0)
        self._parts.append((rows[known], columns[known], blocks[known]))

    def on_all_ranks(self) -> csr_array:
        """The sum of all. Collective."""
        none: Ints = np.empty(0, np.int64)
        parts = [(none, none, np.empty(0)), *self._parts]
        every = [part for of_rank in self._p.comm.allgather(parts) for part in of_rank]
        rows, columns, values = (np.concatenate(part) for part in zip(*every, strict=True))
        return csr_array((values, (rows, columns)), shape=(self._p.size,) * 2)
