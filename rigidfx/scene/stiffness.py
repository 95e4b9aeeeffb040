"""Which cells are so much stiffer than others that rounding in them may hide these."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigidfx.domain.connected import ConnectedParts, connected_parts

__all__ = ["MUCH", "stiff_parts"]

MUCH = 1e8  # ratio of stiffness from which on rounding of a stiff part's forces is looked at


def stiff_parts(scene: Any) -> ConnectedParts | None:
    """Connected parts of the cells that are stiffer than the softest by `MUCH`. Collective.

    Args:
        scene: The problem.

    Returns:
        Parts, with -1 for other cells; None if all are alike.
    """
    stiffness = [material.stiffness for material, _ in scene.materials]
    bound = MUCH * min(stiffness)
    if max(stiffness) < bound or bound == 0.0:
        return None
    marks = scene.cellwise(
        [
            (1.0, cells)
            for (_, cells), own in zip(scene.materials, stiffness, strict=True)
            if own >= bound
        ]
    )
    dofs = marks.function_space.dofmap.list[:, 0]
    stiff = marks.x.array[dofs] > 0
    parts = connected_parts(scene.mesh, 0, stiff)
    found = np.unique(np.concatenate(scene.comm.allgather(np.unique(parts.of_cell[stiff]))))
    number = np.full(parts.count, -1)
    number[found] = np.arange(found.size)
    return ConnectedParts(
        found.size,
        number[parts.of_cell],
        number[parts.of_entity],
        parts.lower[found],
        parts.upper[found],
    )
