"""Linear resistance of rigid bodies whose nodes are tied to the ground.

A force on node i is fᵢ = wᵢ (K u½ + C Δu/Δt), seen as a resistance: K takes ½ wᵢ u·K u as potential
energy, exactly so over a step, and C takes wᵢ Δu·C Δu/Δt. The nodes of a body move by Δu = a·D with
their body-fixed coordinates a = [1, V] and one matrix D of shape (4, 3), so that all of them need
the sums S = Σ w a aᵀ and Q = Σ w a uᵀ only: a step loops over no node of a body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.effects.action import Action
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments

__all__ = ["Grounded", "GroundedBodies"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class GroundedBodies:
    """Forces of the ground on the rigid bodies.

    Attributes:
        spread: S = Σ w a aᵀ over the nodes of each, shape (bodies, 4, 4).
        pose: Rows r and Rᵀ of reference poses, shape (bodies, 4, 3) [m, 1].
        displaced: Q = Σ w a uᵀ there, shape (bodies, 4, 3).
        potential: Σ ½ w u·K u there, over all bodies [J].
        K: Shape (3, 3).
        C: Shape (3, 3).
        counts: Whether this rank tells their energies.
        share: Which part of an increment K sees: half of it, or all in statics.
    """

    spread: Array
    pose: Array
    displaced: Array
    potential: float
    K: Array
    C: Array
    counts: bool
    share: float = 0.5

    def moments(self, increments: Increments) -> Array:
        """Σ f and Σ V fᵀ of a step, shape (bodies, 4, 3)."""
        D = increments.displacement
        moved = increments.start.pose - self.pose + self.share * D
        stiff = (self.spread @ moved + self.displaced) @ self.K
        return np.asarray(stiff + self.spread @ D @ self.C / increments.step.dt)

    def tangent(self, increments: Increments) -> Array:
        """Derivative of their resultant as far as forces change, shape (bodies, 6, 6) [N/m]."""
        K = self.share * self.K + self.C / increments.step.dt
        on_numbers = self.spread[:, :, None, :, None] * K.T[:, None]
        return np.asarray(
            increments.L.swapaxes(1, 2) @ on_numbers.reshape(-1, 12, 12) @ increments.P
        )

    def energy(self, bodies: Bodies) -> float:
        """Potential energy on the rank that tells it [J]."""
        if not self.counts:
            return 0.0
        U = bodies.pose - self.pose
        return self.potential + float(np.vdot(U, (0.5 * self.spread @ U + self.displaced) @ self.K))

    def dissipated(self, increments: Increments) -> float:
        """Energy taken in a step, on the rank that tells it [J]."""
        if not self.counts:
            return 0.0
        D = increments.displacement
        return float(np.vdot(D, self.spread @ D @ self.C)) / increments.step.dt


class Grounded(Action):
    """An effect that ties nodes to the ground, those of bodies too."""

    _bodies: GroundedBodies

    def resist_bodies(self, increments: Increments) -> Array:
        """See `Action`."""
        return self._bodies.moments(increments)

    def stiffen_bodies(self, increments: Increments) -> Array:
        """See `Action`."""
        return self._bodies.tangent(increments)
