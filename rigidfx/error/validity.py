"""Whether the error motion is small enough for an equation of first order, in each connected part.

The relative error of displacements by e is half of its rotation: they are shown while no rotation
in the part exceeds 0.1. Strains by e are linear in it. The missing part of second order, ½ ∇eᵀ∇e,
comes from its rotation: strains are shown while it is also below a tenth of the largest strain so
far in the part. Gradients are those at the middles of cells. A part that joints hold rotates in e
as its neighbours bend, and a part that nothing holds as contacts move it: their mean rotation
causes no strain, and is left out. The latter are shown without displacements of e, so that their
mean rotation does not count there.
"""

from __future__ import annotations

from typing import Any, ClassVar

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.remembered import CELLS, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.base.warning import warn
from rigidfx.error.joints import joined_parts
from rigidfx.error.response import Response
from rigidfx.error.strained import part_of
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import name_of_cell

__all__ = ["Validity"]


# Quantities that are hidden, and doubts.
ALL, STRAINS = "displacements, stresses and strains", "stresses and strains"
BENT = "has a strain of second order above a tenth of the largest strain"
FAST = "forces on bodies change as fast as vibrations that its modes leave out; it may be wrong"
UNBOUND = "a preload leaves no stiffness to some motion, so that e is not known and not shown"
SMALL = 0.1  # rotation of e, and ½ ∇eᵀ∇e over the largest strain shown, at most


class Validity:
    """Looks at e after each of its steps.

    Attributes:
        concerned: Owned cells in which e was too large at the last look.
        holds: Connected parts without such a cell on any rank: strains of e are told.
        placed: Connected parts with small rotations on all ranks: displacements of e are told.
    """

    remembered: ClassVar[Remembered] = same("holds", "placed", "_said", "_largest") | {
        "concerned": CELLS
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
        self._joined = joined_parts(scene)
        self._largest: Array = np.zeros(scene.parts.count)  # strain of each part so far
        self._field = fem.Function(scene.space)
        self.concerned: Indices = np.empty(0, np.int32)
        self.holds = self.placed = np.ones(scene.parts.count, dtype=bool)
        self._said: tuple[str, ...] = ()  # kinds of warnings

    def look(self, t: float, response: Response, x: Array, shape: Array, free: Bools) -> None:
        """Look at e, and say once where it is not told. Collective.

        Args:
            t: Time [s].
            response: Has e.
            x: Places of the owned nodes in the run, shape (nodes, 3) [m].
            shape: Their places in the shape, likewise [m].
            free: Connected parts that nothing holds.
        """
        turned, square = self._measured(response.coarse(), x, shape, free)
        far, size = turned / SMALL, np.maximum(turned, square) / SMALL
        self.concerned = np.flatnonzero(size > 1).astype(np.int32)
        most: Array = np.zeros((2, self.holds.size))
        np.maximum.at(most[0], self._part, far)
        np.maximum.at(most[1], self._part, size)
        self._scene.comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)
        self.placed, self.holds = most <= 1
        if not self.placed.all() and self._first(ALL, STRAINS):
            self._hides(ALL, t, far, f"rotates by {SMALL * most[0].max():.2g} rad")
        if not self.holds.all() and self._first(STRAINS):
            self._hides(STRAINS, t, size, BENT)
        doubt = FAST if response.hurried else UNBOUND
        if (response.hurried or not response.valid) and self._first(doubt):
            warn(
                self._scene.comm,
                f"Error motion e at t = {t:.6g} s: {doubt}. Take a smaller tolerance, or keep "
                "flexible the parts that forces push (never).",
            )

    def _first(self, *kinds: str) -> bool:
        """Whether the first of these has not been said; now all have."""
        new = kinds[0] not in self._said
        if new:
            self._said = *self._said, *kinds
        return new

    def _hides(self, hidden: str, t: float, size: npt.NDArray[Any], found: str) -> None:
        """Warn that e is too large. Collective."""
        where = self._worst(size)
        warn(
            self._scene.comm,
            f"Error motion: at t = {t:.6g} s e {found} in {where}: too much for a linear equation. "
            f"While this lasts, {hidden} of this connected part are shown without e. Take a "
            "smaller tolerance, or keep flexible what bends (never).",
        )

    def _worst(self, size: npt.NDArray[Any]) -> str:
        """Name of the owned cell in which something is largest. Collective."""
        comm, own = self._scene.comm, float(size.max(initial=0.0))
        most = comm.allreduce(own, op=MPI.MAX)
        return name_of_cell(
            comm, self._scene.mesh, int(np.argmax(size)) if size.size and own == most else None
        )

    def _measured(self, e: Array, x: Array, shape: Array, free: Bools) -> tuple[Array, Array]:
        """Rotation of e in each owned cell, and ½ ∇eᵀ∇e over its part's largest strain. Collective.

        Arguments as of `look`.
        """
        G, F, F0 = (self._in_cells(a).mT @ self._gradients for a in (e, x, shape))
        linear = F0.mT @ G
        E = 0.5 * (F.mT @ F - np.eye(3) + linear + linear.mT)
        G = G @ np.linalg.inv(F0)  # by places in the shape
        np.maximum.at(self._largest, self._part, np.linalg.norm(E, axis=(1, 2)))
        self._scene.comm.Allreduce(MPI.IN_PLACE, self._largest, op=MPI.MAX)
        spin = self._mean_spin(G, self._joined | free)[self._part]
        turned = G - G.swapaxes(1, 2) - 2 * np.where(free[self._part, None, None], spin, 0.0)
        G = G - spin
        square = 0.5 * np.linalg.norm(G.mT @ G, axis=(1, 2))
        return np.linalg.norm(turned, axis=(1, 2)) / np.sqrt(8), part_of(
            square, self._largest[self._part]
        )

    def _mean_spin(self, G: Array, parts: Bools) -> Array:
        """Mean of the skew part of gradients in some parts, zero in others. Collective."""
        if not parts.any():
            return np.zeros((parts.size, 3, 3))
        sums = np.zeros((parts.size, 10))
        np.add.at(sums, self._part, np.c_[G.reshape(-1, 9), np.ones(len(G))])
        sums = self._scene.sum(sums)
        mean = (sums[:, :9] / sums[:, 9:]).reshape(-1, 3, 3)
        return np.where(parts[:, None, None], 0.5 * (mean - mean.swapaxes(1, 2)), 0.0)

    def _in_cells(self, vectors: Array) -> Array:
        """Vectors of the owned nodes at the nodes of each owned cell. Collective."""
        field = self._field.x
        field.array[: vectors.size] = vectors.reshape(-1)
        field.scatter_forward()
        return np.asarray(field.array.reshape(-1, 3)[self._nodes])
