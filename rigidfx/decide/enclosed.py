"""Cells that a body would enclose and that strain too fast to be rigid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.clusters import CellGraph

__all__ = ["round_enclosed"]


def round_enclosed(
    graph: CellGraph, parts: Sequence[Indices], able: Bools, loud: Array, most: float
) -> Bools:
    """Enclosed cells that strain too fast, with the cells round them. Collective.

    Such a cell would wake soon after the freeze. So it stays flexible, with a ring of cells.

    Args:
        graph: Neighbours of the cells.
        parts: Owned flexible cells that are to freeze, of each body that is to be.
        able: Owned cells that may freeze; others are in parts because these enclose them.
        loud: Strain rate of each owned cell over its tolerance.
        most: Permitted strain of an enclosed cell, over its tolerance.
    """
    inside = np.zeros(loud.size)
    for own in parts:
        inside[own] = (~able & (loud > most))[own]
    return graph.touching(graph.largest_at_nodes(inside) > 0)
