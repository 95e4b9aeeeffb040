"""The stress that eased cells bear on: that of another shape, less their own.

A stress S of cells resists a motion by ∫ F S : Grad w dV = Σ g_ab x_b, linear in places x, with
g_ab = ∫ Grad N_a · S Grad N_b dV, symmetric and of rows that add up to nothing: it moves neither
momentum, whatever S is, and its work in a step, x½ᵀ G Δx, is ∫ S : ΔE dV.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import ufl
from dolfinx import fem

from rigidfx.flexible.dealt_cells import DealtCells
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import Kernel
from rigidfx.flexible.material_classes import MaterialClass
from rigidfx.mechanics.eased import Eased
from rigidfx.mechanics.schemes import second_piola_kirchhoff
from rigidfx.scene.scene import Scene

__all__ = ["EasedStress"]


class EasedStress:
    """The form of G; compiled once, when anything is eased."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Keep the problem.

        Args:
            scene: The problem.
            forces: Internal forces, which know the materials.
        """
        self._scene, self._forces = scene, forces
        self._shape, self._strained = fem.Function(scene.space), fem.Function(scene.space)

    @cached_property
    def _kernel(self) -> Kernel:
        """Collective."""
        V, element = self._scene.space, self._scene.element
        x, w = ufl.TrialFunction(V), ufl.TestFunction(V)

        def stress(c: MaterialClass, u: fem.Function) -> Any:
            C = element.right_cauchy_green(u)
            return second_piola_kirchhoff(c.law.energy, C, c.law.parameters)

        def work(i: int, c: MaterialClass) -> Any:
            S = stress(c, self._strained) - stress(c, self._shape)
            return ufl.inner(ufl.grad(x) * S, ufl.grad(w))

        return Kernel(self._forces.integrate(work), [V, V], self._scene.mesh)

    def shapes(self, eased: Eased) -> tuple[fem.Function, fem.Function]:
        """Both shapes of eased cells, at local nodes [m]."""
        out = fem.Function(self._scene.space), fem.Function(self._scene.space)
        for function, values in zip(out, (eased.shape, eased.strained), strict=True):
            function.x.array.reshape(-1, 3)[eased.nodes] = values
        return out

    def bind(
        self,
        cells: Cells,
        shapes: tuple[fem.Function, fem.Function],
        dealt: DealtCells | None = None,
    ) -> fem.Form:
        """G over owned cells. Collective if these are dealt.

        Args:
            cells: Cells by subdomain id.
            shapes: Theirs, and the one that they would have.
            dealt: Where copies of these cells are that the form is to be over; none if None.
        """
        instead = dict(zip((self._shape, self._strained), shapes, strict=True))
        return self._kernel.bind(cells, instead=instead, dealt=dealt)
