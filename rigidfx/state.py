"""The only mutable physics: displacement, velocity, time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.errors import SceneError, agree, together
from rigidfx.base.inputs import numbers
from rigidfx.effects import InitialVelocity
from rigidfx.mechanics.rigid_body import BodyMotion, RigidBody
from rigidfx.scene.scene import Scene

__all__ = ["Snapshot", "State", "initial_velocity"]


@dataclass(frozen=True)
class Snapshot:
    """A copy of a state that it can be restored to."""

    t: float
    u: npt.NDArray[np.float64]
    v: npt.NDArray[np.float64]
    motions: tuple[BodyMotion, ...]


class State:
    """Displacement and velocity of all nodes at one time.

    Attributes:
        t: Time [s].
        u: Displacement [m].
        v: Velocity [m/s].
        bodies: Rigid bodies.
        motions: Their motions, in the same order.
        clamped: Owned cells of each named part that a support moves, by the part's number.
        carried: For each body, which of its nodes have its velocity: all of them with a lumped
            mass, else those that no flexible cell touches.

    Between outputs u and v of nodes inside bodies lag behind; `rebuild` brings them up to date.
    """

    def __init__(self, scene: Scene) -> None:
        """The state at rest in the reference configuration at t = 0."""
        self.t = 0.0
        self.u = fem.Function(scene.space, name="displacement")
        self.v = fem.Function(scene.space, name="velocity")
        self.bodies: tuple[RigidBody, ...] = ()
        self.motions: tuple[BodyMotion, ...] = ()
        self.clamped: Mapping[int, npt.NDArray[np.int32]] = {}
        self.carried: tuple[npt.NDArray[np.int32], ...] = ()
        self.X = scene.space.tabulate_dof_coordinates()

    def snapshot(self) -> Snapshot:
        """Copy of the state."""
        return Snapshot(self.t, self.u.x.array.copy(), self.v.x.array.copy(), self.motions)

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot."""
        self.t = snapshot.t
        self.u.x.array[:] = snapshot.u
        self.v.x.array[:] = snapshot.v
        self.motions = snapshot.motions

    def positions(self, nodes: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Positions of owned nodes, also of those inside bodies, shape (nodes, 3) [m]."""
        x = self.X[nodes] + self.u.x.array.reshape(-1, 3)[nodes]
        for body, motion in zip(self.bodies, self.motions, strict=True):
            place = np.searchsorted(body.nodes, nodes)
            inside = place < body.nodes.size
            inside[inside] = body.nodes[place[inside]] == nodes[inside]
            x[inside] = motion.positions(body.offsets[place[inside]])
        return np.asarray(x)

    @property
    def stored(self) -> float:
        """Energy that the bodies keep for their release [J]."""
        return sum(body.frozen.energy for body in self.bodies)

    def body_numbers(self) -> npt.NDArray[np.int32]:
        """For each owned cell the number of the body or clamped part it is in, else 0."""
        numbers = np.zeros(self.u.function_space.mesh.topology.index_map(3).size_local, np.int32)
        for body in self.bodies:
            numbers[body.cells] = body.number
        for number, cells in self.clamped.items():
            numbers[cells] = number
        return numbers

    def rebuild(self) -> None:
        """Set displacement and velocity of the nodes inside bodies from their motions. Collective.

        With a consistent mass velocities at the interface stay: the flexible cells' side of it has
        a velocity of its own.
        """
        if not self.bodies:
            return
        u, v = (f.x.array.reshape(-1, 3) for f in (self.u, self.v))
        for body, motion, own in zip(self.bodies, self.motions, self.carried, strict=True):
            u[body.nodes] = motion.positions(body.offsets) - self.X[body.nodes]
            v[body.nodes[own]] = motion.velocities(body.offsets[own])
        self.u.x.scatter_forward()
        self.v.x.scatter_forward()


# Relative error of the difference quotient for a path whose velocity is not given.
CONTRADICTION = 1e-5


def initial_velocity(scene: Scene, dt: float) -> npt.NDArray[np.float64]:
    """Velocity at the start per local node with ghosts, shape (nodes, 3) [m/s]. Collective.

    Args:
        scene: The problem.
        dt: Nominal Δt [s], the scale for velocities of supports that are known by their path only.

    Raises:
        SceneError: If a given velocity is not finite, or contradicts a support that acts at the
            start. Where no velocity is given, a support simply begins to move its nodes.
    """
    X = scene.space.tabulate_dof_coordinates()
    v = np.zeros_like(X)
    given = scene.named(InitialVelocity)
    for effect in given:
        centre = scene.centre_of_mass if effect.centre is None else np.asarray(effect.centre)
        v += np.asarray(effect.linear) + np.cross(effect.angular, X - centre)
        if effect.function is not None:
            v += _evaluate(effect, scene, X)
    scale = scene.comm.allreduce(float(np.abs(v).max(initial=0.0)), op=MPI.MAX)
    for support, nodes in scene.supports if given else ():
        if not (support.since <= 0.0 < support.until):
            continue
        wanted = together(
            scene.comm,
            f"{type(support).__name__} on '{support.where}'",
            lambda s=support: s.velocity_at(0.0, dt),  # type: ignore[misc]
        )
        axes = list(support.axes)
        error = np.abs(v[nodes][:, axes] - wanted[axes]).max(initial=0.0)
        bound = max(scale, float(np.abs(wanted).max()))
        agree(
            scene.comm,
            None
            if error <= CONTRADICTION * bound
            else f"InitialVelocity contradicts {type(support).__name__} on '{support.where}' "
            f"(components '{support.components}'): they differ by {error:.3g} m/s at its nodes. "
            "Give the nodes of a support its velocity, or start the support later.",
        )
    return v


def _evaluate(
    effect: InitialVelocity, scene: Scene, X: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    assert effect.function is not None
    problem, values = None, np.zeros_like(X)
    try:
        given = effect.function(X.T)
        values = numbers(given).T
        if values.size == 0 and np.size(given):
            raise TypeError("it gives no real numbers")
        if values.shape != X.shape:
            values = np.broadcast_to(values, X.shape)
        if not np.isfinite(values).all():
            problem = "InitialVelocity: function gives values that are not finite."
    except Exception as error:  # whatever a user's function may raise
        problem = (
            f"InitialVelocity: function must map (3, n) to (3, n); it failed with "
            f"{type(error).__name__}: {error}"
        )
    agree(scene.comm, problem, SceneError)
    return values
