"""Energies and internal virtual work in UFL: equations (18)-(22) and the discrete gradient.

A *scheme* turns a material's stored energy into the internal virtual work of a step from u₀ to u₁,
∫ F½ S : Grad δu with the S of docs/theory.md, section 1; material, scheme and damping are chosen
independently. The correction of the discrete gradient has the defect d = 2 (W₁ - W₀) - S̄:M. Below
|M| = 1e-3 it is d⁵/(d⁴ + n⁴) in place of d, n = 16 ε (r(C₀) + |W₁|): all of it where it stands out
from rounding, nothing where it does not, and smooth between, as Newton's method needs it (figures:
docs/notes/step.md).

How large rounding is, r(C₀) ε, only the energy's formula tells: neo-Hooke's tr C - 3 is the small
difference of large numbers, known to 3 ε however small the strain, E:E to ε of itself. A running
error analysis follows the formula (N. J. Higham, Accuracy and Stability of Numerical Algorithms
(2002), section 3.3): a result has the errors of its arguments, times derivatives, and ε of itself.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import singledispatch
from math import sqrt
from typing import Any, ClassVar, Protocol

import numpy as np
import ufl
from ufl import classes
from ufl.algorithms import expand_derivatives
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.expand_indices import expand_indices
from ufl.corealg.traversal import unique_pre_traversal

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array
from rigidfx.mechanics.element import Element, Portion
from rigidfx.mechanics.materials import Energy, Isotropic, Material

GUARD = 1e-6  # M:M below which the correction of the discrete gradient may be rounding only
TINY = 1e-13  # M:M below which it is so for any energy that can be computed with
NOISE = 16 * sys.float_info.epsilon  # of the numbers that a stored energy is the difference of


def rounding_of_energy(energy: Energy, C: Any, p: dict[str, Any]) -> Any:
    """Rounding of W(C), in units of the machine precision [J/m³].

    C and the parameters count as exact: those are compared that know the same ones.
    """
    C = _without_variables(C, set())
    exact = ufl.as_matrix([[ufl.variable(C[i, j]) for j in range(3)] for i in range(3)])
    W = apply_algebra_lowering(ufl.as_ufl(energy(exact, **p)))
    labels = {exact[i, j].label() for i in range(3) for j in range(3)}
    W = expand_indices(_without_variables(apply_derivatives(W), labels))
    return _Errors().of(W)


def _without_variables(o: Any, kept: set[Any]) -> Any:
    """An expression without variables but some: UFL takes all entries of a tensor's for one."""
    found: dict[Any, Any] = {}

    def plain(o: Any) -> Any:
        if isinstance(o, classes.Terminal) or (
            isinstance(o, classes.Variable) and o.label() in kept
        ):
            return o
        if o not in found:
            operands = [plain(x) for x in o.ufl_operands]
            known = isinstance(o, classes.Variable)
            found[o] = operands[0] if known else o._ufl_expr_reconstruct_(*operands)
        return found[o]

    return plain(o)


class _Errors:
    """Errors of numbers, each found once."""

    def __init__(self) -> None:
        self._found: dict[Any, Any] = {}

    def of(self, o: Any) -> Any:
        """The error of a number, in units of the machine precision; zero if it is exact."""
        if o not in self._found:
            self._found[o] = _error(o, self)
        return self._found[o]


@singledispatch
def _error(o: Any, errors: _Errors) -> Any:
    """Of a function f of numbers x: |f| + Σ |∂f/∂x| times the error of x."""
    given = o.ufl_operands
    known = [errors.of(x) for x in given]
    xs = [x if _is_zero(e) else ufl.variable(x) for x, e in zip(given, known, strict=True)]
    f = o._ufl_expr_reconstruct_(*xs)
    inexact = [(x, e) for x, e in zip(xs, known, strict=True) if not _is_zero(e)]
    return abs(o) + sum(abs(ufl.diff(f, x)) * e for x, e in inexact)


