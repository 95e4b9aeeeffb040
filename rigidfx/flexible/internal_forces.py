"""The forces of a scene's cells: compiled once, bound to the cells that are flexible.

Cells of materials that share an energy function, and on which the same effects may act, share a
kernel. Effects that belong into the forms (viscous stress, pressure) are terms of them only while
their time windows are open: for each combination that the run will see there is one *variant* of
the forms, compiled at the start.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from rigidfx.base.errors import by_name, together
from rigidfx.base.types import Indices
from rigidfx.effects import Effect, FormTerm
from rigidfx.flexible.dealt_cells import DealtCells
from rigidfx.flexible.kernels import Kernel, MaterialClass, material_classes
from rigidfx.flexible.surface import Surface
from rigidfx.mechanics.schemes import initial_stiffness_times, stored_energy
from rigidfx.scene.scene import Scene


@dataclass(frozen=True)
class BoundForces:
    """Forms over the flexible cells and those of their facets that loads act on."""

    residual: fem.Form  # force vector
    # Its derivative by the unknown displacement, over cells that touch no rigid body
    interior: fem.Form
    interface: fem.Form  # the same over those that do
    # Both derivatives where nothing is displaced, whatever the coefficients hold
    undeformed: tuple[fem.Form, fem.Form]


@dataclass(frozen=True)
class Taken:
    """Energy that terms of the forms take out of the motion in a step [J]."""

    dissipated: Mapping[str, fem.Form]  # by each kind of damping
    against_loads: Sequence[fem.Form]  # forces of cells against loads; no form if there are none


@dataclass(frozen=True)
class Variant:
    """Compiled forms of a step with the terms that act at a time."""

    residual: Kernel  # virtual work
    tangent: Kernel  # its derivative by the unknown displacement
    # Energy that damping takes in a step [J], by the kind of damping
    dissipated: Mapping[str, Kernel]
    against_loads: Kernel | None  # energy that goes into loads on facets [J]


Cells = Mapping[int, Indices]
Facets = Mapping[int, Indices]
Terms = tuple[str, tuple[int, ...]]  # the kind of what gives ξ, if it acts; terms of effects


class InternalForces:
    """Compiled virtual work of cells, its tangent, and the stored energy of a scene.

    Attributes:
        u0: Displacement at the start of the step, a coefficient of the forms.
        u1: Displacement at its end, a coefficient of the forms.
        rest: No displacement, in place of both.
        surface: The deformed boundary at u0.
        strain_noise: Rounding error of the algorithmic strain in units of the machine precision:
            1 for stresses linear in the strain, more for the quotient in the discrete gradient.
    """

    def __init__(
        self, scene: Scene, u0: fem.Function, acting: Iterable[Sequence[Effect]] = ((),)
    ) -> None:
        """Compile the forms, with u₀ the displacement at the start of each step. Collective.

        Effects act together for each time at which that changes; the last of these are selected.
        """
        self._scene, self._element = scene, scene.element
        self.u0, self.u1 = u0, fem.Function(scene.space)
        self.rest = fem.Function(scene.space)
        self.surface = Surface(scene, u0)
        terms = ((effect, effect.term(scene.mesh)) for effect in scene.effects)
        self._terms: list[tuple[Effect, FormTerm]] = [
            (effect, term) for effect, term in terms if term is not None
        ]
        on_cells = [k for k, (_, term) in enumerate(self._terms) if not term.boundary]
        self._classes = material_classes(scene, [self._terms[k][0] for k in on_cells])
        self._of_class = [{on_cells[j] for j in c.effects} for c in self._classes]
        self._facets = {
            k: scene.boundary(getattr(effect, "where", ""), effect.kind)
            for k, (effect, term) in enumerate(self._terms)
            if term.boundary
        }
        # A constant of no form, as long as no term reads it.
        self._xi = fem.Constant(scene.mesh, 0.0)
        self._dx = scene.cell_measure
        self._variants: dict[Terms, Variant] = {}
        self._acting: Terms = ("", ())
        for together_ in acting:
            self.select(together_)
        self._energy = Kernel(
            self.integrate(lambda i, c: stored_energy(self._element, c.law, self.u0)),
            [],
            scene.mesh,
        )
        linear = all(c.law.quadratic for c in self._classes) or not scene.scheme.conserving
        self.strain_noise = 1.0 if linear else 30.0

    # Which terms act ----------------------------------------------------------------------------

    def select(self, acting: Sequence[Effect]) -> None:
        """Limit the forms bound from now on to the terms of these effects. Collective."""
        damping = {e.kind: e.numerical_damping for e in acting if e.numerical_damping is not None}
        damped = next(iter(damping), "")
        self._xi.value = sum(damping.values())
        self._acting = (damped, self._numbers(acting))
        if self._acting not in self._variants:
            self._variants[self._acting] = self._compile(*self._acting)

    def select_static(self, acting: Sequence[Effect]) -> list[tuple[int, FormTerm]]:
        """Limit the loads on facets to those of these effects; their numbers and terms.

        Damping has no part in statics.
        """
        loads = [k for k in self._numbers(acting) if self._terms[k][1].boundary]
        self._acting = ("", tuple(loads))
        return [(k, self._terms[k][1]) for k in loads]

    def _numbers(self, acting: Sequence[Effect]) -> tuple[int, ...]:
        here = {id(effect) for effect in acting}
        return tuple(k for k, (effect, _) in enumerate(self._terms) if id(effect) in here)

    def set_time(self, t: float, dt: float) -> None:
        """Set the values of forms that depend on the step. Collective.

        A user's function that fails on any rank is a `SceneError` on all.
        """
        _, acting = self._acting
        if acting:

            def evaluate() -> None:
                for k in acting:
                    effect, term = self._terms[k]
                    by_name(effect.owner, t, partial(term.set_time, t, dt))

            together(self._scene.comm, "An effect", evaluate)

    def _compile(self, damped: str, acting: tuple[int, ...]) -> Variant:
        scene, V, mesh = self._scene, self._scene.space, self._scene.mesh
        test, trial = ufl.TestFunction(V), ufl.TrialFunction(V)
        xi = self._xi if damped else None
        acts = [(k, term) for k, (_, term) in enumerate(self._terms) if k in acting]
        on_facets = [(k, term) for k, term in acts if term.boundary]

        def virtual_work(i: int, c: MaterialClass) -> Any:
            step = (self._element, self.u0, self.u1)
            work = scene.scheme.virtual_work(step[0], c.law, *step[1:], test, xi)
            for k, term in acts:
                if k in self._of_class[i - 1]:
                    work += term.of(c.law).virtual_work(*step, test)
            return work

        def eliminated(i: int, c: MaterialClass) -> Any:
            step = (self._element, self.u0, self.u1, test, trial)
            here = [scene.scheme.eliminated(*step, xi)]
            here += [t.eliminated(*step) for k, t in acts if k in self._of_class[i - 1]]
            parts = [part for part in here if part is not None]
            return sum(parts) if parts else None

        work = self.integrate(virtual_work)
        less = self.integrate(eliminated)
        for k, term in on_facets:
            integrand = term.virtual_work(self._element, self.u0, self.u1, test)
            work += integrand * scene.boundary_measure(k + 1)
        loads = ufl.Form([])
        for k, term in on_facets:
            taken = term.taken(self._element, self.u0, self.u1)
            loads += taken * scene.boundary_measure(k + 1)
        return Variant(
            Kernel(work, [V], mesh),
            Kernel(ufl.derivative(work, self.u1, trial) + less, [V, V], mesh),
            self._dissipated(damped, [(k, t) for k, t in acts if t.dissipates]),
            Kernel(loads, [], mesh) if on_facets else None,
        )

    def _dissipated(self, damped: str, acts: Sequence[tuple[int, FormTerm]]) -> dict[str, Kernel]:
        """Energy that damping takes in a step, by its kind."""
        element, u0, u1 = self._element, self.u0, self.u1
        dE = element.strain_increment(u0, u1)

        def numerical(i: int, c: MaterialClass) -> Any:
            stress = initial_stiffness_times(c.law.energy, c.law.parameters, dE)
            return self._xi * ufl.inner(stress, dE)

        def of(kind: str) -> Callable[[int, MaterialClass], Any]:
            def integrand(i: int, c: MaterialClass) -> Any:
                here = [t for k, t in acts if t.kind == kind and k in self._of_class[i - 1]]
                return sum(t.of(c.law).taken(element, u0, u1) for t in here) if here else None

            return integrand

        forms = {damped: self.integrate(numerical)} if damped else {}
        forms |= {kind: self.integrate(of(kind)) for kind in {t.kind for _, t in acts}}
        return {
            kind: Kernel(form, [], self._scene.mesh)
            for kind, form in forms.items()
            if not form.empty()
        }

    def integrate(
        self, integrand: Callable[[int, MaterialClass], Any], degree: int | None = None
    ) -> ufl.Form:
        """Sum over the classes, by subdomain id, of an integrand, which may be None."""
        how = {} if degree is None else {"metadata": {"quadrature_degree": degree}}
        parts = ((i, integrand(i, c)) for i, c in enumerate(self._classes, start=1))
        each = (part * self._dx(i, **how) for i, part in parts if part is not None)
        return sum(each, ufl.Form([]))

    # Forms over cells ---------------------------------------------------------------------------

    def cells(self, flexible: Indices | None = None) -> Cells:
        """Owned cells by subdomain id; the sorted, flexible ones if given."""
        return {
            i: c.cells if flexible is None else np.intersect1d(c.cells, flexible)
            for i, c in enumerate(self._classes, start=1)
        }

    def facets_of(self, *groups: Cells) -> Facets:
        """Facets of cells that loads act on now, by subdomain id."""
        every = np.concatenate(
            [np.empty(0, np.int32), *(own for g in groups for own in g.values())]
        )
        return {
            k + 1: pairs[np.isin(pairs[:, 0], every)]
            for k, pairs in self._facets.items()
            if k in self._acting[1]
        }

    def bind(
        self,
        cells: Cells,
        interior: Cells | None = None,
        interface: Cells | None = None,
        driven: Cells | None = None,
        dealt: DealtCells | None = None,
    ) -> BoundForces:
        """Internal forces of flexible cells in a step. Collective if cells are dealt.

        Those that touch no rigid body are interior, all if None, and those that do an interface. A
        support bears the pressure on cells that are driven. Forms may be over dealt copies.
        """
        variant = self._variants[self._acting]
        interior = cells if interior is None else interior
        interface = {i: own[:0] for i, own in cells.items()} if interface is None else interface
        parts = [(own, self.facets_of(own)) for own in (interior, interface)]
        facets = self.facets_of(cells, driven or {})
        residual = variant.residual.bind(cells, facets, dealt=dealt)
        return self.bound(residual, variant.tangent, parts, dealt)

    def bound(
        self,
        residual: fem.Form,
        tangent: Kernel,
        parts: Sequence[tuple[Cells, Facets]],
        dealt: DealtCells | None = None,
    ) -> BoundForces:
        """Forms over all cells, and over interior and interface cells with their facets."""
        rest = {self.u0: self.rest, self.u1: self.rest}
        interior, interface = (tangent.bind(*part, dealt=dealt) for part in parts)
        undeformed = (tangent.bind(*parts[0], rest, dealt), tangent.bind(*parts[1], rest, dealt))
        return BoundForces(residual, interior, interface, undeformed)

    def bind_tangent(self, cells: Cells, u: fem.Function) -> fem.Form:
        """Derivative of the internal forces of owned cells by u₁, where both ends are at u."""
        tangent = self._variants[self._acting].tangent
        return tangent.bind(cells, {}, {self.u0: u, self.u1: u})

    @property
    def damps(self) -> bool:
        """Whether anything damps cells now."""
        return bool(self._acting[0]) or self.viscous

    @contextmanager
    def undamped(self) -> Iterator[list[tuple[str, bool, Callable[[float], None]]]]:
        """Switch damping off in the forms, but for those that are switched on.

        Yields:
            Of each that acts its kind, whether it grows with 1/Δt, and a function that multiplies
            it, a viscous one at Δt = 1 s.
        """
        xi = float(self._xi.value)

        def numerical(factor: float) -> None:
            self._xi.value = factor * xi

        parts: list[tuple[str, bool, Callable[[float], None]]] = []
        if self._acting[0]:
            parts.append((self._acting[0], False, numerical))
        for _, term in self.viscous_terms:
            parts.append((term.kind, True, term.set_rate))
        for _, _, multiply in parts:
            multiply(0.0)
        try:
            yield parts
        finally:
            if self._acting[0]:
                numerical(1.0)

    def loaded(self, *groups: Cells) -> Indices:
        """Those of some cells at whose facets loads act now, sorted."""
        found = [pairs[:, 0] for pairs in self.facets_of(*groups).values()]
        return np.unique(np.concatenate([np.empty(0, np.int32), *found]))

    def bind_loads(self, cells: Cells, u0: fem.Function, u1: fem.Function) -> fem.Form | None:
        """Forces of the loads on facets of owned cells, less those of the cells; None if none act.

        Displacements u0 and u1 of both ends are read in place of those of steps.
        """
        facets = self.facets_of(cells)
        if not facets:
            return None
        none = {i: own[:0] for i, own in cells.items()}
        residual = self._variants[self._acting].residual
        return residual.bind(none, facets, {self.u0: u0, self.u1: u1})

    @property
    def residual_form(self) -> ufl.Form:
        """The virtual work as it is compiled for the effects that act."""
        return self._variants[self._acting].residual.form

    @property
    def viscous_terms(self) -> list[tuple[int, FormTerm]]:
        """The viscous stresses that act, each with its number."""
        terms = ((k, self._terms[k][1]) for k in self._acting[1])
        return [(k, term) for k, term in terms if term.viscous]

    @property
    def viscous(self) -> bool:
        """Whether a viscous stress acts: one that grows with 1/Δt."""
        return any(self._terms[k][1].viscous for k in self._acting[1])

    def set_rate(self, rate: float) -> None:
        """Set 1/Δt of the viscous stresses [1/s]."""
        for k in self._acting[1]:
            self._terms[k][1].set_rate(rate)

    def bind_energy(self, cells: Cells, u: fem.Function | None = None) -> fem.Form:
        """Stored energy at u over the given cells, at `u0` if None."""
        return self._energy.bind(cells, instead=None if u is None else {self.u0: u})

    def bind_taken(self, cells: Cells, driven: Cells | None = None) -> Taken:
        """Energy that terms take out of the motion of flexible cells, and of driven ones' loads."""
        variant = self._variants[self._acting]
        facets = self.facets_of(cells, driven or {})
        against = variant.against_loads
        return Taken(
            {
                kind: kernel.bind({i: cells[i] for i in kernel.ids})
                for kind, kernel in variant.dissipated.items()
            },
            [] if against is None else [against.bind({}, facets)],
        )
