"""First guesses of a step: u₁ = u₀ + Δt v, rotated where rotations are large.

At a large rotation per step the tangents of the motion lead far away from it and Newton pays for
that with iterations. The mean rigid motion of what is left flexible and of the bodies, c and ω from
their momenta, is therefore continued exactly as the step would continue it if all were one free
rigid body: by the Cayley vector θ that keeps the angular momentum, R₁ J (2θ/Δt - ω) = J ω. Δt ω is
that only where ω is a principal axis; a stiff body that rotates by a wrong angle, even a little,
is strained by its square. What moves relative to it goes on along a straight line if it is slow,
and hardly at all if it vibrates faster than the step can see: both are offered, and the smaller
residual decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import IDENTITY, axial, cayley, cayley_tangent, skew
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Guess", "predict"]

Array = npt.NDArray[np.float64]

SMALL = 0.02  # rotation per step [rad] below which the tangent is as good a guess
TRIES, ENOUGH = 20, 1e-10  # iterations for the rotation of a free body, and where they end


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
    scene: Scene, state: State, layout: DofLayout, start: Bodies, dt: float
) -> tuple[Guess, ...]:
    """First guesses, the most natural one first. Collective.

    Args:
        scene: The problem.
        state: State at the start of the step.
        layout: Division of the dofs.
        start: The state's bodies.
        dt: Δt [s].
    """
    rows = layout.rows
    v = state.v.x.array[rows.dofs].reshape(-1, 3)
    spinning = start.angular_velocity
    whole = Guess(dt * v.reshape(-1), _six(start, dt * start.velocity, dt * spinning))
    x = rows.X + state.u.x.array[rows.dofs].reshape(-1, 3)
    c, velocity, omega, inertia = _mean_motion(scene, start, layout.masses, x, v)
    if 2 * np.arctan(dt * np.linalg.norm(omega) / 2) < SMALL:
        return (whole,)
    theta = free_rotation(inertia, omega, dt)
    size = np.linalg.norm(theta)
    angle = 2 * np.arctan(size / 2)
    turn, half = cayley(theta) - IDENTITY, cayley(2 * np.tan(angle / 4) / size * theta)

    def continued(x: Array, v: Array, share: float) -> Array:
        relative = v - velocity - (x - c) @ skew(omega).T
        return np.asarray(dt * velocity + (x - c) @ turn.T + share * dt * relative @ half.T)

    guesses = []
    for share in (1.0, 0.0):
        increment = continued(x, v, share).reshape(-1)
        centres = continued(start.r, start.velocity, share)
        turns = theta + dt * share * (spinning - omega)
        guesses.append(Guess(increment, _six(start, centres, turns)))
    return tuple(guesses)


def free_rotation(inertia: Array, omega: Array, dt: float) -> Array:
    """Cayley vector θ of a free rigid body's step; Δt ω if none is found.

    Args:
        inertia: J about the centre of mass, shape (3, 3) [kg m²].
        omega: Angular velocity ω at the start of the step, shape (3,) [rad/s].
        dt: Δt [s].
    """
    theta, momentum = dt * omega, inertia @ omega
    for _ in range(TRIES):
        R = cayley(theta)
        now = R @ inertia @ (2 / dt * theta - omega)
        slope = 2 / dt * R @ inertia - skew(now) @ cayley_tangent(theta)
        if not (np.isfinite(slope).all() and np.isfinite(momentum - now).all()):
            break
        change = np.linalg.lstsq(slope, momentum - now, rcond=1e-9)[0]
        theta = theta + change
        if np.linalg.norm(change) <= ENOUGH * np.linalg.norm(theta):
            return np.asarray(theta)
    return dt * omega


def _six(start: Bodies, translations: Array, turns: Array) -> Array:
    """Δr and ℓθ of the bodies from Δr and θ, shape (bodies, 6) [m]."""
    return np.hstack([translations, start.of.length[:, None] * turns])


def _mean_motion(
    scene: Scene, start: Bodies, mass: Array, x: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    """Centre, its velocity, ω and J of nodes and bodies together, by their momenta. Collective."""
    of, bodies = start.of, len(start) > 0
    first = np.asarray(scene.sum(np.concatenate([[mass.sum()], mass @ x, mass @ v])))
    if bodies:
        first[0] += of.mass.sum()
        first[1:4] += of.mass @ start.r
        first[4:] += start.momentum.sum(axis=0)
    c, velocity = first[1:4] / first[0], first[4:] / first[0]
    y = x - c
    weighted = (mass[:, None] * y).T
    inertia = _inertia(weighted @ y)
    second = np.asarray(scene.sum(np.concatenate([axial(weighted @ v), inertia.reshape(-1)])))
    if bodies:
        arms = start.r - c
        second[:3] += axial(arms.T @ start.momentum) + start.angular_momentum.sum(axis=0)
        turned = (start.R @ start.rotated_inertia).sum(axis=0)
        second[3:] += (turned + _inertia((of.mass[:, None] * arms).T @ arms)).reshape(-1)
    whole = second[3:].reshape(3, 3)
    if not np.isfinite(second).all():  # the step will say so
        return c, velocity, np.zeros(3), whole
    return c, velocity, np.linalg.lstsq(whole, second[:3], rcond=1e-9)[0], whole


def _inertia(spread: Array) -> Array:
    """Σ m (y·y I - y yᵀ) from Σ m y yᵀ."""
    return np.asarray(np.trace(spread) * IDENTITY - spread)
