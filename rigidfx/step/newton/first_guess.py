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

SMALL = 1e-3  # rotation per step [rad] below which the tangent is as good a guess
SINGULAR = 1e-9  # ratio of the least extension by a matrix to its largest that counts as none
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

    def parts(x: Array, v: Array) -> tuple[Array, Array]:
        """Increments by the mean motion, and by what goes along relative to it."""
        arms = x - c
        relative = v - velocity - arms @ skew(omega).T
        return dt * velocity + arms @ turn.T, dt * relative @ half.T

    of_nodes, of_centres = parts(x, v), parts(start.r, start.velocity)
    turns = np.broadcast_to(theta, spinning.shape), dt * (spinning - omega)
    along = tuple(map(np.add, *zip(of_nodes, of_centres, turns, strict=True)))
    both = along, (of_nodes[0], of_centres[0], turns[0])
    return tuple(Guess(d.reshape(-1), _six(start, r, turn)) for d, r, turn in both)


def free_rotation(inertia: Array, omega: Array, dt: float) -> Array:
    """Cayley vector θ of a free rigid body's step; Δt ω if none is found.

    Args:
        inertia: J about the centre of mass, shape (3, 3) [kg m²].
        omega: Angular velocity ω at the start of the step, shape (3,) [rad/s].
        dt: Δt [s].
    """
    theta, momentum = dt * omega, inertia @ omega
    for _ in range(TRIES):
        half = skew(0.5 * theta)
        T = cayley_tangent(theta, half)
        turned = inertia + 2 * half @ T @ inertia  # R J, as cay(θ) = I + θ̂ T
        now = turned @ (2 / dt * theta - omega)
        slope = 2 / dt * turned - skew(now) @ T
        if not (np.isfinite(slope).all() and np.isfinite(momentum - now).all()):
            break
        change = _solution(slope, momentum - now)
        theta = theta + change
        if np.vdot(change, change) <= ENOUGH**2 * np.vdot(theta, theta):
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
    return c, velocity, _solution(whole, second[:3]), whole


def _inertia(spread: Array) -> Array:
    """Σ m (y·y I - y yᵀ) from Σ m y yᵀ."""
    return np.asarray(spread.trace() * IDENTITY - spread)


def _solution(A: Array, b: Array) -> Array:
    """A⁻¹ b, shape (3,); of the least size where A is all but singular, as that of a line is."""
    if abs(np.linalg.det(A)) > SINGULAR * np.vdot(A, A) ** 1.5:
        return np.asarray(np.linalg.solve(A, b))
    return np.asarray(np.linalg.lstsq(A, b, rcond=SINGULAR)[0])
