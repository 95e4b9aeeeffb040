"""Whether the error motion is small enough for an equation of first order.

The relative error of displacements by e is half of its rotation: they are shown while no rotation
exceeds 0.1. Strains by e are linear in it. The missing part of second order, ½ ∇eᵀ∇e, comes from
its rotation: strains are shown while it is also below a tenth of the largest strain so far in the
connected part. Gradients are those at the middles of cells. A part that joints hold rotates in e as
its neighbours bend; its mean rotation causes no strain, and is left out.
"""

from __future__ import annotations

from typing import ClassVar

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.log import tell
from rigidfx.base.remembered import CELLS, PART, Remembered, same
from rigidfx.error.joints import joined_parts
from rigidfx.error.response import Response
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.watch import WarnsOnce

__all__ = ["Validity"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int32]

SMALL = 0.1  # rotation of e, and ½ ∇eᵀ∇e over the largest strain shown, at most


class Validity:
    """Looks at e after each of its steps.

    Attributes:
        concerned: Owned cells in which e was too large at the last look.
        holds: Whether there was none on any rank: strains are told.
        placed: Whether its rotations were small on all ranks: displacements are told.
    """

    remembered: ClassVar[Remembered] = same("holds", "placed", "_modes_hold", "_largest") | {
        "concerned": CELLS,
        "_warns": PART,
    }

    def __init__(self, scene: Scene) -> None:
        """Find the gradients at the middles of owned cells. Collective."""
        self._scene = scene
        owned = scene.mesh.topology.index_map(scene.mesh.topology.dim).size_local
        self._nodes = scene.space.dofmap.list[:owned]
        self._X = scene.space.tabulate_dof_coordinates()
        cell = getattr(basix.CellType, scene.mesh.topology.cell_name())
        middle = basix.geometry(cell).mean(axis=0, keepdims=True)
        element = scene.space.element.basix_element
        table = np.asarray(element.tabulate(1, middle))[1:, 0, :, 0]
        J = np.einsum("da,cai->cid", table, self._X[self._nodes])
        self._gradients = np.einsum("da,cdi->cai", table, np.linalg.inv(J))
        self._part = scene.parts.of_cell[:owned]
        self._joined = np.flatnonzero(joined_parts(scene))
        self._largest: Array = np.zeros(scene.parts.count)  # strain of each part so far
        self._field = fem.Function(scene.space)
        self.concerned: Cells = np.empty(0, np.int32)
        self.holds = self.placed = self._modes_hold = True
        self._warns = WarnsOnce(scene.comm)

    def look(self, t: float, response: Response, x: Array, shape: Array) -> None:
        """Look at e, and say once where it is not told. Collective.

        Args:
            t: Time [s].
            response: Has e.
            x: Places of the owned nodes in the run, shape (nodes, 3) [m].
            shape: Their places in the shape, likewise [m].
        """
        reason = self._measured(response.coarse(), x, shape)
        self.holds = not reason
        if reason and self._warns.waits:
            self._warns.say(
                f"Error motion: at t = {t:.6g} s {reason}, so that a linear equation does not tell "
                f"it. While that lasts {_hidden(self.placed)} shown are those of the run itself, "
                "without its error. Take a smaller tolerance, or keep flexible what bends (never)."
            )
        if self._modes_hold and not response.valid:
            self._modes_hold = False
            tell(
                self._scene.comm,
                f"Error motion: at t = {t:.6g} s forces on bodies change faster than its modes and "
                "their static response tell. While that lasts it is not shown.",
            )

    def _measured(self, e: Array, x: Array, shape: Array) -> str:
        """The quantity that is too large, in words; "" where e is small. Collective."""
        G, F, F0 = (
            np.einsum("cai,caj->cij", self._in_cells(a), self._gradients) for a in (e, x, shape)
        )
        linear = np.einsum("cki,ckj->cij", F0, G)
        E = 0.5 * (np.einsum("cki,ckj->cij", F, F) - np.eye(3) + linear + linear.swapaxes(1, 2))
        G = G @ np.linalg.inv(F0)  # by places in the shape
        turned = np.linalg.norm(G - G.swapaxes(1, 2), axis=(1, 2)) / np.sqrt(8)
        np.maximum.at(self._largest, self._part, np.linalg.norm(E, axis=(1, 2)))
        self._scene.comm.Allreduce(MPI.IN_PLACE, self._largest, op=MPI.MAX)
        for part in self._joined:
            own = self._part == part
            sums = self._scene.sum(np.r_[G[own].sum(axis=0).reshape(-1), own.sum()])
            mean = sums[:9].reshape(3, 3) / sums[9]
            G[own] -= 0.5 * (mean - mean.T)
        square = 0.5 * np.linalg.norm(np.einsum("cki,ckj->cij", G, G), axis=(1, 2))
        far = turned > SMALL
        bent = square > SMALL * self._largest[self._part]
        self.concerned = np.flatnonzero(far | bent).astype(np.int32)
        largest = turned.max(initial=0.0), float(bent.any())
        turn, bends = np.max(self._scene.comm.allgather(largest), axis=0)
        self.placed = bool(turn <= SMALL)
        if not self.placed:
            return f"it turns by {turn:.2g} rad"
        return "its part of second order is above a tenth of the largest strain" if bends else ""

    def _in_cells(self, vectors: Array) -> Array:
        """Vectors of the owned nodes at the nodes of each owned cell. Collective."""
        field = self._field.x
        field.array[: vectors.size] = vectors.reshape(-1)
        field.scatter_forward()
        return np.asarray(field.array.reshape(-1, 3)[self._nodes])


def _hidden(placed: bool) -> str:
    """Quantities to which e is not added."""
    return "stresses and strains" if placed else "displacements, stresses and strains"
