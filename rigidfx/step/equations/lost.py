"""Loss of energy and momenta by a residual: whether a step may end with it.

A method that conserves energy and momenta loses exactly the work and resultants of its residual.
The balances of a step that ends with a residual R are off by exactly

    R·y,    Δt Σ R,    Δt Σ x½ × R,

y the increments of nodes and bodies and x½ their places in the middle of the step. ‖R‖ tells little
of that. In steps in which waves get far, nearly all of it is what is left of strains, or rounding
in them: that acts on no part as a whole, and does little work. A residual a hundredth as large may
turn a part that has next to no inertia against it, compared with its stiffness.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.rotation import axial, skew
from rigidfx.scene.scene import Scene

__all__ = ["Lost"]


TINY = 1e-200  # J, and kg m/s; what is relative to less than that would be beyond all numbers


class Lost:
    """Measures residuals of one division by its largest energy and momentum so far.

    Attributes:
        of_momenta: Whether momenta are its own; forces of supports change them.
    """

    def __init__(self, scene: Scene, prolongation: Prolongation) -> None:
        """Begin before the first step. Collective.

        Args:
            scene: The problem.
            prolongation: Map between unknowns and dofs.
        """
        self._p, parts = prolongation, scene.parts
        corners = parts.upper.max(axis=0) - parts.lower.min(axis=0)
        self._size = 0.5 * float(np.linalg.norm(corners))
        held = not prolongation.layout.ensemble.known.all()
        self.of_momenta = (
            prolongation.comm.allreduce(prolongation.prescribed.size) == 0 and not held
        )
        self._energy = self._momentum = TINY
        self._each = np.ones(len(prolongation.free_of_nodes))

    def of_energy(self, y: Array, R: Array, energy: float) -> Array:
        """Error of the energy of a step that ends with a residual. Collective.

        Args:
            y: Unknowns of this rank [m].
            R: Residual there [N].
            energy: Energy that active nodes have, or gain, on this rank [J].

        Returns:
            One number, relative to the largest energy so far.
        """
        sums = np.array([y @ R, energy])
        self._p.comm.Allreduce(MPI.IN_PLACE, sums)
        return np.array([self._lost_energy(*sums)])

    def of_all(
        self, dt: float, y: Array, R: Array, x: Array, energy: float, momentum: float
    ) -> Array:
        """Errors of energy and momenta where supports hold nothing. Collective.

        Args:
            dt: Δt [s].
            y: Unknowns of this rank [m].
            R: Residual there [N].
            x: Places of the active nodes in the middle of the step, shape (nodes, 3) [m].
            energy: Energy that these nodes have, or gain, on this rank [J].
            momentum: Sum of their momenta's sizes likewise [kg m/s].

        Returns:
            Energy, linear and angular momentum, relative to the largest energy so far, sum of
            momenta, and that times the structure's size.
        """
        sums = np.zeros(13)
        sums[:3] = y @ R, energy, momentum
        self._sum_up(R, x, sums[3:])
        self._p.comm.Allreduce(MPI.IN_PLACE, sums)
        if len(self._p.increments):
            sums[2] += self._p.increments.start.momentum_scale
        self._momentum = max(self._momentum, sums[2])
        count, places, force, moment = sums[3], sums[4:7], sums[7:10], sums[10:13]
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

    def _sum_up(self, R: Array, x: Array, out: Array) -> None:
        """Nodes and their places, force and moment about the origin of this rank's residual."""
        p = self._p
        n = p.own_free
        f = R[:n].reshape(-1, 3)  # nothing is held: whole nodes
        at, each = p.at_nodes(x), self._each
        out[0], out[1:4] = each.size, each @ at
        out[4:7], out[7:10] = each @ f, axial(at.T @ f)
        own = p.moving
        if own.size:
            six, start = R[p.six], p.increments.start
            middle = start.r[own] + 0.5 * p.increments.dr[own]
            out[4:7] += six[:, :3].sum(axis=0)
            out[7:10] += axial(middle.T @ six[:, :3]) + start.of.length[own] @ six[:, 3:]
