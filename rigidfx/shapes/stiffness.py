"""Stiffness and mass of a whole structure about a state."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from dolfinx import fem, la
from petsc4py import PETSc

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.dof_layout import dof_layout, nodes_of
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import product
from rigidfx.effects import Effect, Structure, Windowed
from rigidfx.effects.nodes import Forces, Motion, Tangent
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import add_vector
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_motions import fitted_motion, rigid_motions
from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import columns
from rigidfx.state import State
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.supports import PrescribedDofs, supports_of


class Stiffness:
    """K by the free dofs and by six numbers of each body, M by nodes; `destroy` frees them.

    Attributes:
        scene: The problem.
        cells: All owned cells by subdomain id.
        linear: Forms about the state.
        prolongation: Map between unknowns and dofs.
        structure: All nodes, as effects see them.
        bodies: Those that stay rigid.
        places: Of the owned nodes in the state, shape (owned nodes, 3) [m].
        prescribed: Dofs of supports.
        springs: Effects between nodes and the ground whose stiffness is in K.
        held: For each owned dof, whether it is held, by a support or in a part that one clamps.
        mass: Mass operator of the owned nodes.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        state: State,
        acting: Sequence[Windowed],
        bodies: Bodies | None = None,
    ) -> None:
        """Bind forms and effects: see `Responses`. Collective."""
        state.rebuild()
        self.scene, self.cells = scene, forces.cells()
        self.bodies = Bodies.of_each(()) if bodies is None else bodies
        self.linear = LinearForms(scene, forces)
        self.linear.shape.x.array[:] = state.u.x.array
        self.places: Array = np.array(state.places)
        self.prescribed = PrescribedDofs(scene, supports_of(acting))
        self.held = self.prescribed.mask.copy()
        for cells in state.clamped.values():
            self.held |= np.repeat(nodes_of(scene, {0: cells})[: scene.owned_nodes], 3)
        layout = dof_layout(scene, self.cells, self.bodies.of, self.held)
        rows, own = layout.rows, np.ones(layout.rows.nodes.size, dtype=bool)
        self.mass: Mass = Mass(scene, rows, self.cells, own)
        self.structure = Structure(
            scene=scene,
            rows=rows,
            own=layout.massive[rows.nodes],
            bodies=self.bodies,
            mass=self.mass,
            u=self.linear.shape.x.array,
            surface=forces.surface,
            static=True,
        )
        self.prolongation = p = Prolongation(layout, scene.comm)
        if p.size == 0:
            raise SceneError(
                "Reduced: supports hold the whole structure, so that nothing can deform. Take the "
                "supports, or the Reduced, away."
            )
        p.pose(self.bodies)
        self._K = CondensedMatrix(
            p, self.linear.tangent(layout.interior), self.linear.tangent(layout.interface)
        )
        if p.touched:  # else its pattern was found by its entries
            self._K.assemble()
        self.springs: list[Effect] = self._stiffen()

    def _stiffen(self) -> list[Effect]:
        """Add springs to K, and complete it; these are returned. Collective."""
        p = self.prolongation
        lasting = [e for e in self.scene.effects if e.is_lasting and not e.is_windowed]
        actions, tangent = Actions(self.structure, lasting, []), Tangent(self._K, p)
        if actions.stiffens:
            still = self.structure.rows.vector()
            actions.stiffen(Motion(still, p.increments, 1.0), tangent)
            actions.sum(tangent.moments)
            still.destroy()
        if actions.stiffens or p.touched:
            self._K.finish(tangent.blocks)
        actions.destroy()
        return lasting if actions.stiffens else []

    def bound(self, *effects: Effect) -> Actions:
        """Effects on all nodes, also those of bodies. Collective."""
        own = np.ones_like(self.structure.own)
        flexible = replace(self.structure, own=own, bodies=Bodies.of_each(()))
        return Actions(flexible, effects, [effect for effect in effects if effect.is_windowed])

    def of_springs(self, u: Array) -> Array:
        """Forces against springs by displacements, both (owned nodes, 3, k). Collective."""
        if not self.springs or not u.shape[2]:
            return np.zeros_like(u)
        actions, d, out = self.bound(*self.springs), self.structure.rows.vector(), []
        for moved in np.c_[np.zeros(d.local_size), columns(u)].T:
            forces = Forces.none(self.structure.rows.vector())
            d.array[:] = moved
            actions.resist(Motion(d, self.prolongation.increments, 1.0), forces)
            out.append(forces.nodes.copy())
            forces.vector.destroy()
        d.destroy()
        actions.destroy()
        return np.stack(out[1:], axis=2) - out[0][:, :, None]

    @property
    def matrix(self) -> PETSc.Mat:
        """K by the unknowns, which stays the owner's."""
        return self._K.matrix

    def internal_forces(self, cells: Cells) -> Array:
        """Forces of cells in the state, on the owned nodes, shape (nodes, 3) [N]. Collective."""
        return on_nodes(self.scene, self.linear.force(cells))

    def times_mass(self, u: Array) -> Array:
        """M u, shape (owned nodes, 3, k). Collective."""
        return times(self.mass, columns(u), self.structure.rows.vector).reshape(u.shape)

    # Between nodes and unknowns -----------------------------------------------------------------

    def on_unknowns(self, F: Array) -> Array:
        """Lᵀ F of forces on nodes (owned nodes, 3, k), shape (owned unknowns, k). Collective."""
        p, none = self.prolongation, np.zeros((len(self.bodies), 6))

        def restrict(f: PETSc.Vec, y: PETSc.Vec) -> None:
            p.restrict(f, none, y)

        out = np.empty((p.owned, F.shape[2]))
        return by_columns(restrict, columns(F), out, (self.structure.rows.vector, p.unknowns))

    def at_nodes(self, y: Array) -> Array:
        """Displacements of nodes by unknowns, shape (owned nodes, 3, k). Collective."""
        p, still = self.prolongation, np.zeros(self.prolongation.prescribed.size)

        def apply(x: PETSc.Vec, d: PETSc.Vec) -> None:
            p.apply(x, p.bodies_part(x), still, d)

        out = np.empty((*self.places.shape, y.shape[1]))
        by_columns(apply, y, columns(out), (p.unknowns, self.structure.rows.vector))
        return out

    def unknowns_of(self, u: Array) -> Array:
        """Unknowns, (owned unknowns, k), in motions in which bodies are rigid [m]. Collective."""
        p, k = self.prolongation, u.shape[2]
        out, y = np.empty((p.owned, k)), p.unknowns()
        six = np.zeros((len(self.bodies), 6, k))
        for own, body in zip(six, self.bodies, strict=True):
            data = body.data
            R = columns(rigid_motions(data.offsets @ body.motion.R.T, data.length))
            own[:] = fitted_motion(R, columns(u[data.nodes]), self.scene.sum)
        for column in range(k):
            p.collapse(u[:, :, column].reshape(-1), six[:, :, column], y)
            out[:, column] = y.array_r
        y.destroy()
        return out

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._K, self.mass):
            item.destroy()


