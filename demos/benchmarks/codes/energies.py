"""The energy of a motion that is known at the nodes."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

from .case import Array, Case


class Energies:
    """T + W of St.Venant and Kirchhoff's material, by the quadrature of the scene."""

    def __init__(self, case: Case, mass: str) -> None:
        """Compile the form.

        Args:
            case: Whose cells they are.
            mass: "lumped" or "consistent".
        """
        scene, material = case.scene, case.material
        self._u, self._v = fem.Function(scene.space), fem.Function(scene.space)
        lmbda = material.E * material.nu / ((1 + material.nu) * (1 - 2 * material.nu))
        mu = material.E / (2 * (1 + material.nu))
        F = ufl.Identity(3) + ufl.grad(self._u)
        E = (F.T * F - ufl.Identity(3)) / 2
        W = lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)
        rule = (
            {"quadrature_rule": "GLL", "quadrature_degree": 2 * scene.order - 1}
            if mass == "lumped"
            else {"quadrature_degree": 2 * scene.order}
        )
        T = material.rho / 2 * ufl.inner(self._v, self._v)
        self._form = fem.form(W * scene.cell_measure + T * ufl.dx(domain=scene.mesh, metadata=rule))

    def __call__(self, u: Array, v: Array) -> float:
        """H [J] at displacements [m] and velocities [m/s] of the nodes, of any shape."""
        self._u.x.array[:] = np.ravel(u)
        self._v.x.array[:] = np.ravel(v)
        return float(fem.assemble_scalar(self._form))
