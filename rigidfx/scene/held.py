"""Supports that hold a structure against all rigid motions, throughout a run."""

from __future__ import annotations

from math import inf

import numpy as np

from rigidfx.effects import Windowed
from rigidfx.effects.supports.support import Support
from rigidfx.scene.scene import Scene

__all__ = ["always", "holding"]

SPREAD = 1e-6  # of nodes that are held, the second axis over the first, squared: they form no line


def holding(scene: Scene) -> list[Support]:
    """Supports that by themselves hold a structure of one part, from the start to the end.

    Collective.

    Args:
        scene: The problem.
    """
    if scene.parts.count > 1:
        return []
    X, n = scene.space.tabulate_dof_coordinates(), scene.owned_nodes
    found: list[Support] = []
    for support, nodes in scene.supports:
        if len(support.axes) < 3 or not always(support):
            continue
        x = X[nodes[nodes < n]]
        ones = np.hstack([np.ones((len(x), 1)), x])
        moments = np.asarray(scene.sum(ones.T @ ones))
        centre = moments[0, 1:] / moments[0, 0]
        spread = np.linalg.eigvalsh(moments[1:, 1:] / moments[0, 0] - np.outer(centre, centre))
        if spread[1] > SPREAD * spread[2]:
            found.append(support)
    return found


def always(effect: Windowed) -> bool:
    """Whether an effect acts from the start to the end."""
    return effect.since <= 0 and effect.until == inf
