"""C̃ of enhanced elements at the integration points, for what is evaluated there point by point.

Modes are eliminated in the kernels of forms only. So C̃ is tested with the functions of the
integration points, and what that gives is divided by their volumes.
"""

from __future__ import annotations

from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from rigidfx.flexible.kernels import Kernel
from rigidfx.scene.scene import Scene

__all__ = ["EnhancedMetric"]

COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class EnhancedMetric:
    """C̃ of a displacement, as a function on the integration points."""

    def __init__(self, scene: Scene, u: fem.Function) -> None:
        """Compile the form. Collective.

        Args:
            scene: The problem, of enhanced elements.
            u: Displacement.
        """
        self._u = u
        self._of: npt.NDArray[np.float64] = np.empty(0)  # displacement that the values are of
        points = basix.ufl.quadrature_element(
            scene.mesh.basix_cell(), value_shape=(6,), degree=scene.quadrature_degree
        )
        self._values = fem.Function(fem.functionspace(scene.mesh, points))
        w, dx = ufl.TestFunction(self._values.function_space), scene.cell_measure(1)
        C = scene.element.right_cauchy_green(u)
        cells = {1: scene.owned_cells(None, "")}
        space = self._values.function_space
        values = ufl.as_vector([C[ij] for ij in COMPONENTS])
        self._form = Kernel(ufl.inner(values, w) * dx, [space], scene.mesh).bind(cells)
        ones = ufl.inner(ufl.as_vector([1.0] * 6), w) * dx
        self._volumes = np.zeros_like(self._values.x.array)
        fem.assemble_vector(self._volumes, Kernel(ones, [space], scene.mesh).bind(cells))
        self._inside = self._volumes > 0  # others are of ghost cells

    @property
    def tensor(self) -> Any:
        """C̃, shape (3, 3)."""
        xx, yy, zz, xy, xz, yz = (self._values[i] for i in range(6))
        return ufl.as_matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def update(self) -> None:
        """Have the values be those of the displacement as it is now, ghosts included."""
        if np.array_equal(self._of, self._u.x.array):
            return
        self._of, values = self._u.x.array.copy(), self._values.x.array
        values[:] = 0.0
        fem.assemble_vector(values, self._form)
        values[self._inside] /= self._volumes[self._inside]
