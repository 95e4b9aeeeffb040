"""Shapes of a body that was found: vectors of the whole structure in the frame of the body.

They are taken about the shape in which it was frozen: f₀ = Φᵀ f_int(ξ) and Ω = ΦᵀK(ξ)Φ with the
stresses there, so that forces do not jump at the freeze.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.rows import Rows
from rigidfx.error.linear_motion import assembled
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import add_vector
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import Body, Frozen, RigidBody
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.mechanics.shapes import Shapes
from rigidfx.scene.scene import Scene
from rigidfx.shapes.linear import resolved
from rigidfx.shapes.orthonormal import columns, normalised
from rigidfx.shapes.stiffness import times

__all__ = ["Found"]

Array = npt.NDArray[np.float64]

# Size of a vector, once rigid motions and other shapes are taken out of it, over that before: what
# is less is a combination of these.
NEW = 1e-6


class Found:
    """Stiffness and mass of a body about the shape that it is frozen in; `destroy` frees them."""

    def __init__(
        self, scene: Scene, forces: InternalForces, linear: LinearForms, data: RigidBody
    ) -> None:
        """Assemble. Collective.

        Args:
            scene: The problem.
            forces: Internal forces, which know the cells of each material.
            linear: Forms, which get the shape.
            data: The body.
        """
        self._scene, self._linear, self._data = scene, linear, data
        self._cells = cells = forces.cells(data.cells)
        self._rows = Rows(scene.space, data.nodes)
        own = np.ones(data.nodes.size, dtype=bool)
        self._mass = mass_operator(scene, self._rows, cells, own)
        self._internal = self.forces(np.zeros_like(data.offsets))
        self._K = assembled(self._rows, linear.tangent(cells))
        R = rigid_motions(data.offsets, data.length)
        self._rigid = normalised(R, self.dot(R, self.times_mass(R)))
        self._momenta = self.times_mass(self._rigid)

    def modes(self, dt: float, above: float) -> tuple[Array, float]:
        """Its own modes that Δt resolves, where it moves freely: see `resolved`. Collective.

        Args:
            dt: Δt [s].
            above: ω above which [1/s].

        Returns:
            φ at its nodes, shape (nodes, 3, k); and the lowest ω that is left out [1/s].
        """
        M = self._mass.matrix()
        y, omega, cut = resolved(self._K, M, columns(self._rigid), self._rows.vector, dt)
        M.destroy()
        y = y[:, omega > above]
        return y.reshape(*self._rigid.shape[:2], y.shape[1]), max(cut, above)

    def forces(self, w: Array) -> Array:
        """Internal forces of its cells at the frozen shape and w beside it [N]. Collective.

        Args:
            w: At its nodes in its frame, shape (nodes, 3) [m].
        """
        shape, b = self._linear.shape.x, fem.Function(self._scene.space)
        shape.array[:] = 0.0
        shape.array.reshape(-1, 3)[self._data.nodes] = self._data.displacement + w
        shape.scatter_forward()
        add_vector(b.x.array, self._linear.force(self._cells))
        b.x.scatter_reverse(la.InsertMode.add)
        return np.array(b.x.array.reshape(-1, 3)[self._data.nodes])

    def missed(self, shapes: Shapes, q: Array, respond: Callable[[Array], Array]) -> Array:
        """Energy that the expansion in q misses, by nodes, over ½ q·Ωq, shape (nodes,). Collective.

        The structure relieves what shapes strain it by in second order: a shape that bends a leaf
        stretches it. So the energy is that at w = Φq + δ₂, with δ₂ the response to the mean of the
        forces at Φq and -Φq, by Simpson's rule along w. Sum and largest are |V - U|/½ q·Ωq.

        Args:
            shapes: The body's.
            q: Their coordinates, not zero [m].
            respond: Static responses of the whole to forces on the body's nodes, in its frame.
        """
        bent = np.einsum("nka,k->na", shapes.modes, q)
        both = 0.5 * (self.forces(bent) + self.forces(-bent)) - self._internal
        w = bent - respond(both)
        mean = (self.forces(w) + 4 * self.forces(0.5 * w) - 5 * self._internal) / 6
        linear = np.einsum("nka,k->na", shapes.images, q)
        return np.asarray(
            (w * mean - 0.5 * bent * linear).sum(axis=1) / (0.5 * q @ shapes.stiffness @ q)
        )

    def dot(self, a: Array, b: Array) -> Array:
        """aᵀb of all columns of fields, shape (k, l). Collective."""
        return np.asarray(self._scene.sum(columns(a).T @ columns(b)))

    def times_mass(self, u: Array) -> Array:
        """M u, shape (nodes, 3, k). Collective."""
        return times(self._mass, columns(u), self._rows.vector).reshape(u.shape)

    def outside(self, data: RigidBody, force: Array) -> Array:
        """Forces without those that shapes follow, by the mass, shape (nodes, 3). Collective.

        Args:
            data: The body, with its shapes.
            force: On its nodes, in its frame, shape (nodes, 3) [N].
        """
        if data.shapes is None:
            return force
        modes = data.shapes.modes.swapaxes(1, 2)
        D = np.einsum("kkii->k", data.shapes.moments[1:, 1:])  # shapes are orthogonal by the mass
        on = self.dot(modes, force[:, :, None])[:, 0]
        return np.asarray(force - self.times_mass((modes @ (on / D))[:, :, None])[:, :, 0])

    def with_shapes(self, body: Body, vectors: Array, held: Array | None = None) -> Body | None:
        """A body with more shapes, all of them orthogonal by the mass, at q = q̇ = 0. Collective.

        Args:
            body: The body.
            vectors: At its nodes in its frame, shape (nodes, 3, k).
            held: Forces that are balanced without the new shapes [N], shape (nodes, 3): lasting
                ones, which these shapes are not to follow all at once.

        Returns:
            None if none of the vectors is new.
        """
        data, m = body.data, body.data.deforms_by
        old: Array = np.zeros((len(data.nodes), 3, 0))
        if data.shapes is not None:
            old = data.shapes.modes.swapaxes(1, 2)
        new = self._new(old, vectors)
        if not new.shape[2]:
            return None
        K = times(self._K, columns(new), self._rows.vector).reshape(new.shape)
        modes = np.concatenate([old, new], axis=2)
        stiffness = np.zeros((modes.shape[2], modes.shape[2]))
        stiffness[:, m:] = self.dot(modes, K)
        stiffness[m:] = stiffness[:, m:].T
        force = self._internal if held is None else self._internal + held
        on = self.dot(new, force[:, :, None])[:, 0]
        images = K
        if data.shapes is not None:
            stiffness[:m, :m] = data.shapes.stiffness
            on = np.r_[data.shapes.force, on]
            images = np.concatenate([data.shapes.images.swapaxes(1, 2), K], axis=2)
        fields = np.concatenate([data.offsets[:, :, None], modes], axis=2)
        moved = self.times_mass(fields)
        moments = np.asarray(self._scene.sum(np.einsum("nak,nbl->klab", fields, moved)))
        moments[0, 0] = 0.0  # it is that of the rigid body
        shapes = Shapes(
            data.nodes,
            modes.swapaxes(1, 2).copy(),
            np.zeros(data.nodes.size, dtype=bool),
            moments,
            0.5 * (stiffness + stiffness.T),
            on,
            images=images.swapaxes(1, 2).copy(),
        )
        q, rate = np.zeros((2, modes.shape[2]))
        q[:m], rate[:m] = body.motion.q, body.motion.q_rate
        return Body(replace(data, shapes=shapes), replace(body.motion, q=q, q_rate=rate))

    def _new(self, old: Array, vectors: Array) -> Array:
        """The new part of vectors, their largest displacement 1, (nodes, 3, k). Collective."""
        scene, every = self._scene, normalised(old, self.dot(old, self.times_mass(old)))
        for k in range(vectors.shape[2]):
            y = vectors[:, :, k : k + 1]
            before = float(self.dot(y, self.times_mass(y))[0, 0])
            basis = np.concatenate([self._rigid, every], axis=2)
            for _ in range(2):  # once more for what rounding leaves
                parts = self.dot(basis, self.times_mass(y))[:, 0]
                y = y - (basis @ parts)[:, :, None]
            left = float(self.dot(y, self.times_mass(y))[0, 0])
            if left > NEW**2 * before:
                every = np.concatenate([every, y / np.sqrt(left)], axis=2)
        new = every[:, :, old.shape[2] :]
        largest = np.linalg.norm(new, axis=1).max(axis=0, initial=0.0)
        scene.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        return np.asarray(new / largest)

    def moving(self, body: Body) -> Body:
        """A body frozen just now, whose shapes have of its nodes' velocities what they can.

        Collective. The momenta stay, and the energy: shapes have no momenta.
        """
        data, shapes = body.data, body.data.shapes
        assert shapes is not None
        lost, modes = data.frozen.velocities, shapes.modes.swapaxes(1, 2)
        D = np.einsum("kkii->k", shapes.moments[1:, 1:])
        rates = self.dot(modes, self.times_mass(lost[:, :, None]))[:, 0] / D
        vibration = data.frozen.vibration - 0.5 * float(rates @ (D * rates))
        left = Frozen(data.nodes, lost - modes @ rates, data.frozen.strain, max(vibration, 0.0))
        return Body(replace(data, frozen=left), replace(body.motion, q_rate=rates))

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._mass.destroy()
        self._K.destroy()
