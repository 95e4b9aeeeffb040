"""Damping: viscous stresses, ξ of the scheme and drags; centrifugal forces of statics.

Forces proportional to mass are a resistance s M x, with x of the nodes and, of bodies, matrices X
as their poses: a body has s Σ m a aᵀ X. A drag on velocities takes x = Δu.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar, Literal

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.effects.action import Action, FormTerm, Structure
from rigidfx.effects.base import Effect, Windowed
from rigidfx.effects.nodes import Forces, Motion, Tangent
from rigidfx.mechanics.element import Element, Portion
from rigidfx.mechanics.schemes import Law, initial_stiffness_times

Share = Callable[[], float]


class ViscousTerm(FormTerm):
    """A stress S = η ΔE/Δt in the compiled forms."""

    viscous = True
    law: Literal["elastic", "viscous"] = "viscous"  # what the modulus multiplies: see `Portion`

    def __init__(self, kind: str, modulus: float, mesh: Any) -> None:
        """Store the modulus η [Pa s], and the constant of the forms that is modulus/Δt."""
        self.kind, self._modulus, self._rate = kind, modulus, fem.Constant(mesh, modulus)

    def set_time(self, t: float, dt: float) -> None:
        """Set modulus/Δt; an instant has no rate."""
        self.set_rate(1 / dt if dt else 0.0)

    def set_rate(self, rate: float) -> None:
        """Set the modulus times a rate [1/s]."""
        self._rate.value = self._modulus * rate

    def increment(self, element: Element, u0: Any, u1: Any) -> Any:
        """ΔE of a step from u₀ to u₁."""
        return element.viscous_strain_increment(u0, u1)

    def stress(self, dE: Any) -> Any:
        """S by ΔE [Pa]."""
        return self._rate * dE

    def virtual_work(self, element: Element, u0: Any, u1: Any, w: Any) -> Any:
        """F½ S : Grad w."""
        S, portion = self.stress(self.increment(element, u0, u1)), (u1, u0, 0.0, self._rate)
        return element.virtual_work(S, (Portion(self.law, *portion),), (u0, u1), w)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """The derivative of S by u₁ at F½."""
        return element.viscous_eliminated((u0, u1), u1, self._rate, w, du)

    def taken(self, element: Element, u0: Any, u1: Any) -> Any:
        """S:ΔE [J/m³]."""
        dE = self.increment(element, u0, u1)
        return ufl.inner(self.stress(dE), dE)


class ProportionalTerm(ViscousTerm):
    """S = β ℂ₀:ΔE/Δt in the compiled forms, of one law; its modulus is β [s]."""

    law = "elastic"
    _law: Law

    def of(self, law: Law) -> "ProportionalTerm":
        """The stress in cells of a law."""
        out = copy(self)
        out._law = law
        return out

    def increment(self, element: Element, u0: Any, u1: Any) -> Any:
        """ΔE of a step from u₀ to u₁."""
        return element.strain_increment(u0, u1)

    def stress(self, dE: Any) -> Any:
        """S by ΔE [Pa]."""
        return self._rate * initial_stiffness_times(self._law.energy, self._law.parameters, dE)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """The derivative of S by u₁ at F½."""
        return element.eliminated((u0, u1), u1, 0.0, self._rate, w, du)


@dataclass(frozen=True)
class KelvinVoigt(Windowed):
    """Objective viscous stress S = η ΔE/Δt, which takes ∫ η ΔE:ΔE/Δt dV per step.

    It depends on strain rates only, so it damps neither rigid motions nor rigid bodies. Effects on
    the same cells add up.

    Attributes:
        eta: Viscosity η > 0 [Pa s].
        where: Name of a set of cells; everywhere if None.
    """

    checks: ClassVar[Checks] = {"eta": positive}
    on_cells: ClassVar[bool] = True

    eta: float
    where: str | None = None

    def term(self, mesh: Any) -> FormTerm:
        """The viscous stress."""
        return ViscousTerm(self.kind, float(self.eta), mesh)


@dataclass(frozen=True)
class StiffnessDamping(Windowed):
    """Viscous stress S = β ℂ₀:ΔE/Δt with β = ζ/(π f), ℂ₀ the material's stiffness when unstrained.

    A linear vibration at the frequency f has the damping ratio ζ; the ratio is proportional to the
    frequency. It damps neither rigid motions nor rigid bodies, and dissipates
    β ∫ ΔE:ℂ₀:ΔE/Δt dV per step. `MassDamping` is the other part of Rayleigh's damping.

    Attributes:
        ratio: Damping ratio ζ > 0 of a vibration, 1 where it is critical.
        frequency: Its frequency f > 0 [Hz].
        where: Name of a set of cells; everywhere if None.
    """

    checks: ClassVar[Checks] = {"ratio": positive, "frequency": positive}
    on_cells: ClassVar[bool] = True

    ratio: float
    frequency: float
    where: str | None = None

    @property
    def beta(self) -> float:
        """β [s]."""
        return float(self.ratio) / (pi * float(self.frequency))

    def check(self, scene: Any) -> None:
        """Look its cells up; warn of a ratio at which nothing vibrates."""
        super().check(scene)
        warn_of_ratio(scene.comm, self.owner, self.ratio)

    def term(self, mesh: Any) -> FormTerm:
        """The viscous stress."""
        return ProportionalTerm(self.kind, self.beta, mesh)


def warn_of_ratio(comm: MPI.Intracomm, owner: str, ratio: float) -> None:
    """Warn of a damping ratio above the critical one."""
    if ratio > 1:
        warn(
            comm,
            f"{owner}: the damping ratio {ratio:.3g} is above the critical one, 1, so that nothing "
            "vibrates. Two per cent are 0.02.",
        )


@dataclass(frozen=True)
class NumericalDamping(Windowed):
    """High-frequency dissipation of Armero and Petöcz, equation (22): ξ ∫ ΔE:ℂ₀:ΔE dV per step.

    The ends of its window release no rigid body.

    Attributes:
        xi: ξ ≥ 0, dimensionless; the scheme is of first order in Δt where ξ > 0.
    """

    xi: float

    def __post_init__(self) -> None:
        """Raise `SceneError` if ξ is negative, above ½ or not finite."""
        super().__post_init__()
        if not 0 <= number("NumericalDamping", "xi", self.xi) <= 0.5:
            raise SceneError(f"NumericalDamping: xi must lie in [0, 1/2], got {shown(self.xi)}.")

    @property
    def numerical_damping(self) -> float:  # type: ignore[override]
        """ξ."""
        return float(self.xi)


class MassForces(Action):
    """A resistance s M x; `destroy` frees its work vectors."""

    def __init__(self, structure: Structure, factor: Callable[[Motion], float]) -> None:
        """Store the mass of nodes and bodies, and s as a function of an iterate. Collective."""
        self._mass, n = structure.mass, structure.bodies.pose.shape[1]
        self._factor = factor
        self._spread: Array = np.zeros((len(structure.bodies), n, n))  # Σ m a aᵀ, on the first rank
        for k, body in enumerate(structure.bodies.of.records):
            products = structure.once * body.mass_products
            self._spread[k, : len(products), : len(products)] = products
        self._field, self._image = structure.rows.vector(), structure.rows.vector()

    def moved(self, motion: Motion) -> tuple[Any, Array]:
        """x of the nodes of the rows, a vector, and X of bodies, shape (bodies, n, 3)."""
        raise NotImplementedError

    def resist(self, motion: Motion, forces: Forces) -> None:
        """Add s M x."""
        factor, (at_nodes, of_bodies) = self._factor(motion), self.moved(motion)
        self._mass.mult(at_nodes, self._image)
        forces.vector.axpy(factor, self._image)
        if len(of_bodies):
            forces.moments[...] += factor * (self._spread @ of_bodies)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add s M."""
        factor = self._factor(motion)
        self._mass.add_to(tangent.matrix, factor, tangent.prolongation)
        tangent.add_spread(self._spread, factor * np.eye(3))

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        self._field.destroy()
        self._image.destroy()


