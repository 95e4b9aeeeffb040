"""Stiffness and mass of a whole structure about a state, and the motions without stiffness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from petsc4py import PETSc

from rigidfx.base.errors import SceneError
from rigidfx.base.failures import Failures
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.dof_layout import dof_layout, nodes_of
from rigidfx.coupling.mass import Mass, mass_operator
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Joint, SpringDamper, Windowed
from rigidfx.effects.joints.on_face import OnFace
from rigidfx.effects.motion import Motion, Tangent
from rigidfx.error.forces.rigid_motions import rigid_motions as rigid_motions_of
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import add_vector
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import columns
from rigidfx.state import State
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.structure import BoundStructure
from rigidfx.step.system.rigid_motion import FREE, rigid_motions
from rigidfx.step.system.supports import PrescribedDofs, supports_of

__all__ = ["ROUNDING", "Stiffness", "times"]

Array = npt.NDArray[np.float64]

# Stiffness of springs against a rigid motion, over the sum of φ·diag(K)φ, that is no more than the
# rounding of K.
ROUNDING = 1e3 * float(np.finfo(np.float64).eps)


class Stiffness:
    """K by the free dofs, and by six numbers of each body; M by nodes; `destroy` frees them.

    Attributes:
        linear: Forms about the state.
        cells: All owned cells by subdomain id.
        prolongation: Map between unknowns and dofs.
        structure: All nodes, as effects see them.
        bodies: Those that stay rigid.
        places: Of the owned nodes in the state, shape (owned nodes, 3) [m].
        prescribed: Dofs of supports.
        held: For each owned dof, whether it is held, by a support or in a part that one clamps.
        mass: Mass operator of the owned nodes.
        part: Connected part of each owned node.
        sizes: Extent of each connected part [m].
        loose: Motions of connected parts that nothing prevents, shape (owned nodes, 3, n).
        rounding: Force that rounding may leave in one of cells [N].
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
        _check(scene)
        state.rebuild()
        self._scene = scene
        self.bodies = Bodies.of_each(()) if bodies is None else bodies
        self.linear = LinearForms(scene, forces)
        self.linear.shape.x.array[:] = state.u.x.array
        u = state.u.x.array[: 3 * scene.owned_nodes].reshape(-1, 3)
        self.places: Array = state.X[: scene.owned_nodes] + u
        self.prescribed = PrescribedDofs(scene, supports_of(acting))
        self.held = self.prescribed.mask.copy()
        for cells in state.clamped.values():
            self.held |= np.repeat(nodes_of(scene, {0: cells})[: scene.owned_nodes], 3)
        self.cells = every = forces.cells()
        self.part, self.sizes = _parts(scene)
        layout = dof_layout(scene, every, self.bodies.of, self.held)
        rows, own = layout.rows, np.ones(layout.rows.nodes.size, dtype=bool)
        self.mass: Mass = mass_operator(scene, rows, every, own)
        self.structure = BoundStructure(
            scene=scene,
            rows=rows,
            own=layout.massive[rows.nodes],
            bodies=self.bodies,
            mass=self.mass,
            u=self.linear.shape.x.array,
            surface=forces.surface,
            failures=Failures(scene.comm),
            static=True,
        )
        lasting = [e for e in scene.effects if e.is_lasting and not isinstance(e, Windowed)]
        self._springs = Actions(self.structure, lasting, ())
        self._springs.set_time(state.t, 1.0)
        self.prolongation = p = Prolongation(layout, scene.comm)
        if p.size == 0:
            raise SceneError(
                "Reduced: supports hold the whole structure, so that nothing can deform. Take the "
                "supports, or the Reduced, away."
            )
        p.pose(self.bodies)
        parts = (self.linear.tangent(own) for own in (layout.interior, layout.interface))
        self._K = CondensedMatrix(p, *parts)

        self._K.assemble()
        self._K.finish()
        diagonal = self._K.matrix.getDiagonal()
        self.rounding = ROUNDING * float(diagonal.norm()) * float(self.sizes.max())
        self.loose = self._loose(diagonal)
        diagonal.destroy()
        if self._springs.stiffens:
            self._K.assemble()
            self._stiffen()

    def matrix(self) -> PETSc.Mat:
        """K by the unknowns, of the type AIJ, as a new one; the caller destroys it. Collective."""
        return self._K.matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())

    def internal_forces(self, cells: Cells) -> Array:
        """Forces of cells in the state, at all local dofs [N]. Collective."""
        b = fem.Function(self._scene.space)
        add_vector(b.x.array, self.linear.force(cells))
        b.x.scatter_reverse(la.InsertMode.add)
        b.x.scatter_forward()
        return np.array(b.x.array)

    def _stiffen(self) -> None:
        """Add springs to K, and complete it. Collective."""
        tangent = Tangent(self._K, self.prolongation)
        self._springs.stiffen(Motion(None, self.prolongation.increments, 1.0), tangent)
        self._springs.sum(tangent.moments)
        self._K.finish(tangent.blocks)

    def times_mass(self, u: Array) -> Array:
        """M u, shape (owned nodes, 3, k). Collective."""
        d, f = self.structure.rows.vector(), self.structure.rows.vector()
        out = times(self.mass, u, d, f)
        d.destroy()
        f.destroy()
        return out

    def unknowns_of(self, u: Array) -> Array:
        """Unknowns of this rank in motions in which bodies are rigid, shape (owned, k). Collective.

        Args:
            u: Of the owned nodes, shape (owned nodes, 3, k) [m].
        """
        p, k = self.prolongation, u.shape[2]
        out, y = np.empty((p.owned, k)), p.unknowns()
        six = np.zeros((len(self.bodies), 6, k))
        for own, body in zip(six, self.bodies, strict=True):
            data = body.data
            R = rigid_motions_of(data.offsets @ body.motion.R.T, data.length)
            sums = np.einsum("nai,nak->ik", R, np.concatenate([R, u[data.nodes]], axis=2))
            sums = np.asarray(self._scene.sum(sums))
            own[:] = np.linalg.lstsq(sums[:, :6], sums[:, 6:])[0]
        for column in range(k):
            p.collapse(u[:, :, column].reshape(-1), six[:, :, column], y)
            out[:, column] = y.array_r
        y.destroy()
        return out

    # Motions without stiffness ------------------------------------------------------------------

    def motions(self) -> Array:
        """Six rigid motions of each connected part, shape (owned nodes, 3, 6 · parts)."""
        parts, n = self._scene.parts, len(self.part)
        out = np.zeros((n, 3, parts.count, 6))
        out[np.arange(n), :, self.part] = rigid_motions(self.places, self.part, parts)
        return out.reshape(n, 3, 6 * parts.count)

    def _loose(self, diagonal: PETSc.Vec) -> Array:
        """See `loose`. Collective.

        Args:
            diagonal: That of the stiffness of cells.
        """
        V = self.motions()
        on_held = columns(V)[self.held]
        values, vectors = np.linalg.eigh(self._scene.sum(on_held.T @ on_held))
        V = V @ vectors[:, values <= FREE * max(float(values[-1]), 1.0)]
        columns(V)[self.held] = 0.0
        if not self._springs.stiffens:
            return V
        K, y = self._K.matrix, self.unknowns_of(V)
        K.zeroEntries()
        self._stiffen()
        resisted = self._scene.sum(y.T @ _times_matrix(K, self.prolongation, y))
        sizes = self._scene.sum(np.abs(diagonal.array_r) @ y**2)
        values, vectors = np.linalg.eigh(0.5 * (resisted + resisted.T))
        return V @ vectors[:, values <= ROUNDING * float(sizes.max(initial=0.0))]

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._K, self._springs, self.mass):
            item.destroy()


