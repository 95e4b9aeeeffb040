"""Static internal forces, and the stiffness of cells about a shape that they are frozen in.

The stiffness is the material's part of the tangent, ∫ δE : ∂S/∂E : ΔE; `tangent` has that of
stresses besides. Internal forces and follower loads at the end of a load step are
w·∫ S(E₁) : δE₁ dV + ∫ p cof(F₁) N · w dA, without viscous stresses and numerical damping.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import ufl
from dolfinx import fem

from rigidfx.base.types import Array
from rigidfx.effects import Effect
from rigidfx.flexible.internal_forces import BoundForces, Cells, InternalForces
from rigidfx.flexible.kernels import Kernel, MaterialClass
from rigidfx.flexible.strain_rate import StrainRates
from rigidfx.mechanics.element import Portion
from rigidfx.mechanics.schemes import second_piola_kirchhoff, static_virtual_work
from rigidfx.scene.scene import Scene


def static_forces(
    scene: Scene,
    forces: InternalForces,
    cells: Cells,
    interior: Cells | None = None,
    interface: Cells | None = None,
    driven: Cells | None = None,
    acting: Sequence[Effect] = (),
) -> BoundForces:
    """Static forces of flexible cells at `forces.u1`; compiled when first asked for. Collective.

    Cells that touch no rigid body are interior, all if None, and those that do an interface. A
    support bears the pressure on cells that are driven. Loads on facets are those of effects that
    act.
    """
    V, mesh, element, at = scene.space, scene.mesh, scene.element, forces.u1
    test, trial = ufl.TestFunction(V), ufl.TrialFunction(V)
    loads = forces.select_static(acting)
    work = forces.integrate(lambda i, c: static_virtual_work(element, c.law, at, test))
    less = forces.integrate(lambda i, c: element.eliminated((at,), at, 1.0, None, test, trial))
    for k, term in loads:
        work += term.virtual_work(element, at, at, test) * scene.boundary_measure(k + 1)
    tangent = Kernel(ufl.derivative(work, at, trial) + less, [V, V], mesh)
    none = {i: own[:0] for i, own in cells.items()}
    each = cells if interior is None else interior, interface or none
    parts = [(own, forces.facets_of(own)) for own in each]
    residual = Kernel(work, [V], mesh).bind(cells, forces.facets_of(cells, driven or {}))
    return forces.bound(residual, tangent, parts)


class LinearForms:
    """Compiled forms about a shape, each when it is first asked for; then that is collective.

    Attributes:
        shape: The displacement that makes the shape [m].
    """

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Compile the forces. Collective."""
        V = scene.space
        self.shape = fem.Function(V)
        self._scene, self._forces = scene, forces
        self._test, self._trial = ufl.TestFunction(V), ufl.TrialFunction(V)
        self._stiffness: tuple[fem.Function, Kernel] | None = None
        self._tension: tuple[fem.Function, fem.Function, fem.Function, Kernel] | None = None
        self._tangent: Kernel | None = None
        self._force = Kernel(forces.integrate(self._strains), [V], scene.mesh)

    def _strains(self, i: int, c: MaterialClass) -> Any:
        return static_virtual_work(self._scene.element, c.law, self.shape, self._test)

    def stiffness(self, cells: Cells) -> fem.Form:
        """∫ δE : ∂S/∂E : ΔE over cells."""
        if self._stiffness is None:
            V, element = self._scene.space, self._scene.element
            strained = fem.Function(V)

            def stiff(i: int, c: MaterialClass) -> Any:
                C = element.right_cauchy_green(strained)
                S = second_piola_kirchhoff(c.law.energy, C, c.law.parameters)
                portion = Portion("elastic", strained)
                return element.virtual_work(S, (portion,), (self.shape,), self._test)

            work = ufl.derivative(self._forces.integrate(stiff), strained, self._trial)
            step = (self.shape,), strained, 1.0, None, self._test, self._trial
            work += self._forces.integrate(lambda i, c: element.eliminated(*step))
            self._stiffness = strained, Kernel(work, [V, V], self._scene.mesh)
        strained, kernel = self._stiffness
        return kernel.bind(cells, instead={strained: self.shape})

    def tension(self, cells: Cells, along: Array, bent: Array | None = None) -> fem.Form:
        """∫ S'[along] : ∇wᵀ∇v: what stresses add to the stiffness, of each component alike.

        They are those of a displacement at the owned dofs [m], at one point of each cell where
        strains are constant or parasitic, else as they vary in it. Arguments are in the space of
        one component: see `Scene`. Strains ½ ∇bᵀ∇b of another one may come on top.
        """
        if self._tension is None:
            V, Q, element = self._scene.space, self._scene.component[0], self._scene.element
            ends, curve = (fem.Function(V), fem.Function(V)), fem.Function(V)
            test, trial = ufl.TestFunction(Q), ufl.TrialFunction(Q)
            slopes = ufl.outer(ufl.grad(test), ufl.grad(trial))

            def work(i: int, c: MaterialClass) -> Any:
                C, s = element.right_cauchy_green(self.shape), ufl.variable(ufl.as_ufl(0.0))
                C += s * (2 * element.strain_increment(*ends) + ufl.grad(curve).T * ufl.grad(curve))
                S = second_piola_kirchhoff(c.law.energy, C, c.law.parameters)
                return ufl.inner(ufl.diff(S, s), slopes)

            degree = 2 * (self._scene.order - 1) if element.locks else None
            form = self._forces.integrate(work, degree)
            self._tension = *ends, curve, Kernel(form, [Q, Q], self._scene.mesh)
        begin, end, curve, kernel = self._tension
        own = self.shape.x.array[: along.size]
        each = own - along / 2, own + along / 2, 0.0 if bent is None else bent
        for f, values in zip((begin, end, curve), each, strict=True):
            f.x.array[: along.size] = values
            f.x.scatter_forward()
        return kernel.bind(cells)

    @cached_property
    def strains(self) -> StrainRates:
        """Strains of cells between two displacements. Collective, when first asked for."""
        return StrainRates(self._scene, self._forces, "rms")

    def tangent(self, cells: Cells) -> fem.Form:
        """Derivative of `force` by the shape; compiled when first asked for. Collective."""
        if self._tangent is None:
            V, element, shape = self._scene.space, self._scene.element, self.shape
            own = (shape,), shape, 1.0, None, self._test, self._trial
            work = ufl.derivative(self._forces.integrate(self._strains), shape, self._trial)
            work += self._forces.integrate(lambda i, c: element.eliminated(*own))
            self._tangent = Kernel(work, [V, V], self._scene.mesh)
        return self._tangent.bind(cells)

    def force(self, cells: Cells) -> fem.Form:
        """Internal forces of cells in their shape."""
        return self._force.bind(cells)
