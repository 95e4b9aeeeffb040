"""Enhanced strains at integration points, for expressions: these have no kernel that eliminates."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_coefficients

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.types import Indices
from rigidfx.flexible.elimination import library_of
from rigidfx.flexible.kernels import jit_options
from rigidfx.mechanics.enhancement import Enhancement

__all__ = ["Enhancements"]


class Enhancements:
    """The enhancement of a displacement as a function that expressions can read."""

    def __init__(self, u: fem.Function) -> None:
        """Keep the displacement."""
        self._u = u
        self._eta: fem.Function | None = None

    def readable(self, expression: Any) -> Any:
        """The expression with a function in the place of the enhancement. Collective."""
        of = [w for w in extract_coefficients(expression) if isinstance(w, Enhancement)]
        if not of:
            return expression
        if self._eta is None:
            self._law = of[0].law
            self._eta = fem.Function(self._law.function_space)
            options = jit_options()["cffi_extra_compile_args"]
            self._library, _ = library_of(self._law.function_space.mesh.comm, options)
        return ufl.replace(expression, {of[0]: self._eta})

    def update(self, cells: Indices) -> None:
        """Compute it for some local cells; nothing if no expression reads it."""
        if self._eta is None or not cells.size:
            return
        mesh, V = self._u.function_space.mesh, self._u.function_space
        dofs = self._law.function_space.dofmap.list[cells]
        x = mesh.geometry.x[cell_geometry_dofs(mesh)[cells]]
        u = self._u.x.array.reshape(-1, 3)[V.dofmap.list[cells]]
        law = self._law.x.array.reshape(-1, 6)[dofs[:, 0], :3]
        eta = np.empty((cells.size, dofs.shape[1], 6))
        ffi = self._library.ffi
        given = (ffi.from_buffer("double[]", np.ascontiguousarray(a)) for a in (x, u, law))
        self._library.lib.enhancements(cells.size, *given, ffi.from_buffer("double[]", eta))
        self._eta.x.array.reshape(-1, 6)[dofs] = eta
