"""How well floating-point numbers know a stored energy: a running error analysis of its formula.

An energy may be the small difference of large numbers, and of how large ones only its formula
tells: neo-Hooke's tr C - 3 is known to 3 ε however small the strain, E:E to ε of itself. The
formula is followed as by N. J. Higham, Accuracy and Stability of Numerical Algorithms (2002),
section 3.3: a result has the errors of its arguments, times derivatives, and ε of itself.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import ufl
from ufl import classes
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.expand_indices import expand_indices

from rigidfx.mechanics.materials import Energy

__all__ = ["rounding_of_energy"]


def rounding_of_energy(energy: Energy, C: Any, p: dict[str, Any]) -> Any:
    """Rounding of W(C), in units of the machine precision [J/m³].

    C and the parameters count as exact: those are compared that know the same ones.

    Args:
        energy: Stored energy W(C, **p).
        C: Right Cauchy-Green tensor.
        p: Parameters of the energy.
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
