"""Holes, shafts, balls and sockets, from the facets of their surfaces.

Vertices of a sphere, or of a cylinder across its axis, have |x - c|² = r², which is linear in c and
in r² - |c|². Normals n of a cylinder are perpendicular to its axis: there Σ A n nᵀ vanishes. Those
of a sphere point along x - c: the vertices of a hole between two rings lie on a sphere too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import mesh as dmesh

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Indices

__all__ = ["cylinder_of", "sphere_of"]


ROUND = 0.02  # part of the normals' squares along the axis, or of the radius, that may be off


def cylinder_of(scene: Any, owner: str, where: str) -> tuple[Array, Array]:
    """Middle and unit axis of a cylindrical surface, shapes (3,). Collective.

    Raises:
        SceneError: On every rank, if the surface is no cylinder.
    """
    x, middle, n = _facets(scene, owner, where)
    area = np.linalg.norm(n, axis=1)
    n /= np.where(area > 0, area, 1.0)[:, None]
    second = np.asarray(scene.sum((area[:, None] * n).T @ n))
    values, axes = np.linalg.eigh(second / np.trace(second))
    axis = axes[:, 0] * np.sign(axes[np.argmax(np.abs(axes[:, 0])), 0])
    across, points = axes[:, 1:], x.reshape(-1, 3)
    centre, radius, off = _fitted(scene, points @ across)
    along = points @ axis
    ends = scene.comm.allgather((along.min(initial=np.inf), along.max(initial=-np.inf), off))
    low, high, worst = min(e[0] for e in ends), max(e[1] for e in ends), max(e[2] for e in ends)
    if values[0] > ROUND or values[1] < ROUND or not worst <= ROUND * radius:
        raise SceneError(
            f"{owner}: the surface '{where}' is no cylinder, whose axis and middle could be found. "
            "Give the joint's place, and its axis if it has one."
        )
    return middle + across @ centre + 0.5 * (low + high) * axis, axis


def sphere_of(scene: Any, owner: str, where: str) -> Array | None:
    """Centre of a spherical surface, shape (3,) [m]; None if it is no sphere. Collective."""
    x, middle, n = _facets(scene, owner, where)
    centre, radius, off = _fitted(scene, x.reshape(-1, 3))
    out = (x - centre).mean(axis=1)
    sizes = np.linalg.norm(n, axis=1) * np.linalg.norm(out, axis=1)
    along = np.abs((n * out).sum(axis=1))
    tilted = 1 - (along / np.where(sizes > 0, sizes, 1.0)).min(initial=1.0)
    worst, tilt = np.max(scene.comm.allgather((off, tilted)), axis=0)
    return middle + centre if worst <= ROUND * radius and tilt <= ROUND else None


def _facets(scene: Any, owner: str, where: str) -> tuple[Array, Array, Array]:
    """Corners of owned facets less their mean place on all ranks, that, and normals. Collective."""
    x = _corners_of(scene, scene.boundary(where, owner))
    n = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    total = np.asarray(scene.sum(np.r_[x.sum(axis=(0, 1)), float(x[..., 0].size)]))
    middle = total[:3] / max(total[3], 1.0)  # a fit about a far origin would lose digits
    return x - middle, middle, np.asarray(n)


def _fitted(scene: Any, x: Array) -> tuple[Array, float, float]:
    """Centre and radius of the circle or sphere that fits points of all ranks best. Collective.

    The points have shape (points, 2 or 3) [m]; the largest distance of this rank's from it is last.
    """
    rows, squares = np.c_[2 * x, np.ones(len(x))], (x**2).sum(axis=1)
    left, right = (np.asarray(scene.sum(v)) for v in (rows.T @ rows, rows.T @ squares))
    *found, rest = np.linalg.lstsq(left, right, rcond=None)[0]
    centre = np.array(found)
    radius = float(np.sqrt(max(rest + centre @ centre, 0.0)))
    off = np.abs(np.linalg.norm(x - centre, axis=1) - radius).max(initial=0.0)
    return centre, radius, float(off)


def _corners_of(scene: Any, pairs: Indices) -> Array:
    """Corners of owned facets by cells and sides of these, shape (facets, 3 or 4, 3) [m]."""
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
