"""Linear forces between nodes and the ground: springs, dashpots, drag proportional to mass.

A force on node i is fᵢ = wᵢ (K u½ + C Δu/Δt), seen as a resistance: K takes ½ wᵢ u·K u as potential
energy, exactly so over a step, and C takes wᵢ Δu·C Δu/Δt. On free nodes these are 3×3 blocks. On a
rigid body, whose nodes move by Δu = a·D with the arms a = [1, V] and one matrix D of shape (4, 3),
all of them need the sums S = Σ w a aᵀ and Q = Σ w a uᵀ only: a step loops over no node of a body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import MassDamping, Spring
from rigidfx.mechanics.bodies import Motions, poses
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import IDENTITY
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Drag", "GroundForces", "GroundedBodies", "Springs"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class GroundedBodies:
    """Forces of the ground on the rigid bodies.

    Attributes:
        arms: S = Σ w a aᵀ over the nodes of each, shape (bodies, 4, 4).
        pose: Rows r and Rᵀ of reference poses, shape (bodies, 4, 3) [m, 1].
        displaced: Q = Σ w a uᵀ there, shape (bodies, 4, 3).
        potential: Σ ½ w u·K u there, over all bodies [J].
        K: Shape (3, 3).
        C: Shape (3, 3).
    """

    arms: Array
    pose: Array
    displaced: Array
    potential: float
    K: Array
    C: Array

    def moments(self, increments: Increments) -> Array:
        """See `rigidfx.mechanics.body_step.BodyTerm`."""
        D = increments.displacement
        moved = increments.start.pose - self.pose + 0.5 * D
        stiff = (self.arms @ moved + self.displaced) @ self.K
        return np.asarray(stiff + self.arms @ D @ self.C / increments.step.dt)

    def tangent(self, increments: Increments) -> Array:
        """See `rigidfx.mechanics.body_step.BodyTerm`."""
        K = 0.5 * self.K + self.C / increments.step.dt
        on_numbers = self.arms[:, :, None, :, None] * K.T[:, None]
        return np.asarray(
            increments.L.swapaxes(1, 2) @ on_numbers.reshape(-1, 12, 12) @ increments.P
        )

    def energy(self, motions: Motions) -> float:
        """Potential energy [J]."""
        U = motions.pose - self.pose
        return self.potential + float(np.vdot(U, (0.5 * self.arms @ U + self.displaced) @ self.K))

    def dissipated(self, increments: Increments) -> float:
        """Energy taken in a step [J]."""
        D = increments.displacement
        return float(np.vdot(D, self.arms @ D @ self.C)) / increments.step.dt


class GroundForces(Protocol):
    """One effect of this kind, bound to a layout.

    Attributes:
        kind: Name of the effect's class.
        bodies: What it does to the bodies.
        rounding: Size of a force that the machine precision is to be multiplied with [N].
    """

    kind: ClassVar[str]

    @property
    def bodies(self) -> GroundedBodies:
        """See above."""
        ...

    @property
    def rounding(self) -> float:
        """See above."""
        ...

    def add_forces(self, d: PETSc.Vec, dt: float, f: PETSc.Vec) -> None:
        """Add the resistance of the active nodes that are no body's to f, for increments d."""
        ...

    def add_to(self, tangent: CondensedMatrix, dt: float, prolongation: Prolongation) -> None:
        """Add its derivative to an assembled tangent that is not finished yet. Collective."""
        ...

    def energy(self, u: Array) -> float:
        """Potential energy of these nodes of this rank at displacements of the rows [J]."""
        ...

    def dissipated(self, d: PETSc.Vec, dt: float) -> float:
        """Energy that these nodes of this rank lose in a step [J]."""
        ...

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        ...