@dataclass(frozen=True)
class MassDamping(Windowed):
    """Drag proportional to mass: the force -α M Δu/Δt, on flexible nodes and on rigid bodies.

    It damps rigid motion too, as a surrounding fluid would; a mode of angular frequency ω gets the
    damping ratio α/(2 ω). The ends of its window release no rigid body.

    Attributes:
        alpha: α > 0 [1/s].
    """

    checks: ClassVar[Checks] = {"alpha": positive}

    alpha: float

    @property
    def mass_damping(self) -> float:  # type: ignore[override]
        """α [1/s]."""
        return float(self.alpha)

    def bind(self, structure: Structure) -> Action:
        """The drag on nodes and bodies."""
        return Drag(structure, lambda motion: float(self.alpha) / motion.dt)


class Drag(MassForces):
    """The force α M Δu/Δt as a resistance; its rounding is below that of inertia.

    A body has -α m Δr/Δt and -α I_av θ/Δt, I_av = tr(B) I - B with B = R_av (Σ m V Vᵀ) R_avᵀ.
    """

    kind = MassDamping.__name__

    def moved(self, motion: Motion) -> tuple[Any, Array]:
        """Δu [m]."""
        return motion.d, motion.increments.displacement

    def taken(self, motion: Motion) -> float:
        """α Δu·M Δu/Δt [J]."""
        at_nodes, of_bodies = self.moved(motion)
        self._mass.mult(at_nodes, self._image)
        own = float(at_nodes.array_r @ self._image.array_r)
        return self._factor(motion) * (own + float(np.vdot(of_bodies, self._spread @ of_bodies)))


