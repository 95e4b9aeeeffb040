"""Rounding: in the residual of a step, and in the strains that its solution gives.

Both are judged by the stiffness of the undeformed scene, to which a viscous stress adds η/Δt. Not
by that of the current state: near the collapse of a cell that one grows without bound, and any
residual would pass for rounding.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.stiff_parts import StiffParts

__all__ = ["Rounding"]


class Rounding:
    """Rounding in the equations of one division."""

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        undeformed: tuple[fem.Form, fem.Form],
        tangent: CondensedMatrix,
        prolongation: Prolongation,
        actions: Actions,
    ) -> None:
        """Find the stiffness without deformation. Collective.

        Args:
            scene: The problem.
            forces: Owner of the coefficients that the forms read.
            undeformed: The tangent without deformation, over interior and interface cells.
            tangent: Matrix of such a form, overwritten; that of the steps later on.
            prolongation: Map between unknowns and dofs.
            actions: Actions on nodes and bodies.
        """
        self._scene, self._forces, self._actions = scene, forces, actions
        self._tangent = tangent
        self._rest = undeformed
        self._cell_size = scene.mean_cell_size
        self._comm = prolongation.comm
        self._stiff_parts = StiffParts(scene, prolongation)
        self._p, self._n = prolongation, prolongation.own_free
        self._translations = prolongation.six[:, :3]
        # Per unknown of this rank, as a step of infinite length has it, and what 1/Δt adds.
        forces.set_rate(0.0)
        self._elastic = self._stiffness = self._undeformed(tangent)  # [N/m]
        self._viscous: Array | None = None  # [N s/m]
        self._stiff_for = np.nan  # Δt of the stiffness [s] ...
        self._mean = 0.0  # ... and that over sqrt(unknowns), of all ranks, once it is asked for
        if forces.viscous:
            forces.set_rate(1.0)
            self._viscous = self._undeformed(tangent) - self._elastic
        free = float(self._elastic[: self._n].sum())
        own_mass = 3 * float(prolongation.layout.masses.sum())
        stiffness, inertia = self._comm.allreduce(np.array([free, own_mass]))
        self._largest = self._largest_ratios(prolongation)
        strained = forces.strain_noise * self._cell_size
        self._u1, self._strained = forces.u1.x.array, np.full(self._elastic.size, strained)
        self._frequency = float(np.sqrt(stiffness / inertia)) if inertia > 0 else 0.0  # [1/s]
        self._against: Array = np.empty(0)  # 1/|Kᵢᵢ| of the tangent of this number [m/N]
        self._tangent_is = -1

    def in_residual(
        self,
        dt: float,
        momentum: PETSc.Vec | None,
        f_ext: PETSc.Vec,
        start: Bodies,
    ) -> float:
        """Size of the terms whose difference is the residual at the present u₁ [N]. Collective.

        Args:
            dt: Δt [s]; of no meaning in statics.
            momentum: M v₀ of the active nodes at the start of the step [kg m/s]; None in statics.
            f_ext: External forces at the active nodes at the midpoint [N].
            start: The bodies at the start of the step.
        """
        if self._viscous is not None and dt != self._stiff_for:
            self._stiffness, self._mean = self._elastic + self._viscous / dt, 0.0
            self._stiff_for = dt
        moved = self._strained.copy()
        moved[: self._n] += np.abs(self._p.at_unknowns(self._u1[self._p.layout.rows.dofs]))
        elastic = self._stiffness * moved
        noise = float(np.sqrt(self._scene.sum(elastic @ elastic))) + f_ext.norm()
        if momentum is not None:
            noise += 2 / dt * momentum.norm()
        if len(start):
            noise += 2 / dt * start.momentum_scale + start.elastic_scale
        return float(noise + self._actions.rounding)

    def in_strain(self, residual: float, bodies: Bodies) -> float:
        """Strain that a residual and rounding may leave in a cell. Collective.

        The residual moves a node by no more than it would against the mean stiffness of a node;
        without flexible cells it strains nothing. Nodes of bodies are where these are, rounded as
        places are.

        Args:
            residual: ‖R‖ of a solution [N].
            bodies: The bodies at the start of the step.
        """
        if self._mean == 0.0:
            sums = np.array([self._stiffness.sum(), self._stiffness.size])
            self._comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
            self._mean = float(sums[0] / np.sqrt(max(sums[1], 1.0)))
        moved = residual / self._mean if self._mean > 0 else 0.0
        eps = float(np.finfo(np.float64).eps)
        lengths = (body.length for body in bodies.of.records)
        reach = float(np.abs(bodies.r).max(initial=0.0)) + max(lengths, default=0.0)
        noise = max(1.0, reach / self._cell_size) * self._forces.strain_noise
        return float(moved / self._cell_size + eps * noise)

    def waves(self, dt: float) -> float:
        """How many cells a wave passes in a step of Δt [s], about."""
        return dt * self._frequency

    def fastest(self, dt: float) -> float:
        """The same of the node, or body, that is the stiffest for its mass; at most."""
        return dt * float(np.sqrt(self._largest[0] + self._largest[1] / dt))

    def left(self, residual: PETSc.Vec) -> float:
        """How far a residual moves an unknown by itself, or a stiff part, at most [m]. Collective.

        That is |Rᵢ|/Kᵢᵢ of an unknown.

        Args:
            residual: R, against which the last tangent that was assembled stands [N].
        """
        number = self._tangent.matrix.stateGet()
        if number != self._tangent_is:
            diagonal = self._tangent.matrix.getDiagonal()
            K = np.abs(diagonal.array_r)
            self._against = np.divide(1.0, K, out=np.zeros_like(K), where=K > 0)
            self._tangent_is = number
            diagonal.destroy()
        most = float(np.abs(residual.array_r * self._against).max(initial=0.0))
        of_parts = self._stiff_parts.left(self._tangent.matrix, residual, self._forces.u1.x.array)
        return max(float(self._comm.allreduce(most, op=MPI.MAX)), of_parts)

    def _largest_ratios(self, prolongation: Prolongation) -> Array:
        """Largest elastic stiffness over lumped mass [1/s²], and viscous [1/s]. Collective.

        Infinite where lumping leaves a node no mass, as at vertices of second-order tetrahedra.
        """
        layout, bodies = prolongation.layout, prolongation.owned_bodies
        of_bodies = np.repeat(layout.ensemble.mass[bodies], layout.ensemble.unknowns[bodies])
        mass = np.concatenate([prolongation.at_unknowns(np.repeat(layout.masses, 3)), of_bodies])
        ratios = np.zeros(2)
        for k, K in enumerate((self._elastic, self._viscous)):
            if K is not None:
                own = np.divide(K, mass, out=np.full(K.size, np.inf), where=mass > 0)
                ratios[k] = own.max(initial=0.0)
        self._comm.Allreduce(MPI.IN_PLACE, ratios, op=MPI.MAX)
        return ratios

    def _undeformed(self, tangent: CondensedMatrix) -> Array:
        """Diagonal of the tangent without deformation, at the present rate. Collective."""
        tangent.assemble(self._rest)
        tangent.finish()
        diagonal = tangent.matrix.getDiagonal()
        out = diagonal.array_r.copy()
        diagonal.destroy()
        # Of bodies the translations tell: those of rotations grow with (V/ℓ)², where a heavy centre
        # makes ℓ small without bound.
        kept = out[self._translations]
        out[self._n :] = 0.0
        out[self._translations] = kept
        return np.asarray(out)
