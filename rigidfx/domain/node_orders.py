"""In which order the nodes of given cells are, seen from where they lie.

Programs number the nodes of a cell in different ways: DOLFINx the corners of a hexahedron by x, y,
z, most others round its bottom and then round its top; nodes on edges and in faces almost each in a
way of its own. One order only makes sound cells, so that places tell which it is.
"""

from __future__ import annotations

import basix
import numpy as np

from rigidfx.base.types import Array, Ints

CORNERS = {"hexahedron": 8, "tetrahedron": 4}
SECOND = {"hexahedron": 27, "tetrahedron": 10}  # nodes of a cell of second order
ROUND = (0, 1, 3, 2, 4, 5, 7, 6)  # of a hexahedron round its bottom and its top: DOLFINx's order
MOST = 5000  # cells that are looked at

# What to do with cells of so many nodes that are of no kind that is taken.
TWENTY = (
    "Bricks of 20 nodes have none in their faces: give their corners, cells[:, :8], and let the "
    "scene be of second order (order=2)."
)
WEDGES = (
    "Wedges and pyramids are no cells of a domain: mesh the part by tetrahedra or hexahedra alone."
)
ADVICE = {20: TWENTY} | dict.fromkeys((5, 6, 13, 15), WEDGES)

# Shapes of a brick of four, five, six and seven different corners.
SHAPES = ("a tetrahedron", "a pyramid", "a wedge", "a brick with an edge of no length")


def widths(cell: str) -> tuple[int, int]:
    """Numbers of nodes that a cell may have."""
    return CORNERS[cell], SECOND[cell]


def advice_on(cell: str, width: int) -> str:
    """The remedy for cells of so many nodes, which are not of this kind; empty if unknown."""
    other = next((kind for kind in CORNERS if kind != cell and width in widths(kind)), "")
    advice = ADVICE.get(width, f"Cells of {width} nodes are of another kind: cell={other!r}.")
    return f" {advice}" if other or width in ADVICE else ""


def collapsed(corners: Ints) -> tuple[int, str] | None:
    """The first cell that names a corner twice, and a text of its fault; None if there is none.

    Args:
        corners: Nodes at the corners of each cell, shape (cells, corners).
    """
    ordered = np.sort(corners, axis=1)
    same = (np.diff(ordered, axis=1) == 0).sum(axis=1)
    if not same.any():
        return None
    at = int(np.flatnonzero(same)[0])
    names, times = np.unique(ordered[at], return_counts=True)
    shape = f"it is {SHAPES[len(names) - 4]}. {WEDGES}" if len(names) >= 4 else "it is flat."
    return at, f"names node {names[times.argmax()]} {times.max()} times: {shape}"


def degree_of(cell: str, width: int) -> int:
    """Order of the geometry of cells with so many nodes."""
    return 2 if width == SECOND[cell] else 1


def in_dolfinx_order(x: Array, rows: Ints, cell: str) -> tuple[Ints, str | None]:
    """Cells with their nodes in DOLFINx's order, and the fault of the given one, or None.

    Args:
        x: Points, shape (points, 3) [m].
        rows: Points of each cell, shape (cells, nodes): corners first.
        cell: "hexahedron" or "tetrahedron".
    """
    corners = CORNERS[cell]
    some = rows[:: max(1, len(rows) // MOST)]
    if cell == "hexahedron" and _sound(x, some[:, ROUND]) > _sound(x, some[:, :corners]):
        rows, some = (np.hstack([r[:, ROUND], r[:, corners:]]) for r in (rows, some))
    if rows.shape[1] == corners:
        return rows, None
    order = _order_of_others(x, some, cell)
    if order is None:
        return rows, (
            f"from_arrays: after its {corners} corners a {cell}'s nodes must be those in the "
            f"middles of its {_others(cell)}, in the same order in all cells, but in most cells "
            "these are not what lies there. Give the corners alone, "
            f"cells[:, :{corners}] (read_inp: corners=True), and let the scene be of second order "
            "(order=2)."
        )
    return np.hstack([rows[:, :corners], rows[:, corners:][:, order]]), None


def _sound(x: Array, rows: Ints) -> int:
    """How many hexahedra have a volume of one sign at all corners, in DOLFINx's order."""
    X = x[rows].reshape(-1, 2, 2, 2, 3)  # by z, y, x
    along = [np.diff(X, axis=axis) for axis in (3, 2, 1)]
    det = np.linalg.det(np.stack(np.broadcast_arrays(*along), axis=-1)).reshape(len(rows), -1)
    return int(np.count_nonzero((det > 0).all(axis=1) | (det < 0).all(axis=1)))


def _order_of_others(x: Array, rows: Ints, cell: str) -> Ints | None:
    """Columns after the corners, in DOLFINx's order; None if most cells have no common one.

    A node belongs where the middle of an edge, a face or the cell is nearest. In a few cells that
    may be another one, as they are curved; whether they are sound is for det J to say.
    """
    corners = CORNERS[cell]
    topology = basix.topology(getattr(basix.CellType, cell))
    parts = topology[1] if cell == "tetrahedron" else [p for dim in topology[1:] for p in dim]
    middles = np.stack([x[rows[:, part]].mean(axis=1) for part in parts], axis=1)
    apart = np.linalg.norm(middles[:, :, None] - x[rows[:, None, corners:]], axis=-1)
    orders, times = np.unique(apart.argmin(axis=2), axis=0, return_counts=True)
    order = orders[np.argmax(times)].astype(np.int64)
    usual = 2 * times.max() > len(rows)
    return order if usual and len(set(order.tolist())) == len(parts) else None


def _others(cell: str) -> str:
    """Where the nodes are that are no corners."""
    return "edges" if cell == "tetrahedron" else "edges and faces, and in its own middle"
