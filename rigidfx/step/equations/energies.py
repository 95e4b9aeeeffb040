"""Read-only numbers of a state: energies and momenta, already summed over ranks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rigidfx.base.matrices import free
from rigidfx.base.types import Array
from rigidfx.effects.nodes import Instant
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import integral
from rigidfx.mechanics.rotation import axial
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.equations import Equations


@dataclass(frozen=True)
class Measures:
    """Energies and momenta of a state."""

    kinetic: float  # ½ v·M v [J]
    strain: float  # ∫ W dV of the flexible cells, and U(q) of bodies that deform [J]
    stored: float  # energy that bodies keep for their release [J]
    springs: float  # potential energy of springs to ground [J]
    contact: float  # energy stored in contacts [J]
    linear_momentum: Array  # L = Σ (M v)ᵢ, shape (3,) [kg m/s]
    angular_momentum: Array  # J = Σ xᵢ × (M v)ᵢ about the origin, shape (3,) [kg m²/s]
    momentum_scale: float  # Σ |(M v)ᵢ| [kg m/s], a scale for L; a body counts with |m ṙ| + |π|/ℓ

    @property
    def energy(self) -> float:
        """H = kinetic + strain + stored + springs + contact [J]."""
        return self.kinetic + self.strain + self.stored + self.springs + self.contact

    def momenta_since(self, before: "Measures") -> tuple[Array, Array]:
        """Changes of both momenta since a state before."""
        linear = self.linear_momentum - before.linear_momentum
        return linear, self.angular_momentum - before.angular_momentum


class Energies:
    """Measures states of a scene."""

    def __init__(self, scene: Scene, forces: InternalForces, equations: Equations) -> None:
        """Bind the stored energy to the flexible cells. Collective."""
        layout = equations.layout
        self._actions, self._linkage = equations.actions, equations.linkage
        self._scene, self._mass, self._rows = scene, equations.mass, layout.rows
        self._energy = forces.bind_energy(layout.flexible)
        self._v, self._p = self._rows.vector(), self._rows.vector()
        self._held = layout.prescribed[self._rows.dofs]

    def measure(self, state: State) -> Measures:
        """Energies and momenta of the state that the forms' u₀ belongs to. Collective."""
        dofs = self._rows.dofs
        p, x = self._momenta(state)
        u, bodies = state.u.x.array[dofs], state.bodies
        local = np.empty(11)
        local[0] = 0.5 * float(self._v.array_r @ self._p.array_r)
        local[1] = integral(self._energy)
        local[2:5] = p.sum(axis=0)
        local[5:8] = axial(x.T @ p)
        local[8] = np.sqrt((p * p).sum(axis=1)).sum()
        local[9:11] = self._actions.stored(Instant(bodies, u, state.t))
        total = np.asarray(self._scene.sum(local))
        if len(bodies):
            total[0] += bodies.kinetic
            total[1] += bodies.strain
            total[2:5] += bodies.momentum.sum(axis=0)
            total[5:8] += axial(bodies.r.T @ bodies.momentum) + bodies.angular_momentum.sum(axis=0)
            total[8] += bodies.momentum_scale
        if self._linkage is not None:
            total[9] += self._linkage.stored(bodies)
        return Measures(
            kinetic=float(total[0]),
            strain=float(total[1]),
            stored=state.stored,
            springs=float(total[9]),
            contact=float(total[10]),
            linear_momentum=total[2:5],
            angular_momentum=total[5:8],
            momentum_scale=float(total[8]),
        )

    def held_momenta(self, state: State) -> Array:
        """Linear and angular momentum of dofs which supports hold, shape (2, 3). Collective."""
        p, x = self._momenta(state)
        held = np.where(self._held, p.reshape(-1), 0.0).reshape(-1, 3)
        return np.asarray(self._scene.sum(np.stack([held.sum(axis=0), axial(x.T @ held)])))

    def both(self, state: State, d: Array, further: Callable[[], Sequence[float]]) -> Array:
        """Numbers of flexible cells before and after the owned nodes move by d [m]. Collective.

        These are, shape (2, 4 + n), energy [J], angular momentum [kg m²/s], and further ones of a
        rank, which are summed over ranks as well. d has the shape (nodes, 3).
        """
        kept, found = state.snapshot(), []
        for way in (0.0 * d, d):
            state.shift(np.arange(d.size), way.reshape(-1))
            p, x = self._momenta(state)
            found.append(np.r_[integral(self._energy), axial(x.T @ p), further()])
        state.restore(kept)
        return np.asarray(self._scene.sum(np.array(found)))

    def _momenta(self, state: State) -> tuple[Array, Array]:
        """M v and x of the active nodes, shapes (nodes, 3) [kg m/s, m]. Collective."""
        dofs = self._rows.dofs
        self._v.array[:] = state.v.x.array[dofs]
        self._mass.mult(self._v, self._p)
        return self._p.array_r.reshape(-1, 3), self._rows.X + state.u.x.array[dofs].reshape(-1, 3)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        free(self._v, self._p)
