"""How stiff a stored energy is at rest: λ and μ, those of a mean if it has directions."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from ufl import classes
from ufl.algorithms import expand_derivatives
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.corealg.traversal import unique_pre_traversal

from rigidfx.base.types import Array
from rigidfx.mechanics.materials import Isotropic, Material
from rigidfx.mechanics.schemes import initial_stiffness_times

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


def rest_moduli(material: Material) -> tuple[float, float] | None:
    """λ and μ [Pa] of ℂ₀ = ∂²W/∂E² at C = I; of its isotropic part, if it has directions.

    The isotropic part is the mean over all rotations: with K = ℂ_iijj/9 the mean bulk modulus,
    μ = (ℂ_ijij - 3 K)/10 and λ = K - 2μ/3.

    Returns:
        None if UFL cannot evaluate its energy, as it depends on the place, or if they are not those
        of a stable material.
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