def times(operator: Mass | PETSc.Mat, u: Array, d: PETSc.Vec, f: PETSc.Vec) -> Array:
    """A matrix of nodes' rows times vectors, of the shape (nodes, 3, k). Collective.

    Args:
        operator: The matrix.
        u: The vectors.
        d: A vector to work with, overwritten.
        f: Another one.
    """
    out = np.empty_like(u)
    for k in range(u.shape[2]):
        d.array[:] = u[:, :, k].reshape(-1)
        operator.mult(d, f)
        out[:, :, k] = f.array_r.reshape(-1, 3)
    return out


def _times_matrix(K: PETSc.Mat, p: Prolongation, y: Array) -> Array:
    out, a, b = np.empty_like(y), p.unknowns(), p.unknowns()
    for k in range(y.shape[1]):
        a.array[:] = y[:, k]
        K.mult(a, b)
        out[:, k] = b.array_r
    a.destroy()
    b.destroy()
    return out


def _parts(scene: Scene) -> tuple[npt.NDArray[np.int64], Array]:
    """Connected part of each owned node, and the extent of each part [m]. Collective."""
    parts, of_node = scene.parts, np.zeros(scene.nodal_mass.size, dtype=np.int64)
    of_node[scene.space.dofmap.list] = parts.of_cell[:, None]
    return of_node[: scene.owned_nodes], np.linalg.norm(parts.upper - parts.lower, axis=1)


def _check(scene: Scene) -> None:
    """See that nothing acts that the stiffness cannot hold.

    Raises:
        SceneError: If there is a joint, or a force between points of faces.
    """
    linked = [*scene.named(Joint), *scene.named(SpringDamper)]
    linked += [effect for effect in scene.named(OnFace) if effect.face is not None]
    if linked:
        raise SceneError(
            f"Reduced: {linked[0].owner} joins parts or faces. Reduced parts in machines come "
            "next; leave the part flexible, or name it Rigid, until then."
        )
