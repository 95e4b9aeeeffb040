"""Sources of the error motion: forces at bodies' nodes, and velocities that switches take out.

Both are in the frame of one shape: forces of a body by the body's own frame, r⁰ = Q_bᵀ r, forces
that a release lets down by the rotation of the released cells round each node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import ON_NODES, Remembered
from rigidfx.base.types import Array, Indices
from rigidfx.error.frames import Frames, to_shape, to_space
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.step.stepper import Stepper
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.parts import Parts

__all__ = ["Impulse"]

Nodes = npt.NDArray[np.integer]


class Impulse:
    """Knows r, and velocities that e has not taken yet.

    Attributes:
        kick: Velocities that were taken out since the last step, shape (nodes, 3) [m/s].
    """

    remembered: ClassVar[Remembered] = {"kick": ON_NODES}

    def __init__(self, stepper: Stepper, forces: BodyForces) -> None:
        """Nothing has acted.

        Args:
            stepper: Solves the steps.
            forces: Knows ρ.
        """
        self._stepper, self._forces = stepper, forces
        shape = stepper.scene.owned_nodes, 3
        self._nodes = np.arange(shape[0])
        self.kick: Array = np.zeros(shape)
        self._of_bodies: dict[int, tuple[object, Array, Array]] = {}  # shape and Q_b, by number

    def force(self, dt: float, frames: Frames) -> Array:
        """r of a step of length dt [s], in the shape's frame, shape (nodes, 3) [N]. Collective."""
        out = np.zeros_like(self.kick)
        if self._forces.borne is not None:
            parts, force = self._forces.borne
            for body, at in zip(parts.bodies, parts.at, strict=True):
                out[body.nodes] += to_shape(force[at], self._frame_of(body, frames))
        easing = self._stepper.system.actions.easing
        if easing:
            let_down = np.zeros_like(out)
            for eased in easing:
                eased.add_impulse(dt, let_down.reshape(-1))
            x = self._stepper.state.places
            cells = np.unique(np.concatenate([eased.cells for eased in self._stepper.state.eased]))
            out += to_shape(np.asarray(let_down / dt), frames.of_nodes(x, cells))
        return out

    def _frame_of(self, body: RigidBody, frames: Frames) -> Array:
        """Q of a body's own frame against the shape: it is constant. Collective."""
        known = self._of_bodies.get(body.number)
        if known is None or known[0] is not body or known[1] is not frames.shape:
            x = np.zeros_like(frames.shape)
            x[body.nodes] = body.offsets
            known = body, frames.shape, frames.of_sets([body.nodes], x)[0]
            self._of_bodies[body.number] = known
        return known[2]

    def in_space(self, e: Array, frames: Frames, out: Array) -> tuple[Array, Indices]:
        """e of bodies without their rigid motions, as it is in space. Collective.

        Args:
            e: Of the owned nodes, in the frame of the shape, shape (nodes, 3) [m].
            frames: Those of the shape.
            out: Of the owned nodes; those of bodies are written into it.

        Returns:
            The same, and the bodies' owned cells.
        """
        if self._forces.borne is None:
            return out, np.empty(0, np.int32)
        parts = self._forces.borne[0]
        own = parts.unmoved(self._framed(e, parts, frames))
        return parts.in_space(own, self._stepper.state.bodies, out)

    def withheld(self, e: Array, frames: Frames) -> float:
        """½ ρᵀe of the bodies, no less than zero [J]. Collective; arguments as of `in_space`."""
        if self._forces.borne is None:
            return 0.0
        parts, force = self._forces.borne
        own = parts.energies(force, self._framed(e, parts, frames)).sum()
        return max(0.0, float(self._stepper.scene.sum(own)))

    def _framed(self, e: Array, parts: Parts, frames: Frames) -> Array:
        """e at the bodies' nodes in their frames, shape (nodes, 3) [m]. Collective."""
        out = np.zeros_like(parts.V)
        for body, at in zip(parts.bodies, parts.at, strict=True):
            out[at] = to_space(e[body.nodes], self._frame_of(body, frames))
        return out

    def velocities(self) -> Array:
        """Present velocities of the owned nodes, bodies included, shape (nodes, 3) [m/s]."""
        state = self._stepper.state
        state.rebuild()
        return state.v.x.array[: 3 * len(self._nodes)].reshape(-1, 3).copy()

    def switched(self, lost: Array, sets: Sequence[Nodes], frames: Frames) -> None:
        """Add velocities that a switch has taken out. Collective.

        Args:
            lost: Of the owned nodes, in space, shape (nodes, 3) [m/s].
            sets: Owned nodes of each body before and after it.
            frames: Those of the shape.
        """
        x = self._stepper.state.places
        Q = frames.of_parts(x)[frames.part]
        for own, R in zip(sets, frames.of_sets(sets, x), strict=True):
            Q[own] = R
        self.kick = self.kick + to_shape(lost, Q)
