"""A robot's arm: a hub with a bore, a link with holes, a thin leaf, and a heavy head at its end.

The arm lies along x, its leaf bends in y; of aluminium it weighs one kilogram. Re-entrant corners
are rounded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx import Domain, from_gmsh

HEIGHT = 0.04  # m; of all parts, along z
HUB, BORE = 0.036, 0.016  # m; radii
LINK = 0.12, 0.040  # m; where it ends, and its width
HOLES = (0.064, 0.096), 0.011  # m; where they are in the link, and their radius
LEAF = 0.07, 0.0025  # m; length and thickness
HEAD = 0.06, 0.056  # m; length and width
GRIP = 0.014  # m; radius of the hole in the head
FILLET = 0.006  # m; radius
TIP = LINK[0] + LEAF[0] + HEAD[0]  # m; x of the end
# Name → from where to where along x [m].
PARTS = {
    "link": (-HUB, LINK[0]),
    "leaf": (LINK[0] + FILLET, LINK[0] + LEAF[0] - FILLET),
    "head": (LINK[0] + LEAF[0], TIP),
}


def robot_arm(
    size: float = 0.012, leaf_size: float = 0.006, comm: MPI.Comm = MPI.COMM_WORLD
) -> Domain:
    """The arm of tetrahedra. Collective.

    All cells are named "arm", those between the fillets "link" (with the hub), "leaf" and "head";
    facets "bore", by which the hub is held, and "end", the far face of the head.

    Args:
        size: Largest edge of a cell [m].
        leaf_size: The same in the leaf and next to it.
        comm: Communicator of the mesh.
    """
    domain = from_gmsh(lambda gmsh: _build(gmsh, size, leaf_size), comm)
    for name, (start, end) in PARTS.items():
        domain = domain.with_cells(name, _between(start, end))
    return domain


def _between(start: float, end: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: (x[0] > start - 1e-9) & (x[0] < end + 1e-9)


def _build(gmsh: Any, size: float, leaf_size: float) -> None:
    """Plates and cylinders, united, rounded and drilled."""
    model, occ = gmsh.model, gmsh.model.occ

    def plate(x0: float, x1: float, width: float) -> tuple[int, int]:
        return 3, occ.addBox(x0, -width / 2, 0, x1 - x0, width, HEIGHT)

    def cylinder(x: float, radius: float) -> tuple[int, int]:
        return 3, occ.addCylinder(x, 0, 0, 0, 0, HEIGHT, radius)

    leaf_end = LINK[0] + LEAF[0]
    parts = [
        plate(0, LINK[0], LINK[1]),
        plate(LINK[0] - FILLET, leaf_end + FILLET, LEAF[1]),
        plate(leaf_end, TIP, HEAD[1]),
    ]
    body, _ = occ.fuse([cylinder(0, HUB)], parts)
    occ.synchronize()
    occ.fillet([body[0][1]], _corners(model), [FILLET])
    occ.synchronize()
    holes = [cylinder(0, BORE), *(cylinder(x, HOLES[1]) for x in HOLES[0])]
    occ.cut(model.getEntities(3), [*holes, cylinder(leaf_end + HEAD[0] / 2, GRIP)])
    occ.synchronize()

    def within(lower: tuple[float, ...], upper: tuple[float, ...]) -> list[int]:
        found = model.getEntitiesInBoundingBox(*lower, *upper, dim=2)
        return [tag for _, tag in found]

    e = 1e-5
    bore = within((-BORE - e, -BORE - e, -e), (BORE + e, BORE + e, HEIGHT + e))
    end = within((TIP - e, -HEAD[1], -e), (TIP + e, HEAD[1], HEIGHT + e))
    model.addPhysicalGroup(3, [tag for _, tag in model.getEntities(3)], name="arm")
    model.addPhysicalGroup(2, bore, name="bore")
    model.addPhysicalGroup(2, end, name="end")

    near = model.mesh.field.add("Box")
    for option, value in {
        "VIn": leaf_size,
        "VOut": size,
        "XMin": LINK[0] - FILLET / 2,
        "XMax": leaf_end + FILLET / 2,
        "YMin": -LEAF[1],
        "YMax": LEAF[1],
        "ZMin": -1.0,
        "ZMax": 1.0,
        "Thickness": 3 * size,
    }.items():
        model.mesh.field.setNumber(near, option, value)
    model.mesh.field.setAsBackgroundMesh(near)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    model.mesh.generate(3)


def _corners(model: Any) -> list[int]:
    """Edges along z that are rounded: re-entrant ones, and the outer ones of the head."""
    found = []
    leaf_end = LINK[0] + LEAF[0]
    for _, tag in model.getEntities(1):
        x0, y0, z0, x1, y1, z1 = model.getBoundingBox(1, tag)
        x, y = (x0 + x1) / 2, abs(y0 + y1) / 2
        along_z = z1 - z0 > 0.9 * HEIGHT and x1 - x0 < 1e-4 and y1 - y0 < 1e-4
        at_hub = abs(y - LINK[1] / 2) < 1e-4 and 0 < x < HUB
        at_leaf = abs(y - LEAF[1] / 2) < 1e-4 and min(abs(x - LINK[0]), abs(x - leaf_end)) < 1e-4
        of_head = abs(y - HEAD[1] / 2) < 1e-4
        if along_z and (at_hub or at_leaf or of_head):
            found.append(tag)
    return found
