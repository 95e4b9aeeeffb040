"""Records of an input file's mesh on rank 0, and how its cells and faces are numbered."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.domain.node_orders import CORNERS, widths


@dataclass
class InpMesh:
    """A mesh on rank 0.

    Attributes:
        kind: "hexahedron" or "tetrahedron".
        points: Nodes of cells, shape (nodes, 3) [the file's unit of length].
        cells: Shape (cells, nodes of each).
        of_cells: Rows of cells by name.
        of_facets: Corners of facets by name, sorted, shape (facets, 3 or 4).
        of_edges: Corners of edges by name, sorted, shape (edges, 2).
        of_nodes: Rows of nodes by name, shape (nodes, 1).
        notes: Texts of warnings.
        elements: Name of each instance, and the numbers of its elements, one instance after the
            other as `cells` are.
    """

    kind: str
    points: Array
    cells: Ints
    of_cells: dict[str, Ints] = field(default_factory=dict)
    of_facets: dict[str, Ints] = field(default_factory=dict)
    of_edges: dict[str, Ints] = field(default_factory=dict)
    of_nodes: dict[str, Ints] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    elements: list[tuple[str, Ints]] = field(default_factory=list)

    def names(self) -> dict[int, dict[str, Ints]]:
        """Its sets by dimension."""
        return {3: self.of_cells, 2: self.of_facets, 1: self.of_edges, 0: self.of_nodes}


def faces_of(kind: str) -> list[tuple[int, ...]]:
    """Corners of the faces S1, S2, … of a cell, as Abaqus and CalculiX number them."""
    if kind == "tetrahedron":
        return [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)]
    sides = [(0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    return [(0, 1, 2, 3), (4, 7, 6, 5), *sides]


def edges_of(kind: str) -> list[tuple[int, int]]:
    """Both ends of the edges of a cell, in the order in which the nodes on them follow corners."""
    if kind == "tetrahedron":
        return [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    low = [(k, (k + 1) % 4) for k in range(4)]
    return [*low, *((a + 4, b + 4) for a, b in low), *((k, k + 4) for k in range(4))]


def element_name(elements: list[tuple[str, Ints]], cell: int) -> str:
    """The name of a cell in the file."""
    for instance, numbers in elements:
        if cell < len(numbers):
            return f"element {numbers[cell]}" + (f" of instance '{instance}'" if instance else "")
        cell -= len(numbers)
    return f"number {cell} of the input"


class Numbers:
    """Rows by the numbers of one instance."""

    def __init__(self, labels: Ints, rows: Ints) -> None:
        """Sort them.

        Args:
            labels: Numbers in the file.
            rows: Of each, where it is.
        """
        order = np.argsort(labels, kind="stable")
        self.labels, self.rows = labels[order], rows[order]

    def find(self, wanted: Ints) -> tuple[Ints, Ints]:
        """Rows of the numbers that there are, and the numbers that there are not."""
        if not len(self.labels):
            return np.empty(0, np.int64), wanted
        at = np.minimum(np.searchsorted(self.labels, wanted), len(self.labels) - 1)
        there = self.labels[at] == wanted
        return self.rows[at[there]], wanted[~there]


def kind_of(width: int) -> str:
    """The kind of cells with so many nodes; "other" if unknown."""
    if width == CORNERS["hexahedron"] + 12:  # a node on each edge
        return "hexahedron"
    return next((kind for kind in CORNERS if width in widths(kind)), "other")
