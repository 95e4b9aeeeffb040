"""Vibrations about a state that turns: its spin, and the centrifugal softening.

In the frame that turns with the state, with ω about a point c, the state is in equilibrium under

    f = M S (x - c),    S = |ω|² I - ω ωᵀ,

whose derivative is the stiffness -M S (L. Meirovitch, Computational Methods in Structural Dynamics,
1980, Section 2.6). Coriolis forces are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.ports import RANK
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.inertia import Centrifugal, StaticForces
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.state import State

# Part of an energy: of the kinetic one, by which a motion that turns may differ from a rigid one;
# of a mode's, by a spin that changes no frequency by more than half of it.
NEGLECTED = 0.01


@dataclass(frozen=True)
class Spin:
    """How a state turns.

    Attributes:
        omega: Its angular velocity, shape (3,) [rad/s]; zero if it does not turn as a whole.
        centre: A point of the axis, shape (3,) [m].
        apart: Largest difference to the angular velocity of a part [rad/s].
    """

    omega: Array
    centre: Array
    apart: float

    @property
    def turns(self) -> bool:
        """Whether the state turns as a whole."""
        return bool(self.omega.any())

    @property
    def forces(self) -> list[StaticForces]:
        """Its centrifugal forces, without the stiffness of nodes; none if it does not turn."""
        return [StaticForces(partial(Centrifugal, self.omega, self.centre))] if self.turns else []


def spin_of(scene: Scene, state: State) -> Spin:
    """How a state turns, by the velocities of its nodes. Collective."""
    n, count = scene.owned_nodes, scene.parts.count
    part, middle = parts_of_nodes(scene), np.asarray(scene.centre_of_mass)
    m = scene.averaging_mass[:n]
    a = np.c_[np.ones(n), state.places - middle, state.velocities(np.arange(n))]
    sums = np.zeros((count, 7, 7))
    np.add.at(sums, part[:n], m[:, None, None] * a[:, :, None] * a[:, None])
    sums = np.asarray(scene.sum(sums))
    none = np.zeros(3)
    whole = _fitted(sums.sum(axis=0))
    omega, centre = (none, none) if whole is None else whole
    own = [found[0] for k in range(count) if (found := _fitted(sums[k])) is not None]
    apart = max((float(np.linalg.norm(each - omega)) for each in own), default=0.0)
    return Spin(omega, middle + centre, apart)


def _fitted(sums: Array) -> tuple[Array, Array] | None:
    """Angular velocity and a point of the axis of a motion that is rigid; None if it is not.

    Args:
        sums: Σ m a aᵀ of a = [1, x, v], shape (7, 7).
    """
    sums = sums / sums[0, 0]
    X, V = sums[0, 1:4], sums[0, 4:]
    C, D = sums[1:4, 1:4] - np.outer(X, X), sums[1:4, 4:] - np.outer(X, V)
    L = np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
    omega = np.linalg.pinv(np.trace(C) * np.eye(3) - C, rcond=RANK, hermitian=True) @ L
    energy = float(np.trace(sums[4:, 4:]))
    left = energy - V @ V - omega @ L
    if not (energy > 0 and omega.any()) or left > NEGLECTED * energy:
        return None
    return np.asarray(omega), np.asarray(X + np.cross(omega, V) / (omega @ omega))


def softening(spin: Spin, mass: Mass, prolongation: Prolongation) -> PETSc.Mat:
    """-M S of the nodes, by the unknowns; the caller destroys it. Collective.

    Args:
        spin: How the state turns.
        mass: Mass operator of the nodes.
        prolongation: Map between unknowns and dofs, in the pose of the state.
    """
    omega, M = spin.omega, mass.matrix()
    S = np.outer(omega, omega) - omega @ omega * np.eye(3)
    first, end = M.getOwnershipRange()
    kind, own = PETSc.IntType, end - first
    columns = (first + 3 * (np.arange(own) // 3)[:, None] + np.arange(3)).astype(kind)
    csr = 3 * np.arange(own + 1, dtype=kind), columns.ravel(), np.tile(S, (own // 3, 1)).ravel()
    turned = PETSc.Mat().createAIJ(M.getSizes(), csr=csr, comm=M.comm)
    product = M.matMult(turned)
    out = prolongation.condense(product)
    for A in (M, turned, product):
        A.destroy()
    return out
