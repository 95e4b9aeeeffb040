"""Values of expressions of numbers."""

from __future__ import annotations

from typing import Any

from ufl import classes
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.corealg.traversal import unique_pre_traversal

__all__ = ["evaluated"]

NUMBERS = classes.ConstantValue, classes.MultiIndex, classes.Label


def evaluated(expression: Any) -> float:
    """The value of a scalar expression of UFL that holds numbers only.

    UFL itself asks a function on a mesh for its value at no point in two ways, each of which asks
    again: it never returns.

    Args:
        expression: Without derivatives that are still to be applied.

    Raises:
        TypeError: If it depends on the place, by a function on a mesh or the shape of cells, say.
    """
    lowered = apply_algebra_lowering(expression)
    for o in unique_pre_traversal(lowered):
        if o._ufl_is_terminal_ and not isinstance(o, NUMBERS) and not _is_number(o):
            raise TypeError(f"{type(o).__name__} has no value without a place.")
    return float(lowered(()))


def _is_number(o: Any) -> bool:
    """Whether it is a constant that knows its value."""
    return isinstance(o, classes.Constant) and o.ufl_shape == () and hasattr(o, "value")
