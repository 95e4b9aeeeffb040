"""First guess of a step: u₁ = u₀ + Δt v, rotated where rotations are large.

At a large rotation per step the tangents of the motion lead far away from it and Newton pays for
that with iterations. The mean rigid motion of what is left flexible and of the bodies, c and ω from
their momenta, is therefore continued exactly as the step would continue it, by the Cayley vector
Δt ω, and only the velocity relative to it along a straight line.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from rigidfx.partition import Partition
from rigidfx.rotation import cayley, skew
from rigidfx.scene import Scene
from rigidfx.state import State

__all__ = ["predict"]

SMALL = 0.02  # rotation per step [rad] below which the tangent is as good a guess


def predict(scene: Scene, state: State, partition: Partition, dt: float, guess: PETSc.Vec) -> None:
    """Set the guess. Collective.

    Args:
        scene: The problem.
        state: State at the begin of the step.
        partition: Division of the dofs.
        dt: Δt [s].
        guess: Increment of the displacement, full length, overwritten [m].
    """
    v0 = state.v.x.petsc_vec
    v0.copy(guess)
    guess.scale(dt)
    nodes = slice(None, scene.owned_nodes) if partition.whole else partition.active
    m = (scene.nodal_mass[: scene.owned_nodes] * partition.massive)[nodes]
    x, v = state.X[nodes] + _nodal(state.u.x.array)[nodes], _nodal(state.v.x.array)[nodes]
    first = np.asarray(scene.sum(np.r_[m.sum(), m @ x, m @ v]))
    for body, motion in zip(state.bodies, state.motions, strict=True):
        first += body.mass * np.r_[1.0, motion.r, motion.velocity]
    c, velocity = first[1:4] / first[0], first[4:] / first[0]
    y = x - c
    moment = np.cross(y, m[:, None] * v).sum(axis=0)
    inertia = (m @ (y * y).sum(axis=1)) * np.eye(3) - (m[:, None] * y).T @ y
    second = np.asarray(scene.sum(np.r_[moment, inertia.reshape(-1)]))
    for body, motion in zip(state.bodies, state.motions, strict=True):
        arm = motion.r - c
        second[:3] += np.cross(arm, body.mass * motion.velocity) + motion.angular_momentum(body)
        J = motion.R @ body.inertia @ motion.R.T - body.mass * skew(arm) @ skew(arm)
        second[3:] += J.reshape(-1)
    omega = np.linalg.lstsq(second[3:].reshape(3, 3), second[:3], rcond=1e-9)[0]
    theta = dt * omega
    angle = 2 * np.arctan(np.linalg.norm(theta) / 2)
    if angle < SMALL:
        return
    half = 2 * np.tan(angle / 4) / np.linalg.norm(theta) * theta
    relative = v - velocity - np.cross(omega, y)
    d = dt * velocity + y @ (cayley(theta) - np.eye(3)).T + dt * relative @ cayley(half).T
    guess.array.reshape(-1, 3)[nodes] = d


def _nodal(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, 3)
