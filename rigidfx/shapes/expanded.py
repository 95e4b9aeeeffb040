"""The cells of a part, expanded to second order about a state.

With d the displacement by shapes, w = d + δ where δ is the response of second order,
δ = -K⁻¹(½ [f(d) + f(-d)] - f(0)), and with forces f and energy V of the cells about the state,

    ν = |V(w) - V(0) - f(0)·w - ½ d·K d| / (½ d·K d)

as far as energies tell it (`rigidfx.shapes.excess`). The energy is that of the corrected place: a
shape that bends a leaf stretches it by the square of the rotation, which the structure relieves.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.flexible.surface import SMALL_WAY
from rigidfx.mechanics.rigid_motions import fitted_motion, free_motions, rigid_motions
from rigidfx.mechanics.shapes import Shapes, ShapesOfBodies, inverse
from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import Basis, columns, normalised
from rigidfx.shapes.stiffness import on_nodes, times


class Expanded:
    """Stiffness, mass and forces of cells about a state; `destroy` frees them.

    Attributes:
        nodes: Its owned nodes on this rank.
        cells: Its owned cells by subdomain id.
        rows: Its nodes as rows of vectors.
        motions: Its rigid motions that supports in it leave free, RᵀMR = 1, shape (nodes, 3, n).
        internal: Forces of the cells in the state, shape (nodes, 3) [N].
    """

    def __init__(
        self,
        scene: Scene,
        linear: LinearForms,
        cells: Cells,
        nodes: Indices,
        state: Array,
        held: Bools | None = None,
        rigid: Sequence[tuple[Ints, Array]] = (),
    ) -> None:
        """Assemble cells of owned nodes, sorted, about their displacement [m]. Collective.

        The displacement and the dofs that supports hold have the shape (nodes, 3). The forms' shape
        is moved and brought back. Rigid bodies in it have some of its nodes each, by arms.
        """
        self._scene, self._linear, self._state, self._rigid = scene, linear, state, rigid
        self.nodes, self.cells, self.rows = nodes, cells, Rows(scene.space, nodes)
        self._mass = Mass(scene, self.rows, cells, np.ones(nodes.size, dtype=bool))
        with self._displaced(0 * state):
            self._K = self.rows.assembled(linear.tangent(cells))
        self._force = linear.force(cells)
        self.internal = self.forces(0 * state)
        held = np.zeros(state.shape, dtype=bool) if held is None else held
        self.motions = self._rigid_motions(held)
        self._momenta = self.times_mass(self.motions)

    def _rigid_motions(self, held: Bools) -> Array:
        """Rigid motions that supports in it leave free, RᵀMR = 1. Collective."""
        scene = self._scene
        x = scene.space.tabulate_dof_coordinates()[self.nodes] + self._state
        sums = np.asarray(scene.sum(np.r_[x.sum(axis=0), len(x)]))
        x = x - sums[:3] / sums[3]
        length = float(np.sqrt(scene.sum((x * x).sum()) / sums[3]))
        R = rigid_motions(x, length) @ free_motions(x, held, length, scene.comm)
        columns(R)[held.reshape(-1)] = 0.0
        return normalised(R, self.dot(R, self.times_mass(R)))

    def times_mass(self, u: Array) -> Array:
        """M u of its own mass, shape (nodes, 3, k). Collective."""
        return times(self._mass, columns(u), self.rows.vector).reshape(u.shape)

    def times_stiffness(self, u: Array) -> Array:
        """K u of its own cells, shape (nodes, 3, k). Collective."""
        return times(self._K, columns(u), self.rows.vector).reshape(u.shape)

    def dot(self, a: Array, b: Array) -> Array:
        """aᵀb of all columns of fields, shape (k, l). Collective."""
        return np.asarray(self._scene.sum(columns(a).T @ columns(b)))

    def largest(self, u: Array) -> float:
        """The largest value of any node. Collective."""
        here = float(np.abs(u).max(initial=0.0))
        return float(self._scene.comm.allreduce(here, op=MPI.MAX))

    def sizes(self, u: Array, images: Array) -> Array:
        """The size of each of some fields by their images M u, shape (k,). Collective."""
        return np.sqrt(np.asarray(self._scene.sum(np.einsum("nak,nak->k", u, images))))

    def unmoved(self, own: Array) -> Array:
        """Fields at its nodes without their rigid motion, shape (nodes, 3, k). Collective."""
        for _ in range(2):  # once more for what rounding leaves
            own = own - self.motions @ self.dot(self._momenta, own)
        return np.asarray(own)

    def begun(self, vectors: Array) -> Basis:
        """A basis of fields that are orthogonal by the mass. Collective."""

        def anew(u: Array) -> tuple[Array, Array]:
            own = self.unmoved(u)
            return own, self.times_mass(own)

        images, basis = self.times_mass(vectors), Basis(self.nodes.size, self._scene.sum, anew)
        sizes = self.sizes(vectors, images)
        basis.vectors, basis.images = np.asarray(vectors / sizes), np.asarray(images / sizes)
        return basis

    def still(self, fields: Array) -> Array:
        """Independent fields without their rigid motion, made orthonormal by mass. Collective."""
        own = self.unmoved(fields)
        return normalised(own, self.dot(own, self.times_mass(own)))

    def moments(self, offsets: Array, modes: Array) -> Array:
        """G of ξ, shape (nodes, 3), and Φ, shape (nodes, 3, m): see `Shapes`. Collective."""
        fields = np.concatenate([offsets[:, :, None], modes], axis=2)
        images = self.times_mass(fields)
        found = np.asarray(self._scene.sum(np.einsum("nak,nbl->klab", fields, images)))
        found[0, 0] = 0.0  # it is that of the rigid body
        return found

    def rates(self, shapes: Shapes, v: Array) -> Array:
        """q̇ of shapes that take over what they can of v, shape (nodes, 3) [m/s]. Collective."""
        modes = shapes.modes.swapaxes(1, 2)
        momenta = self.dot(modes, self.times_mass(v[:, :, None]))[:, 0]
        return np.asarray(np.linalg.solve(shapes.mass, momenta), dtype=np.float64)

    @contextmanager
    def _displaced(self, d: Array) -> Iterator[None]:
        """Displace the cells by d beside the state. Collective."""
        x = self._linear.shape.x
        before = x.array.copy()
        x.array.reshape(-1, 3)[self.nodes] = self._state + d
        x.scatter_forward()
        yield
        x.array[:] = before

    def rolled(self, d: Array) -> Array:
        """Displacement by which bodies in it, rigid in d, stay so to second order. Collective."""
        more = np.zeros(d.shape)
        for own, arms in self._rigid:
            turn = self._turns(own, arms, d[:, :, None])[:, 0]
            more[own] = 0.5 * np.cross(turn, np.cross(turn, arms))
        return more

    def swung(self, e: Array, modes: Array) -> Array:
        """Stiffness of shapes in which bodies turn, by forces K e on these, (m,) [N/m]. Collective.

        It is half the change of their work by what `rolled` adds.
        """
        out, forces = np.zeros(modes.shape[2]), self.times_stiffness(e[:, :, None])[:, :, 0]
        for own, arms in self._rigid:
            W = np.asarray(self._scene.sum(forces[own].T @ arms))
            turns = self._turns(own, arms, modes)
            out += (turns * ((W - np.trace(W) * np.eye(3)) @ turns)).sum(axis=0)
        return out

    def _turns(self, own: Ints, arms: Array, fields: Array) -> Array:
        """Turns of a body in it in fields (nodes, 3, k), shape (3, k). Collective."""
        modes = columns(rigid_motions(arms, 1.0))
        return fitted_motion(modes, columns(fields[own]), self._scene.sum)[3:]

    def forces(self, d: Array, cells: Cells | None = None) -> Array:
        """Forces of its cells, or some, at d [m] beside the state, (nodes, 3) [N]. Collective."""
        with self._displaced(d):
            form = self._force if cells is None else self._linear.force(cells)
            return on_nodes(self._scene, form)[self.nodes]

    def even(self, d: Array, more: Array | float = 0.0) -> Array:
        """½ [f(d) + f(-d)] - f(0), the forces of second order, shape (nodes, 3) [N]. Collective.

        Without those that move it as a whole: its frame follows these, at the nodes' places in d.
        More of second order may be in both displacements.
        """
        both = self.forces(more + d) + self.forces(more - d)
        return self._resting(0.5 * both - self.internal)

    def lengthened(self, d: Array) -> Array:
        """The part of these by strains of second order, ½ ∫ S'[w] : ∇dᵀ∇d, (nodes, 3). Collective.

        Stresses of d pull by the rest, ∫ S'[d] : ∇wᵀ∇d.
        """
        return self.even(d) - self._resting(self.pull(d, d[:, :, None])[:, :, 0])

    def left(self, e: Array, w: Array) -> Array:
        """Forces at w beside those of shapes that stretch it by e, (nodes, 3) [N]. Collective."""
        stretch = e[:, :, None]
        known = self.times_stiffness(stretch) + self.pull(e, stretch)
        return self._resting(self.forces(w) - self.internal - known[:, :, 0])

    def _resting(self, forces: Array) -> Array:
        """Forces, (nodes, 3), without those that move it as a whole. Collective."""
        return np.asarray(forces - self._momenta @ self.dot(self.motions, forces[:, :, None])[:, 0])

    @property
    def small(self) -> float:
        """Size of displacements whose strains are small [m]."""
        return float(np.sqrt(SMALL_WAY) * self._scene.mean_cell_size)

    def curved(self, field: Array) -> Array:
        """Forces of second order along a field, over its size squared, (nodes, 3). Collective."""
        h = self.small  # strains by h times it are small
        return np.asarray(self.even(h * field) / h**2)

    def stiffer(self, shapes: Shapes, which: Ints) -> Array:
        """Part by which each stretch e stiffens some shapes, per e, (shapes, m). Collective.

        It is φ_k·K'[φ_j] φ_j over Ω_jj, of forces of second order along φ_j.
        """
        modes = shapes.whole.swapaxes(1, 2)
        each = [2 * self.curved(modes[:, :, j]) for j in which]
        own = np.diag(shapes.stiffness)[which]
        return self.dot(np.stack(each, axis=2), modes) / own[:, None]

    def turned_by(self, d: Array, left: Array, right: Array) -> Array:
        """leftᵀ K'[d] right of fields, by tangents on both sides of the state. Collective.

        d has the shape (nodes, 3), the fields (nodes, 3, k).
        """
        size, images = self.largest(d), np.zeros(right.shape)
        if size == 0.0:
            return np.zeros((left.shape[2], right.shape[2]))
        h = self.small / size  # strains by h d are small
        for way in (h, -h):
            with self._displaced(way * d):
                K = self.rows.assembled(self._linear.tangent(self.cells))
            images += times(K, columns(right), self.rows.vector).reshape(right.shape) / (2 * way)
            K.destroy()
        return self.dot(left, images)

    def tension_by(self, fields: Array, modes: Array, bent: Array | None = None) -> Array:
        """What the stresses of fields, (nodes, 3, k) [m], add to Ω, (k, m, m) [N/m]. Collective.

        Those of strains of second order of a displacement, (nodes, 3) [m], may come on top.
        """
        at = self._at_corners(modes)
        each = [columns(at).T @ columns(image) for image in self._pulled(fields, at, bent)]
        out = np.asarray(self._scene.sum(np.reshape(each, (-1, *2 * modes.shape[2:]))))
        return 0.5 * (out + out.swapaxes(1, 2))

    def pull(self, d: Array, modes: Array) -> Array:
        """Forces ∫ S'[d] : ∇wᵀ∇φ by stresses of d at fields φ, (nodes, 3, k) [N]. Collective."""
        (image,) = self._pulled(d[:, :, None], self._at_corners(modes))
        out, found = fem.Function(self._scene.space), np.empty(modes.shape)
        for k in range(modes.shape[2]):
            out.x.array[:] = 0.0
            out.x.array.reshape(-1, 3)[self._scene.component[1]] = image[:, :, k]
            out.x.scatter_reverse(la.InsertMode.add)
            found[:, :, k] = out.x.array.reshape(-1, 3)[self.nodes]
        return found

    def _at_corners(self, fields: Array) -> Array:
        """Fields at the local dofs of one component, zero elsewhere, (dofs, 3, k). Collective."""
        own, nodes = fem.Function(self._scene.space), self._scene.component[1]
        at = np.zeros((nodes.size, 3, fields.shape[2]))
        for j, field in enumerate(np.moveaxis(fields, 2, 0)):
            own.x.array[:] = 0.0
            own.x.array.reshape(-1, 3)[self.nodes] = field
            own.x.scatter_forward()
            at[:, :, j] = own.x.array.reshape(-1, 3)[nodes]
        return at

    def _pulled(self, fields: Array, at: Array, bent: Array | None = None) -> Iterator[Array]:
        """Forces of this rank's cells by the stresses of each field on others. Collective."""
        A, both = None, np.zeros((2, self._scene.owned_nodes, 3))
        both[1, self.nodes] = 0.0 if bent is None else bent
        for field in np.moveaxis(fields, 2, 0):
            both[0, self.nodes] = field
            with self._displaced(0 * self._state):
                form = self._linear.tension(self.cells, *both.reshape(2, -1))
                if A is None:
                    A = fem.create_matrix(form)
                A.set_value(0.0)
                fem.assemble_matrix(A, form)
            # Columns that other ranks would fill come last.
            image = A.to_scipy(ghosted=True)[:, : len(at)] @ columns(at).reshape(len(at), -1)
            yield image.reshape(at.shape)

    def energy(self, d: Array) -> float:
        """½ d·K d [J]. Collective."""
        return 0.5 * float(self.dot(d[:, :, None], self.times_stiffness(d[:, :, None]))[0, 0])

    def relief(
        self, shapes: Shapes, n: int, even: Array, respond: Callable[[Array], Array]
    ) -> tuple[Array, Array]:
        """Forces of second order beside those that n shapes follow, and the way of nodes by these.

        Static responses are those of the whole; the way is none along these shapes. Both have the
        shape (nodes, 3) [N, m]. Collective.
        """
        modes, flexibility = shapes.whole[:, :n].swapaxes(1, 2), inverse(shapes.stiffness[:n, :n])
        images = self.times_stiffness(modes)
        forces = even[:, :, None] - images @ (flexibility @ self.dot(modes, even[:, :, None]))
        away = -self.unmoved(respond(forces[:, :, 0])[:, :, None])
        away -= modes @ (flexibility @ self.dot(images, away))
        return np.asarray(forces[:, :, 0]), np.asarray(away[:, :, 0])

    def beyond(self, shapes: Shapes, even: Array) -> Array:
        """Forces of second order less those by which shapes with Γ follow. Collective."""
        if shapes.tension is None:
            return even
        n = len(shapes.tension)
        modes = shapes.whole[:, :n].swapaxes(1, 2)
        follow = self.dot(modes, even[:, :, None])[:, 0]
        along = np.linalg.solve(shapes.stiffness[:n, :n], follow)
        return np.asarray(even - self.times_stiffness(modes) @ along)

    def left_on(self, shapes: Shapes, e: Array, even: Array) -> Array:
        """Forces of second order on shapes, beside those of their stretches e, (m,). Collective."""
        on_shapes = self.dot(shapes.whole.swapaxes(1, 2), even[:, :, None])[:, 0]
        return np.asarray(on_shapes - ShapesOfBodies([shapes]).even_force(e[None])[0])

    def followed(self, shapes: Shapes, forces: Array, d: Array) -> float:
        """Part of d by which forces Φᵀf on shapes, (m,), would move them along it. Collective.

        It is d·M Φ Ω⁻¹ Φᵀf over d·M d, of shapes whose coordinates no support gives.
        """
        k, along = shapes.given, self.times_mass(d[:, :, None])
        own = shapes.whole[:, k:].swapaxes(1, 2)
        moved = np.linalg.solve(shapes.stiffness[k:, k:], forces[k:, None])
        square = self.dot(d[:, :, None], along)
        return float((self.dot(along, own) @ moved / square)[0, 0])

    def missed(self, e: Array, w: Array) -> Array:
        """Energy that ½ e·K e misses, over it, whose sum over the nodes, (nodes,), is meant.

        That is ν but for the sign, with the energy by Simpson's rule along w, see `whole`, which
        is exact where it is of fourth order. Collective.
        """
        mean = (self.forces(w) + 4 * self.forces(0.5 * w) - 5 * self.internal) / 6
        linear = self.times_stiffness(e[:, :, None])[:, :, 0]
        return np.asarray((w * mean - 0.5 * e * linear).sum(axis=1) / self.energy(e))

    def lacking(self, e: Array, w: Array) -> Array:
        """Energy that ½ e·K e misses in each owned cell, over its volume [J/m³]. Collective.

        It is told by Young's modulus and Green's strain at w, and by that which is linear in e.
        """
        scene, strains = self._scene, self._linear.strains
        ends, squares = (fem.Function(scene.space), fem.Function(scene.space)), []
        strains.bind(self.cells, ends)
        for moved in ((0 * w, w), (-0.5 * e, 0.5 * e)):  # even parts cancel in the latter
            for end, d in zip(ends, moved, strict=True):
                end.x.array.reshape(-1, 3)[self.nodes] = self._state + d
                end.x.scatter_forward()
            strains.measure(1.0)
            squares.append(strains.values**2)
        modulus = np.zeros(strains.values.size)
        for material, cells in scene.materials:
            modulus[cells] = material.stiffness
        return np.asarray(modulus * np.abs(squares[0] - squares[1]))

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._mass.destroy()
        self._K.destroy()
