"""The spin up to which shapes hold for parts between joints.

A part that spins on a hinge is stretched by the hinge's force, and so is stiffer. Shapes do not
know that. A beam that a motor spins up then lags by 4.7 (W/ω)² too much, with W its spin and ω its
lowest frequency while nothing holds it (`test_reduced_joints.py`). So W² is ω²/300 at most: parts
that are named are refused above, and found ones wake. The shapes of a part that was frozen while it
span know the stresses of that spin.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigvalsh

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.effects import Joint
from rigidfx.mechanics.rigid_body import Body
from rigidfx.scene.scene import Scene
from rigidfx.shapes.part import LACKING
from rigidfx.state import State


def off_by(ratio: float) -> float:
    """Bound of the relative error of amplitudes, by the share of energy that shapes lack: ν.

    With ν forces err by 2 ν where the energy has a fourth order. With spin, see above, the share is
    the square of it over that of the lowest frequency.
    """
    return 3 * ratio


class SpinLimits:
    """Says which parts between joints spin too fast for their shapes."""

    def __init__(self, scene: Scene) -> None:
        """Nothing is computed."""
        self._scene, self._joints = scene, scene.named(Joint)
        self._lowest: dict[tuple[int, int], float] = {}
        self._slow = float(np.sqrt(LACKING / off_by(1.0)))  # spin over the lowest frequency

    def limit(self, body: Body, known: Array) -> float | None:
        """Spin that a body has passed; None if it has not [rad/s]. Collective.

        Stresses by spins W are linear in WWᵀ, and shapes know those of a spin that stays, in its
        frame.
        """
        own, W = body.data.shapes, body.motion.angular_velocity_body
        if not self._joints or own is None or own.drift is not None:
            return None
        key = body.data.number, len(own)
        if key not in self._lowest:
            self._lowest[key] = self._found(body)
        changed, limit = np.outer(W, W) - np.outer(known, known), self._slow * self._lowest[key]
        return limit if np.linalg.norm(changed, 2) > limit**2 else None

    def forget(self, number: int) -> None:
        """Forget a body that is no more."""
        self._lowest = {key: own for key, own in self._lowest.items() if key[0] != number}

    def check(self, state: State) -> None:
        """Refuse parts named `Reduced` whose joints would stiffen them. Collective.

        Raises:
            SceneError: On every rank, with the limit.
        """
        for body in state.bodies if self._joints else ():
            limit = self.limit(body, np.zeros(3)) if body.data.named else None
            if limit is not None:
                spin = float(np.linalg.norm(body.motion.angular_velocity))
                raise SceneError(
                    f"Reduced '{body.data.name}': at t = {state.t:.4g} s it spins at {spin:.4g} "
                    f"rad/s between joints, whose forces stiffen it. Its shapes hold up to "
                    f"{limit:.4g} rad/s, {self._slow:.1%} of its lowest frequency of "
                    f"{limit / self._slow / (2 * np.pi):.4g} Hz. Take the Reduced away: keep its "
                    "cells flexible, or name it Rigid."
                )

    def _found(self, body: Body) -> float:
        """Lowest frequency of a part that no joint holds; ∞ of others. Collective [rad/s]."""
        shapes, own = body.data.shapes, body.data.nodes
        assert shapes is not None
        faces = [a.nodes for joint in self._joints for a in joint.averages]
        if not self._scene.sum(sum(np.isin(nodes, own).sum() for nodes in faces)):
            return np.inf
        return float(np.sqrt(max(eigvalsh(shapes.stiffness, shapes.mass)[0], 0.0)))
