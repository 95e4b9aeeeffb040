"""Read-only numbers of a state: energies and momenta, already summed over ranks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.internal import InternalForces
from rigidfx.mass import Mass
from rigidfx.partition import Partition
from rigidfx.scene import Scene
from rigidfx.state import State

__all__ = ["Measures", "Monitor"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Measures:
    """Energies and momenta of a state.

    Attributes:
        kinetic: ½ v·M v [J].
        strain: ∫ W dV of the flexible cells [J].
        stored: Energy that bodies keep for their release [J].
        linear_momentum: L = Σ (M v)ᵢ, shape (3,) [kg m/s].
        angular_momentum: J = Σ xᵢ × (M v)ᵢ about the origin, shape (3,) [kg m²/s].
        momentum_scale: Σ |(M v)ᵢ| [kg m/s], what L is to be compared with; a body counts with
            |m ṙ| + |π|/ℓ.
    """

    kinetic: float
    strain: float
    stored: float
    linear_momentum: Array
    angular_momentum: Array
    momentum_scale: float

    @property
    def energy(self) -> float:
        """H = kinetic + strain + stored [J]."""
        return self.kinetic + self.strain + self.stored


class Monitor:
    """Measures states of a scene."""

    def __init__(
        self, scene: Scene, forces: InternalForces, mass: Mass, partition: Partition
    ) -> None:
        """Bind the stored energy to the flexible cells. Collective."""
        self._scene, self._forces, self._mass = scene, forces, mass
        self._energy = forces.bind_energy(partition.flexible)
        self._nodes = slice(None, scene.owned_nodes) if partition.whole else partition.active
        self._X = scene.space.tabulate_dof_coordinates()[self._nodes]
        self._momentum = fem.Function(scene.space)

    def measure(self, state: State) -> Measures:
        """Energies and momenta of the state that the forms' u₁ holds. Collective.

        Args:
            state: A state whose displacement equals that of the forms' u₁.
        """
        nodes = self._nodes
        self._mass.mult(state.v.x.petsc_vec, self._momentum.x.petsc_vec)
        p, v, u = (f.x.array.reshape(-1, 3)[nodes] for f in (self._momentum, state.v, state.u))
        x = self._X + u
        local = np.concatenate(
            [
                [0.5 * float(np.vdot(v, p)), float(fem.assemble_scalar(self._energy))],
                p.sum(axis=0),
                np.cross(x, p).sum(axis=0),
                [np.linalg.norm(p, axis=1).sum()],
            ]
        )
        total = np.asarray(self._scene.sum(local))
        for body, motion in zip(state.bodies, state.motions, strict=True):
            momentum, spin = body.mass * motion.velocity, motion.angular_momentum(body)
            total[0] += motion.kinetic(body)
            total[2:5] += momentum
            total[5:8] += np.cross(motion.r, momentum) + spin
            total[8] += np.linalg.norm(momentum) + np.linalg.norm(spin) / body.length
        return Measures(
            kinetic=float(total[0]),
            strain=float(total[1]),
            stored=state.stored,
            linear_momentum=total[2:5],
            angular_momentum=total[5:8],
            momentum_scale=float(total[8]),
        )
