"""Straighten curved cells that gmsh has turned inside out.

gmsh puts the nodes on edges of second-order cells onto the geometry. Where a surface turns much
within a cell, det J changes its sign there. A node at x then moves towards its place s in the
straight cell, x ← s + t (x - s), with t halved until det J ≥ LEAST of the straight cell's. The
straight cell, t = 0, always has one sign if it is a tetrahedron. gmsh's own optimisers are no way:
they throw C++ exceptions that nobody can catch.
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import numpy.typing as npt

from rigidfx.domain.cell_quality import check_points

__all__ = ["straighten"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LEAST = 0.1  # of the straight cell's det J: gmsh's Mesh.HighOrderThresholdMin; also the least t
CURVED = np.sqrt(np.finfo(float).eps)  # of a cell's size: nodes farther off are of curved edges

# Kinds of cells by gmsh's names.
KINDS = {"Tetrahedron": basix.CellType.tetrahedron, "Hexahedron": basix.CellType.hexahedron}


def straighten(gmsh: Any, metres: float) -> str:
    """Straighten curved cells of gmsh's model where det J would vanish.

    Args:
        gmsh: The module; its model has a mesh.
        metres: Those of the model's unit of length, for the text.

    Returns:
        A text that says how many cells, where, and how far they are off the geometry; empty if
        there are none.
    """
    mesh = gmsh.model.mesh
    tags, flat, _ = mesh.getNodes()
    x = np.reshape(flat, (-1, 3))
    row = np.zeros(int(tags.max(initial=0)) + 1, np.int64)
    row[tags] = np.arange(len(tags))
    told = ""
    for name, cell in KINDS.items():
        first, kind = (mesh.getElementType(name, order) for order in (1, 2))
        cells = row[mesh.getElementsByType(kind)[1]].reshape(-1, mesh.getElementProperties(kind)[3])
        if not len(cells):
            continue
        degree = 3 if cell == basix.CellType.tetrahedron else 5  # of det J
        lattice = basix.create_lattice(cell, degree, basix.LatticeType.equispaced, True)
        points = np.vstack([check_points(cell, 2), lattice])
        if cell == basix.CellType.hexahedron:
            points = 2 * points - 1  # gmsh's hexahedra reach from -1 to 1
        slopes = _values(mesh, kind, points, "GradLagrange").reshape(len(points), -1, 3)
        nodes = np.reshape(mesh.getElementProperties(kind)[4], (-1, 3))
        moved, bad = _moved(x, cells, slopes, _values(mesh, first, nodes, "Lagrange"))
        off = np.linalg.norm(moved - x, axis=1)
        for node in np.flatnonzero(off):
            mesh.setNode(tags[node], moved[node], [])
        if len(bad):
            place = ", ".join(f"{value:.4g}" for value in metres * x[cells[bad[0]]].mean(axis=0))
            told = (
                f"{len(bad)} of {len(cells)} cells would be inside out, or nearly, if they were as "
                f"curved as the geometry. They are straighter, by up to {metres * off.max():.2g} m,"
                f" the first around ({place}) m. Smaller cells (size; in read_cad also "
                "per_circle=24, along curves only) bring them nearer to the geometry."
            )
    return told


def _values(mesh: Any, kind: int, points: Array, called: str) -> Array:
    """Functions of a kind of cells at points of the reference cell, shape (points, …)."""
    values = mesh.getBasisFunctions(kind, points.ravel(), called)[1]
    return np.reshape(values, (len(points), -1))


def _moved(x: Array, cells: Ints, slopes: Array, corners: Array) -> tuple[Array, Ints]:
    """Places of nodes once all cells are sound, and the cells that were not.

    Args:
        x: Places, shape (nodes, 3).
        cells: Their rows, shape (cells, nodes of each).
        slopes: Derivatives of the cells' functions, shape (points, nodes of each, 3).
        corners: Values of the straight cells' functions at the nodes, shape (nodes of each, first).
    """
    straight = x.copy()
    straight[cells] = np.einsum("nk,cki->cni", corners, x[cells[:, : corners.shape[1]]])
    bend = np.linalg.norm(x - straight, axis=1)[cells].max(axis=1)
    curved = np.flatnonzero(bend > CURVED * np.linalg.norm(np.ptp(x[cells], axis=1), axis=1))
    own = cells[curved]
    usual = _det(straight, own, slopes).mean(axis=1)
    part = np.ones(len(x))  # t of each node
    found = np.zeros(len(own), dtype=bool)
    while True:
        now = straight + part[:, None] * (x - straight)
        bad = (_det(now, own, slopes) / usual[:, None]).min(axis=1) < LEAST
        bad &= part[own].max(axis=1) > 0  # others are straight
        if not bad.any():
            return np.where(part[:, None] < 1, now, x), curved[found]
        found |= bad
        touched = np.unique(own[bad])
        part[touched] = np.where(part[touched] > 2 * LEAST, part[touched] / 2, 0.0)


def _det(x: Array, cells: Ints, slopes: Array) -> Array:
    """Det J, shape (cells, points)."""
    return np.linalg.det(np.einsum("pnj,cni->cpij", slopes, x[cells], optimize=True))
