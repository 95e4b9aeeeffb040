"""Records of an input file's mesh on rank 0, and how its cells and faces are numbered."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rigidfx.domain.node_orders import CORNERS, widths

__all__ = ["InpMesh", "Numbers", "faces_of", "kind_of"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass
class InpMesh:
    """A mesh on rank 0.

    Attributes:
        kind: "hexahedron" or "tetrahedron".
        points: Nodes of cells, shape (nodes, 3) [the file's unit of length].
        cells: Shape (cells, nodes of each).
        of_cells: Rows of cells by name.
        of_facets: Corners of facets by name, sorted, shape (facets, 3 or 4).
        of_nodes: Rows of nodes by name, shape (nodes, 1).
        notes: Texts of warnings.
    """

    kind: str
    points: Array
    cells: Ints
    of_cells: dict[str, Ints] = field(default_factory=dict)
    of_facets: dict[str, Ints] = field(default_factory=dict)
    of_nodes: dict[str, Ints] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def names(self) -> tuple[dict[str, Ints], dict[str, Ints], dict[str, Ints], list[str]]:
        """All that other ranks have to know beside their cells."""
        return self.of_cells, self.of_facets, self.of_nodes, self.notes


def faces_of(kind: str) -> list[tuple[int, ...]]:
    """Corners of the faces S1, S2, … of a cell, as Abaqus and CalculiX number them."""
    if kind == "tetrahedron":
        return [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)]
    sides = [(0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    return [(0, 1, 2, 3), (4, 7, 6, 5), *sides]


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
