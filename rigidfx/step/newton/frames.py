"""How nodes and bodies have turned, and unknowns turned along with them.

A tangent belongs to directions in space. Where the surroundings of a node have turned by Q since it
was assembled, its rows and columns are turned: A ≈ Q A₀ Qᵀ with a block of Q for each node and each
body, exactly so for parts in steady rigid rotation, and up to curvature times cell size in parts
that bend. Increments of a node and residuals at it turn as vectors, and so do Δr and ℓθ of a body.
Coordinates of shapes do not turn. A node that supports hold in part keeps its directions.
"""

from __future__ import annotations

import numpy as np
from dolfinx import la

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.local_rotations import LocalRotations, turn_vectors
from rigidfx.mechanics.rotation import IDENTITY


class Frames:
    """The frames of the nodes and bodies that the unknowns of a layout belong to.

    Attributes:
        starts: Where vectors of three among this rank's unknowns begin.
    """

    def __init__(self, prolongation: Prolongation) -> None:
        """Find where vectors of unknowns begin. Collective.

        Args:
            prolongation: Map between unknowns and dofs.
        """
        self._p, layout = prolongation, prolongation.layout
        parts = [np.empty(0, dtype=np.int32), *layout.flexible.values()]
        cells = layout.space.dofmap.list[np.concatenate(parts)]
        X = layout.space.tabulate_dof_coordinates()
        self._local = LocalRotations(cells, X, prolongation.comm)
        self._spread = la.vector(layout.space.dofmap.index_map, 9)
        self._nodes = layout.rows.nodes
        self._fitted = np.broadcast_to(IDENTITY, (self._nodes.size, 3, 3)).copy()
        free = prolongation.free_of_nodes
        self._whole = free.all(axis=1)
        first = (np.cumsum(free.reshape(-1)).reshape(-1, 3) - 1)[self._whole, 0]
        bodies = prolongation.six[:, ::3].reshape(-1)
        self.starts = np.concatenate([first, bodies]).astype(np.int32)

    def rotations(self, u: Array) -> Array:
        """Rotation of each vector of unknowns of this rank, shape (vectors, 3, 3). Collective.

        Args:
            u: Displacement of all local nodes, ghosts included, one number per dof [m].
        """
        M = self._spread.array.reshape(-1, 9)
        M[:] = 0.0
        self._local.spread(u, M)
        self._spread.scatter_reverse(la.InsertMode.add)
        self._local.fit(M[self._nodes], self._fitted)
        nodes = self._p.at_nodes(self._fitted.reshape(-1, 9)).reshape(-1, 3, 3)
        bodies = self._p.increments.start.R[self._p.moving]
        return np.concatenate([nodes[self._whole], np.repeat(bodies, 2, axis=0)])

    def turn(self, y: Array, Q: Array, back: bool = False) -> None:
        """Turn unknowns, or residuals, of this rank in place.

        Args:
            y: One number per unknown of this rank.
            Q: Rotation of each vector, shape (vectors, 3, 3).
            back: Whether by Qᵀ.
        """
        turn_vectors(y, self.starts, Q, back)
