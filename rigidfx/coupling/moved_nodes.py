"""Motion of the nodes that a rank knows, its ghosts included: unknowns of their own, or a body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import la

from rigidfx.base.types import Array, Ints
from rigidfx.coupling.prolongation import Prolongation

__all__ = ["MovedNodes", "moved_nodes"]


@dataclass(frozen=True)
class MovedNodes:
    """The motion of some nodes.

    Attributes:
        unknowns: Number of each of a node's dofs as an unknown, -1 if it is none, shape (n, 3).
        body: Body that moves the node, -1 if none.
        coordinates: a = [1, V, Φ₁, ..., Φ_m] in the frame of that body, shape (n, 4 + 3 m), with
            the largest m of all; zero beyond its own [1, m].
    """

    unknowns: Ints
    body: Ints
    coordinates: Array

    def __getitem__(self, chosen: Ints) -> MovedNodes:
        """Some of them."""
        return MovedNodes(self.unknowns[chosen], self.body[chosen], self.coordinates[chosen])


def moved_nodes(prolongation: Prolongation, known: Any) -> MovedNodes:
    """The motion of the nodes of an index map, ghosts included. Collective.

    Args:
        prolongation: Map between unknowns and dofs.
        known: Index map of nodes whose owned ones are those of the prolongation's space.
    """
    layout, dealt = prolongation.layout, prolongation.dealt
    n = int(layout.ensemble.frozen.shape[1])
    of_rows: Array = np.zeros((layout.rows.nodes.size, 1 + n))  # body, a
    of_rows[:, 0] = -1.0
    for k, (body, at) in enumerate(zip(layout.bodies, layout.attached, strict=True)):
        places = layout.rows.positions(body.nodes[at])
        a = body.coordinates(at)
        of_rows[places, 0], of_rows[places, 1 : 1 + a.shape[1]] = k, a
    found = la.vector(known, 4 + n)
    values = found.array.reshape(-1, 4 + n)  # three unknowns, body, a
    values[:, :4] = -1.0
    if dealt is None:
        values[layout.rows.nodes, 3:] = of_rows
    else:
        own_nodes = prolongation.space.dofmap.index_map.size_local
        values[:own_nodes, 3:] = dealt.give_nodes(of_rows, -1.0)[:own_nodes]
    dofs = prolongation.dofs
    values[dofs // 3, dofs % 3] = prolongation.first_column + np.arange(dofs.size)
    found.scatter_forward()
    numbers: Ints = values[:, :4].astype(np.int64)
    return MovedNodes(numbers[:, :3], numbers[:, 3], values[:, 4:].copy())