def _is_zero(expression: Any) -> bool:
    return isinstance(expression, classes.Zero)


@_error.register(classes.Terminal)
@_error.register(classes.Indexed)
@_error.register(classes.Variable)
def _of_given(o: Any, errors: _Errors) -> Any:
    return classes.Zero()


@_error.register
def _of_sum(o: classes.Sum, errors: _Errors) -> Any:
    return sum((errors.of(x) for x in o.ufl_operands), abs(o))


@_error.register
def _of_product(o: classes.Product, errors: _Errors) -> Any:
    a, b = o.ufl_operands
    return abs(o) + errors.of(a) * abs(b) + abs(a) * errors.of(b)


@_error.register
def _of_power(o: classes.Power, errors: _Errors) -> Any:
    base, exponent = o.ufl_operands
    error = errors.of(base) * abs(exponent * base ** (exponent - 1))
    return abs(o) + error + errors.of(exponent) * abs(o * ufl.ln(base))


@_error.register(classes.Abs)
@_error.register(classes.Conj)
@_error.register(classes.Real)
def _of_itself(o: Any, errors: _Errors) -> Any:
    return errors.of(o.ufl_operands[0])


@_error.register(classes.MinValue)
@_error.register(classes.MaxValue)
def _of_choice(o: Any, errors: _Errors) -> Any:
    return sum(errors.of(x) for x in o.ufl_operands)


@_error.register
def _of_conditional(o: classes.Conditional, errors: _Errors) -> Any:
    condition, *branches = o.ufl_operands
    return ufl.conditional(condition, *(errors.of(x) for x in branches))


def second_piola_kirchhoff(energy: Energy, C: Any, p: dict[str, Any]) -> Any:
    """S = 2 ∂W/∂C [Pa], symmetric whichever of C's components W names.

    W is differentiated as a function of the six components on and above the diagonal, C_ij in place
    of C_ji: an energy in Voigt's notation names one of the two only, and its derivative by nine
    components would have no symmetry, which makes energy out of nothing. The kernel of a tangent
    gets smaller, too, but for St.Venant-Kirchhoff's, which stays (operations in its source for
    hexahedra: neo-Hooke 6653 → 5933, Mooney-Rivlin 11078 → 9426).
    """
    C = ufl.variable(C)
    D = ufl.diff(energy(_from_upper(C), **p), C)  # zero below the diagonal, both sides' sum above
    return _from_upper(D + ufl.diag(D))


def _from_upper(A: Any) -> Any:
    """The symmetric tensor of the components on and above a tensor's diagonal."""
    return ufl.as_matrix([[A[min(i, j), max(i, j)] for j in range(3)] for i in range(3)])


def stored_energy(element: Element, law: Law, u: Any) -> Any:
    """W at the displacement u [J/m³]."""
    return law.energy(element.right_cauchy_green(u), **law.parameters)


def static_virtual_work(element: Element, law: Law, u: Any, w: Any) -> Any:
    """F S : Grad w at the displacement u: the internal virtual work of statics."""
    S = second_piola_kirchhoff(law.energy, element.right_cauchy_green(u), law.parameters)
    return element.virtual_work(S, (Portion("elastic", u),), (u,), w)


def initial_stiffness_times(energy: Energy, p: dict[str, Any], dE: Any) -> Any:
    """ℂ₀:ΔE, the derivative of S at C = I in the direction 2 ΔE."""
    s = ufl.variable(ufl.as_ufl(0.0))
    return ufl.diff(second_piola_kirchhoff(energy, ufl.Identity(3) + 2 * s * dE, p), s)


