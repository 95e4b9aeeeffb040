"""Vectors linear in e, each by three sums over the dofs: of points and of supports."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from rigidfx.scene.points import Point

__all__ = ["of_point"]


def of_point(point: Point, nodes: int) -> csr_array:
    """The displacement of a point, by weights of this rank's dofs.

    Args:
        point: Weighted nodes.
        nodes: Number of owned nodes.

    Returns:
        Shape (3, 3 · nodes).
    """
    dofs = 3 * point.nodes[:, None] + np.arange(3)
    axes = np.broadcast_to(np.arange(3), dofs.shape)
    weights = np.repeat(point.weights, 3)
    return csr_array((weights, (axes.ravel(), dofs.ravel())), shape=(3, 3 * nodes))
