"""Strain rates of the flexible cells in a step: equation (24).

Both measures come from ∫ ΔE:ΔE dV0 per cell, E the Green-Lagrange strain, by the quadrature rule of
the internal forces. Rigid motion changes neither E nor, therefore, either measure.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import ufl
from dolfinx import fem

from rigidfx.base.form_cache import form_on
from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import Kernel, add_vector
from rigidfx.scene.scene import Scene


class StrainRates:
    """Measures strain rates of the cells it is bound to."""

    def __init__(
        self, scene: Scene, forces: InternalForces, measure: Literal["rms", "paper"]
    ) -> None:
        """Compile the form. Collective.

        Args:
            scene: The problem.
            forces: Internal forces, whose u₀ and u₁ hold the ends of a step.
            measure: See `rigidfx.decide.criteria.criterion.StrainRate`.
        """
        self._forces = forces
        space = scene.cell_space
        dx, C = scene.cell_measure, scene.element.right_cauchy_green
        dE = (C(forces.u1) - C(forces.u0)) / 2
        form = ufl.inner(dE, dE) * ufl.TestFunction(space) * dx(tuple(forces.cells()))
        self._kernel = Kernel(form, [space], scene.mesh)
        self._square = fem.Function(space)
        self._nowhere = fem.Function(scene.space)
        self._dofs = space.dofmap.list[:, 0]
        self._power = 1 if measure == "rms" else 2
        self._volume = _volumes(space)[self._dofs]
        self.values = np.zeros(scene.mesh.topology.index_map(3).size_local)
        self.weights = self._volume[: self.values.size] ** self._power

    def bind(
        self, flexible: Cells, between: tuple[fem.Function, fem.Function] | None = None
    ) -> None:
        """Measure these cells from now on; all others have the strain rate zero.

        Cells that were bound before keep the strain rate of the last step.

        Args:
            flexible: Owned cells by subdomain id.
            between: Displacements at the ends of a step, in place of u₀ and u₁.
        """
        ends = dict(zip((self._forces.u0, self._forces.u1), between or (), strict=False))
        self._form = self._kernel.bind(flexible, instead=ends)
        nowhere, u = self._nowhere, ends.get(self._forces.u0, self._forces.u0)
        instead = {self._forces.u0: nowhere, self._forces.u1: u}
        self._whole = self._kernel.bind(flexible, instead=instead)
        self.cells = np.sort(np.concatenate([np.empty(0, np.int32), *flexible.values()]))
        self._own = self._dofs[self.cells]
        self._divisor = self._volume[self.cells] ** (self._power / 2)
        others = np.ones(self.values.size, dtype=bool)
        others[self.cells] = False
        self.values[others] = 0.0

    def measure(self, dt: float) -> Array:
        """Strain rates of the bound cells in the step that u₀ and u₁ hold, in their order [1/s]."""
        rates = np.asarray(self._integrated(self._form) / dt)
        self.values[self.cells] = rates
        return rates

    def strains(self) -> Array:
        """Strain at u₀ of each owned cell, by the same measure; zero where none is bound."""
        out = np.zeros_like(self.values)
        out[self.cells] = self._integrated(self._whole)
        return out

    def _integrated(self, form: fem.Form) -> Array:
        """Strain of the bound cells between the ends of a form."""
        square = self._square.x.array
        square[self._own] = 0.0
        add_vector(square, form)
        return np.asarray(np.sqrt(square[self._own]) / self._divisor)


def _volumes(space: fem.FunctionSpace) -> Array:
    """V0 of each local cell [m³], by the number of its unknown in the space."""
    volume = fem.Function(space)
    form = form_on(space.mesh.comm, ufl.TestFunction(space) * ufl.dx)
    fem.assemble_vector(volume.x.array, form)
    return volume.x.array.copy()
