"""Memory of two surfaces of their contact, and its form in a checkpoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.mesh_order import MeshOrder
from rigidfx.effects.contacts.pair_surface import PairSurface

__all__ = ["PairMemory", "PairNote", "memory_of"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass
class PairMemory:
    """Memory of a pair from step to step, of each node that is kept out.

    Attributes:
        gap: ḡ [m]; infinite while it meets nothing.
        mate: The triangle that it met last, -1 if none.
        surface: Both surfaces, whose numbers these are.
    """

    gap: Array
    mate: Ints
    surface: PairSurface

    def __deepcopy__(self, known: dict[int, Any]) -> PairMemory:
        """The same with arrays of its own."""
        return replace(self, gap=self.gap.copy(), mate=self.mate.copy())

    def part(self, order: MeshOrder) -> Any:
        """A rank's part of a checkpoint: where its nodes are in the mesh."""
        surface = self.surface
        return surface.numbers, order.nodes[surface.nodes]

    def whole(self, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> PairNote:
        """The part of a checkpoint, by numbers of nodes in the mesh."""
        surface = self.surface
        number = np.empty(surface.size, np.int64)
        for own, in_mesh in parts:
            number[own] = in_mesh
        closed = np.flatnonzero(np.isfinite(self.gap) | (self.mate >= 0))
        corners = np.full((closed.size, 3), -1)
        met = self.mate[closed] >= 0
        corners[met] = np.sort(number[surface.triangles[self.mate[closed][met]]], axis=1)
        return PairNote(number[surface.slaves[closed]], self.gap[closed], corners)


@dataclass
class PairNote:
    """The memory of a pair as a checkpoint keeps it.

    Attributes:
        nodes: Numbers in the mesh of the nodes that meet something.
        gap: ḡ of each [m].
        corners: Numbers of the corners of the triangle that each met last, sorted; -1 if none.
        order: Numbers of this rank's nodes, once it is given back.
    """

    nodes: Ints
    gap: Array
    corners: Ints
    order: MeshOrder | None = None

    def given(self, order: MeshOrder) -> PairNote:
        """The same for a rank."""
        return replace(self, order=order)

    def memory(self, surface: PairSurface) -> PairMemory:
        """The memory of surfaces as ranks number them now. Collective."""
        order = self.order
        assert order is not None
        assert order.comm is not None
        number = np.zeros(surface.size, np.int64)
        number[surface.numbers] = order.nodes[surface.nodes]
        order.comm.Allreduce(MPI.IN_PLACE, number)
        slaves = {int(node): k for k, node in enumerate(number[surface.slaves])}
        corners = np.sort(number[surface.triangles], axis=1)
        triangles = {row.tobytes(): k for k, row in enumerate(corners)}
        out = _fresh(surface)
        places = [slaves[int(node)] for node in self.nodes]
        out.gap[places] = self.gap
        out.mate[places] = [triangles.get(row.tobytes(), -1) for row in self.corners]
        return out


def memory_of(known: Any, surface: PairSurface) -> PairMemory:
    """The memory of a pair. Collective.

    Args:
        known: A memory, the note of a checkpoint, or None.
        surface: Both surfaces.
    """
    if known is None:
        return _fresh(surface)
    return known.memory(surface) if isinstance(known, PairNote) else known


def _fresh(surface: PairSurface) -> PairMemory:
    """That nothing has met."""
    n = surface.slaves.size
    return PairMemory(np.full(n, np.inf), np.full(n, -1), surface)