class Springs:
    """A `Spring` effect."""

    kind: ClassVar[str] = Spring.__name__

    def __init__(
        self,
        scene: Scene,
        spring: Spring,
        rows: Rows,
        own: npt.NDArray[np.bool_],
        state: State,
        static: bool = False,
    ) -> None:
        """Find its nodes. Collective.

        Args:
            scene: The problem.
            spring: The effect.
            rows: Those of the active nodes.
            own: For each of them, whether it is no body's.
            state: State whose displacements are up to date at all nodes of bodies.
            static: Whether forces are those at the end of a step, without dashpots.
        """
        n = scene.owned_nodes
        weights = scene.shares(spring.where, "Spring")[:n]
        self._at = np.flatnonzero(own & (weights[rows.nodes] > 0))
        self._nodes, self._weights = rows.nodes[self._at], weights[rows.nodes[self._at]]
        self._dofs = rows.dofs.reshape(-1, 3)[self._at]
        self._u0 = state.u.x.array
        self._share = 1.0 if static else 0.5
        self._K, self._C = spring.K, np.zeros((3, 3)) if static else spring.C
        u = self._u0[: 3 * n].reshape(-1, 3)
        sums = np.zeros((len(state.bodies), 29))
        for row, body in zip(sums, state.bodies, strict=True):
            w, moved = weights[body.nodes], u[body.nodes]
            arms = np.c_[np.ones(body.nodes.size), body.offsets]
            row[:16] = ((w[:, None] * arms).T @ arms).reshape(-1)
            row[16:28] = ((w[:, None] * arms).T @ moved).reshape(-1)
            row[28] = 0.5 * np.vdot(w[:, None] * moved, moved @ self._K)
        total = np.asarray(scene.sum(sums))
        self.bodies = GroundedBodies(
            total[:, :16].reshape(-1, 4, 4),
            poses(state.motions),
            total[:, 16:28].reshape(-1, 4, 3),
            float(total[:, 28].sum()),
            self._K,
            self._C,
        )
        x = np.abs(scene.space.tabulate_dof_coordinates()[:n] + u).max(initial=0.0)
        self.rounding = float(np.linalg.norm(self._K)) * scene.comm.allreduce(float(x))

    def add_forces(self, d: PETSc.Vec, dt: float, f: PETSc.Vec) -> None:
        """See `GroundForces`."""
        step = d.array_r.reshape(-1, 3)[self._at]
        force = (self._u0[self._dofs] + self._share * step) @ self._K + step @ self._C / dt
        f.array.reshape(-1, 3)[self._at] += self._weights[:, None] * force

    def add_to(self, tangent: CondensedMatrix, dt: float, prolongation: Prolongation) -> None:
        """See `GroundForces`."""
        block = self._share * self._K + self._C / dt
        tangent.add_nodal(self._nodes, self._weights[:, None, None] * block)

    def energy(self, u: Array) -> float:
        """See `GroundForces`."""
        moved = u.reshape(-1, 3)[self._at]
        return 0.5 * float(np.vdot(self._weights[:, None] * moved, moved @ self._K))

    def dissipated(self, d: PETSc.Vec, dt: float) -> float:
        """See `GroundForces`."""
        step = d.array_r.reshape(-1, 3)[self._at]
        return float(np.vdot(self._weights[:, None] * step, step @ self._C)) / dt

    def destroy(self) -> None:
        """Nothing to free."""


class Drag:
    """`MassDamping`: the weights are the mass operator, C is α times the identity.

    A body has -α m Δr/Δt and -α I_av θ/Δt, I_av = tr(B) I - B with B = R_av (Σ m V Vᵀ) R_avᵀ.
    """

    kind: ClassVar[str] = MassDamping.__name__

    def __init__(self, alpha: float, mass: Mass, rows: Rows, state: State) -> None:
        """Take the mass over.

        Args:
            alpha: α, summed over the effects that act [1/s].
            mass: Mass operator of the flexible cells.
            rows: Those of the active nodes.
            state: State with its bodies.
        """
        self._alpha, self._mass = alpha, mass
        self.rounding = 0.0  # below that of inertia
        self._image = rows.vector()
        self.bodies = GroundedBodies(
            np.reshape([_euler(body) for body in state.bodies], (-1, 4, 4)),
            poses(state.motions),
            np.zeros((len(state.bodies), 4, 3)),
            0.0,
            np.zeros((3, 3)),
            alpha * np.eye(3),
        )

    def add_forces(self, d: PETSc.Vec, dt: float, f: PETSc.Vec) -> None:
        """See `GroundForces`."""
        self._mass.mult(d, self._image)
        f.axpy(self._alpha / dt, self._image)

    def add_to(self, tangent: CondensedMatrix, dt: float, prolongation: Prolongation) -> None:
        """See `GroundForces`."""
        self._mass.add_to(tangent, self._alpha / dt, prolongation)

    def energy(self, u: Array) -> float:
        """None."""
        return 0.0

    def dissipated(self, d: PETSc.Vec, dt: float) -> float:
        """See `GroundForces`."""
        self._mass.mult(d, self._image)
        return self._alpha / dt * float(d.array_r @ self._image.array_r)

    def destroy(self) -> None:
        """Free the work vector. Collective."""
        self._image.destroy()


def _euler(body: RigidBody) -> Array:
    """Σ m a aᵀ of a body about its centre of mass, shape (4, 4) [kg, kg m²]."""
    out = np.zeros((4, 4))
    out[0, 0] = body.mass
    out[1:, 1:] = 0.5 * np.trace(body.inertia) * IDENTITY - body.inertia
    return out
