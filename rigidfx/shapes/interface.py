"""What shapes do to the cells beside a part as its sections turn.

Shapes are linear. A section that turns by φ in the frame of its part is stretched there by

    δ = ½ φ × (φ × x)

less, where a section of cells would not be. So flexible cells beside the part are strained by -δ,
and have the energy ½ δ·K δ too much, with their K and δ at the nodes that they share with the part.
φ is the mean of each patch of cells beside it that are connected; nodes further out count as fixed.
"""

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.dof_layout import AtNodes, nodes_of
from rigidfx.coupling.rows import Rows
from rigidfx.domain.connected import connected_parts
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.shapes.stiffness import Stiffness, times


class Interface:
    """Nodes that a part shares with cells beside it; `destroy` frees K of these.

    Attributes:
        holds: Whether there are any, on any rank.
    """

    def __init__(self, stiffness: Stiffness, cells: Cells, nodes: Indices) -> None:
        """Find them by a part's owned cells and nodes, in the state of a stiffness. Collective."""
        scene, self._scene = stiffness.scene, stiffness.scene
        others = {i: np.setdiff1d(own, cells[i]) for i, own in stiffness.cells.items()}
        self._shared: Ints = np.flatnonzero(nodes_of(scene, others)[nodes])
        self._own = nodes[self._shared]
        self._K: PETSc.Mat | None = None
        self.holds = bool(scene.sum(self._shared.size) > 0)
        if not self.holds:
            return
        self._rows, dofmap = Rows(scene.space, self._own), scene.space.dofmap.list
        meets = nodes_of(scene, cells)[dofmap].any(axis=1)
        beside = {i: own[meets[own]] for i, own in others.items()}
        self._K = self._rows.assembled(stiffness.linear.tangent(beside))
        self._patch, self._count = self._patches(beside)
        self._places = stiffness.places[nodes]
        x, sums = stiffness.places[self._own], np.zeros((self._count, 4))
        np.add.at(sums, self._patch, np.c_[np.ones(len(x)), x])
        sums = np.asarray(scene.sum(sums))
        # Relative to the middle of each patch.
        self._x = x - (sums[:, 1:] / np.maximum(sums[:, :1], 1.0))[self._patch]

    def _patches(self, beside: Cells) -> tuple[Ints, int]:
        """The patch of each shared node, and how many there are. Collective."""
        mesh, dofmap = self._scene.mesh, self._scene.space.dofmap.list
        among, at = np.zeros(len(dofmap), dtype=bool), AtNodes(self._scene)
        some = np.sort(np.concatenate([*beside.values()]))
        among[some] = True
        parts = connected_parts(mesh, 2, among)
        found = at.largest(dofmap[some], parts.of_cell[some].astype(np.float64))[self._own]
        return found.astype(np.int64), parts.count

    def apart(self, d: Array) -> Array:
        """Displacements of the part's nodes as those see it that it shares, (nodes, 3). Collective.

        They are without the rigid motion that fits the shared ones best, if there are any.
        """
        if self._K is None:
            return d
        modes = rigid_motions(self._places, 1.0)
        own = modes[self._shared].reshape(-1, 6)
        sums = self._scene.sum(own.T @ np.c_[own, d[self._shared].reshape(-1)])
        return np.asarray(d - modes @ np.linalg.lstsq(sums[:, :6], sums[:, 6])[0])

    def energy(self, d: Array) -> float:
        """½ δ·K δ by displacements of the part's nodes, shape (nodes, 3) [m]. Collective."""
        if self._K is None:
            return 0.0
        turns = self._turns(d[self._shared])
        y = 0.5 * np.cross(turns, np.cross(turns, self._x)).reshape(-1, 1)
        found = (y * times(self._K, y, self._rows.vector)).sum()
        return 0.5 * float(self._scene.sum(found))

    def _turns(self, d: Array) -> Array:
        """φ of each shared node's patch by their displacements, shape (nodes, 3). Collective."""
        modes, sums = rigid_motions(self._x, 1.0), np.zeros((self._count, 6, 7))
        local = modes.swapaxes(1, 2) @ np.concatenate([modes, d[:, :, None]], axis=2)
        np.add.at(sums, self._patch, local)
        fits = np.asarray(self._scene.sum(sums))
        best = [np.linalg.lstsq(fit[:, :6], fit[:, 6])[0][3:] for fit in fits]
        return np.array(best)[self._patch]

    def destroy(self) -> None:
        """Free the matrix. Collective."""
        if self._K is not None:
            self._K.destroy()
