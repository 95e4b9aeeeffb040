"""How the connected parts of a structure have turned, and unknowns turned along with them.

A tangent belongs to a direction in space. If a part has turned by Q since it was assembled, it is
Q A Qᵀ to the accuracy to which the part has moved like a rigid body: exactly so for a free one in
steady rotation. Q is block diagonal: increments of a node and residuals at it turn as vectors, and
so do Δr and ℓθ of a body. A part that only supports hold in place turns by next to nothing.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.coupling.prolongation import Prolongation
from rigidfx.domain.connected import ConnectedParts
from rigidfx.mechanics.rotation import IDENTITY

__all__ = ["Frames"]

Array = npt.NDArray[np.float64]

SLENDER = 1e-6  # a part this thin, relative to its length, has no direction of its own


class Frames:
    """The connected parts that the unknowns of a layout belong to."""

    def __init__(self, prolongation: Prolongation, parts: ConnectedParts) -> None:
        """Find the part of each unknown. Collective.

        Args:
            prolongation: Map between unknowns and dofs.
            parts: Connected parts of the mesh.
        """
        layout, self._comm = prolongation.layout, prolongation.comm
        self._parts, nodes = parts.count, layout.rows.nodes
        dofmap = layout.space.dofmap.list
        of_node = np.zeros(int(dofmap.max(initial=-1)) + 1, dtype=np.int64)
        of_node[dofmap] = parts.of_cell[: len(dofmap), None]
        self._of_row = of_node[nodes]
        X = layout.rows.X
        moments = np.hstack([np.ones((len(X), 1)), X])
        count, *sums = self._summed(moments).T
        self._arms = X - (np.transpose(sums) / np.maximum(count, 1.0)[:, None])[self._of_row]
        self._whole = parts.count == 1
        # Nodes all of whose components are unknowns, and bodies: three unknowns each.
        free = prolongation.free_of_nodes
        of_row = self._of_row[:, None].astype(np.float64)
        turned = prolongation.at_nodes(of_row)[:, 0].astype(np.int64)  # by the part of each node
        place = np.cumsum(free.reshape(-1)).reshape(-1, 3) - 1
        turning = free.all(axis=1)
        own = prolongation.owned_bodies
        of_body = self._parts_of_bodies(prolongation)[own]
        last = prolongation.own_free + np.arange(6 * own.size).reshape(-1, 3)
        self._vectors = np.concatenate([place[turning], last])
        self._of_vector = np.concatenate([turned[turning], np.repeat(of_body, 2)])
        n = prolongation.owned
        self._all = self._vectors.size == n and bool(
            np.array_equal(self._vectors.reshape(-1), np.arange(n))
        )

    def _parts_of_bodies(self, prolongation: Prolongation) -> npt.NDArray[np.int64]:
        """Part of each body: that of the nodes by which it is attached. Collective."""
        layout = prolongation.layout
        found = np.zeros(len(layout.bodies), dtype=np.int64)
        for k, (body, at) in enumerate(zip(layout.bodies, layout.attached, strict=True)):
            if at.size:
                found[k] = self._of_row[layout.rows.positions(body.nodes[at[:1]])[0]]
        self._comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        return found

    def _summed(self, values: Array) -> Array:
        """Sums over the rows of each part, shape (parts, columns). Collective."""
        out = np.array([np.bincount(self._of_row, v, self._parts) for v in values.T]).T.copy()
        self._comm.Allreduce(MPI.IN_PLACE, out)
        return out

    def rotations(self, u: Array) -> Array:
        """The rotation that fits the positions of each part best, shape (parts, 3, 3). Collective.

        Args:
            u: Displacements of the active nodes, one number per row [m].
        """
        # Arms sum up to zero, so that a displacement as a whole does not count.
        W, size, Vt = np.linalg.svd(self._spread(self._arms + u.reshape(-1, 3)))
        W[:, :, 2] *= np.linalg.det(W @ Vt)[:, None]
        R = W @ Vt
        R[size[:, 1] <= SLENDER**2 * size[:, 0]] = IDENTITY
        return np.asarray(R)

    def _spread(self, x: Array) -> Array:
        """Σ x Xᵀ over the rows of each part, X their arms, shape (parts, 3, 3) [m²]. Collective."""
        if not self._whole:
            products = (x[:, :, None] * self._arms[:, None, :]).reshape(-1, 9)
            return self._summed(products).reshape(-1, 3, 3)
        out = (x.T @ self._arms)[None]
        self._comm.Allreduce(MPI.IN_PLACE, out)
        return out

    def turn(self, y: Array, Q: Array) -> None:
        """Turn unknowns, or residuals, of this rank by the rotations of their parts, in place.

        Args:
            y: One number per unknown of this rank.
            Q: Shape (parts, 3, 3).
        """
        if self._whole and self._all:
            y.reshape(-1, 3)[:] = y.reshape(-1, 3) @ Q[0].T
        elif self._whole:
            y[self._vectors] = y[self._vectors] @ Q[0].T
        else:
            y[self._vectors] = (Q[self._of_vector] @ y[self._vectors][:, :, None])[:, :, 0]
