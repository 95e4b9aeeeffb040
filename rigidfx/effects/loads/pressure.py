"""Follower pressure: on flexible cells a term of the compiled forms, on bodies in closed form.

The force on the nodes is -∫ p cof(F½) N Nᵢ dA. Where a body has the deformation gradient R F_f, the
midpoint's is R_av F_f with R_av = ½ (R₀ + R₁) = (I - ½θ̂)⁻¹ R₀, so that cof F½ = cof(R_av) cof F_f
with cof(R_av) = T R₀, T the Cayley map's tangent: one matrix rotates the
forces at its nodes. A step therefore needs no facets of frozen cells, and momenta and work come out
as if it had them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Any, ClassVar

import numpy as np
import ufl
from dolfinx import fem

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import is_function, number, scalar
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.action import Action, FormTerm, Structure
from rigidfx.effects.base import Scaled, mean_over
from rigidfx.effects.nodes import Motion, Tangent
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.element import Element
from rigidfx.mechanics.rotation import IDENTITY


def _number_or_function(owner: str, name: str, value: Any) -> None:
    if not is_function(value):
        number(owner, name, value)


@dataclass(frozen=True)
class Pressure(Scaled):
    """Pressure on the deformed boundary: the force -p n da, with n da = cof(F½) N dA.

    On a closed surface it changes neither linear nor angular momentum. It has no potential in
    general; its work is reported with that of the other loads.

    Attributes:
        where: Name of a set of boundary facets.
        value: p [Pa], positive where it pushes inwards, or a function of time giving it.
    """

    checks: ClassVar[Checks] = Scaled.checks | {"value": _number_or_function}

    where: str
    value: float | Callable[[float], float]

    def intensity(self, t: float) -> float:
        """Pressure at t [Pa]; zero outside the window. `SceneError` if it is no finite number."""
        if not self.acts(t):
            return 0.0
        value = self.value(t) if is_function(self.value) else self.value
        pressure = scalar(value) * self.factor(t)
        if not isfinite(pressure):
            raise SceneError(
                f"{self.owner}: at t = {t:g} s it is {pressure}; check its value and time function."
            )
        return pressure

    def check(self, scene: Any) -> None:
        """Look its facets up, and see whether its function of time can be used."""
        scene.boundary(self.where, self.kind)
        function = f"{self.owner}: its value or time function"
        together(scene.comm, function, partial(self.intensity, self.start))

    def signal(self, t: float, dt: float) -> Array:
        """The pressure."""
        return np.array([self.intensity(t)])

    def pushes(self, t: float) -> tuple[str, float]:
        """Its facets and the size of the pressure."""
        return self.where, abs(self.intensity(t))

    def term(self, mesh: Any) -> FormTerm:
        """The pressure on flexible cells."""
        return PressureTerm(self, mesh)

    def bind(self, structure: Structure) -> Action | None:
        """The pressure on rigid bodies."""
        return RotatedPressure(self, structure) if len(structure.bodies) else None


class PressureTerm(FormTerm):
    """-p n da as an integral over facets."""

    kind = Pressure.__name__
    boundary = True
    dissipates = False

    def __init__(self, effect: Pressure, mesh: Any) -> None:
        self._effect, self._mesh = effect, mesh
        self._p = fem.Constant(mesh, 0.0)

    def set_time(self, t: float, dt: float) -> None:
        """Set p."""
        self._p.value = mean_over(self._effect.intensity, t, dt)

    def virtual_work(self, element: Element, u0: Any, u1: Any, w: Any) -> Any:
        """The integrand p cof(F½) N·w."""
        F = element.deformation_gradient((u0 + u1) / 2)
        n = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(self._mesh)
        return self._p * ufl.inner(n, w)


class RotatedPressure(Action):
    """A pressure on the bodies; where these deform, its forces are of first order in the shapes."""

    kind = Pressure.__name__
    dissipates = False

    def __init__(self, effect: Pressure, structure: Structure) -> None:
        """Find the forces for p = 1, pushing outwards, in the bodies' frames. Collective."""
        self._effect, self._bodies = effect, structure.bodies
        where, surface = (effect.where, effect.kind, structure.bodies), structure.surface
        self._moments = surface.outward_moments(*where)
        deform = structure.bodies.of.shapes is not None
        self._slopes = surface.outward_slopes(*where) if deform else None
        self._p, self._over = 0.0, structure.over

    def _unit(self, increments: Increments) -> Array:
        """Σ a fᵀ for p = 1 at the place where forces are taken, (bodies, n, 3) [m², m³]."""
        if self._slopes is None:
            return self._moments
        q = increments.start.q - self._bodies.q + increments.step.share * increments.unknowns[:, 6:]
        return np.asarray(self._moments + np.einsum("bk,kbni->bni", q, self._slopes))

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate p."""
        self._p = mean_over(self._effect.intensity, t, self._over(dt))

    def _turned(self, increments: Increments) -> Array:
        """Moments in space."""
        return np.asarray(self._p * (self._unit(increments) @ increments.turned.swapaxes(1, 2)))

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add the moments in space."""
        forces.moments[...] += self._turned(motion.increments)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add the derivative of the moments by turns and shapes.

        d(T a) = (½ w × a - ½ (θ·w) T a)/(1 + ¼ |θ|²) in the direction w; in statics that of R₁ a is
        T w × R₁ a.
        """
        increments = motion.increments
        turned, of = self._turned(increments), increments.start.of
        theta = increments.theta
        scale = 1 / of.length
        if not (static := increments.step.share == 1.0):
            scale = 0.5 * scale / (1 + 0.25 * (theta * theta).sum(axis=1))
        a = self._p * (self._unit(increments) @ increments.start.R.swapaxes(1, 2))
        for j, w in enumerate(IDENTITY):
            if static:
                change = np.cross(increments.T[:, None, :, j], turned)
            else:
                change = np.cross(w, a) - theta[:, j, None, None] * turned
            tangent.moments[:, :, 3 + j] += (scale[:, None, None] * change).reshape(len(a), -1)
        if self._slopes is not None:
            by_q = increments.step.share * self._p * self._slopes
            by_q = by_q @ increments.turned.swapaxes(1, 2)
            tangent.moments[:, :, 6:] += np.moveaxis(by_q, 0, -1).reshape(len(a), -1, len(by_q))

    def taken(self, motion: Motion) -> float:
        """Work against the pressure in a step [J]."""
        increments = motion.increments
        return increments.work(increments.resultant(self._turned(increments)))
