"""Rounding: in the residual of a step, and in the strains that its solution gives.

Both are judged by the stiffness of the undeformed scene, to which a viscous stress adds η/Δt. Near
the collapse of a cell that of the current state grows without bound, and any residual would pass
for rounding. The balances of a step that ends with a residual are off by its work and resultants:
docs/theory/step.md#where-the-iteration-ends.
"""

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.matrices import free
from rigidfx.base.types import Array
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.mechanics.rotation import axial, skew
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.actions import Actions

TINY = 1e-200  # J, and kg m/s; what is relative to less than that would be beyond all numbers


class Lost:
    """Measures residuals of one division by its largest energy and momentum so far.

    Attributes:
        of_momenta: Whether momenta are its own; forces of supports change them.
    """

    def __init__(self, scene: Scene, prolongation: Prolongation) -> None:
        """Begin before the first step. Collective."""
        self._p, self._size = prolongation, 0.5 * scene.parts.extent
        held = not prolongation.layout.ensemble.known.all()
        self.of_momenta = (
            prolongation.comm.allreduce(prolongation.prescribed.size) == 0 and not held
        )
        self._energy = self._momentum = TINY
        self._each = np.ones(len(prolongation.free_of_nodes))

    def of_energy(self, y: Array, R: Array, energy: float) -> Array:
        """Error of the energy, over the largest so far, of a step that ends at y with R.

        Active nodes of this rank have, or gain, an energy [J]. Collective.
        """
        return np.array([self._lost_energy(*self._p.sum(np.array([y @ R, energy])))])

    def of_all(
        self, dt: float, y: Array, R: Array, x: Array, energy: float, momentum: float
    ) -> Array:
        """Errors of energy and momenta where supports hold nothing. Collective.

        A step of Δt [s] ends at y [m] with R [N]. The active nodes of this rank are at x in its
        middle, shape (nodes, 3) [m], and have, or gain, an energy [J]; sizes of their momenta have
        a sum. The errors are relative to the largest energy so far, the largest sum, and that times
        the size of the structure.
        """
        sums = np.zeros(13)  # from the third on of nodes, their places, forces and moments
        sums[:3] = y @ R, energy, momentum
        p, f = self._p, R[: self._p.own_free].reshape(-1, 3)  # nothing is held: whole nodes
        at, each, own = p.at_nodes(x), self._each, p.moving
        sums[3], sums[4:7] = each.size, each @ at
        sums[7:10], sums[10:] = each @ f, axial(at.T @ f)
        if own.size:
            six, start = R[p.six], p.increments.start
            middle = start.r[own] + 0.5 * p.increments.dr[own]
            sums[7:10] += six[:, :3].sum(axis=0)
            sums[10:] += axial(middle.T @ six[:, :3]) + start.of.length[own] @ six[:, 3:]
        p.sum(sums)
        if len(p.increments):
            sums[2] += p.increments.start.momentum_scale
        self._momentum = max(self._momentum, sums[2])
        count, places, force, moment = sums[3], sums[4:7], sums[7:10], sums[10:]
        turn = moment - skew(places / max(count, 1.0)) @ force
        off = force @ force, turn @ turn / self._size**2
        return np.array([self._lost_energy(*sums[:2]), *(dt / self._momentum * np.sqrt(off))])

    def _lost_energy(self, work: float, energy: float) -> float:
        increments = self._p.increments
        if len(increments):
            gained = float(np.vdot(increments.inertia_force(), increments.unknowns))
            energy += increments.start.kinetic + abs(gained)
        self._energy = max(self._energy, energy)
        return abs(work) / self._energy


