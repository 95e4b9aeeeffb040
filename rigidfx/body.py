"""One rigid body: its data, its motion, and its own part of a step's residual and tangent.

A body is frozen in the configuration of an instant: Vᵢ = xᵢ - x_s are its nodes' positions relative
to the centre of mass, and x_i = r + R Vᵢ from then on. The unknowns of a step are Δr and the Cayley
vector θ of the rotation increment,

    R1 = cay(θ) R0,    ṙ1 = 2 Δr/Δt - ṙ0,    W1 = 2 R0ᵀθ/Δt - W0,    π = R J W,

and the body's own part of the balance of momenta (12) reads m (ṙ1 - ṙ0)/Δt and (π1 - π0)/Δt. Then
Δr·m(ṙ1 - ṙ0)/Δt and θ·(π1 - π0)/Δt are exactly the increments of the kinetic energy (Simo and Wong,
IJNME 31 (1991) 19). In the vector of unknowns θ is multiplied by the length ℓ, ℓ² = tr J/(2 m), and
moments are divided by it: all unknowns are lengths and all residuals forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from rigidfx.rotation import IDENTITY, UNIT_SPINS, cayley_tangent, orthonormalized, skew

__all__ = [
    "TRANSLATIONS",
    "BodyMotion",
    "BodyTerm",
    "Frozen",
    "Increment",
    "RigidBody",
    "at_rest",
    "mass_block",
]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Frozen:
    """What a body keeps for its release. The deformed shape is kept by its offsets.

    Attributes:
        nodes: Owned nodes on this rank whose velocity the freeze changed.
        velocities: Rᵀ (v - v_rigid) at these nodes, shape (nodes, 3) [m/s]; equation (40).
        strain: Strain energy of its cells [J].
        vibration: Kinetic energy that the freeze took out of the motion; beside a support that
            moves it may be less than zero, with a consistent mass [J].
    """

    nodes: npt.NDArray[np.int32]
    velocities: Array
    strain: float
    vibration: float

    @property
    def energy(self) -> float:
        """Energy that the body gives back [J]."""
        return self.strain + self.vibration


# How the first of twelve numbers depend on a translation, see `Increment.L`.
TRANSLATIONS = np.eye(12, 6) * (np.arange(6) < 3)
NOTHING = Frozen(np.empty(0, np.int32), np.empty((0, 3)), 0.0, 0.0)


@dataclass(frozen=True)
class RigidBody:
    """What does not change while a body is rigid.

    Attributes:
        name: Its name in reports, that of a set of cells where a `Rigid` effect named it.
        cells: Owned cells on this rank, sorted.
        nodes: Owned nodes on this rank, sorted.
        offsets: V of these nodes in the body's frame, shape (nodes, 3) [m].
        mass: m [kg].
        inertia: J about the centre of mass in the body's frame, shape (3, 3) [kg m²].
        origin: Centre of mass at the freeze, shape (3,) [m].
        number: Its number ≥ 1, which no other body of the run has had.
        size: Number of its cells over all ranks.
        named: Sets of cells in it that are rigid always.
        given: Whether mass or inertia are given in place of those of its cells.
        frozen: What it keeps for its release.
    """

    name: str
    cells: npt.NDArray[np.int32]
    nodes: npt.NDArray[np.int32]
    offsets: Array
    mass: float
    inertia: Array
    origin: Array
    number: int = 1
    size: int = 0
    named: tuple[str, ...] = ()
    given: bool = False
    frozen: Frozen = NOTHING

    @cached_property
    def length(self) -> float:
        """ℓ = sqrt(tr J/(2 m)), the radius of gyration that scales rotations [m]."""
        return float(np.sqrt(np.trace(self.inertia) / (2 * self.mass)))

    @cached_property
    def arms_of_turns(self) -> Array:
        """-v̂/ℓ is v times this, row by row; shape (3, 9) [1/m]."""
        return np.asarray(UNIT_SPINS / -self.length)


@dataclass(frozen=True)
class BodyMotion:
    """Pose and velocity of a body.

    Attributes:
        r: Position of the centre of mass [m].
        R: Rotation since the freeze.
        velocity: ṙ [m/s].
        spin: W, angular velocity in the body's frame [rad/s].
    """

    r: Array
    R: Array
    velocity: Array
    spin: Array

    @property
    def angular_velocity(self) -> Array:
        """ω = R W in space [rad/s]."""
        return np.asarray(self.R @ self.spin)

    def angular_momentum(self, body: RigidBody) -> Array:
        """π = R J W about the centre of mass [kg m²/s]."""
        return np.asarray(self.R @ (body.inertia @ self.spin))

    def kinetic(self, body: RigidBody) -> float:
        """½ m ṙ·ṙ + ½ W·J W [J]."""
        translation = body.mass * self.velocity @ self.velocity
        return float(0.5 * (translation + self.spin @ body.inertia @ self.spin))

    def positions(self, offsets: Array) -> Array:
        """X = r + R V for offsets of shape (n, 3) [m]."""
        return np.asarray(self.r + offsets @ self.R.T)

    def velocities(self, offsets: Array) -> Array:
        """ṙ + ω × R V for offsets of shape (n, 3) [m/s]; equation (2)."""
        return np.asarray(self.velocity + np.cross(self.angular_velocity, offsets @ self.R.T))


def mass_block(body: RigidBody, motion: BodyMotion) -> Array:
    """Mass matrix of ṙ and ℓω in space, shape (6, 6) [kg]."""
    block = np.zeros((6, 6))
    block[:3, :3] = body.mass * np.eye(3)
    block[3:, 3:] = motion.R @ body.inertia @ motion.R.T / body.length**2
    return block


def at_rest(body: RigidBody) -> BodyMotion:
    """The motion of a body at the freeze, without velocity."""
    return BodyMotion(body.origin.copy(), np.eye(3), np.zeros(3), np.zeros(3))


@dataclass(frozen=True)
class Increment:
    """A trial step of one body.

    Attributes:
        body: The body.
        start: Its motion at the begin of the step.
        dr: Δr [m].
        theta: θ [1].
        dt: Δt [s].
    """

    body: RigidBody
    start: BodyMotion
    dr: Array
    theta: Array
    dt: float

    @cached_property
    def T(self) -> Array:
        """Spin of R1 per unit dθ."""
        return cayley_tangent(self.theta)

    @cached_property
    def turn(self) -> Array:
        """R1 - R0 = θ̂ T R0 = θ̂ R_av, as cay(θ) = I + θ̂ T."""
        return np.asarray(skew(self.theta) @ (self.T @ self.start.R))

    @cached_property
    def R1(self) -> Array:
        """Rotation at the end of the step."""
        return self.start.R + self.turn

    @cached_property
    def R_av(self) -> Array:
        """½ (R0 + R1), equation (4)."""
        return self.start.R + 0.5 * self.turn

    @cached_property
    def spin1(self) -> Array:
        """W1, angular velocity at the end in the body's frame [rad/s]."""
        return np.asarray(2 / self.dt * (self.theta @ self.start.R) - self.start.spin)

    @cached_property
    def pi1(self) -> Array:
        """π1, angular momentum at the end about the centre of mass [kg m²/s]."""
        return np.asarray(self.R1 @ (self.body.inertia @ self.spin1))

    def end(self) -> BodyMotion:
        """The motion at the end of the step."""
        s = self.start
        velocity = 2 / self.dt * self.dr - s.velocity
        return BodyMotion(s.r + self.dr, orthonormalized(self.R1), velocity, self.spin1)

    def inertia_force(self) -> Array:
        """M (ṙ1 - ṙ0)/Δt and (π1 - π0)/(ℓ Δt), shape (6,) [N]."""
        body, s = self.body, self.start
        out = np.empty(6)
        out[:3] = body.mass * 2 / self.dt * (self.dr / self.dt - s.velocity)
        out[3:] = (self.pi1 - s.angular_momentum(body)) / (self.dt * body.length)
        return out

    def tangent(self, couples: Array) -> Array:
        """Derivative of the body's residual rows that P does not carry, shape (6, 6) [N/m].

        Args:
            couples: Σ ½ f̂ᵢ v̂₁,ᵢ over forces on the body's nodes, shape (3, 3) [N m]: how the
                moments Σ v_av × f change with R1.
        """
        body, dt = self.body, self.dt
        rotation = (couples - skew(self.pi1) / dt) @ self.T
        rotation += 2 / dt**2 * self.R1 @ body.inertia @ self.start.R.T
        G = np.zeros((6, 6))
        G[:3, :3] = 2 * body.mass / dt**2 * IDENTITY
        G[3:, 3:] = rotation / body.length**2
        return G

    # Nodes of the body. With arms [1, V], shape (n, 4), everything that happens to them goes
    # through one small matrix, shape (4, 3): displacements are arms @ matrix, forces f enter as
    # their moments armsᵀ f, with F = Σ f in the first row and A = Σ V fᵀ below. L and P say how
    # its twelve numbers, row by row, depend on the body's six unknowns.

    @property
    def displacement(self) -> Array:
        """The matrix of the displacement in this step, shape (4, 3) [m, 1]."""
        out = np.empty((4, 3))
        out[0], out[1:] = self.dr, self.turn.T
        return out

    @cached_property
    def L(self) -> Array:
        """Of the displacement Δr + θ × v_av, equations (5) and (13); shape (12, 6) [1, 1/m]."""
        out = TRANSLATIONS.copy()
        out[3:, 3:] = (self.R_av.T @ self.body.arms_of_turns).reshape(9, 3)
        return out

    @cached_property
    def P(self) -> Array:
        """Derivative of `displacement`, that is δr + T δθ × v₁; shape (12, 6) [1, 1/m]."""
        out = TRANSLATIONS.copy()
        out[3:, 3:] = (self.R1.T @ self.body.arms_of_turns).reshape(9, 3) @ self.T
        return out

    def resultant(self, moments: Array) -> Array:
        """Lᵀ: Σ f and Σ v_av × f/ℓ of forces with these moments, shape (6,) [N].

        Args:
            moments: Shape (4, 3) [N, N m].
        """
        return np.asarray(moments.reshape(12) @ self.L)

    def couples(self, moments: Array) -> Array:
        """Σ ½ f̂ᵢ v̂₁,ᵢ of forces with these moments, shape (3, 3) [N m]: see `tangent`."""
        B = 0.5 * self.R1 @ moments[1:]  # ½ Σ v₁ fᵀ, and f̂ v̂ = v fᵀ - (f·v) I
        return np.asarray(B - B.trace() * IDENTITY)


class BodyTerm(Protocol):
    """Forces on the nodes of one body that depend on its motion; written as resistance."""

    def moments(self, increment: Increment) -> Array:
        """Σ f and Σ V fᵀ of a step, as `Increment.resultant` takes them, shape (4, 3) [N, N m]."""
        ...

    def tangent(self, increment: Increment) -> Array:
        """Derivative of their resultant as far as the forces change, shape (6, 6) [N/m]."""
        ...
