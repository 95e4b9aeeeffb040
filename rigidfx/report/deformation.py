"""The energy of deformation: energy of a structure beyond its rigid motion.

Strain energy, energy of bodies, and the kinetic energy relative to the best rigid motion of each
connected part, the one that has its momenta. Relative energies are relative to this one: one per
cent of the energy with which a body flies would let all of its vibration freeze. What
supports hold still has no rigid motion: all of its kinetic energy is of deformation.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import axial, cross
from rigidfx.scene.damped import holding
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.system.system import System

__all__ = ["THIN", "Deformation"]

THIN = 1e-9  # of the largest moment of inertia or singular value: below it nodes lie on a line


class Deformation:
    """Measures the energy of deformation of a scene.

    Attributes:
        largest: The largest so far [J].
        kinetic: Kinetic energy beyond rigid motions at the last measure [J]; all of it where
            supports hold a structure still.
        strain: Strain energy, and energy of bodies, at the last measure [J].
    """

    remembered: ClassVar[Remembered] = same("largest", "kinetic", "strain")

    def __init__(self, scene: Scene) -> None:
        """Find the connected part of each node. Collective."""
        self._scene, self._parts = scene, scene.parts
        self._still = any(not support.moves for support in holding(scene))
        dofmap = scene.space.dofmap.list
        self._of_node = np.zeros(scene.space.tabulate_dof_coordinates().shape[0], dtype=np.int64)
        self._of_node[dofmap] = self._parts.of_cell[: len(dofmap), None]
        self._system: object = None
        self._bodies_alone = False
        self._of_body: Ints = np.empty(0, dtype=np.int64)
        self.largest = self.kinetic = self.strain = 0.0

    def measure(self, system: System, state: State, report: Any) -> float:
        """The energy of deformation now [J]. Collective.

        Args:
            system: Equations of the present division.
            state: The state.
            report: Its report.
        """
        self.kinetic = report.kinetic
        if not self._still:
            self.kinetic = max(report.kinetic - self._rigid(system, state, report.kinetic), 0.0)
        self.strain = report.strain + report.stored
        now = self.strain + self.kinetic
        self.largest = max(self.largest, now)
        return now

    def _rigid(self, system: System, state: State, kinetic: float) -> float:
        """Energy of the best rigid motions [J], of the kinetic energy that there is. Collective."""
        if system is not self._system:
            self._system, self._of_body = system, self._parts_of(state.bodies)
            rest = self._scene.comm.allreduce(system.layout.rows.nodes.size)
            self._bodies_alone = not rest and np.unique(self._of_body).size == len(state.bodies)
        if self._bodies_alone:  # each a part of its own: what they move by is rigid motion
            return kinetic
        return float(_rigid_energies(self._sums(system, state)).sum())

    def _parts_of(self, bodies: Bodies) -> Ints:
        """Connected part of each body. Collective."""
        found = [int(self._parts.of_cell[b.cells].max(initial=0)) for b in bodies.of.records]
        of = np.array(found, dtype=np.int64)
        self._scene.comm.Allreduce(MPI.IN_PLACE, of, op=MPI.MAX)
        return of

    def _sums(self, system: System, state: State) -> Array:
        """m, m x, p, m x xᵀ and x × p of each part, shape (parts, 19). Collective."""
        rows, mass = system.layout.rows, system.layout.masses
        v = state.v.x.array[rows.dofs].reshape(-1, 3)
        one_x_v = np.empty((len(v), 7))
        one_x_v[:, 0], one_x_v[:, 4:] = 1.0, v
        one_x_v[:, 1:4] = rows.X + state.u.x.array[rows.dofs].reshape(-1, 3)
        left = mass[:, None] * one_x_v[:, :4]
        of, count = self._of_node[rows.nodes], self._parts.count
        # Σ m (1, x) (1, x, v)ᵀ of each part.
        if count == 1:
            local = left.T @ one_x_v
        else:
            columns = (left[:, :, None] * one_x_v[:, None, :]).reshape(-1, 28).T
            local = np.array([np.bincount(of, c, count) for c in columns]).T
        sums = np.asarray(self._scene.sum(local)).reshape(-1, 4, 7)
        m_mx_p, spread, x_p = sums[:, 0], sums[:, 1:, 1:4].reshape(-1, 9), sums[:, 1:, 4:]
        total = np.hstack([m_mx_p, spread, axial(x_p)])
        bodies = state.bodies
        if len(bodies):
            m, r = bodies.of.mass, bodies.r
            turned = bodies.R @ bodies.rotated_inertia
            # Σ m y yᵀ = ½ tr J I - J about the centre.
            trace = np.trace(turned, axis1=1, axis2=2)[:, None, None]
            own = 0.5 * trace * np.eye(3) - turned + m[:, None, None] * r[:, :, None] * r[:, None]
            J = cross(r, bodies.momentum) + bodies.angular_momentum
            parts = [m[:, None], m[:, None] * r, bodies.momentum, own.reshape(-1, 9), J]
            np.add.at(total, self._of_body, np.hstack(parts))
        return total


def _rigid_energies(sums: Array) -> Array:
    """½ p²/m + ½ Jc·Ic⁻¹ Jc of each part, shape (parts,) [J]."""
    m, mx, p = sums[:, :1], sums[:, 1:4], sums[:, 4:7]
    mass = np.where(m > 0, m, 1.0)
    c = mx / mass
    spread = sums[:, 7:16].reshape(-1, 3, 3) - mx[:, :, None] * c[:, None, :]
    moments, axes = np.linalg.eigh(spread)
    moments = moments.sum(axis=1, keepdims=True) - moments
    J = sums[:, 16:] - cross(c, p)
    along = np.einsum("ki,kij->kj", J, axes)
    known = moments > THIN * moments.max(axis=1, keepdims=True)
    turning = np.divide(along**2, moments, out=np.zeros_like(along), where=known).sum(axis=1)
    return np.asarray(0.5 * ((p**2 / mass).sum(axis=1) + turning))
