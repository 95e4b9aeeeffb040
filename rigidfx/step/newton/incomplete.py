"""Solve with a tangent by GMRES and incomplete factors, both of a tangent that is kept.

Where inertia is large, GMRES takes a handful of iterations to a hundredth, and each costs a third
of a solve with full factors, or less. Newton's iteration with a kept tangent removes the error of a
solve, as it does the tangent's own error.

But the error of GMRES has a resultant force and moment, by which momenta would drift. With full
factors it has none. So a correction solves exactly for the rigid motions N of free parts,

    z ← z + N (Nᵀ A N)⁻¹ (Nᵀ r - (Aᵀ N)ᵀ z),

if that hardly increases ‖r - A z‖. Aᵀ N is computed with the tangent, which saves one of five
products with A in each solve. Beside a support, and where a heavy body takes the resultant of many
nodes, the correction would increase the residual many times, and slow Newton's iteration down.

The rigid motions of the free parts of a layout: they hardly strain.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import PREFIX, configure, default_options

__all__ = ["EMPTY", "IncompleteFactors", "motions_of_unknowns"]

OWN = PREFIX + "incomplete_"  # prefix of its options
REDUCTION = 1e-2  # of the residual in a solve
MAX_ITERATIONS = 100
HARMLESS = 2.0  # what solving for rigid motions may enlarge a residual by, at most
EMPTY = 1e-12  # squared norm of a motion that nothing takes part in, relative to the largest


def motions_of_unknowns(prolongation: Prolongation, x: Array) -> Array:
    """An orthonormal basis of the unknowns' rigid motions. Collective.

    Args:
        prolongation: Map between unknowns and dofs.
        x: Positions of the active nodes, shape (nodes, 3) [m].

    Returns:
        Shape (owned unknowns, motions): six, fewer where supports leave none of some.
    """
    increments = prolongation.increments
    own = prolongation.moving
    comm = prolongation.comm
    sums = np.append(x.sum(axis=0), len(x))
    comm.Allreduce(MPI.IN_PLACE, sums)
    middle = sums[:3] / max(sums[3], 1.0)
    out = np.zeros((prolongation.owned, 6))
    nodes, axis = np.nonzero(prolongation.free_of_nodes)
    moved = rigid_motions(prolongation.at_nodes(x)[nodes] - middle, 1.0)
    out[np.arange(nodes.size), :6] = moved[np.arange(nodes.size), axis]
    six = np.zeros((own.size, 6, 6))  # Δr and ℓθ of each body, by motions
    six[:, :3] = rigid_motions(increments.start.r[own] - middle, 1.0)
    six[:, 3:, 3:] = np.eye(3) * increments.start.of.length[own, None, None]
    out[prolongation.six] = six
    gram = out.T @ out
    comm.Allreduce(MPI.IN_PLACE, gram)
    squares, vectors = np.linalg.eigh(gram)
    kept = squares > EMPTY * squares[-1]
    return np.asarray(out @ (vectors[:, kept] / np.sqrt(squares[kept])))


class IncompleteFactors:
    """GMRES with incomplete factors of each rank's rows; `destroy` frees it.

    Options of PETSc's are understood under the prefix `rigidfx_incomplete_`.

    Attributes:
        renewal: Cost of a new tangent, its factors included, in iterations with these.
    """

    # 3 at 700 unknowns, 7 at 4000, 4 at 27 000; 8 to 12 with a coarse grid, beyond 100 000
    renewal = 5.0

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        self._equilibrium, p = equilibrium, equilibrium.prolongation
        self._ksp = PETSc.KSP().create(p.comm)
        self._ksp.setOptionsPrefix(OWN)
        self._defaults = _of_ranks(len(p.layout.bodies) > 0) if p.comm.size > 1 else {}
        with default_options(OWN, **self._defaults):
            configure(self._ksp, False, p.size, len(p.layout.bodies) > 0)
            # This kind keeps what the factors have made of each direction, and spares a solve with
            # them at the end: one in five.
            self._ksp.setType(PETSc.KSP.Type.FGMRES)
            self._ksp.setTolerances(rtol=REDUCTION, atol=0.0, max_it=MAX_ITERATIONS)
            self._ksp.setFromOptions()
        self._ksp.setOperators(equilibrium.tangent_matrix)
        self._motion, self._image = p.unknowns(), p.unknowns()
        self._motions: Array = np.empty((p.owned, 0))
        self._resultants: Array = np.empty((p.owned, 0))  # Aᵀ N
        self._gram: Array = np.empty((0, 0))

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._ksp.getType()}+{self._ksp.getPC().getType()}"

    @property
    def iterations(self) -> int:
        """How many the last solve took."""
        return int(self._ksp.getIterationNumber())

    def renew(self) -> None:
        """Take note of a new tangent, at the last iterate of the equations. Collective."""
        with default_options(OWN, **self._defaults):  # blocks are told when they are made
            self._ksp.setUp()
        N = motions_of_unknowns(self._equilibrium.prolongation, self._equilibrium.positions)
        A, images, resultants = self._equilibrium.tangent_matrix, np.empty_like(N), np.empty_like(N)
        for k in range(N.shape[1]):
            self._motion.array[:] = N[:, k]
            A.mult(self._motion, self._image)
            images[:, k] = self._image.array_r
            A.multTranspose(self._motion, self._image)
            resultants[:, k] = self._image.array_r
        gram, squares = self._summed(np.stack([N.T @ images, images.T @ images]))
        enlarged = np.linalg.norm(np.linalg.solve(gram.T, np.linalg.solve(gram.T, squares).T), 2)
        if not enlarged <= HARMLESS**2:
            N, gram = N[:, :0], gram[:0, :0]
        self._motions, self._resultants, self._gram = N, resultants, gram

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r: to a hundredth, but for motions of free parts exactly. Collective."""
        self._ksp.solve(r, z)
        if not self._gram.size:
            return
        left = r.array_r @ self._motions - z.array_r @ self._resultants
        z.array[:] += self._motions @ np.linalg.solve(self._gram, self._summed(left))

    def _summed(self, values: Array) -> Array:
        self._equilibrium.prolongation.comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def destroy(self) -> None:
        """Free the factors and the work vectors. Collective."""
        for item in (self._ksp, self._motion, self._image):
            item.destroy()


def _of_ranks(bodies: bool) -> dict[str, str]:
    """Options on several ranks.

    With the rows round its own, in the order that one rank would take, a rank's factors are as good
    as those of all: at 27 000 unknowns on two ranks a step took 37 iterations, 37 on one rank, 52
    by blocks without others' rows.

    Args:
        bodies: Whether there are any.
    """
    return {
        "pc_type": "asm",
        "pc_asm_overlap": "1",
        "sub_pc_factor_mat_ordering_type": "natural" if bodies else "rcm",
    }
