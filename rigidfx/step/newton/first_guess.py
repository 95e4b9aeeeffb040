"""First guesses of a step: u₁ = u₀ + Δt v, rotated if rotations are large.

With a large rotation per step a straight line is far from the motion, and costs iterations. So the
mean rigid motion of the flexible cells and the bodies, c and ω from their momenta, is continued as
that of one free rigid body. Its Cayley vector θ keeps the angular momentum, R₁ J (2θ/Δt - ω) = J ω.
With R₁ = (I - ½θ̂)⁻¹ (I + ½θ̂) this is

    J θ + ½ θ × J θ = Δt J ω.

θ = Δt ω only if ω is a principal axis. A stiff body that rotates by a slightly wrong angle δ is
strained by δ². The motion relative to the mean is continued along a straight line in one guess, and
left out in another, since steps may not resolve a vibration. The guess with the smaller residual is
taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, isfinite, sqrt, tan

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import IDENTITY, axial, cayley, skew
from rigidfx.scene.scene import Scene

__all__ = ["Guess", "predict"]

Array = npt.NDArray[np.float64]

SMALL = 1e-3  # rotation per step [rad] below which the tangent is as good a guess
SINGULAR = 1e-9  # ratio of a principal moment of inertia to the largest that counts as none
# Iterations for the rotation of a free body, and the correction whose square is left of it.
TRIES, ENOUGH = 20, 1e-5


@dataclass(frozen=True)
class Guess:
    """A first guess of a step.

    Attributes:
        increment: Increments of the active nodes [m], one number per row; those of nodes on bodies
            are of no concern.
        bodies: Δr and ℓθ of each body, shape (bodies, 6) [m].
    """

    increment: Array
    bodies: Array


def predict(
    scene: Scene, layout: DofLayout, u: Array, v: Array, start: Bodies, dt: float
) -> tuple[Guess, ...]:
    """First guesses, the most natural one first. Collective.

    Args:
        scene: The problem.
        layout: Division of the dofs.
        u: Displacements of the active nodes at the start of the step, one number per row [m].
        v: Their velocities there [m/s].
        start: The bodies there.
        dt: Δt [s].
    """
    x, v = layout.rows.X + u.reshape(-1, 3), v.reshape(-1, 3)
    mean = _mean_motion(scene, layout.masses, start, x, v)
    omega = mean.omega
    if 2 * atan(0.5 * dt * sqrt(omega @ omega)) < SMALL:
        turns = dt * start.angular_velocity
        return (Guess((dt * v).reshape(-1), _six(start, dt * start.velocity, turns)),)
    theta = free_rotation(mean.principal, mean.axes, omega, dt)
    size = sqrt(theta @ theta)
    turn = cayley(theta) - IDENTITY
    half = dt * cayley(2 * tan(0.5 * atan(0.5 * size)) / size * theta)
    spin = skew(omega)

    def parts(arms: Array, relative: Array) -> tuple[Array, Array]:
        """Increments by the mean motion, and by motion that goes along relative to it."""
        going = relative - arms @ spin.T
        return arms @ turn.T + dt * mean.velocity, going @ half.T

    with_mean, going = parts(mean.arms, mean.relative)
    along = (with_mean + going).reshape(-1)
    if not len(start):
        none = np.empty((0, 6))
        return Guess(along, none), Guess(with_mean.reshape(-1), none)
    carried, drifting = parts(start.r - mean.centre, start.velocity - mean.velocity)
    turns = theta + dt * (start.angular_velocity - omega)
    return (
        Guess(along, _six(start, carried + drifting, turns)),
        Guess(with_mean.reshape(-1), _six(start, carried, theta)),
    )


def free_rotation(principal: Array, axes: Array, omega: Array, dt: float) -> Array:
    """Cayley vector θ of a free rigid body's step; Δt ω if none is found.

    Args:
        principal: Principal moments of inertia about the centre of mass, above zero, shape (3,)
            [kg m²].
        axes: Their axes, a right-handed frame, one per column.
        omega: Angular velocity ω at the start of the step, shape (3,) [rad/s].
        dt: Δt [s].
    """
    theta = dt * (omega @ axes)
    # Arithmetic of numbers: with arrays of three it takes three times as long.
    i, j, k = map(float, principal)
    f, g, h = 0.5 * (k - j), 0.5 * (i - k), 0.5 * (j - i)
    p, q, r = map(float, principal * theta)
    for _ in range(TRIES):
        a, b, c = map(float, theta)
        off = p - i * a - f * b * c, q - j * b - g * c * a, r - k * c - h * a * b
        if not all(map(isfinite, (a, b, c, *off))):
            break
        slope = (i, f * c, f * b), (g * c, j, g * a), (h * b, h * a, k)
        try:
            change = np.linalg.solve(slope, off)
        except np.linalg.LinAlgError:
            break
        theta = theta + change
        if change @ change <= ENOUGH**2 * (theta @ theta):
            return np.asarray(axes @ theta)
    return dt * omega


def _six(start: Bodies, translations: Array, turns: Array) -> Array:
    """Δr and ℓθ of the bodies from Δr and θ, shape (bodies, 6) [m]."""
    out = np.empty((len(start), 6))
    out[:, :3] = translations
    np.multiply(start.of.length[:, None], turns, out=out[:, 3:])
    return out


@dataclass(frozen=True)
class _MeanMotion:
    """Common motion of nodes and bodies, by their momenta, and motion of nodes relative to that.

    Attributes:
        centre: Their centre of mass, shape (3,) [m].
        velocity: Its velocity, shape (3,) [m/s].
        omega: Angular velocity ω, shape (3,) [rad/s].
        principal: Principal moments of inertia about the centre, shape (3,) [kg m²]; the largest
            in place of those that are next to none, as that of a line is.
        axes: Their axes, a right-handed frame, one per column.
        arms: Positions of nodes from the centre [m].
        relative: Their velocities less that of the centre [m/s].
    """

    centre: Array
    velocity: Array
    omega: Array
    principal: Array
    axes: Array
    arms: Array
    relative: Array


def _mean_motion(scene: Scene, mass: Array, start: Bodies, x: Array, v: Array) -> _MeanMotion:
    """The mean motion of nodes and bodies. Collective.

    Args:
        scene: The problem.
        mass: Mass of each active node that is its own [kg].
        start: The bodies.
        x: Positions of the active nodes, shape (nodes, 3) [m].
        v: Their velocities, likewise [m/s].
    """
    n, bodies = len(x), len(start) if scene.comm.rank == 0 else 0  # all ranks know all bodies
    both = np.empty((n + bodies, 6))
    both[:n, :3], both[:n, 3:] = x, v
    if bodies:
        both[n:, :3], both[n:, 3:] = start.r, start.velocity
        mass = np.concatenate([mass, start.of.mass])
    first = np.empty(7)
    first[0], first[1:] = mass.sum(), mass @ both
    first = np.asarray(scene.sum(first))
    first[1:] /= first[0]
    both -= first[1:]
    products = (mass[:, None] * both[:, :3]).T @ both
    second = np.empty((4, 3))
    second[0] = axial(products[:, 3:])
    np.subtract(products[:, :3].trace() * IDENTITY, products[:, :3], out=second[1:])
    second = np.asarray(scene.sum(second))
    if len(start):
        second[0] += start.angular_momentum.sum(axis=0)
        second[1:] += (start.R @ start.rotated_inertia).sum(axis=0)
    centre, velocity, arms, relative = first[1:4], first[4:], both[:n, :3], both[:n, 3:]
    if not np.isfinite(second).all():  # the step will say so
        return _MeanMotion(centre, velocity, np.zeros(3), np.ones(3), IDENTITY, arms, relative)
    principal, axes = np.linalg.eigh(second[1:])
    axes[:, 2] = skew(axes[:, 0]) @ axes[:, 1]
    largest = principal[2]
    resists = principal > SINGULAR * largest
    spin = np.divide(second[0] @ axes, principal, out=np.zeros(3), where=resists)
    principal = np.where(resists, principal, largest or 1.0)
    return _MeanMotion(centre, velocity, axes @ spin, principal, axes, arms, relative)
