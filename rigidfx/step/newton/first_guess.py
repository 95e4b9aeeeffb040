"""First guesses of a step: u₁ = u₀ + Δt v, rotated if rotations are large.

At a large rotation per step a straight line leads far from the motion, and costs iterations. So the
mean rigid motion of the flexible cells and the bodies, c and ω from their momenta, continues by the
Cayley vector θ = Δt ω, with R = (I - ½θ̂)⁻¹ (I + ½θ̂). Other motion, rotated by half of θ (Cayley
vector θ / (1 + √(1 + ¼θ²))), continues along a straight line if it is slow, and hardly if it
vibrates faster than steps resolve: the guess with the smaller residual is taken, and stays until
its residual exceeds that which the other had.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from rigidfx.base.types import Array
from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import IDENTITY, axial, cayley, skew
from rigidfx.scene.scene import Scene

SMALL = 1e-3  # rotation per step [rad] below which a straight line is as good a guess
SINGULAR = 1e-9  # ratio of a principal moment of inertia to the largest that counts as none


@dataclass(frozen=True)
class Guess:
    """A first guess of a step."""

    # Increments of the active nodes [m], one number per row; those of nodes on bodies are of no
    # concern
    increment: Array
    bodies: Array  # Δr, ℓθ and Δq of each body, shape (bodies, 6 + m) [m]


def predict(
    scene: Scene, layout: DofLayout, u: Array, v: Array, start: Bodies, dt: float
) -> tuple[Guess, ...]:
    """First guesses of a step of Δt [s], the most natural one first. Collective.

    At its start are u and v of the active nodes, one number per row [m, m/s], and the bodies.
    """
    x, v = layout.rows.X + u.reshape(-1, 3), v.reshape(-1, 3)
    turns = dt * start.angular_velocity
    centre, velocity, omega = _mean_motion(scene, layout.masses, start, x, v)
    theta = dt * omega
    if theta @ theta < SMALL**2:
        return (Guess((dt * v).reshape(-1), _unknowns(start, dt * start.velocity, turns, dt)),)
    spin, turn = skew(omega), cayley(theta) - IDENTITY
    half = dt * cayley(theta / (1 + sqrt(1 + 0.25 * theta @ theta)))

    def parts(x: Array, v: Array) -> tuple[Array, Array]:
        """Increments by the mean motion, and by motion relative to it."""
        arms = x - centre
        return arms @ turn.T + dt * velocity, (v - velocity - arms @ spin.T) @ half.T

    mean, other = parts(x, v)
    if not len(start):
        none = np.empty((0, start.of.columns))
        return Guess((mean + other).reshape(-1), none), Guess(mean.reshape(-1), none)
    carried, drifting = parts(start.r, start.velocity)
    turned = np.broadcast_to(theta, turns.shape)
    return (
        Guess((mean + other).reshape(-1), _unknowns(start, carried + drifting, turns, dt)),
        Guess(mean.reshape(-1), _unknowns(start, carried, turned, 0.0)),
    )


def _unknowns(start: Bodies, translations: Array, turns: Array, dt: float) -> Array:
    """Δr, ℓθ and Δq of the bodies from Δr, θ and a time for q̇, shape (bodies, 6 + m) [m]."""
    out = np.empty((len(start), start.of.columns))
    out[:, :3], out[:, 3:6] = translations, start.of.length[:, None] * turns
    if start.of.shapes is not None:
        out[:, 6:] = dt * start.q_rate
    return out


def _mean_motion(
    scene: Scene, mass: Array, start: Bodies, x: Array, v: Array
) -> tuple[Array, Array, Array]:
    """Centre of mass of nodes and bodies, its velocity, and ω, by their momenta. Collective.

    Active nodes have masses of their own [kg], positions x and velocities v, (nodes, 3) [m, m/s].
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
    if not np.isfinite(second).all():  # the step will say so
        return first[1:4], first[4:], np.zeros(3)
    moments, axes = np.linalg.eigh(0.5 * (second[1:] + second[1:].T))
    spins = np.zeros(3)  # a line has no inertia about itself
    np.divide(second[0] @ axes, moments, out=spins, where=moments > SINGULAR * moments[2])
    return first[1:4], first[4:], axes @ spins
