"""What a residual takes from energy and momenta: what a step is good for that ends with it.

What a method conserves that conserves energy and momenta is off by what its equations are off by,
and by nothing else. The balances of a step that ends with a residual R are off by exactly

    R·y,    Δt Σ R,    Δt Σ x½ × R,

y the increments of nodes and bodies and x½ their places in the middle of the step. ‖R‖ tells little
of that. In steps in which waves get far, nearly all of it is what is left of strains, or rounding
in them: that acts on no part as a whole, and does little work. A residual a hundredth as large may
turn a part that has next to no inertia against it, compared with its stiffness.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.rotation import axial
from rigidfx.scene.scene import Scene

__all__ = ["Lost"]

Array = npt.NDArray[np.float64]

TINY = float(np.finfo(np.float64).tiny)


class Lost:
    """Measures residuals of one division by its largest energy and momentum so far."""

    def __init__(self, scene: Scene, prolongation: Prolongation) -> None:
        """Begin before the first step. Collective.

        Args:
            scene: The problem.
            prolongation: Map between unknowns and dofs.
        """
        self._p, parts = prolongation, scene.parts
        corners = parts.upper.max(axis=0) - parts.lower.min(axis=0)
        self._size = 0.5 * float(np.linalg.norm(corners))
        # What supports hold gives its momenta to them.
        self._held = prolongation.comm.allreduce(prolongation.prescribed.size) > 0
        self._energy = self._momentum = TINY

    def relative(
        self, dt: float, y: Array, R: Array, x: Array, energy: float, momentum: float
    ) -> Array:
        """What a step is off by that ends with a residual. Collective.

        Args:
            dt: Δt [s].
            y: Unknowns of this rank [m].
            R: Residual there [N].
            x: Places of the active nodes in the middle of the step, shape (nodes, 3) [m].
            energy: Energy that these nodes have, or gain, on this rank [J].
            momentum: Sum of their momenta's sizes likewise [kg m/s].

        Returns:
            Energy relative to the largest so far, and where supports hold nothing linear and
            angular momentum, to the largest sum of momenta and that times the structure's size.
        """
        increments = self._p.increments
        sums = np.zeros(13)
        sums[:3] = y @ R, energy, momentum
        if not self._held:
            self._sum_up(R, x, sums[3:])
        self._p.comm.Allreduce(MPI.IN_PLACE, sums)
        work, energy, momentum = sums[:3]
        if len(increments):
            gained = float(np.vdot(increments.inertia_force(), increments.six))
            energy += increments.start.kinetic + abs(gained)
            momentum += increments.start.momentum_scale
        self._energy = max(self._energy, energy)
        self._momentum = max(self._momentum, momentum)
        if self._held:
            return np.array([abs(work) / self._energy])
        count, places, force, moment = sums[3], sums[4:7], sums[7:10], sums[10:13]
        middle = places / max(count, 1.0)
        turn = np.linalg.norm(moment - axial(np.outer(middle, force))) / self._size
        off = np.array([np.linalg.norm(force), turn])
        return np.array([abs(work) / self._energy, *(dt * off / self._momentum)])

    def _sum_up(self, R: Array, x: Array, out: Array) -> None:
        """Nodes and their places, force and moment about the origin of this rank's residual."""
        p = self._p
        n = p.free.size
        f = R[:n].reshape(-1, 3)  # nothing is held: whole nodes
        at = x[p.free[::3] // 3]
        out[0], out[1:4] = len(at), at.sum(axis=0)
        out[4:7], out[7:10] = f.sum(axis=0), axial(at.T @ f)
        own = p.owned_bodies
        if own.size:
            six, start = R[n:].reshape(-1, 6), p.increments.start
            middle = start.r[own] + 0.5 * p.increments.dr[own]
            out[4:7] += six[:, :3].sum(axis=0)
            out[7:10] += axial(middle.T @ six[:, :3]) + start.of.length[own] @ six[:, 3:]
