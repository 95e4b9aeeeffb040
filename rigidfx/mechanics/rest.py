"""How stiff a stored energy is at rest: λ and μ, those of a mean if it has directions."""

from __future__ import annotations

import numpy as np
import ufl
from ufl.algorithms import expand_derivatives

from rigidfx.base.types import Array
from rigidfx.mechanics.evaluated import evaluated
from rigidfx.mechanics.materials import Isotropic, Material
from rigidfx.mechanics.schemes import initial_stiffness_times

__all__ = ["rest_moduli"]


def rest_moduli(material: Material) -> tuple[float, float] | None:
    """λ and μ [Pa] of ℂ₀ = ∂²W/∂E² at C = I; of its isotropic part, if it has directions.

    The isotropic part is the mean over all rotations: with K = ℂ_iijj/9 the mean bulk modulus,
    μ = (ℂ_ijij - 3 K)/10 and λ = K - 2μ/3.

    Args:
        material: Any.

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
