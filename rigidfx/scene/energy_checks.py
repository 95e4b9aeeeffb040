"""Is a stored energy of a user's one: a scalar that depends on C, and finite and stable at rest?"""

from __future__ import annotations

import numpy as np
import ufl

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.domain.domain import Domain
from rigidfx.mechanics.evaluated import evaluated
from rigidfx.mechanics.materials import Hyperelastic, Material

__all__ = ["check_energy"]

STEP = 1e-3  # of C, for differences of W about rest
STRESSED = 1e-2  # stress at rest over stiffness; differences know it to 1e-3


def check_energy(domain: Domain, material: Material) -> None:
    """Check a stored energy as far as its formula tells.

    Args:
        domain: The mesh on which it is to be.
        material: A material, whose energy may be a user's function.

    Raises:
        SceneError: If it cannot be formed, is no scalar, does not depend on C or knows another
            mesh, or is not finite at rest.
    """
    owner = getattr(material, "label", type(material).__name__)
    C = ufl.variable(ufl.Constant(domain.mesh.ufl_domain(), shape=(3, 3)))
    try:
        W = ufl.as_ufl(material.energy(C, **material.parameters))
    except Exception as error:  # whatever a user's function may raise
        raise SceneError(
            f"Scene: the stored energy of {owner} cannot be formed: {type(error).__name__}: "
            f"{error}. It must be a function of C and of the parameters that are given, written "
            "with functions of UFL (ufl.exp, not math.exp)."
        ) from error
    if W.ufl_shape != ():
        raise SceneError(f"Scene: the stored energy of {owner} must be a scalar.")
    meshes = ufl.domain.extract_domains(W)
    if not meshes:
        raise SceneError(f"Scene: the stored energy of {owner} does not depend on C.")
    if len(meshes) > 1:
        raise SceneError(f"Scene: the stored energy of {owner} is of another mesh than the scene.")
    if isinstance(material, Hyperelastic):
        _check_rest(domain, owner, material)


def _check_rest(domain: Domain, owner: str, material: Material) -> None:
    """Look at the energy about C = I by differences, if UFL can evaluate it."""
    rest = np.eye(3)
    try:
        W0 = _value(material, rest)
        slopes, curvatures = np.transpose([_differences(material, rest, W0, k) for k in range(6)])
    except (ArithmeticError, ValueError):  # such as the logarithm of what is not above zero
        W0, slopes, curvatures = np.nan, *np.full((2, 6), np.nan)
    except Exception:  # it depends on the place, or has functions that UFL does not evaluate
        return
    if not np.isfinite(np.r_[W0, slopes, curvatures]).all():
        raise SceneError(f"Scene: the stored energy of {owner} is not finite at rest, C = I.")
    stiffness = float(np.abs(curvatures).max())
    if curvatures.min() < -STRESSED * stiffness:
        warn(
            domain.comm,
            f"Scene: the stored energy of {owner} falls where rest is strained, by "
            f"{-curvatures.min():.3g} Pa: such a material is not stable. Look at its signs.",
        )
    stress = float(np.abs(slopes).max())
    if stress > STRESSED * stiffness:
        warn(
            domain.comm,
            f"Scene: the stored energy of {owner} has a stress of {stress:.3g} Pa at rest, C = I, "
            "so that the mesh is not its shape without loads: it will spring into another one. "
            "Subtract what is linear in C, if that is not meant.",
        )


def _differences(material: Material, rest: Array, W0: float, k: int) -> tuple[float, float]:
    """2 ∂W/∂C and 4 ∂²W/∂C² along the k-th strain, xx, yy, zz, yz, zx or xy [Pa]."""
    direction = np.zeros((3, 3))
    i, j = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)][k]
    direction[i, j] = direction[j, i] = STEP
    ahead, behind = (_value(material, rest + sign * direction) for sign in (1, -1))
    return (ahead - behind) / STEP, 4 * (ahead - 2 * W0 + behind) / STEP**2


def _value(material: Material, C: Array) -> float:
    """W at a C of numbers [J/m³]."""
    W = material.energy(ufl.as_matrix(C.tolist()), **material.parameters)
    with np.errstate(all="ignore"):
        return evaluated(ufl.as_ufl(W))
