"""Mend curved cells that gmsh has turned inside out.

gmsh puts the nodes of second-order cells that lie on the geometry where it is, and leaves those
inside on straight edges. Where a surface turns much within a cell, det J changes its sign there.
Let s be the place of a node in the straight cell, and d = x - s. First, nodes on edges inside
follow those on surfaces: ∇·∇d = 0 around such cells. If cells are left with det J below LEAST of
the straight cell's, their nodes go towards s, x ← s + t d, with t halved until none is. The
straight cell has det J of one sign if it is a tetrahedron. gmsh's own optimisers are no way: they
throw C++ exceptions that nobody can catch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.domain.cell_quality import check_points

__all__ = ["straighten"]


LEAST = 0.1  # of the straight cell's det J: gmsh's Mesh.HighOrderThresholdMin; also the least t
CURVED = np.sqrt(np.finfo(float).eps)  # of a cell's size: nodes farther off are of curved edges

# Kinds of cells by gmsh's names.
KINDS = {"Tetrahedron": basix.CellType.tetrahedron, "Hexahedron": basix.CellType.hexahedron}


def straighten(gmsh: Any, metres: float) -> str:
    """Mend curved cells of gmsh's model where det J would vanish.

    Args:
        gmsh: The module; its model has a mesh.
        metres: Those of the model's unit of length, for the text.

    Returns:
        A text that says how many cells are straighter than the geometry, where, and by how much;
        empty if there are none.
    """
    mesh = gmsh.model.mesh
    tags, flat, _ = mesh.getNodes()
    x = np.reshape(flat, (-1, 3))
    row = np.zeros(int(tags.max(initial=0)) + 1, np.int64)
    row[tags] = np.arange(len(tags))
    on_surface = np.zeros(len(x), dtype=bool)
    on_surface[row[mesh.getNodes(2, -1, includeBoundary=True)[0]]] = True
    told = ""
    for name, cell in KINDS.items():
        kind = mesh.getElementType(name, 2)
        cells = row[mesh.getElementsByType(kind)[1]].reshape(-1, mesh.getElementProperties(kind)[3])
        if not len(cells):
            continue
        moved, bad = _Cells.of(mesh, name, cell, x, cells).mended(x, on_surface)
        for node in np.flatnonzero((moved != x).any(axis=1)):
            mesh.setNode(tags[node], moved[node], [])
        off = float(np.linalg.norm(moved - x, axis=1)[on_surface].max(initial=0.0))
        if off:
            place = ", ".join(f"{value:.4g}" for value in metres * x[cells[bad[0]]].mean(axis=0))
            told = (
                f"{len(bad)} of {len(cells)} cells would be inside out, or nearly, if they were as "
                f"curved as the geometry. They are straighter, by up to {metres * off:.2g} m,"
                f" the first around ({place}) m. Smaller cells (size; in read_cad also "
                "per_circle=24, along curves only) bring them nearer to the geometry."
            )
    return told


@dataclass(frozen=True)
class _Cells:
    """Cells of second order of one kind.

    Attributes:
        nodes: Rows of nodes, shape (cells, nodes of each).
        straight: Place of each node in the straight cells, shape (nodes, 3).
        corners: Whether a node is a corner of a cell, shape (nodes,).
        slopes: Derivatives of their functions at points where det J is checked, shape (points,
            nodes of each, 3); the last points are those of a rule ...
        weights: ... with these weights.
    """

    nodes: Ints
    straight: Array
    corners: Bools
    slopes: Array
    weights: Array

    @classmethod
    def of(cls, mesh: Any, name: str, cell: basix.CellType, x: Array, nodes: Ints) -> _Cells:
        """Cells of gmsh's mesh, by its name of their kind and by basix's."""
        first, kind = (mesh.getElementType(name, order) for order in (1, 2))
        degree = 3 if cell == basix.CellType.tetrahedron else 5  # of det J
        lattice = basix.create_lattice(cell, degree, basix.LatticeType.equispaced, True)
        rule, weights = basix.make_quadrature(cell, 4)
        points = np.vstack([lattice, check_points(cell, 2), rule])
        if cell == basix.CellType.hexahedron:
            points = 2 * points - 1  # gmsh's hexahedra reach from -1 to 1
        slopes = _values(mesh, kind, points, "GradLagrange").reshape(len(points), -1, 3)
        at_nodes = np.reshape(mesh.getElementProperties(kind)[4], (-1, 3))
        functions = _values(mesh, first, at_nodes, "Lagrange")
        straight = x.copy()
        at_corners = nodes[:, : functions.shape[1]]
        straight[nodes] = np.einsum("nk,cki->cni", functions, x[at_corners])
        corners = np.zeros(len(x), dtype=bool)
        corners[at_corners] = True
        return cls(nodes, straight, corners, slopes, weights)

    def mended(self, x: Array, fixed: Bools) -> tuple[Array, Ints]:
        """Places of nodes once all cells are sound, and cells that had to be straightened.

        Args:
            x: Places, shape (nodes, 3).
            fixed: Whether a node lies on a surface, shape (nodes,).
        """
        bad = self._bad(x)
        if not len(bad):
            return x, bad
        relaxed = self._relaxed(x, fixed, bad)
        if len(self._bad(relaxed)) < len(bad):
            x = relaxed
        part = np.ones(len(x))  # t of each node
        found = bad[:0]
        while True:
            now = np.where(
                part[:, None] < 1, self.straight + part[:, None] * (x - self.straight), x
            )
            bad = self._bad(now)
            bad = bad[part[self.nodes[bad]].max(axis=1) > 0]  # others are straight
            if not len(bad):
                return now, found
            found = np.union1d(found, bad)
            touched = np.unique(self.nodes[bad])
            part[touched] = np.where(part[touched] > 2 * LEAST, part[touched] / 2, 0.0)

    def _bad(self, x: Array) -> Ints:
        """Cells whose det J is too small, or of the wrong sign, at nodes' places x."""
        size = np.linalg.norm(np.ptp(self.straight[self.nodes], axis=1), axis=1)
        bend = np.linalg.norm(x - self.straight, axis=1)[self.nodes].max(axis=1)
        curved = np.flatnonzero(bend > CURVED * size)
        usual = np.linalg.det(self._jacobians(self.straight, curved)).mean(axis=1)
        now = np.linalg.det(self._jacobians(x, curved))
        return curved[(now / usual[:, None]).min(axis=1) < LEAST]

    def _jacobians(self, x: Array, cells: Ints) -> Array:
        """J, shape (cells, points, 3, 3)."""
        return np.einsum("pnj,cni->cpij", self.slopes, x[self.nodes[cells]], optimize=True)

    def _relaxed(self, x: Array, fixed: Bools, bad: Ints) -> Array:
        """Places once nodes on edges inside follow those on surfaces, around some cells."""
        near = np.zeros(len(x), dtype=bool)
        near[self.nodes[bad]] = True
        near[self.nodes[near[self.nodes].any(axis=1)]] = True
        free = near & ~fixed & ~self.corners
        if not free.any():
            return x
        cells = np.flatnonzero(free[self.nodes].any(axis=1))
        J = self._jacobians(self.straight, cells)[:, -len(self.weights) :]
        slopes = self.slopes[-len(self.weights) :]
        slopes = np.einsum("pnj,cpji->cpni", slopes, np.linalg.inv(J), optimize=True)
        volumes = self.weights * np.abs(np.linalg.det(J))
        K = np.einsum("cp,cpni,cpmi->cnm", volumes, slopes, slopes, optimize=True)
        nodes = self.nodes[cells]
        rows, columns = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
        shape = (len(x), len(x))
        whole = coo_array((K.ravel(), (rows.ravel(), columns.ravel())), shape).tocsr()[free]
        d = x - self.straight
        d[free] = 0.0
        d[free] = spsolve(whole[:, free].tocsc(), -(whole @ d)).reshape(-1, 3)
        return self.straight + d


def _values(mesh: Any, kind: int, points: Array, called: str) -> Array:
    """Functions of a kind of cells at points of the reference cell, shape (points, …)."""
    values = mesh.getBasisFunctions(kind, points.ravel(), called)[1]
    return np.reshape(values, (len(points), -1))