def rayleigh(
    first: float, second: float, ratio: float, second_ratio: float | None = None
) -> tuple[MassDamping, StiffnessDamping]:
    """Rayleigh damping with given damping ratios at two frequencies.

    A mode of angular frequency ω has the ratio ζ = α/(2ω) + βω/2 (R. W. Clough and J. Penzien,
    Dynamics of Structures, 3rd ed., Section 12-5). Between both frequencies ζ is lower than at
    them, outside it is higher.

    Example:
        >>> found = modes(scene, 3).frequencies                       # doctest: +SKIP
        >>> effects = [Fixed("x0"), *rayleigh(found[0], found[2], 0.02)]

    Args:
        first: Frequency [Hz], such as that of the first mode.
        second: Another one, higher [Hz].
        ratio: Damping ratio ζ at the first, 1 where it is critical.
        second_ratio: Damping ratio at the second; the same if None.

    Returns:
        Both effects, for the list of a scene's effects.

    Raises:
        SceneError: If a number cannot be used, or no α > 0 and β > 0 give these ratios.
    """
    f1, f2 = positive("rayleigh", "first", first), positive("rayleigh", "second", second)
    z1 = positive("rayleigh", "ratio", ratio)
    z2 = z1 if second_ratio is None else positive("rayleigh", "second_ratio", second_ratio)
    warn_of_ratio(MPI.COMM_WORLD, "rayleigh", max(z1, z2))
    if not f1 < f2:
        raise SceneError(f"rayleigh: first must be below second, got {f1:g} and {f2:g} Hz.")
    w1, w2 = 2 * pi * f1, 2 * pi * f2
    beta = 2 * (z2 * w2 - z1 * w1) / (w2**2 - w1**2)
    alpha = 2 * z1 * w1 - beta * w1**2
    if not (alpha > 0 and beta > 0):
        raise SceneError(
            f"rayleigh: no α > 0 and β > 0 give the ratio {z1:g} at {f1:g} Hz and {z2:g} at {f2:g} "
            f"Hz: the second must lie between {z1 * f1 / f2:.4g} and {z1 * f2 / f1:.4g}. Take "
            "MassDamping or StiffnessDamping alone beyond."
        )
    return MassDamping(alpha), StiffnessDamping(beta * pi * f1, f1)


@dataclass(frozen=True)
class StaticForces(Effect):
    """Forces of statics only, which `of` makes for a division."""

    of: Callable[[Structure], Action]

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes and bodies."""
        return self.of(structure)


class StepDrag(MassForces):
    """The drag on increments, s M (x - x*) as a resistance; its `rate` is s [1/s²].

    It makes statics of loose parts regular. Where places x* near an equilibrium follow the solution
    it vanishes: a proximal point method (R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877).
    Each solve is an implicit Euler step of length s^(-1/2) from rest, and leads to stable
    equilibria.
    """

    kind = "StepDrag"

    def __init__(self, structure: Structure) -> None:
        """Draw to the start. Collective."""
        super().__init__(structure, lambda motion: self.rate)
        self.rate, self._pose = 1.0, structure.bodies.pose
        self._centre: Array = np.zeros(self._field.local_size)

    def draw_to(self, d: Array, pose: Array) -> None:
        """Set x*: increments of the rows in the step [m], and matrices of the places of bodies."""
        self._centre, self._pose = d, pose

    def moved(self, motion: Motion) -> tuple[Any, Array]:
        """x - x* [m]."""
        self._field.array[:] = motion.array_r - self._centre
        increments = motion.increments
        return self._field, increments.start.pose - self._pose + increments.displacement


class Centrifugal(MassForces):
    """-M S (x - c) as a resistance, S = |ω|² I - ω ωᵀ: the load -M ω × (ω × (x - c)) of statics."""

    kind = "Preload"

    def __init__(
        self, spin: Array, centre: Array, structure: Structure, share: Share | None = None
    ) -> None:
        """Store ω [rad/s], c [m], and the share of the forces that acts in increments of a load.

        All of them act if it is None, and the stiffness of nodes is left to others. Collective.
        """
        super().__init__(structure, lambda motion: -1.0 if share is None else -share())
        rows, self._with_nodes = structure.rows, share is not None
        self._S = spin @ spin * np.eye(3) - np.outer(spin, spin)
        self._u0, self._dofs, self._arms = structure.u, rows.dofs, rows.X - centre
        self._axis = np.zeros_like(structure.bodies.pose)
        self._axis[:, 0] = centre
        self._nodes = rows.nodes[np.flatnonzero(structure.own)]
        self._own_mass = structure.scene.nodal_mass[self._nodes]
        mass = structure.scene.sum(self._own_mass.sum())
        largest = structure.scene.comm.allreduce(np.abs(self._arms).max(initial=0.0))
        self.rounding = float(np.linalg.norm(self._S)) * mass * largest

    def moved(self, motion: Motion) -> tuple[Any, Array]:
        """S (x - c) [m/s²]."""
        arms = self._arms + self._u0[self._dofs].reshape(-1, 3) + motion.nodes
        self._field.array[:] = (arms @ self._S).reshape(-1)
        increments = motion.increments
        places = increments.start.pose + increments.displacement - self._axis
        return self._field, places @ self._S

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add -M S; of a consistent mass by row sums: iterations see it, the solution not."""
        softening = self._factor(motion) * self._S
        tangent.add_spread(self._spread, softening)
        if self._with_nodes:
            tangent.matrix.add_nodal(self._nodes, self._own_mass[:, None, None] * softening)