def on_nodes(scene: Scene, form: fem.Form) -> Array:
    """Forces of a form on the owned nodes, shape (nodes, 3) [N]. Collective."""
    b = fem.Function(scene.space)
    add_vector(b.x.array, form)
    b.x.scatter_reverse(la.InsertMode.add)
    return np.array(b.x.array.reshape(-1, 3)[: scene.owned_nodes])


def times(operator: Mass | PETSc.Mat, u: Array, vector: Callable[[], PETSc.Vec]) -> Array:
    """A matrix times the columns, (rows, k), of another one of this rank's rows. Collective."""
    if isinstance(operator, PETSc.Mat) and u.shape[1] > 1:
        return product(operator.matMult, u, operator.comm)
    return by_columns(operator.mult, u, np.empty_like(u), (vector, vector))


def by_columns(
    act: Callable[[PETSc.Vec, PETSc.Vec], None],
    u: Array,
    out: Array,
    vectors: tuple[Callable[[], PETSc.Vec], Callable[[], PETSc.Vec]],
) -> Array:
    """What an action makes of the columns of a matrix, in those of `out`. Collective."""
    a, b = (vector() for vector in vectors)
    for k, column in enumerate(u.T):
        a.array[:] = column
        act(a, b)
        out[:, k] = b.array_r
    a.destroy()
    b.destroy()
    return out
