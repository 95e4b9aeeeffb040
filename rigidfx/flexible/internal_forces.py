"""The forces of a scene's cells: compiled once, bound to the cells that are flexible.

Cells of materials that share an energy function, and are damped alike, share a kernel. Damping and
pressure are terms of the forms only while their time windows are open: for each combination that
the run will see there is one *variant* of the forms, compiled at the start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from rigidfx.effects import KelvinVoigt, NumericalDamping, Windowed
from rigidfx.flexible.kernels import Kernel
from rigidfx.flexible.material_classes import Group, group_cells
from rigidfx.flexible.pressures import Pressures
from rigidfx.mechanics.schemes import (
    deformation_gradient,
    initial_stiffness_times,
    static_virtual_work,
    stored_energy,
    strain_increment,
)
from rigidfx.scene.scene import Scene

__all__ = ["BoundForces", "InternalForces"]

Cells = Mapping[int, npt.NDArray[np.int32]]


@dataclass(frozen=True)
class BoundForces:
    """Forms over the flexible cells and those of their facets that are under pressure.

    Attributes:
        residual: Force vector.
        interior: Its derivative by the unknown displacement, over cells that touch no rigid body.
        interface: The same over those that do.
    """

    residual: fem.Form
    interior: fem.Form
    interface: fem.Form


@dataclass(frozen=True)
class Variant:
    """Compiled forms of a step with the terms that act at a time.

    Attributes:
        residual: Virtual work.
        tangent: Its derivative by the unknown displacement.
        lost: Energy that damping takes in a step [J], by the kind of damping.
    """

    residual: Kernel
    tangent: Kernel
    lost: Mapping[str, Kernel]


class InternalForces:
    """Compiled virtual work of cells, its tangent, and the stored energy of a scene.

    Attributes:
        u0: Displacement at the start of the step, a coefficient of the forms.
        u1: Displacement at its end, a coefficient of the forms.
        pressures: What follower pressures add.
        strain_noise: Rounding error of the algorithmic strain in units of the machine precision:
            1 for stresses linear in the strain, more for the quotient in the discrete gradient.
    """

    def __init__(self, scene: Scene, u0: fem.Function, resolution: float = 0.0) -> None:
        """Compile the forms. Collective.

        Args:
            scene: The problem.
            u0: Function that holds the displacement at the start of each step.
            resolution: Times closer than this are the same [s].
        """
        self._scene = scene
        self.u0, self.u1 = u0, fem.Function(scene.space)
        self._dampers: tuple[KelvinVoigt, ...] = scene.named(KelvinVoigt)
        self._groups = group_cells(scene, self._dampers)
        # A constant of no form, as long as no term reads it.
        self._xi, self._rate = (fem.Constant(scene.mesh, value) for value in (0.0, 1.0))
        self._eta = [fem.Constant(scene.mesh, float(d.eta)) for d in self._dampers]
        self._dx = ufl.Measure(
            "dx", domain=scene.mesh, metadata={"quadrature_degree": scene.quadrature_degree}
        )
        self.pressures = Pressures(scene, self.u0, self.u1)
        self._variants: dict[tuple[object, ...], Variant] = {}
        starts = {0.0, *(t for t in scene.breakpoints if t > 0)}
        for t in sorted(starts, reverse=True):
            self.select(scene.acting(t, resolution))
        self._energy = Kernel(
            self._integrate(lambda i, g: stored_energy(g.energy, self.u0, g.parameters)),
            [],
            scene.mesh,
        )
        linear = all(g.quadratic for g in self._groups) or not scene.scheme.conserving
        self.strain_noise = 1.0 if linear else 30.0

    def select(self, acting: Sequence[Windowed]) -> None:
        """Have the forms bound from now on hold the terms of these effects only. Collective.

        Args:
            acting: The effects with a time window that act.
        """
        here = {id(effect) for effect in acting}
        damped = any(isinstance(effect, NumericalDamping) for effect in acting)
        viscous = tuple(k for k, d in enumerate(self._dampers) if id(d) in here)
        self._terms = (damped, viscous, self.pressures.select(acting))
        if self._terms not in self._variants:
            self._variants[self._terms] = self._compile(damped, viscous)

    def _compile(self, damped: bool, viscous: tuple[int, ...]) -> Variant:
        scene, V, mesh = self._scene, self._scene.space, self._scene.mesh
        test, trial = ufl.TestFunction(V), ufl.TrialFunction(V)

        xi = self._xi if damped else None
        dE = strain_increment(self.u0, self.u1)
        # η/Δt of the groups that are damped now
        rates = {
            i: sum(self._eta[k] for k in g.dampers if k in viscous) * self._rate
            for i, g in enumerate(self._groups, start=1)
            if set(g.dampers) & set(viscous)
        }

        def virtual_work(i: int, g: Group) -> Any:
            work = scene.scheme.virtual_work(
                g.energy, g.quadratic, g.parameters, self.u0, self.u1, test, xi
            )
            if i in rates:
                F = deformation_gradient((self.u0 + self.u1) / 2)
                work += ufl.inner(F * (rates[i] * dE), ufl.grad(test))
            return work

        def numerical(i: int, g: Group) -> Any:
            return self._xi * ufl.inner(initial_stiffness_times(g.energy, g.parameters, dE), dE)

        lost = {}
        if damped:
            lost[NumericalDamping.__name__] = self._integrate(numerical)
        if rates:
            lost[KelvinVoigt.__name__] = self._integrate(
                lambda i, g: rates[i] * ufl.inner(dE, dE) if i in rates else None
            )
        work = self._integrate(virtual_work) + self.pressures.virtual_work(test)
        return Variant(
            Kernel(work, [V], mesh),
            Kernel(ufl.derivative(work, self.u1, trial), [V, V], mesh),
            {name: Kernel(form, [], mesh) for name, form in lost.items()},
        )

    def _integrate(self, integrand: Callable[[int, Group], Any]) -> ufl.Form:
        """Sum over the groups, by subdomain id, of an integrand, which may be None."""
        parts = ((i, integrand(i, group)) for i, group in enumerate(self._groups, start=1))
        return sum((part * self._dx(i) for i, part in parts if part is not None), ufl.Form([]))

    def cells(self, flexible: npt.NDArray[np.int32] | None = None) -> Cells:
        """Owned cells by subdomain id.

        Args:
            flexible: Sorted owned cells to keep; all if None.
        """
        return {
            i: g.cells if flexible is None else np.intersect1d(g.cells, flexible)
            for i, g in enumerate(self._groups, start=1)
        }

    def bind(
        self,
        cells: Cells,
        interior: Cells | None = None,
        interface: Cells | None = None,
        carried: Cells | None = None,
    ) -> BoundForces:
        """Internal forces of a step.

        Args:
            cells: Flexible cells.
            interior: Those that touch no rigid body; all if None.
            interface: Those that do; none if None.
            carried: Cells that a support moves; pressure on them is for the support to bear.
        """
        variant = self._variants[self._terms]
        none = {i: own[:0] for i, own in cells.items()}
        interior, interface = (
            cells if interior is None else interior,
            none if interface is None else interface,
        )
        facets = self.pressures.facets
        return BoundForces(
            variant.residual.bind(cells, facets([*cells.values(), *(carried or {}).values()])),
            variant.tangent.bind(interior, facets(interior.values())),
            variant.tangent.bind(interface, facets(interface.values())),
        )

    @property
    def residual_form(self) -> ufl.Form:
        """The virtual work as it is compiled for the effects that act."""
        return self._variants[self._terms].residual.form

    @property
    def viscous(self) -> bool:
        """Whether a viscous stress acts: one that grows with 1/Δt."""
        _, viscous, _ = self._terms
        return bool(viscous)

    def bind_energy(self, cells: Cells) -> fem.Form:
        """Stored energy at `u0` over the given cells."""
        return self._energy.bind(cells)

    def bind_static(self, cells: Cells) -> BoundForces:
        """Static internal forces at `u1` over the given cells; compiled when first asked for."""
        test, trial = ufl.TestFunction(self._scene.space), ufl.TrialFunction(self._scene.space)
        work = self._integrate(
            lambda i, g: static_virtual_work(g.energy, g.parameters, self.u1, test)
        )
        V, mesh = self._scene.space, self._scene.mesh
        tangent = Kernel(ufl.derivative(work, self.u1, trial), [V, V], mesh)
        none = {i: own[:0] for i, own in cells.items()}
        return BoundForces(
            Kernel(work, [V], mesh).bind(cells), tangent.bind(cells), tangent.bind(none)
        )

    def bind_dissipation(self, cells: Cells) -> dict[str, fem.Form]:
        """Energy that damping of flexible cells takes in a step [J], by kind, as far as it acts."""
        return {
            name: kernel.bind({i: cells[i] for i in kernel.ids})
            for name, kernel in self._variants[self._terms].lost.items()
        }

    def set_time(self, t: float, dt: float) -> None:
        """Set what in the forms depends on the step. Collective.

        Args:
            t: Its midpoint [s].
            dt: Its length [s].
        """
        self._xi.value = sum(d.xi for d in self._scene.named(NumericalDamping) if d.active(t))
        self.set_rate(1 / dt)
        self.pressures.set_time(t)

    def set_rate(self, rate: float) -> None:
        """Set 1/Δt of the viscous stresses [1/s]."""
        self._rate.value = rate
