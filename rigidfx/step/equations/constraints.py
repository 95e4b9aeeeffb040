"""The constraint rows of one division: joints, motors and springs of joints, with multipliers.

    R(y) + Gᵀ(y½) λ = 0,    g(y) = 0;  in statics both at the end of a load step

The multipliers come last, on rank 0, as μ = λ/k [m], and rows as k g [N]. The tangent of R stays
the one that is condensed without joints; these meet it at ports: docs/theory/joints.md#solving.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array, dia_array

from rigidfx.base.errors import StepError
from rigidfx.base.matrices import Matrix, compact
from rigidfx.base.types import Array
from rigidfx.coupling.ports import Ports, independent
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Joint, JointSpring, Motor, PointMass, Stop, Structure, Windowed
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.remote import Points
from rigidfx.effects.nodes import Forces, Motion
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.equations.actions import OwnMethods, bound

# Of a joint's size, that a row without a force may be open by: rounding and poses make some 1e-9.
OPEN = float(np.cbrt(np.finfo(np.float64).eps))


class Constraints:
    """The rows of one division, their multipliers, and how both meet its unknowns.

    Attributes:
        linkage: The joints.
        ports: Where they take hold of the unknowns.
        own: How many multipliers are among the unknowns of this rank.
        scale: k of each row in the present step [N/m].
        springs: Springs on ports that make the tangent regular, at all unknowns; None without any.
        drag: Drag per mass of a load step that does so in their place; 0 without [1/s²].
    """

    def __init__(self, linkage: Linkage, bodies: Bodies, p: Prolongation, anchored: bool) -> None:
        """Find the ports, and the rows that others imply, of bodies as they are now. Collective.

        Springs on ports make the tangent regular if anchored.
        """
        self.linkage, self._p, self.drag = linkage, p, 0.0
        self.ports = Ports(p, linkage)
        if anchored:
            self.ports.anchor()
        linkage.begin(bodies)
        rows, terms, compliance = self.ports.resisted(linkage, bodies)
        kept = independent(rows, terms, compliance)
        linkage.rows.keep(kept)
        self._check_motors(rows[kept], terms[kept], compliance)
        self.own = linkage.count if p.comm.rank == 0 else 0
        self.scale: Array = np.ones(linkage.count)
        self._known: Array = linkage.multipliers  # λ of the last step, attempts left out [N]
        self._multipliers = self._known  # at the last iterate
        self._springs: Array = np.zeros(self.ports.count)
        self.springs: csr_array | None = None
        if anchored:
            ports, unknowns = self.ports.anchors()
            self._springs[ports] = linkage.stiffness
            values = np.full(unknowns.size, linkage.stiffness)
            self.springs = csr_array((values, (unknowns, unknowns)), shape=(p.size, p.size))

    def _check_motors(self, rows: Array, terms: Array, compliance: Array) -> None:
        """Refuse motors of given motion whose joint cannot move. Collective."""
        drives = self.linkage.drives
        if not drives.prescribed.any():
            return
        given = self.linkage.test()[self.linkage.rows.active.size :]
        for k in np.flatnonzero(drives.prescribed):
            effect = drives.each[k].effect
            more, sizes = self.ports.led(given[[k]])
            every = np.vstack([rows, more]), np.vstack([terms, sizes])
            if independent(*every, compliance).size == len(rows):
                raise StepError(
                    f"{effect.owner} prescribes a motion of '{effect.joint}', which cannot move: "
                    "both sides are in one rigid body, or other joints hold them.",
                    "Keep cells between the sides flexible (`never`), or take the motor out.",
                )

    def begin(self, dt: float, start: Bodies) -> None:
        """Begin a step of Δt [s] of these bodies. Collective."""
        self.scale = self.linkage.scale(dt, self.drag)
        self.linkage.begin(start)

    def guess(self, y: Array) -> None:
        """Set the multipliers among this rank's unknowns to those of the last step."""
        y[self._p.owned :] = (self._known / self.scale)[: self.own]

    def of_rows(self, y: Array) -> Array:
        """The entries of rows in a vector of this rank, on all ranks. Collective."""
        values = y[self._p.owned :].copy() if self.own else np.empty(self.linkage.count)
        if self._p.comm.size > 1:
            self._p.comm.Bcast(values)
        return values

    def multipliers(self, y: Array) -> Array:
        """λ of the rows in unknowns of this rank, on all ranks [N]. Collective."""
        return self.scale * self.of_rows(y)

    def look(self, y: Array) -> None:
        """See the unknowns of an iterate. Collective."""
        self._multipliers = self.multipliers(y)

    def resist(self, motion: Motion, forces: Forces) -> None:
        """Add the forces of rows at this iterate. Collective."""
        self.linkage.look(motion, self._multipliers)
        self.linkage.resist(forces)

    def fill(self, gaps: Array, r: Array) -> None:
        """Set the entries of rows in residuals of this rank by gaps [m]."""
        r[self._p.owned :] = (self.scale * gaps)[: self.own]

    def border(self) -> tuple[Matrix, Matrix, Matrix, Array]:
        """Addition of joints to the tangent at the last iterate.

        Derivatives of forces at the ports by these, of rows by ports on the test and on the trial
        side, and of each row by its multiplier, scaled, have shapes (ports, ports), (rows, ports)
        twice, and (rows,).
        """
        increments, linkage = self._p.increments, self.linkage
        test = self.ports.lead(increments)
        trial = self.ports.lead(increments, end=True) if self.ports.bodies.size else test
        H = test.T @ (linkage.curvature() @ trial)
        if self.springs is not None:
            H = H - compact(dia_array((self._springs[None], [0]), shape=H.shape).tocsr())
        R = self.scale**2 * linkage.compliance()
        return H, self._scaled(linkage.test() @ test), self._scaled(linkage.trial() @ trial), R

    def _scaled(self, rows: Matrix) -> Matrix:
        """Rows times the scales of their multipliers."""
        if isinstance(rows, np.ndarray):
            return self.scale[:, None] * rows
        values = rows.data * np.repeat(self.scale, np.diff(rows.indptr))
        return csr_array((values, rows.indices, rows.indptr), shape=rows.shape)

    @property
    def noise(self) -> float:
        """Size of the forces at the last iterate, in statics also of those that close rows [N].

        In motion the latter are of the size of momenta over Δt.
        """
        own = self.linkage
        close = float(np.linalg.norm(self.scale * own.sizes)) if own.drives.static else 0.0
        return float(np.abs(own.multipliers).sum()) + own.points.rounding + close

    def accept(self) -> None:
        """Accept the last iterate as a step; a `StepError` if rows that others implied are open."""
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


def elements_of(scene: Any, acting: Sequence[Windowed]) -> tuple[Motor | JointSpring | Stop, ...]:
    """Actions along free coordinates of joints: motors that act, springs and stops."""
    here = {id(effect) for effect in acting}
    motors = [motor for motor in scene.named(Motor) if id(motor) in here]
    return (*motors, *scene.named(JointSpring), *scene.named(Stop))


def linked(structure: Structure, acting: Sequence[Windowed]) -> Linkage | None:
    """Joints, remote points and springs between points, bound; None without any. Collective."""
    scene, here = structure.scene, {id(effect) for effect in acting}
    joints = (*scene.named(Joint), *(e for e in scene.named(PointMass) if e.is_carried))
    wanted = [e for e in scene.effects if not e.is_windowed or id(e) in here]
    each = [(e.owner, bound(e, structure, "bind_points")) for e in wanted]
    owners = {id(action): owner for owner, action in each}
    actions = [action for _, action in each if action is not None]
    if not joints and not actions:
        return None
    points = Points(actions, OwnMethods(owners, scene.comm).call)
    return Linkage(joints, elements_of(scene, acting), structure, points)
