"""The equations of a step with joints: multipliers are unknowns beside those of nodes and bodies.

    R(y) + Gᵀ(y½) λ = 0,    g(y) = 0

In statics both are those of the end of a load step, and springs on the ports, which the border
takes out again, make the tangent regular of parts that only joints hold.

In the vectors of unknowns and residuals the multipliers come last, on rank 0, as μ = λ/k [m], and
rows as k g [N], with k = 2 m/Δt² of the mass that a joint moves: all unknowns are lengths and all
residuals forces. The tangent of R stays the one that is condensed without joints; these meet it at
*ports*, at most three numbers for each average of nodes and six for each body, see
`rigidfx.step.newton.border`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, dia_array

from rigidfx.base.errors import StepError
from rigidfx.base.matrices import Matrix, compact, dense
from rigidfx.base.types import Array
from rigidfx.coupling.ports import Ports, independent
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.motion import Forces, Tangent
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.equations.equations import Equilibrium, Trial

__all__ = ["DraggedEquilibrium", "JoinedEquilibrium"]


# Of a joint's size, that a row without a force may be open by: rounding and poses make some 1e-9.
OPEN = float(np.cbrt(np.finfo(np.float64).eps))


class JoinedEquilibrium(Equilibrium):
    """The balance of forces in the steps of one division, with joints.

    Attributes:
        linkage: The joints.
        ports: Where they take hold of the unknowns.
        anchored: Whether springs on ports make the tangent of statics regular.
        drag: Drag per mass of a load step that does so in their place; 0 without [1/s²].
    """

    anchored = True

    def __init__(self, linkage: Linkage, bodies: Bodies, *given: Any) -> None:
        """Create matrices and vectors, and find rows that others imply. Collective.

        Args:
            linkage: The joints.
            bodies: The rigid bodies as they are now.
            given: See `Equilibrium`.
        """
        super().__init__(*given)
        self.linkage, self.drag = linkage, 0.0
        self.ports = Ports(self.prolongation, linkage)
        anchored = self.anchored and not self.inertial
        if anchored:
            self.ports.anchor()
        linkage.begin(bodies)
        rows, terms, compliance = self.ports.resisted(linkage, bodies)
        kept = independent(rows, terms, compliance)
        linkage.rows.keep(kept)
        self._check_motors(rows[kept], terms[kept], compliance)
        self._own = linkage.count if self.prolongation.comm.rank == 0 else 0
        self._inner, self._rest = self.prolongation.unknowns(), self.prolongation.unknowns()
        self._scale: Array = np.ones(linkage.count)
        self._known: Array = linkage.multipliers  # λ of the last step, attempts left out [N]
        # Springs on some ports, which the tangent has, and the border takes out again.
        self._springs: Array = np.zeros(self.ports.count)
        self._sprung: csr_array | None = None
        if anchored:
            ports, unknowns = self.ports.anchors()
            self._springs[ports] = linkage.stiffness
            values = np.full(unknowns.size, linkage.stiffness)
            size = self.prolongation.size
            self._sprung = csr_array((values, (unknowns, unknowns)), shape=(size, size))

    def _check_motors(self, rows: Array, terms: Array, compliance: Array) -> None:
        """Refuse motors of given motion whose joint cannot move. Collective.

        Args:
            rows: Independent rows of joints at the start of a step: see `Ports.resisted`.
            terms: Likewise.
            compliance: Likewise.
        """
        drives = self.linkage.drives
        if not drives.prescribing:
            return
        lead = self.ports.lead(self.prolongation.increments)
        given = self.linkage.test()[self.linkage.rows.active.size :]
        for k in np.flatnonzero(drives.prescribed):
            effect = drives.each[k].effect
            more, sizes = dense(given[[k]] @ lead), dense(abs(given[[k]]) @ abs(lead))
            every = np.vstack([rows, more]), np.vstack([terms, sizes])
            if independent(*every, compliance).size == len(rows):
                raise StepError(
                    f"{effect.owner} prescribes a motion of '{effect.joint}', which cannot move: "
                    "both sides are in one rigid body, or other joints hold them.",
                    "Keep cells between the sides flexible (`never`), or take the motor out.",
                )

    def unknowns(self) -> PETSc.Vec:
        """See `Equilibrium`."""
        y = PETSc.Vec().create(self.prolongation.comm)
        y.setSizes((self.prolongation.owned + self._own, None))
        y.setType(PETSc.Vec.Type.STANDARD)
        return y

    def begin(
        self,
        dt: float,
        v0: PETSc.Vec | None,
        imposed: Array,
        start: Bodies,
        given: Array | None = None,
    ) -> Trial:
        """See `Equilibrium`."""
        trial = super().begin(dt, v0, imposed, start, given)
        self._scale = self.linkage.scale(dt, self.drag)
        self.linkage.begin(start)
        return trial

    def guess(self, increment: Array, bodies: Array, y: PETSc.Vec) -> None:
        """See `Equilibrium`; multipliers are those of the last step."""
        super().guess(increment, bodies, self._inner)
        self._put(self._inner, self._known / self._scale, y)

    def largest(self, y: PETSc.Vec) -> float:
        """See `Equilibrium`."""
        return super().largest(self._part(y, self._inner))

    def right_side(self, f: PETSc.Vec, bodies: Array, across: Array, r: PETSc.Vec) -> None:
        """See `Equilibrium`."""
        super().right_side(f, bodies, across, self._rest)
        self._put(self._rest, self._scale * across, r)

    def response(self, z: PETSc.Vec, held: Array, d: PETSc.Vec) -> tuple[Array, Array]:
        """See `Equilibrium`."""
        six, _ = super().response(self._part(z, self._inner), held, d)
        return six, self._scale * self.of_joints(z.array_r)

    def _part(self, y: PETSc.Vec, out: PETSc.Vec) -> PETSc.Vec:
        """Unknowns, or residuals, without those of joints."""
        out.array[:] = y.array_r[: self.prolongation.owned]
        return out

    def of_joints(self, y: Array) -> Array:
        """The entries of joints in a vector of this rank, on all ranks. Collective."""
        values = y[self.prolongation.owned :].copy() if self._own else np.empty(self.linkage.count)
        if self.prolongation.comm.size > 1:
            self.prolongation.comm.Bcast(values)
        return values

    def return_to(self, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """See `Equilibrium`."""
        multipliers = self._scale * self.of_joints(y.array_r)
        same = np.array_equal(self._last, y.array_r[: self.prolongation.owned])
        same = same and np.array_equal(multipliers, self.linkage.multipliers)
        if not self.prolongation.comm.allreduce(same, op=MPI.LAND):
            self.residual(y, r)
        self._cells.settle()

    def residual(self, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """See `Equilibrium`."""
        self._multipliers = self._scale * self.of_joints(y.array_r)
        super().residual(self._part(y, self._inner), self._rest)
        self._put(self._rest, self._scale * self.linkage.residual(), r)

    def _put(self, of_nodes: PETSc.Vec, of_joints: Array, y: PETSc.Vec) -> None:
        """Set a vector to the entries of nodes and bodies, and those of joints."""
        values, n = y.array, self.prolongation.owned
        values[:n], values[n:] = of_nodes.array_r, of_joints[: self._own]

    @property
    def _resists(self) -> bool:
        return True

    def _resist(self, forces: Forces) -> None:
        super()._resist(forces)
        self.linkage.look(self.motion, self._multipliers)
        self.linkage.resist(forces)

    @property
    def _stiffens(self) -> bool:
        return super()._stiffens or self._sprung is not None

    def _stiffen(self, tangent: Tangent) -> None:
        super()._stiffen(tangent)
        if self._sprung is not None:
            tangent.matrix.add_coupling(self._sprung)

    def border(self) -> tuple[Matrix, Matrix, Matrix, Array]:
        """Addition of joints to the tangent at the last iterate.

        Returns:
            Derivative of forces at the ports by these, of rows by ports on the test and on the
            trial side, and of each row by its multiplier, scaled; shapes (ports, ports),
            (rows, ports) twice, and (rows,).
        """
        increments, linkage = self.prolongation.increments, self.linkage
        test = self.ports.lead(increments)
        trial = self.ports.lead(increments, end=True) if self.ports.bodies.size else test
        H = test.T @ (linkage.curvature() @ trial)
        if self._sprung is not None:
            H = H - compact(dia_array((self._springs[None], [0]), shape=H.shape).tocsr())
        R = self._scale**2 * linkage.compliance()
        return H, self._scaled(linkage.test() @ test), self._scaled(linkage.trial() @ trial), R

    def _scaled(self, rows: Matrix) -> Matrix:
        """Rows times the scales of their multipliers."""
        if isinstance(rows, np.ndarray):
            return self._scale[:, None] * rows
        values = rows.data * np.repeat(self._scale, np.diff(rows.indptr))
        return csr_array((values, rows.indices, rows.indptr), shape=rows.shape)

    def noise(self) -> float:
        """See `Equilibrium`."""
        joints = float(np.abs(self.linkage.multipliers).sum()) + self.linkage.points.rounding
        return super().noise() + joints

    def lost(self, y: PETSc.Vec, r: PETSc.Vec) -> Array:
        """See `Equilibrium`."""
        return super().lost(self._part(y, self._inner), self._part(r, self._rest))

    def left(self, residual: PETSc.Vec) -> float:
        """See `Equilibrium`."""
        return super().left(self._part(residual, self._rest))

    def accept(self) -> None:
        """See `Equilibrium`.

        Raises:
            StepError: If rows that others implied when the division was made are open now.
        """
        opened = {title: off for title, off in self.linkage.rows.redundant.items() if off > OPEN}
        if opened:
            title = max(opened, key=lambda name: opened[name])
            raise StepError(
                f"A joint is pulled open, by {opened[title]:.3g} of its size in one step: {title}. "
                "Supports or other joints move both of its sides, so that it has no force.",
                "Let them hold less, or take this joint out.",
            )
        self.linkage.accept()
        self._known = self.linkage.multipliers

    def destroy(self) -> None:
        """See `Equilibrium`."""
        super().destroy()
        self._inner.destroy()
        self._rest.destroy()


class DraggedEquilibrium(JoinedEquilibrium):
    """Statics of loose parts with joints, under a drag on their increments."""

    anchored = False