class StiffParts:
    """The stiff parts of a scene among the unknowns of a division.

    A part that is much stiffer than all around it, and floats there, moves against the stiffness of
    its surroundings, of which no diagonal entry of its own unknowns tells. Rounding of its stresses
    is all of the residual's norm, but adds up to nothing over the part: forces and moments on its
    six rigid motions, and the tangent against these, are known well.
    """

    def __init__(self, scene: Scene, prolongation: Prolongation) -> None:
        """Find their unknowns. Collective."""
        self._comm, self._count = scene.comm, 0
        parts = scene.stiff_parts
        if parts is None:
            return
        self._count = parts.count
        dofmap = scene.space.dofmap.list
        part = np.full(len(scene.space.tabulate_dof_coordinates()), -1)
        stiff = np.flatnonzero(parts.of_cell >= 0)
        part[dofmap[stiff]] = parts.of_cell[stiff, None]
        self._p, rows = prolongation, prolongation.layout.rows
        node, axis = np.nonzero(prolongation.free_of_nodes)
        of_node = prolongation.at_nodes(part[rows.nodes, None].astype(np.float64))[:, 0]
        of_free = of_node[node].astype(np.int64)
        self._at = np.flatnonzero(of_free >= 0)
        self._part = of_free[self._at]
        self._node, self._axis = node[self._at], axis[self._at]
        self._middle, self._size = parts.middle, 0.5 * parts.size

    def left(self, A: PETSc.Mat, R: Array, u: Array) -> float:
        """Largest motion of an unknown by Σ b (b·A b)⁻¹ (b·R), b the rigid motions [m]. Collective.

        A is the tangent [N/m]; stiff parts move about displacements u of all local dofs [m].
        """
        if self._count == 0:
            return 0.0
        rows = self._p.layout.rows
        x = self._p.at_nodes(rows.X + u[rows.dofs].reshape(-1, 3))
        arms = x[self._node] - self._middle[self._part]
        # Translations, and rotations by 1/size, of the unknowns, shape (unknowns, 6).
        modes = rigid_motions(arms, self._size[self._part, None])
        modes = modes[np.arange(len(self._at)), self._axis]
        b, image = self._p.unknowns(), self._p.unknowns()
        sums = np.zeros((self._count, 6, 7))
        for k in range(6):
            b.set(0.0)
            b.array[self._at] = modes[:, k]
            A.mult(b, image)
            np.add.at(sums[:, :, k], self._part, modes * image.array_r[self._at, None])
        np.add.at(sums[:, :, 6], self._part, modes * R[self._at, None])
        free(b, image)
        sums = np.asarray(self._comm.allreduce(sums, op=MPI.SUM))
        moved = np.stack([np.linalg.lstsq(own[:, :6], own[:, 6])[0] for own in sums])
        most = float(np.abs((modes * moved[self._part]).sum(axis=1)).max(initial=0.0))
        return float(self._comm.allreduce(most, op=MPI.MAX))


class Rounding:
    """Rounding in the equations of one division.

    Attributes:
        lost: Measures the loss of energy and momenta by residuals.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        undeformed: tuple[fem.Form, fem.Form],
        tangent: CondensedMatrix,
        prolongation: Prolongation,
        actions: Actions,
    ) -> None:
        """Find the stiffness without deformation, the forms of which are given. Collective.

        The matrix `tangent` is overwritten; it is that of the steps later on.
        """
        self._scene, self._forces, self._actions = scene, forces, actions
        self._tangent = tangent
        self._rest, self.lost = undeformed, Lost(scene, prolongation)
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
        at_nodes = float(self._elastic[: self._n].sum())
        own_mass = 3 * float(prolongation.layout.masses.sum())
        stiffness, inertia = self._comm.allreduce(np.array([at_nodes, own_mass]))
        self._largest = self._largest_ratios()
        strained = forces.strain_noise * self._cell_size
        self._u1, self._strained = forces.u1.x.array, np.full(self._elastic.size, strained)
        self._frequency = float(np.sqrt(stiffness / inertia)) if inertia > 0 else 0.0  # [1/s]
        self._against: Array = np.empty(0)  # 1/|Kᵢᵢ| of the tangent of this number [m/N]
        self._tangent_is = -1

    def in_residual(
        self, dt: float, momentum: PETSc.Vec | None, f_ext: PETSc.Vec, start: Bodies
    ) -> float:
        """Size of the terms whose difference is the residual at the present u₁ [N]. Collective.

        A step of Δt [s] begins with M v₀ of the nodes [kg m/s], which are None in statics, and with
        these bodies; external forces are those at the midpoint [N].
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
        """Strain that a residual ‖R‖ [N] and rounding may leave in a cell. Collective.

        The residual moves a node by no more than it would against the mean stiffness of a node;
        without flexible cells it strains nothing. Nodes of bodies are where these are, rounded as
        places are.
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

    def left(self, residual: Array) -> float:
        """How far R of this rank [N] moves an unknown by itself, or a stiff part, at most [m].

        That is |Rᵢ|/Kᵢᵢ of an unknown, with the last tangent. Collective.
        """
        number = self._tangent.matrix.stateGet()
        if number != self._tangent_is:
            diagonal = self._tangent.matrix.getDiagonal()
            K = np.abs(diagonal.array_r)
            self._against = np.divide(1.0, K, out=np.zeros_like(K), where=K > 0)
            self._tangent_is = number
            diagonal.destroy()
        most = float(np.abs(residual * self._against).max(initial=0.0))
        of_parts = self._stiff_parts.left(self._tangent.matrix, residual, self._forces.u1.x.array)
        return max(float(self._comm.allreduce(most, op=MPI.MAX)), of_parts)

    def _largest_ratios(self) -> Array:
        """Largest elastic stiffness over lumped mass [1/s²], and viscous [1/s]. Collective.

        Infinite where lumping leaves a node no mass, as at vertices of second-order tetrahedra.
        """
        layout, bodies = self._p.layout, self._p.owned_bodies
        of_bodies = np.repeat(layout.ensemble.mass[bodies], layout.ensemble.unknowns[bodies])
        mass = np.concatenate([self._p.at_unknowns(np.repeat(layout.masses, 3)), of_bodies])
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
