"""Contacts of obstacles with round surfaces of flat facets, which roll as polygons.

A round surface of flat facets meets an obstacle as a polygon of n sides, which stands still on
slopes below 180°/n, half the angle between facets, of which a hollow of radius R leaves 1 - r/R. A
surface is round where facets, of triangles in one plane, meet at a small convex angle θ, and their
radius, width over θ, is not small beside the distance from the middle of the part, as of a fillet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.types import Array, Ints
from rigidfx.base.warning import warn
from rigidfx.effects import Contact
from rigidfx.effects.contacts.surface import area_vectors, triangles_of

FLAT = 0.01  # rad: facets that meet at less are one
SHARP = 0.9  # rad, above an octagon's 45°: facets that meet at more are an edge of a part
ROLLS = 0.5  # of the distance from the middle of a part: least radius of what rolls
FINE = np.radians(3.0)  # half the angle between facets that is not worth a word: 60 in a turn


def warn_of_facets(scene: Any) -> None:
    """Warn of round surfaces that obstacles with friction meet. Collective."""
    for contact in (c for c in scene.named(Contact) if c.friction > 0):
        against = contact.against
        inside = getattr(against, "inside", False)
        hollow = getattr(against, "radius", np.inf) if inside else np.inf
        angle, radius = _round(scene, contact.where, contact.owner)
        half = 0.5 * angle
        if half * (1.0 - radius / hollow) <= FINE:
            continue
        count = round(np.pi / half)
        warn(
            scene.comm,
            f"{contact.owner}: the surface is round, and its flat facets meet at "
            f"{np.degrees(2 * half):.3g}°, some n = {count} in a turn. Nodes are the contact: it "
            "rolls as a polygon, which stands still on slopes below 180°/n = "
            f"{np.degrees(half):.3g}° and rolls too slowly on steeper ones. Take four times as "
            "many facets around, or curved cells of second order (gmsh's ElementOrder 2, and "
            "order=2).",
        )


def _round(scene: Any, where: str, owner: str) -> tuple[float, float]:
    """Angle between neighbouring facets of a round surface, and its radius [m]. Collective.

    Half of all turning is at angles as large or larger: sides around an axis, that hardly turn, do
    not count.
    """
    cells, nodes = triangles_of(scene, where, owner)
    X = scene.space.tabulate_dof_coordinates()
    parts = scene.parts
    centre = 0.5 * (parts.lower + parts.upper)[parts.of_cell[cells]]
    numbers = scene.space.dofmap.index_map.local_to_global(nodes.reshape(-1).astype(np.int32))
    mine = numbers.reshape(-1, 3), X[nodes], centre
    every = [np.concatenate(of) for of in zip(*scene.comm.allgather(mine), strict=True)]
    return _of_triangles(*every)


def _of_triangles(numbers: Ints, corners: Array, centre: Array) -> tuple[float, float]:
    """The same of triangles by the numbers and positions of their corners [rad, m]; 0 if none is.

    Args:
        numbers: Shape (n, 3).
        corners: Shape (n, 3, 3) [m].
        centre: Middles of the parts that they bound, shape (n, 3) [m].
    """
    normal, middle = area_vectors(corners), corners.mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    normal /= area[:, None]
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
    radius = _widths(a, b, angle, along, area) / np.maximum(angle, FLAT)
    rolls = radius >= ROLLS * np.linalg.norm(edge - centre[a], axis=1)
    found = convex & rolls & (angle > FLAT) & (angle < SHARP)
    if not found.any():
        return 0.0, 0.0
    angle, turning, radius = angle[found], (angle * along)[found], radius[found]
    order = np.argsort(angle)
    half = int(np.searchsorted(np.cumsum(turning[order]), 0.5 * turning.sum()))
    return float(angle[order][half]), float(np.median(radius))


def _widths(a: Ints, b: Ints, angle: Array, along: Array, area: Array) -> Array:
    """Width of the narrower one of the two facets at each side, across it [m].

    A side lies along the triangles a and b, which meet at an angle [rad] over its length [m].
    """
    flat = angle <= FLAT
    graph = coo_array((np.ones(int(flat.sum())), (a[flat], b[flat])), (area.size, area.size))
    count, facet = connected_components(graph, directed=False)
    areas = np.bincount(facet, weights=area, minlength=count)
    sides = np.sort(np.stack([facet[a], facet[b]]), axis=0)
    _, pair = np.unique(sides, axis=1, return_inverse=True)
    common = np.bincount(pair.reshape(-1), weights=along)[pair.reshape(-1)]
    return np.asarray(areas[sides].min(axis=0) / common)