def discrete_gradient(energy: Energy, p: dict[str, Any], C0: Any, C1: Any) -> Any:
    """Stress with S:(C₁ - C₀) = 2 (W₁ - W₀), regular where C₁ → C₀."""
    M = C1 - C0
    points = ((1 - 1 / sqrt(3)) / 2, (1 + 1 / sqrt(3)) / 2)
    S = sum(second_piola_kirchhoff(energy, C0 + s * M, p) for s in points) / 2
    MM = ufl.inner(M, M)
    W0, W1 = energy(C0, **p), energy(C1, **p)
    defect = 2 * (W1 - W0) - ufl.inner(S, M)
    noise = NOISE * (rounding_of_energy(energy, C0, p) + abs(W1)) + 1e-300
    above = (defect / noise) ** 4 / (1 + (defect / noise) ** 4) * defect
    # Both branches of a conditional are evaluated: the denominator needs a guard of its own.
    small = ufl.lt(MM, TINY)
    known = ufl.conditional(ufl.lt(MM, GUARD), above, defect)
    return S + ufl.conditional(small, 0.0, known / ufl.conditional(small, 1.0, MM)) * M


@dataclass(frozen=True)
class Law:
    """The stored energy W(C, **parameters) [J/m³] of some cells, and whether it is quadratic in E.

    Parameters are UFL constants or functions by name.
    """

    energy: Energy
    quadratic: bool
    parameters: dict[str, Any]


class Scheme(Protocol):
    """A time integration scheme: the virtual work of a step, and three flags.

    Attributes:
        conserving: Whether energy is conserved for ξ = 0 whatever the step.
        damps: Whether numerical damping (22) goes with it.
        couples: Whether it couples to rigid bodies: forces are evaluated at ½ (u₀ + u₁).
    """

    conserving: ClassVar[bool]
    damps: ClassVar[bool]
    couples: ClassVar[bool]

    def virtual_work(self, element: Element, law: Law, u0: Any, u1: Any, w: Any, xi: Any) -> Any:
        """Integrand of the internal virtual work of a step.

        Args:
            element: How cells strain.
            law: Their stored energy.
            u0: Displacement at the start of the step.
            u1: Displacement at its end.
            w: Test function.
            xi: Damping ξ, or None where the scene names none.
        """
        ...

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any, xi: Any) -> Any:
        """Loss of its tangent by elimination within a cell; None if nothing.

        Asked only of conserving schemes, for elements with enhanced strains.
        """
        ...


@dataclass(frozen=True)
class EnergyMomentum:
    """Energy-Momentum Method: averaged stress or discrete gradient, optional damping (22)."""

    conserving: ClassVar[bool] = True
    damps: ClassVar[bool] = True
    couples: ClassVar[bool] = True

    def virtual_work(self, element: Element, law: Law, u0: Any, u1: Any, w: Any, xi: Any) -> Any:
        """F½ S_alg : Grad w."""
        energy, p = law.energy, law.parameters
        C0, C1 = element.right_cauchy_green(u0), element.right_cauchy_green(u1)
        portions: tuple[Portion, ...] = (Portion("elastic", u1),)
        if law.quadratic:
            # S is linear in C: the weighted mean of stresses is the stress of the weighted mean.
            weight = 0.5 if xi is None else 0.5 + xi
            S = second_piola_kirchhoff(energy, C0 + weight * (C1 - C0), p)
            portions = Portion("elastic", u0), Portion("elastic", u1, u0, 0.5, xi)
        else:
            S = discrete_gradient(energy, p, C0, C1)
            if xi is not None:
                S = S + xi * initial_stiffness_times(energy, p, (C1 - C0) / 2)
        return element.virtual_work(S, portions, (u0, u1), w)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any, xi: Any) -> Any:
        """(½ + ξ) ∂S₁/∂u₁ at F½."""
        return element.eliminated((u0, u1), u1, 0.5, xi, w, du)


@dataclass(frozen=True)
class Midpoint:
    """Implicit midpoint rule: S at ½ (u₀ + u₁). Conserves momenta, not energy."""

    conserving: ClassVar[bool] = False
    damps: ClassVar[bool] = False
    couples: ClassVar[bool] = True

    def virtual_work(self, element: Element, law: Law, u0: Any, u1: Any, w: Any, xi: Any) -> Any:
        """F½ S(½ (u₀ + u₁)) : Grad w."""
        return static_virtual_work(element, law, (u0 + u1) / 2, w)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any, xi: Any) -> Any:
        """Nothing: scenes refuse enhanced strains with this scheme."""
        return None


