"""Materials: frozen parameter records in SI units, each with its stored energy in UFL.

A material gives its stored energy W per reference volume as a function of the right Cauchy-Green
tensor C, so that S = 2 ∂W/∂C is the second Piola-Kirchhoff stress. Parameters reach the compiled
form as constants (one material of a kind) or cell-wise constant coefficients (several): changing a
number never compiles anything anew.

A user's own energy is a `Hyperelastic` record or a subclass of `Material`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import ufl

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.taken import take_fields

Energy = Callable[..., Any]


def _lame(owner: object, E: float, nu: float) -> dict[str, float]:
    """Lamé parameters [Pa] from Young's modulus and Poisson's ratio, both checked."""
    positive(type(owner).__name__, "E", E)
    if not -1 < number(type(owner).__name__, "nu", nu) < 0.5:
        raise SceneError(
            f"{type(owner).__name__}: Poisson's ratio nu must lie inside (-1, 1/2), "
            f"got {shown(nu)}; "
            "for nearly incompressible behaviour take, say, 0.499 and second-order cells."
        )
    return {"lmbda": E * nu / ((1 + nu) * (1 - 2 * nu)), "mu": E / (2 * (1 + nu))}


@dataclass(frozen=True)
class Material:
    """The base of all materials: a density, parameters and a stored energy.

    Attributes:
        rho: Density in the reference configuration ρ0 [kg/m³].
        quadratic: True where W is quadratic in the Green-Lagrange strain, so that the averaged
            stress (21) conserves energy and no discrete gradient is needed.
    """

    rho: float
    quadratic: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Copy all values, and check the density.

        Raises:
            SceneError: If ρ0 is not a finite number above zero.
        """
        take_fields(self)
        positive(type(self).__name__, "rho", self.rho)

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameters of `energy` by name."""
        raise NotImplementedError

    @property
    def stiffness(self) -> float:
        """Its largest parameter: about how stiff it is [Pa]."""
        return float(max(map(abs, self.parameters.values()), default=0.0))

    @property
    def energy(self) -> Energy:
        """Stored energy W(C, **parameters) [J/m³] in UFL; equal functions share a kernel."""
        raise NotImplementedError


def _st_venant_kirchhoff(C: Any, lmbda: Any, mu: Any) -> Any:
    E = (C - ufl.Identity(3)) / 2
    return lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)


def _neo_hooke(C: Any, lmbda: Any, mu: Any) -> Any:
    log_J = ufl.ln(ufl.det(C)) / 2
    return mu / 2 * (ufl.tr(C) - 3 - 2 * log_J) + lmbda / 2 * log_J**2


def _mooney_rivlin(C: Any, c10: Any, c01: Any, kappa: Any) -> Any:
    J2 = ufl.det(C)
    I1 = ufl.tr(C)
    I2 = (I1**2 - ufl.tr(C * C)) / 2
    return (
        c10 * (J2 ** (-1 / 3) * I1 - 3)
        + c01 * (J2 ** (-2 / 3) * I2 - 3)
        + kappa / 2 * (ufl.sqrt(J2) - 1) ** 2
    )


@dataclass(frozen=True, kw_only=True)
class Isotropic(Material):
    """A material that two constants describe at small strain.

    Attributes:
        E: Young's modulus at small strain [Pa].
        nu: Poisson's ratio at small strain, inside (-1, 1/2).
    """

    E: float
    nu: float

    def __post_init__(self) -> None:
        """Check all parameters.

        Raises:
            SceneError: If ρ0 or E is not positive, or ν outside (-1, 1/2).
        """
        super().__post_init__()
        _lame(self, self.E, self.nu)

    @property
    def parameters(self) -> Mapping[str, float]:
        """Lamé parameters λ, μ [Pa]."""
        return _lame(self, self.E, self.nu)


@dataclass(frozen=True, kw_only=True)
class StVenantKirchhoff(Isotropic):
    """St.Venant-Kirchhoff: S = λ tr(E) I + 2 μ E, linear in the Green-Lagrange strain E."""

    quadratic: ClassVar[bool] = True

    @property
    def energy(self) -> Energy:
        """W = λ/2 tr(E)² + μ E:E."""
        return _st_venant_kirchhoff


@dataclass(frozen=True, kw_only=True)
class NeoHooke(Isotropic):
    """Compressible neo-Hooke: W = μ/2 (tr C - 3 - 2 ln J) + λ/2 (ln J)²."""

    @property
    def energy(self) -> Energy:
        """W = μ/2 (tr C - 3 - 2 ln J) + λ/2 (ln J)²."""
        return _neo_hooke


@dataclass(frozen=True, kw_only=True)
class MooneyRivlin(Material):
    """Compressible Mooney-Rivlin, W = c10 (Ī₁ - 3) + c01 (Ī₂ - 3) + κ/2 (J - 1)².

    Ī₁ = J^(-2/3) I₁ and Ī₂ = J^(-4/3) I₂; at small strain μ = 2 (c10 + c01).

    Attributes:
        c10: First parameter [Pa].
        c01: Second parameter [Pa], may be zero.
        kappa: Bulk modulus [Pa].
    """

    c10: float
    c01: float
    kappa: float

    def __post_init__(self) -> None:
        """Check all parameters.

        Raises:
            SceneError: If ρ0, κ or c10 + c01 is not positive, or c10 or c01 negative.
        """
        super().__post_init__()
        c10, c01 = (number("MooneyRivlin", name, getattr(self, name)) for name in ("c10", "c01"))
        positive("MooneyRivlin", "kappa", self.kappa)
        positive("MooneyRivlin", "c10 + c01", c10 + c01)
        if min(c10, c01) < 0:
            raise SceneError("MooneyRivlin: c10 and c01 must not be negative.")

    @property
    def parameters(self) -> Mapping[str, float]:
        """c10, c01, κ [Pa]."""
        return {"c10": self.c10, "c01": self.c01, "kappa": self.kappa}

    @property
    def energy(self) -> Energy:
        """W = c10 (Ī₁ - 3) + c01 (Ī₂ - 3) + κ/2 (J - 1)²."""
        return _mooney_rivlin


@dataclass(frozen=True, kw_only=True)
class Hyperelastic(Material):
    """A stored energy of the user's own.

    Example:
        >>> import ufl
        >>> def energy(C, mu, k):
        ...     return mu / 2 * (ufl.tr(C) - 3 - ufl.ln(ufl.det(C))) + k * (ufl.det(C) - 1) ** 2
        >>> rubber = Hyperelastic(rho=1100.0, W=energy, values={"mu": 1e6, "k": 1e7})

    Attributes:
        W: Function (C, **values) → stored energy per reference volume [J/m³] in UFL. It must have
            its minimum, without stress, at C = I.
        values: Its parameters by name; numbers.
        label: Name for messages.
    """

    W: Energy
    values: Mapping[str, float] = field(default_factory=dict)
    label: str = "Hyperelastic"

    def __post_init__(self) -> None:
        """Check the density and the parameters.

        Raises:
            SceneError: If ρ0 is not positive, W cannot be called, or values are no finite numbers
                by their names.
        """
        super().__post_init__()
        if not callable(self.W):
            raise SceneError(
                f"{self.label}: W must be a function of C giving UFL, got {shown(self.W)}."
            )
        if not isinstance(self.values, Mapping) or not all(isinstance(n, str) for n in self.values):
            raise SceneError(
                f"{self.label}: values must be a dict of names to numbers, "
                f"got {shown(self.values)}."
            )
        for name, value in self.values.items():
            number(self.label, f"parameter {name}", value)

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of W by name."""
        return self.values

    @property
    def energy(self) -> Energy:
        """The user's function W."""
        return self.W
