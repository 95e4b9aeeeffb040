"""Bodies whose frame a support holds or moves: what its path gives them in a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigidfx.base.errors import together
from rigidfx.base.types import Array
from rigidfx.coupling.ports import far_apart
from rigidfx.effects import Support
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import IDENTITY, axial, skew
from rigidfx.scene.scene import Scene

__all__ = ["HeldBodies"]


@dataclass(frozen=True)
class _Hold:
    """A body, its support, and three nodes of the body that the support holds.

    Attributes:
        body: Number among the bodies.
        support: The support.
        X: Reference positions of the nodes, shape (3, 3) [m].
        offsets: Their places in the body's frame, from its centre of mass at the freeze [m].
    """

    body: int
    support: Support
    X: Array
    offsets: Array

    def places(self, bodies: Bodies) -> Array:
        """Where the nodes are, shape (3, 3) [m]."""
        k = self.body
        frame = bodies.r[k] - bodies.R[k] @ bodies.drifted[k]
        return np.asarray(frame + self.offsets @ bodies.R[k].T)


class HeldBodies:
    """The bodies of a division that supports hold; all ranks know the same."""

    def __init__(self, scene: Scene, held: Mapping[int, Support], bodies: Bodies) -> None:
        """Find nodes that tell their motion. Collective.

        Args:
            scene: The problem.
            held: The support of each body that is held, by its place among the bodies.
            bodies: The bodies.
        """
        self._scene = scene
        self._holds = [self._hold(k, support, bodies) for k, support in held.items()]

    def __len__(self) -> int:
        """How many there are."""
        return len(self._holds)

    def _hold(self, k: int, support: Support, bodies: Bodies) -> _Hold:
        scene, data = self._scene, bodies.of.records[k]
        nodes = next(nodes for s, nodes in scene.supports if s is support)
        at = np.flatnonzero(np.isin(data.nodes, nodes))
        X = scene.space.tabulate_dof_coordinates()[data.nodes[at]]
        own = np.hstack([X, data.offsets[at]])[far_apart(X)]
        every = np.concatenate(scene.comm.allgather(own))
        chosen = every[far_apart(every[:, :3])]
        return _Hold(k, support, chosen[:, :3], chosen[:, 3:])

    def given(self, t0: float, t1: float, bodies: Bodies) -> Array | None:
        """Δc₀ and θ of the frames from t0 to t1, shape (bodies, 6); None if all rest. Collective.

        Args:
            t0: Start of the step [s].
            t1: Its end [s].
            bodies: The bodies at its start.

        Raises:
            SceneError: On every rank, if the path of a support fails on any.
        """
        moving = [hold for hold in self._holds if hold.support.moves or not hold.support.uniform]
        if not moving:
            return None

        def asked() -> list[Array]:
            return [
                np.broadcast_to(h.support.increments_of(t0, t1, h.X, h.places(bodies)), (3, 3))
                for h in moving
            ]

        out = np.zeros((len(bodies), 6))
        for hold, d in zip(moving, together(self._scene.comm, "A support", asked), strict=True):
            k, x0 = hold.body, hold.places(bodies)
            turn = IDENTITY if hold.support.uniform else _triad(x0 + d) @ _triad(x0).T
            middle = x0.mean(axis=0)
            frame = bodies.r[k] - bodies.R[k] @ bodies.drifted[k]
            out[k, :3] = d.mean(axis=0) + (turn - IDENTITY) @ (frame - middle)
            out[k, 3:] = 2.0 * axial(turn.T) / (1.0 + np.trace(turn))  # Cayley vector of a rotation
        return out

    def moving(self, t: float, dt: float, bodies: Bodies) -> Bodies:
        """The bodies, with frames that move as supports do just after t. Collective.

        Supports exert impulses where shapes are zero, so that Σ m Φ̃·ẋ stays: nodes elsewhere keep
        their velocities, as far as shapes can tell them.

        Args:
            t: Time [s].
            dt: Time step [s], the scale of difference quotients.
            bodies: The bodies at t.
        """

        def asked() -> list[Array]:
            return [
                np.broadcast_to(h.support.velocities_at(t, dt, h.X, h.places(bodies)), (3, 3))
                for h in self._holds
            ]

        velocity, W = bodies.velocity.copy(), bodies.angular_velocity_body.copy()
        q_rate, blocks = bodies.q_rate.copy(), bodies.mass_blocks
        found = together(self._scene.comm, "A support", asked)
        for hold, v in zip(self._holds, found, strict=True):
            k, x = hold.body, hold.places(bodies)
            middle, mean = x.mean(axis=0), v.mean(axis=0)
            arms = -skew(x - middle).reshape(-1, 3)
            omega = np.linalg.lstsq(arms, (v - mean).reshape(-1))[0]
            shapes, R = bodies.of.shapes, bodies.R[k]
            assert shapes is not None
            n, frame = shapes.counts[k], mean + np.cross(omega, bodies.r[k] - middle)
            drift = shapes.drift[k, :n] @ R.T
            B, D = (blocks[k, 6 : 6 + n, own] for own in (slice(3, 6), slice(6, 6 + n)))
            turning = bodies.of.length[k] * (omega - bodies.angular_velocity[k])
            gained = bodies.of.mass[k] * drift @ (frame + q_rate[k, :n] @ drift - velocity[k])
            A = D + bodies.of.mass[k] * drift @ drift.T
            q_rate[k, :n] -= np.linalg.solve(A, B @ turning + gained)
            velocity[k] = frame + q_rate[k, :n] @ drift
            W[k] = R.T @ omega
        return bodies.moving(velocity, W, q_rate)

    def reactions(
        self, rows: Array, middle: Array, length: Array
    ) -> Sequence[tuple[str, Array, Array]]:
        """Force of each support on a body [N] and its moment about the origin [N m], by its set.

        Args:
            rows: Residual of the bodies, shape (bodies, 6 + m) [N].
            middle: Places of the centres of mass at the midpoint, shape (bodies, 3) [m].
            length: ℓ of the bodies [m].
        """
        out = []
        for hold in self._holds:
            k = hold.body
            force, torque = rows[k, :3], length[k] * rows[k, 3:6]
            out.append((hold.support.where, force, torque + np.cross(middle[k], force)))
        return out


def _triad(x: Array) -> Array:
    """An orthonormal basis that three points define, by columns."""
    a, b = x[1] - x[0], x[2] - x[0]
    e = a / np.linalg.norm(a)
    n = np.cross(a, b)
    n /= np.linalg.norm(n)
    return np.stack([e, np.cross(n, e), n], axis=1)