@dataclass(frozen=True)
class Trapezoidal:
    """Trapezoidal rule (Newmark, β = ¼, γ = ½), for comparison: angular momentum is not kept."""

    conserving: ClassVar[bool] = False
    damps: ClassVar[bool] = False
    couples: ClassVar[bool] = False

    def virtual_work(self, element: Element, law: Law, u0: Any, u1: Any, w: Any, xi: Any) -> Any:
        """½ (F₀ S₀ + F₁ S₁) : Grad w."""
        ends = [static_virtual_work(element, law, u, w) for u in (u0, u1)]
        return (ends[0] + ends[1]) / 2

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any, xi: Any) -> Any:
        """Nothing: scenes refuse enhanced strains with this scheme."""
        return None


def scheme_of(given: Any) -> Scheme:
    """The scheme that was given; the energy-momentum method if None, `SceneError` if it is none."""
    scheme: Scheme = EnergyMomentum() if given is None else given
    asked = "virtual_work", "conserving", "damps", "couples"
    if isinstance(given, type) or not all(hasattr(scheme, name) for name in asked):
        raise SceneError(
            f"Scene: scheme must be EnergyMomentum(), Midpoint() or Trapezoidal(), "
            f"got {shown(given)}."
        )
    return scheme


NUMBERS = classes.ConstantValue, classes.MultiIndex, classes.Label


def evaluated(expression: Any) -> float:
    """The value of a scalar expression of UFL that holds numbers only and no open derivatives.

    It raises `TypeError` where the expression depends on the place. UFL itself asks a function on a
    mesh for its value at no point in two ways, each of which asks again: it never returns.
    """
    lowered = apply_algebra_lowering(expression)
    for o in unique_pre_traversal(lowered):
        if o._ufl_is_terminal_ and not isinstance(o, NUMBERS) and not _is_number(o):
            raise TypeError(f"{type(o).__name__} has no value without a place.")
    return float(lowered(()))


def _is_number(o: Any) -> bool:
    """Whether it is a constant that knows its value."""
    return isinstance(o, classes.Constant) and o.ufl_shape == () and hasattr(o, "value")


def rest_moduli(material: Material) -> tuple[float, float] | None:
    """λ and μ [Pa] of ℂ₀ = ∂²W/∂E² at C = I; of its isotropic part, if it has directions.

    The isotropic part is the mean over all rotations: with K = ℂ_iijj/9 the mean bulk modulus, μ =
    (ℂ_ijij - 3 K)/10 and λ = K - 2μ/3. It is None if the energy depends on the place, so that UFL
    cannot evaluate it, or if the material is not stable.
    """
    if isinstance(material, Isotropic):
        return material.parameters["lmbda"], material.parameters["mu"]
    C = np.zeros((3, 3, 3, 3))
    try:
        for k in range(3):
            for m in range(k, 3):
                dE = np.zeros((3, 3))
                dE[k, m] += 0.5
                dE[m, k] += 0.5
                C[:, :, k, m] = C[:, :, m, k] = _stiffness_times(material, dE)
    except Exception:  # whatever UFL raises where it cannot evaluate
        return None
    bulk = np.einsum("iijj", C) / 9
    mu = (np.einsum("ijij", C) - 3 * bulk) / 10
    good = np.isfinite([bulk, mu]).all() and bulk > 0 and mu > 0
    return (float(bulk - 2 * mu / 3), float(mu)) if good else None


def _stiffness_times(material: Material, dE: Array) -> Array:
    """ℂ₀:ΔE of numbers [Pa]."""
    p = dict(material.parameters)
    S = initial_stiffness_times(material.energy, p, ufl.as_matrix(dE.tolist()))
    S = expand_derivatives(S)
    return np.array([[evaluated(S[i, j]) for j in range(3)] for i in range(3)])
