"""A device to be dropped: a shell, two boards across it, and a heavy block between them."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import rigidfx as rf

__all__ = ["EDGES", "device"]

EDGES = 0.12, 0.07, 0.024  # m
WALL = 0.003  # m
INNER = [(WALL, edge - WALL) for edge in EDGES]

# Boxes of the parts: from and to along each axis [m].
BOARDS = [
    (INNER[0], (0.014, 0.056), (0.008, 0.010)),
    ((0.036, INNER[0][1]), (0.021, 0.049), (0.016, 0.018)),
]
HEAVY = [((0.036, 0.072), (0.021, 0.049), (0.010, 0.016))]
CAVITY = [tuple(INNER)]
OUTSIDE = [tuple((0.0, edge) for edge in EDGES)]


def device(size: float, up: tuple[float, float, float], height: float) -> rf.Domain:
    """Hexahedra with the cell sets shell, board and heavy, and all of the outside as skin.

    Boards and block are at one with what they touch. Collective.

    Args:
        size: Largest edge of a cell [m], but for the grid that the parts need.
        up: Direction, from its corner at the origin along its edges, that is turned to z.
        height: Of that corner [m].
    """
    upright = Rotation.align_vectors([(0.0, 0.0, 1.0)], [up])[0]
    turn = upright.as_rotvec()

    def build(gmsh: Any) -> None:
        occ, parts = gmsh.model.occ, {}
        for low, high in _boxes():
            parts[occ.addBox(*low, *(high - low))] = _part(0.5 * (low + high))
        boxes = [(3, tag) for tag in parts]
        _, pieces = occ.fragment(boxes[:1], boxes[1:])
        occ.rotate(occ.getEntities(3), 0, 0, 0, *turn, np.linalg.norm(turn))
        occ.translate(occ.getEntities(3), 0, 0, height)
        occ.synchronize()
        for name in ("shell", "board", "heavy"):
            own = [tag for part, piece in zip(parts.values(), pieces, strict=True)
                   for _, tag in piece if part == name]  # fmt: skip
            gmsh.model.addPhysicalGroup(3, own, name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.setTransfiniteAutomatic()
        gmsh.model.mesh.generate(3)

    def outside(x: np.ndarray) -> np.ndarray:
        along = upright.inv().apply((x - [[0.0], [0.0], [height]]).T)
        return np.asarray(np.any((np.abs(along) < 1e-7) | (np.abs(along - EDGES) < 1e-7), axis=1))

    return rf.from_gmsh(build).with_facets("skin", outside)


def _boxes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Boxes without the empty ones, on a grid that has a line at each face of a part."""
    parts = [*BOARDS, *HEAVY, *CAVITY, *OUTSIDE]
    lines = [sorted({end for part in parts for end in part[axis]}) for axis in range(3)]
    every = product(*(pairwise(own) for own in lines))
    ends = [(np.array([a for a, _ in box]), np.array([b for _, b in box])) for box in every]
    return [(low, high) for low, high in ends if _part(0.5 * (low + high))]


def _part(x: np.ndarray) -> str:
    """The part that a point is in; "" in the air."""

    def within(boxes: list[Any]) -> bool:
        return any(all(a < c < b for c, (a, b) in zip(x, box, strict=True)) for box in boxes)

    for name, boxes in (("board", BOARDS), ("heavy", HEAVY)):
        if within(boxes):
            return name
    return "" if within(CAVITY) else "shell"
