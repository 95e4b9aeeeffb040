"""Forces of a unit pressure on the facets of rigid bodies, in their present shape."""

import numpy as np
import ufl
from dolfinx import fem, la

from rigidfx.base.types import Array, Indices
from rigidfx.flexible.kernels import Kernel
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene

SMALL_WAY = 1e-4  # of a cell, by which nodes are displaced to see how forces or stiffness change


class Surface:
    """The deformed boundary of a scene. Its forms are compiled at first use."""

    def __init__(self, scene: Scene, u: fem.Function) -> None:
        """Keep the displacement, which is up to date inside the bodies when something is asked."""
        self._scene, self._u = scene, u
        self._kernel: Kernel | None = None

    def outward_moments(self, where: str, owner: str, bodies: Bodies) -> Array:
        """Σ a fᵀ of a unit pressure from inside on each body. Collective.

        It is this rank's part in the bodies' frames in their present pose, (bodies, n, 3) [m², m³].
        """
        facets = self._scene.boundary(where, owner)
        out = np.zeros_like(bodies.pose)
        for k, body in enumerate(bodies):
            force = self._forces(facets[np.isin(facets[:, 0], body.data.cells)])
            nodal = force[body.data.nodes] @ body.motion.R
            a = body.data.coordinates()
            out[k, : a.shape[1]] = a.T @ nodal
        return out

    def outward_slopes(self, where: str, owner: str, bodies: Bodies) -> Array:
        """Derivatives of `outward_moments` by the coordinates of shapes. Collective.

        They have the shape (m, bodies, n, 3) [m, m²].
        """
        u, out = self._u.x.array.reshape(-1, 3), []
        before, way = u.copy(), SMALL_WAY * self._scene.mean_cell_size
        for k in range(bodies.q.shape[1]):
            sides = []
            for sign in (way, -way):
                u[:] = before
                for body in bodies:
                    if k < body.data.deforms_by:
                        shape = body.data.shapes.modes[:, k] @ body.motion.R.T  # type: ignore[union-attr]
                        u[body.data.nodes] += sign * shape
                self._u.x.scatter_forward()
                sides.append(self.outward_moments(where, owner, bodies))
            out.append((sides[0] - sides[1]) / (2 * way))
        u[:] = before
        return np.array(out)

    def outward_forces(self, where: str, owner: str) -> Array:
        """Forces of a unit pressure from inside on the owned nodes, (nodes, 3) [m²]. Collective."""
        return self._forces(self._scene.boundary(where, owner))[: self._scene.owned_nodes]

    def _forces(self, facets: Indices) -> Array:
        """The same of some facets, at all local nodes. Collective."""
        scene = self._scene
        if self._kernel is None:
            F = scene.element.deformation_gradient(self._u)
            n = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(scene.mesh)
            form = ufl.inner(n, ufl.TestFunction(scene.space)) * scene.boundary_measure(1)
            self._kernel = Kernel(form, [scene.space], scene.mesh)
        force = fem.Function(scene.space)
        fem.assemble_vector(force.x.array, self._kernel.bind({}, {1: facets}))
        force.x.scatter_reverse(la.InsertMode.add)
        return np.array(force.x.array.reshape(-1, 3))
