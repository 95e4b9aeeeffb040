"""Small motions of a whole structure about its start: static ones, those of a step, and modes.

    K⁺f ,    (2 M/Δt² + K/2)⁻¹ f ,    K φ = ω² M φ with ωΔt < 1

The second is the increment that a force which begins brings in a step of the midpoint rule.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx.shapes.responses import Responses
from rigidfx.step.linear.definite import solver_of
from rigidfx.step.linear.eigenpairs import lowest

__all__ = ["MODES", "Linear"]

Array = npt.NDArray[np.float64]

# Modes that a body begins with, at most: set-up and steps take longer with each.
MODES = 20
DIFFERENT = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


class Linear:
    """Responses of a structure; forces and motions have the shape (owned nodes, 3, k).

    Attributes:
        responses: Its static ones, which stay the owner's.
    """

    def __init__(self, responses: Responses) -> None:
        """Condense the matrices. Collective.

        Args:
            responses: Stiffness and mass about the start.
        """
        self.responses, stiffness = responses, responses.stiffness
        p, M = stiffness.prolongation, stiffness.mass.matrix()
        self._K = stiffness.matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        self._M = p.condense(M)
        p.add_blocks(self._M, stiffness.bodies.mass_blocks)
        M.destroy()
        self._step: tuple[float, PETSc.KSP] | None = None

    def modes(self, dt: float) -> Array:
        """Modes that steps of Δt resolve, ωΔt < 1, `MODES` at most. Collective.

        Args:
            dt: Δt [s].

        Returns:
            φ at the owned nodes, φᵀMφ = 1, shape (owned nodes, 3, modes) [1/√kg].

        Raises:
            SceneError: On every rank, if none are found.
        """
        stiffness, motions = self.responses.stiffness, []
        for column in stiffness.unknowns_of(self.responses.motions).T:
            motions.append(stiffness.prolongation.unknowns())
            motions[-1].array[:] = column
        pairs = lowest(self._K, self._M, MODES, motions)
        some = int(np.count_nonzero(pairs.values[:MODES] * dt**2 < 1))
        y = np.empty((stiffness.prolongation.owned, some))
        for k in range(some):
            y[:, k] = pairs.vectors[k].array_r
        for item in (pairs, *motions):
            item.destroy()
        return stiffness.at_nodes(y)

    def step(self, F: Array, dt: float) -> Array:
        """Displacements by forces that begin with a step. Collective.

        Args:
            F: Forces on nodes [N].
            dt: Δt [s].
        """
        if self._step is None or not np.isclose(self._step[0], dt, rtol=1e-6):
            self._drop()
            A = self._K.copy()
            A.scale(0.5)
            A.axpy(2 / dt**2, self._M, DIFFERENT)
            self._step = dt, solver_of(A)
        stiffness, ksp = self.responses.stiffness, self._step[1]
        p = stiffness.prolongation
        right, out = p.unknowns(), p.unknowns()
        every = stiffness.on_unknowns(F)
        found = np.empty_like(every)
        for k in range(every.shape[1]):
            right.array[:] = every[:, k]
            ksp.solve(right, out)
            found[:, k] = out.array_r
        right.destroy()
        out.destroy()
        return stiffness.at_nodes(found)

    def _drop(self) -> None:
        if self._step is not None:
            self._step[1].destroy()
            self._step = None

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._drop()
        self._K.destroy()
        self._M.destroy()
