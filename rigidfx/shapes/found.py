"""Shapes of a body that was found: vectors of the whole structure in the frame of the body.

They are taken about the shape in which it was frozen: f₀ = Φᵀ f_int(ξ) and Ω = ΦᵀK(ξ)Φ with the
stresses there, so that forces do not jump at the freeze.
"""

from dataclasses import replace

import numpy as np

from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import Body, Frozen, RigidBody
from rigidfx.mechanics.shapes import Shapes
from rigidfx.scene.scene import Scene
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.linear import resolved
from rigidfx.shapes.orthonormal import INDEPENDENT, columns, to_one
from rigidfx.shapes.responses import LACKING


class Found(Expanded):
    """Stiffness and mass of a body about the shape that it is frozen in; `destroy` frees them."""

    def __init__(
        self, scene: Scene, forces: InternalForces, linear: LinearForms, data: RigidBody
    ) -> None:
        """Assemble, by forms whose shape is moved and brought back. Collective."""
        cells = forces.cells(data.cells)
        super().__init__(scene, linear, cells, data.nodes, data.displacement)

    def modes(self, dt: float, above: float) -> tuple[Array, float]:
        """φ of the modes that Δt resolves, where it moves freely, and the lowest ω left out [1/s].

        See `resolved`; φ has the shape (nodes, 3, k). Collective.
        """
        M = self._mass.matrix()
        y, omega, cut = resolved(self._K, M, columns(self.motions), self.rows.vector, dt)
        M.destroy()
        y = y[:, omega > above]
        return y.reshape(*self.motions.shape[:2], y.shape[1]), max(cut, above)

    def with_shapes(self, body: Body, vectors: Array, followers: int = 0) -> Body | None:
        """A body with more shapes, all of them orthogonal by the mass, at q = q̇ = 0. Collective.

        Vectors at its nodes are in its frame, shape (nodes, 3, k), and the last ones, the
        followers, may lack `LACKING` of themselves. None if no vector is new.
        """
        data, m = body.data, body.data.deforms_by
        old: Array = np.zeros((len(data.nodes), 3, 0))
        if data.shapes is not None:
            old = data.shapes.modes.swapaxes(1, 2)
        new = self._new(old, vectors, followers)
        if not new.shape[2]:
            return None
        K = self.times_stiffness(new)
        modes = np.concatenate([old, new], axis=2)
        stiffness = np.zeros((modes.shape[2], modes.shape[2]))
        stiffness[:, m:] = self.dot(modes, K)
        stiffness[m:] = stiffness[:, m:].T
        on = self.dot(new, self.internal[:, :, None])[:, 0]
        images = K
        if data.shapes is not None:
            stiffness[:m, :m] = data.shapes.stiffness
            on = np.r_[data.shapes.force, on]
            images = np.concatenate([data.shapes.images.swapaxes(1, 2), K], axis=2)
        shapes = Shapes(
            data.nodes,
            modes.swapaxes(1, 2).copy(),
            self.moments(data.offsets, modes),
            0.5 * (stiffness + stiffness.T),
            on,
            tension=None if data.shapes is None else data.shapes.tension,
            images=images.swapaxes(1, 2).copy(),
        )
        return body.with_shapes(shapes)

    def _new(self, old: Array, vectors: Array, followers: int) -> Array:
        """The new part of vectors, their largest displacement 1, (nodes, 3, k). Collective."""
        basis, m = self.begun(old), old.shape[2]
        own = self.unmoved(vectors)
        sizes = self.sizes(vectors, self.times_mass(vectors))
        sizes[sizes.size - followers :] *= LACKING / INDEPENDENT
        basis.grow(own, self.times_mass(own), sizes, m + own.shape[2])
        return to_one(self._scene.comm, basis.vectors[:, :, m:])[0]

    def moving(self, body: Body) -> Body:
        """A body frozen just now, whose shapes have of its nodes' velocities what they can.

        Collective. The momenta stay, and the energy: shapes have no momenta.
        """
        data, shapes = body.data, body.data.shapes
        assert shapes is not None
        rates = self.rates(shapes, data.frozen.velocities)
        vibration = max(data.frozen.vibration - 0.5 * float(rates @ shapes.mass @ rates), 0.0)
        lost = data.frozen.velocities - shapes.bent(rates)
        left = Frozen(data.nodes, lost, data.frozen.strain, vibration)
        return Body(replace(data, frozen=left), replace(body.motion, q_rate=rates))
