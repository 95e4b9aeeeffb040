"""Small motions of a whole structure about its start: static ones, swings, and modes.

K⁺f ,    (Ω²M + K)⁻¹ f ,    K φ = ω² M φ with ωΔt < 1
"""

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.mass import Mass
from rigidfx.linear.eigenpairs import EigenControl, clusters, lowest
from rigidfx.linear.linear_solver import solver_of
from rigidfx.shapes.responses import LACKING, Responses
from rigidfx.shapes.stiffness import by_columns

# Modes that a body begins with, at most: set-up and steps take longer with each.
MODES = 20
DIFFERENT = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


class Linear:
    """Responses of a structure; forces and motions have the shape (owned nodes, 3, k)."""

    def __init__(self, responses: Responses) -> None:
        """Condense the matrices about the start; static responses stay the owner's. Collective."""
        self.responses, stiffness = responses, responses.stiffness
        p, bodies, seen = stiffness.prolongation, stiffness.bodies, stiffness.structure
        inside = np.concatenate(
            [np.empty(0, np.int32), *(body.cells for body in bodies.of.records)]
        )
        cells = {i: np.setdiff1d(own, inside) for i, own in stiffness.cells.items()}
        mass = Mass(seen.scene, seen.rows, cells, seen.own)
        self._K = stiffness.matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        self._M = mass.reduced(p, bodies.mass_blocks)
        mass.destroy()
        self._swing: tuple[float, PETSc.KSP] | None = None

    def modes(self, dt: float) -> tuple[Array, float]:
        """Modes that steps of Δt resolve, and the lowest ω left out [1/s]: see `resolved`.

        φ at the owned nodes has the shape (owned nodes, 3, modes) [1/√kg], φᵀMφ = 1. Those in which
        soft springs move a part and do not strain it are left out: as shapes they would be
        rounding. Collective.
        """
        responses, stiffness = self.responses, self.responses.stiffness
        motions = stiffness.unknowns_of(responses.motions)
        y, _, cut = resolved(self._K, self._M, motions, stiffness.prolongation.unknowns, dt)
        found = stiffness.at_nodes(y)
        rigid = responses.dot(responses.motions, responses.inertia(found))
        return found[:, :, (rigid**2).sum(axis=0) < 1 - LACKING**2], cut

    def swing(self, F: Array, omega: float) -> Array:
        """(Ω²M + K)⁻¹ F: half of what modes at Ω [1/s] do under F at rest. Collective."""
        if self._swing is None or self._swing[0] != omega:
            self._drop()
            A = self._K.copy()
            A.axpy(omega**2, self._M, DIFFERENT)
            self._swing = omega, solver_of(A)
        stiffness, vector = self.responses.stiffness, self.responses.stiffness.prolongation.unknowns
        every = stiffness.on_unknowns(F)
        solved = by_columns(self._swing[1].solve, every, np.empty_like(every), (vector, vector))
        return stiffness.at_nodes(solved)

    def _drop(self) -> None:
        if self._swing is not None:
            self._swing[1].destroy()
            self._swing = None

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._drop()
        self._K.destroy()
        self._M.destroy()


def resolved(
    K: PETSc.Mat, M: PETSc.Mat, motions: Array, vector: Callable[[], PETSc.Vec], dt: float
) -> tuple[Array, Array, float]:
    """Modes with ωΔt < 1, the lowest `MODES` of them, of which no equal ones are parted.

    φ, shape (unknowns of this rank, k) [1/√kg], ω of each, and the lowest ω with ωΔt < 1 that is
    left out [1/s], infinite if none is. The motions have no stiffness and the shape (unknowns of
    this rank, n). `SceneError` on every rank, if no modes are found. Collective.
    """
    known = [vector() for _ in motions.T]
    for one, column in zip(known, motions.T, strict=True):
        one.array[:] = column
    pairs = lowest(K, M, MODES + 1, known)
    squares = np.maximum(pairs.values, 0.0)
    some, cut = int(np.count_nonzero(squares * dt**2 < 1)), np.inf
    if some > MODES:
        of = clusters(squares, EigenControl.gap)
        some = int(np.searchsorted(of, of[MODES]))
        cut = float(np.sqrt(squares[some]))
    y = np.empty((len(motions), some))
    for k in range(some):
        y[:, k] = pairs.vectors[k].array_r
    for item in (pairs, *known):
        item.destroy()
    return y, np.sqrt(squares[:some]), cut
