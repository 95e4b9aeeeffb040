"""Drag proportional to mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.inputs import positive
from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.attached.grounded import Grounded, GroundedBodies
from rigidfx.effects.base import Windowed
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rigid_body import RigidBody

__all__ = ["MassDamping", "euler"]


@dataclass(frozen=True)
class MassDamping(Windowed):
    """Drag proportional to mass: the force -α M Δu/Δt, on flexible nodes and on rigid bodies.

    It damps rigid motion too, as a surrounding fluid would; a mode of angular frequency ω gets the
    damping ratio α/(2 ω). The ends of its window release no rigid body.

    Attributes:
        alpha: α > 0 [1/s].
    """

    alpha: float

    def __post_init__(self) -> None:
        """Check α.

        Raises:
            SceneError: If α is not a finite number > 0.
        """
        super().__post_init__()
        positive("MassDamping", "alpha", self.alpha)

    @property
    def mass_damping(self) -> float:
        """α [1/s]."""
        return float(self.alpha)

    def bind(self, structure: Structure) -> Action:
        """The drag on nodes and bodies."""
        return Drag(float(self.alpha), structure)


class Drag(Grounded):
    """The weights are the mass operator, C is α times the identity.

    A body has -α m Δr/Δt and -α I_av θ/Δt, I_av = tr(B) I - B with B = R_av (Σ m V Vᵀ) R_avᵀ.
    """

    kind = MassDamping.__name__
    rounding = 0.0  # below that of inertia

    def __init__(self, alpha: float, structure: Structure) -> None:
        """Take the mass over.

        Args:
            alpha: α [1/s].
            structure: Its nodes and bodies.
        """
        self._alpha, self._mass = alpha, structure.mass
        self._image = structure.rows.vector()
        bodies = structure.bodies
        self._bodies = GroundedBodies(
            np.reshape([euler(body) for body in bodies.of.records], (-1, 4, 4)),
            bodies.pose,
            np.zeros((len(bodies), 4, 3)),
            0.0,
            np.zeros((3, 3)),
            alpha * np.eye(3),
            structure.scene.comm.rank == 0,
        )

    def resist_nodes(self, d: Any, dt: float, f: Any) -> None:
        """Add α M Δu/Δt."""
        self._mass.mult(d, self._image)
        f.axpy(self._alpha / dt, self._image)

    def stiffen_nodes(self, tangent: Any, dt: float, prolongation: Any) -> None:
        """Add α M/Δt."""
        self._mass.add_to(tangent, self._alpha / dt, prolongation)

    def dissipated(self, d: Any, dt: float, increments: Increments) -> float:
        """α Δu·M Δu/Δt [J]."""
        self._mass.mult(d, self._image)
        own = self._alpha / dt * float(d.array_r @ self._image.array_r)
        return own + self._bodies.dissipated(increments)

    def destroy(self) -> None:
        """Free the work vector. Collective."""
        self._image.destroy()


def euler(body: RigidBody) -> Array:
    """Σ m a aᵀ of a body about its centre of mass, shape (4, 4) [kg, kg m²]."""
    out = np.zeros((4, 4))
    out[0, 0] = body.mass
    out[1:, 1:] = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
    return out
