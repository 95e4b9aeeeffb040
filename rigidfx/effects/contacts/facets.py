"""Flat facets of a round surface, which an obstacle meets at their nodes: a drum is a polygon.

A polygon of n sides stands still on slopes below 180°/n, half the angle between facets. A surface
counts as round where facets meet at a small convex angle θ and their radius, width over θ, is not
small beside their distance from the middle of their part: so a fillet at the edge of a box is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.warning import warn
from rigidfx.effects.contacts.surface import triangles_of

__all__ = ["warn_of_facets"]

Array = npt.NDArray[np.float64]

FLAT = 0.01  # rad: facets that meet at less are one
SHARP = 0.9  # rad, above an octagon's 45°: facets that meet at more are an edge of a part
ROLLS = 0.5  # of the distance from the middle of a part: least radius of what rolls
FINE = np.radians(3.0)  # half the angle between facets that is not worth a word: 60 in a turn


def warn_of_facets(scene: Any, where: str, owner: str) -> None:
    """Warn of a round surface of flat facets that an obstacle with friction meets. Collective.

    Args:
        scene: The problem.
        where: Name of a set of boundary facets.
        owner: Who asks, for messages.
    """
    half = 0.5 * _angle(scene, where, owner)
    if half <= FINE:
        return
    count = round(np.pi / half)
    warn(
        scene.comm,
        f"{owner}: the surface is round, and its flat facets meet at {np.degrees(2 * half):.3g}°, "
        f"some n = {count} in a turn. Nodes are the contact: it rolls as a polygon, which stands "
        f"still on slopes below 180°/n = {np.degrees(half):.3g}° and rolls too slowly on steeper "
        "ones. Take four times as many facets around, or curved cells of second order (gmsh's "
        "ElementOrder 2, and order=2).",
    )


def _angle(scene: Any, where: str, owner: str) -> float:
    """Median angle between neighbouring facets of what is round; 0 if nothing is. Collective."""
    cells, nodes = triangles_of(scene, where, owner)
    X = scene.space.tabulate_dof_coordinates()
    parts = scene.parts
    centre = 0.5 * (parts.lower + parts.upper)[parts.of_cell[cells]]
    inside = X[scene.space.dofmap.list[cells]].mean(axis=1)
    numbers = scene.space.dofmap.index_map.local_to_global(nodes.reshape(-1).astype(np.int32))
    mine = numbers.reshape(-1, 3), X[nodes], centre, inside
    every = [np.concatenate(of) for of in zip(*scene.comm.allgather(mine), strict=True)]
    return _median_angle(*every)


def _median_angle(
    numbers: npt.NDArray[np.int64], corners: Array, centre: Array, inside: Array
) -> float:
    """The same of triangles by the numbers and positions of their corners [rad].

    Args:
        numbers: Shape (n, 3).
        corners: Shape (n, 3, 3) [m].
        centre: Middles of the parts that they bound, shape (n, 3) [m].
        inside: Middles of the cells behind, shape (n, 3) [m].
    """
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(normal, axis=1)
    middle = corners.mean(axis=1)
    normal *= (np.sign(((middle - inside) * normal).sum(axis=1)) / double)[:, None]
    ends = np.concatenate([numbers[:, [0, 1]], numbers[:, [1, 2]], numbers[:, [2, 0]]])
    ends.sort(axis=1)
    order = np.lexsort(ends.T)
    first = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    a, b = order[first], order[first + 1]  # sides of two triangles, of which n come first
    n = len(numbers)
    along = np.linalg.norm(corners[a % n, (a // n + 1) % 3] - corners[a % n, a // n], axis=1)
    edge = 0.5 * (corners[a % n, (a // n + 1) % 3] + corners[a % n, a // n])
    a, b = a % n, b % n
    angle = np.arccos(np.clip((normal[a] * normal[b]).sum(axis=1), -1.0, 1.0))
    convex = ((middle[b] - middle[a]) * normal[a]).sum(axis=1) < 0
    radius = 0.5 * (double[a] + double[b]) / along / np.maximum(angle, FLAT)
    rolls = radius >= ROLLS * np.linalg.norm(edge - centre[a], axis=1)
    found = angle[convex & rolls & (angle > FLAT) & (angle < SHARP)]
    return float(np.median(found)) if found.size else 0.0
