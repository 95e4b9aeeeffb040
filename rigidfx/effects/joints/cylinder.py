"""Axis and centre of a hole or a shaft, from the facets of its surface.

Normals n of a cylinder are perpendicular to its axis: that is where Σ A n nᵀ vanishes. Across it
the vertices lie on a circle, |x - c|² = r², which is linear in c and in r² - |c|².
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh

from rigidfx.base.errors import SceneError

__all__ = ["ROUND", "corners_of", "cylinder_of"]

Array = npt.NDArray[np.float64]

ROUND = 0.02  # part of the normals' squares along the axis, or of the radius, that may be off


def cylinder_of(scene: Any, owner: str, where: str) -> tuple[Array, Array]:
    """Middle and unit axis of a cylindrical surface, shapes (3,). Collective.

    Args:
        scene: The problem.
        owner: Who asks, for messages.
        where: Name of a set of boundary facets.

    Raises:
        SceneError: On every rank, if the surface is no cylinder.
    """
    x = corners_of(scene, scene.boundary(where, owner))
    n = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    area = np.linalg.norm(n, axis=1)
    n /= np.where(area > 0, area, 1.0)[:, None]
    second = np.asarray(scene.sum((area[:, None] * n).T @ n))
    values, axes = np.linalg.eigh(second / np.trace(second))
    axis = axes[:, 0] * np.sign(axes[np.argmax(np.abs(axes[:, 0])), 0])
    across = axes[:, 1:]
    every = x.reshape(-1, 3)
    total = np.asarray(scene.sum(np.r_[every.sum(axis=0), float(len(every))]))
    middle = total[:3] / max(total[3], 1.0)  # a fit about a far origin would lose digits
    points = every - middle
    flat = points @ across
    rows = np.c_[2 * flat, np.ones(len(flat))]
    squares = (flat**2).sum(axis=1)
    left, right = (np.asarray(scene.sum(v)) for v in (rows.T @ rows, rows.T @ squares))
    fitted = np.linalg.lstsq(left, right, rcond=None)[0]
    radius = float(np.sqrt(max(fitted[2] + fitted[:2] @ fitted[:2], 0.0)))
    off = np.abs(np.linalg.norm(flat - fitted[:2], axis=1) - radius).max(initial=0.0)
    along = points @ axis
    ends = scene.comm.allgather((along.min(initial=np.inf), along.max(initial=-np.inf), off))
    low, high, worst = min(e[0] for e in ends), max(e[1] for e in ends), max(e[2] for e in ends)
    if values[0] > ROUND or values[1] < ROUND or not worst <= ROUND * radius:
        raise SceneError(
            f"{owner}: the surface '{where}' is no cylinder, whose axis and middle could be found. "
            "Give the joint's place, and its axis if it has one."
        )
    return middle + across @ fitted[:2] + 0.5 * (low + high) * axis, axis


def corners_of(scene: Any, pairs: npt.NDArray[np.int32]) -> Array:
    """Corners of owned facets, shape (facets, 3 or 4, 3) [m].

    Args:
        scene: The problem.
        pairs: Cells and their sides.
    """
    mesh = scene.mesh
    for dims in ((3, 2), (2, 3), (2, 0)):
        mesh.topology.create_connectivity(*dims)
    facets = mesh.topology.connectivity(3, 2)
    numbers = np.array([facets.links(cell)[k] for cell, k in pairs], dtype=np.int32)
    corners = 3 if scene.simplex else 4
    if not numbers.size:  # DOLFINx 0.9 divides by their number
        return np.empty((0, corners, 3))
    nodes = dmesh.entities_to_geometry(mesh, 2, numbers)
    return np.asarray(mesh.geometry.x[nodes.reshape(-1, nodes.shape[-1])[:, :corners]])
