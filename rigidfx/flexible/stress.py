"""Cauchy stress of every cell, for files and pictures.

A cell's stress is the mean over its deformed volume v,

    σ = (1/v) ∫ σ dv = ∫ F S Fᵀ dV0 / ∫ J dV0,    S = 2 ∂W/∂C,  J = det F,

by the quadrature rule of the internal forces: a homogeneous stress is given exactly, a linear one
by its value at the centre, which is where first-order cells are at their best. Nothing is smoothed
between cells, so the jumps there tell how good the mesh is. A single cell across the thickness of a
bent part shows no stress of bending.

Cells of rigid bodies are no exception. Their nodes follow the body, F = R F_frozen, so they keep
the stress they were frozen with, rotated with the body: σ = R σ_frozen Rᵀ.

The stress is the elastic one at an instant, that of the stored energy W. It holds no stress of
damping, and it is not the mean over a step by which the energy-momentum method balances forces.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from rigidfx.flexible.kernels import Kernel
from rigidfx.flexible.material_classes import material_classes
from rigidfx.mechanics.schemes import second_piola_kirchhoff
from rigidfx.scene.scene import Scene

__all__ = ["CauchyStress", "von_mises"]

Array = npt.NDArray[np.float64]

SYMMETRIC = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # components that are computed
PLACES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # where each of all nine is among them


class CauchyStress:
    """Measures the stress of all cells. Its form is compiled once, at construction."""

    def __init__(self, scene: Scene) -> None:
        """Compile the form. Collective.

        Args:
            scene: The problem.
        """
        self._u = fem.Function(scene.space)
        classes = dict(enumerate(material_classes(scene), start=1))
        # Six components of J σ and J itself, together in one vector.
        space = fem.functionspace(scene.mesh, ("DG", 0, (len(SYMMETRIC) + 1,)))
        dx = scene.cell_measure
        F = scene.element.deformation_gradient(self._u)
        C = scene.element.right_cauchy_green(self._u)
        form = ufl.Form([])
        for i, of in classes.items():
            tau = F * second_piola_kirchhoff(of.law.energy, C, of.law.parameters) * F.T
            values = ufl.as_vector([*(tau[ij] for ij in SYMMETRIC), ufl.det(F)])
            form += ufl.inner(values, ufl.TestFunction(space)) * dx(i)
        cells = {i: of.cells for i, of in classes.items()}
        self._form = Kernel(form, [space], scene.mesh).bind(cells)
        self._integrals = np.zeros_like(fem.Function(space).x.array)
        owned = scene.mesh.topology.index_map(3).size_local
        self._rows = space.dofmap.list[:owned, 0]

    def measure(self, u: fem.Function) -> Array:
        """Cauchy stress of each owned cell, shape (cells, 3, 3) [Pa].

        Args:
            u: Displacement, up to date inside bodies too: see `State.rebuild`.
        """
        self._u.x.array[:] = u.x.array
        self._integrals[:] = 0.0
        fem.assemble_vector(self._integrals, self._form)
        values = self._integrals.reshape(-1, len(SYMMETRIC) + 1)[self._rows]
        return np.asarray((values[:, :-1] / values[:, -1:])[:, PLACES])


def von_mises(stress: Array) -> Array:
    """Von Mises' equivalent stress √(3/2 s:s), s the deviator, shape (cells,) [Pa].

    Args:
        stress: Cauchy stress, shape (cells, 3, 3) [Pa].
    """
    pressure = np.trace(stress, axis1=1, axis2=2) / 3
    deviator = stress - pressure[:, None, None] * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.einsum("cij,cij->c", deviator, deviator)))
