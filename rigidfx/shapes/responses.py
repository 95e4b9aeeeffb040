"""Static responses of a whole structure to nodal forces, all of it flexible: K⁺f.

K is the stiffness of cells about the present state, with its stresses and supports, and of springs.
Motions r of connected parts that no support prevents have no stiffness: forces are put in balance
with inertia, f - M r (rᵀMr)⁻¹ rᵀf, some rows that determine these motions are pinned, and responses
are made orthogonal to the motions by the mass. Motions in which springs strain the structure by
more than `LACKING` of the motion count as held. There is one factor, made when it is first asked
for.
"""

from collections.abc import Callable, Sequence

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.effects import Windowed
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import columns, normalised, slowest
from rigidfx.shapes.solver import Solver
from rigidfx.shapes.stiffness import Stiffness
from rigidfx.state import State
from rigidfx.step.system.rigid_motion import FREE, every_motion

# Internal forces over K's diagonal and the extent of the structure: rounding.
ROUNDING = 1e3 * float(np.finfo(np.float64).eps)
# Part of a static response, in the norm of the strain energy, that shapes may lack.
LACKING = 0.01
BALANCED = 1e-9  # part of forces that rounding leaves where inertia balances them


class Motions:
    """Rigid motions of the connected parts of a structure.

    Attributes:
        part: Connected part of each owned node.
        all: Six of each part, shape (owned nodes, 3, 6 · parts).
        loose: Those that no support prevents, shape (owned nodes, 3, n).
        internal: Internal forces of the state, zero if they are rounding, shape (owned nodes, 3).
    """

    def __init__(self, stiffness: Stiffness) -> None:
        """Find them. Collective."""
        scene = stiffness.scene
        parts, n = scene.parts, scene.owned_nodes
        self.part = part = parts_of_nodes(scene)[:n]
        self._sizes = np.linalg.norm(parts.upper - parts.lower, axis=1)
        self.all: Array = every_motion(stiffness.places, part, parts, np.arange(n))
        diagonal = stiffness.matrix.getDiagonal()
        rounding = ROUNDING * float(diagonal.norm()) * float(self._sizes.max())
        diagonal.destroy()
        self.internal: Array = stiffness.internal_forces(stiffness.cells)
        if not scene.sum((self.internal**2).sum()) > rounding**2:
            self.internal[:] = 0.0
        on_held = columns(self.all)[stiffness.held]
        values, vectors = np.linalg.eigh(scene.sum(on_held.T @ on_held))
        self.loose: Array = self.all @ vectors[:, values <= FREE * max(float(values[-1]), 1.0)]
        columns(self.loose)[stiffness.held] = 0.0

    def spins(self, c: Array) -> Array:
        """Angular velocity of each owned node's part, (owned nodes, 3, k) [rad/s], by motions."""
        turns = c.reshape(self._sizes.size, 6, c.shape[1])[:, 3:] / self._sizes[:, None, None]
        return np.asarray(turns[self.part])


class Responses:
    """Stiffness and mass of a structure about a state; `destroy` frees them.

    Arrays of forces and displacements have the shape (owned nodes, 3, k).

    Attributes:
        scene: The problem.
        stiffness: The matrices and how unknowns sit in nodes.
        rigid: Rigid motions of connected parts.
        motions: Those that neither supports nor stiff springs prevent, RᵀMR = 1.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        state: State,
        acting: Sequence[Windowed],
        bodies: Bodies | None = None,
    ) -> None:
        """Bind forms and effects that act; nothing is factored yet without springs. Collective.

        Displacements of the state are taken over; bodies stay rigid. `SceneError` if supports hold
        all.
        """
        self.scene = scene
        self.stiffness = Stiffness(scene, forces, state, acting, bodies)
        self.rigid = Motions(self.stiffness)
        self._solver: Solver | None = None
        R = self.rigid.loose
        self._balance(normalised(R, self.dot(R, self.inertia(R))))
        if self.stiffness.springs and R.shape[2]:
            w = self.solve(self.stiffness.of_springs(self.motions))
            squares, T = slowest(scene.comm, self.dot(w, self.inertia(w)))
            self._balance(np.asarray(self.motions @ T[:, squares <= LACKING**2]))

    def _balance(self, motions: Array) -> None:
        """Let inertia balance forces along motions R, RᵀMR = 1. Collective."""
        self.motions: Array = motions
        self._momenta = self.inertia(motions)
        if self._solver is not None:
            self._solver.balance(motions, self._momenta)

    @property
    def stressed(self) -> bool:
        """Whether cells have stresses in the state. Collective."""
        return bool(self.scene.sum(np.count_nonzero(self.rigid.internal)) > 0)

    def dot(self, a: Array, b: Array) -> Array:
        """aᵀb of all columns, shape (k, l). Collective."""
        return np.asarray(self.scene.sum(columns(a).T @ columns(b)))

    def inertia(self, u: Array) -> Array:
        """M u. Collective."""
        return self.stiffness.times_mass(u)

    def balanced(self, F: Array) -> Array:
        """Forces in balance with inertia where parts are free; zero if that is all. Collective."""
        out = F - self._momenta @ self.dot(self.motions, F)
        before, after = self.scene.sum([(columns(f) ** 2).sum(axis=0) for f in (F, out)])
        out[:, :, after <= BALANCED**2 * before] = 0.0
        return np.asarray(out)

    def act_on(self, nodes: Indices, F: Array) -> Bools:
        """Which forces in balance act on nodes, or on what these hold together with. Collective."""
        part = self.rigid.part
        own = np.concatenate(self.scene.comm.allgather(np.unique(part[nodes])))
        return np.asarray(self.scene.sum((F[np.isin(part, own)] ** 2).sum(axis=(0, 1)))) > 0.0

    def solve(self, F: Array) -> Array:
        """Displacements [m] by forces on nodes, the same number on each rank [N]. Collective.

        They are zero where supports hold and orthogonal by mass to motions that nothing prevents.
        `SceneError` if the state is not stable.
        """
        return self._factored().solve(self.balanced(F))

    @property
    def stable(self) -> bool:
        """Whether the state is stable. Collective."""
        try:
            self._factored()
        except SceneError:
            return False
        return True

    def _factored(self) -> Solver:
        """The solver, made once. `SceneError` if the state is not stable. Collective."""
        if self._solver is None:
            stiffened = self.stressed or bool(self.stiffness.springs)
            self._solver = Solver(self.stiffness, self.rigid.loose, stiffened)
            self._balance(self.motions)
        return self._solver

    def of_nodes(self, nodes: Indices, Q: Array | None = None) -> Callable[[Array], Array]:
        """Responses of owned nodes to forces on them, both (nodes, 3), in the frame turned by Q."""

        def respond(force: Array) -> Array:
            F = np.zeros((self.scene.owned_nodes, 3, 1))
            F[nodes, :, 0] = force if Q is None else force @ Q
            u = self.solve(F)[nodes, :, 0]
            return np.asarray(u if Q is None else u @ Q.T)

        return respond

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._solver, self.stiffness):
            if item is not None:
                item.destroy()
