"""Masses at points of faces: m JᵀJ, J the derivatives of the point's place by nodes.

They take part where all of these nodes do. A reduced tangent gets nothing of them here: with steps
they are a stiffness at ports, see `rigidfx.effects.attached.point_mass`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, vstack

from rigidfx.base.types import Array, Bools
from rigidfx.coupling.averages import add_at_vectors, slopes_of
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import PointMass
from rigidfx.scene.scene import Scene

__all__ = ["WithRemoteMasses", "with_remote_masses"]


class WithRemoteMasses:
    """A mass operator with masses at points of faces."""

    def __init__(self, within: Any, rows: Rows, masses: Array, slopes: csr_array) -> None:
        """Take them.

        Args:
            within: The mass operator of cells and nodes.
            rows: The rows it acts on.
            masses: The masses [kg].
            slopes: J of each, shape (3 · masses, 3 · nodes of the rows).
        """
        self._within, self._rows = within, rows
        self._masses, self._slopes = masses, slopes

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v. Collective."""
        self._within.mult(v, out)
        moved = np.asarray(self._slopes @ v.array_r)
        self._rows.comm.Allreduce(MPI.IN_PLACE, moved)
        out.array[:] += self._slopes.T @ (np.repeat(self._masses, 3) * moved)

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M but for these masses. Collective."""
        self._within.add_to(tangent, factor, prolongation)

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it. Collective."""
        M = self._within.matrix()
        blocks = self._masses[:, None, None] * np.eye(3)
        add_at_vectors(M, self._slopes, blocks, self._rows.comm)
        return M

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._within.destroy()


def with_remote_masses(
    scene: Scene, mass: Any, rows: Rows, counted: Bools, carried: bool = False
) -> Any:
    """A mass operator with the masses at points of faces all of whose nodes count. Collective.

    Args:
        scene: The problem.
        mass: The operator of cells and nodes.
        rows: The rows it acts on.
        counted: For each node of the rows, whether it counts.
        carried: Whether masses count that are bodies of their own in a run.
    """
    masses: list[float] = []
    slopes: list[csr_array] = []
    for effect in (e for e in scene.named(PointMass) if e.face is not None):
        if effect.is_carried and not carried:
            continue
        own = slopes_of(scene, effect.remote.place, rows, counted)
        if own is not None:
            masses.append(float(effect.mass))
            slopes.append(own)
    if not masses:
        return mass
    return WithRemoteMasses(mass, rows, np.array(masses), csr_array(vstack(slopes, format="csr")))
