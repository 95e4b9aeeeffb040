"""The spin up to which shapes hold for parts between joints.

A part that spins on a hinge is stretched by the hinge's force, and so is stiffer. Shapes do not
know that. A beam that a motor spins up then lags by 4.7 (W/ω)² too much, with W its spin and ω its
lowest frequency while nothing holds it (`test_reduced_joints.py`). Parts are refused above
W² = ω²/300.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigvalsh

from rigidfx.base.errors import SceneError
from rigidfx.effects import Joint
from rigidfx.mechanics.rigid_body import Body
from rigidfx.scene.scene import Scene
from rigidfx.shapes.part import LACKING
from rigidfx.state import State

__all__ = ["SpinLimits", "off_by"]


def off_by(ratio: float) -> float:
    """Bound of the relative error of amplitudes, by the share of energy that shapes lack.

    With ν forces err by 2 ν where the energy has a fourth order; with spin see above.

    Args:
        ratio: ν, or the square of a spin over that of the lowest frequency.
    """
    return 3 * ratio


class SpinLimits:
    """Refuses reduced parts between joints that spin too fast."""

    def __init__(self, scene: Scene) -> None:
        """Nothing is computed.

        Args:
            scene: The problem.
        """
        self._scene, self._joints = scene, scene.named(Joint)
        self._lowest: dict[tuple[str, int], float] = {}

    def check(self, state: State) -> None:
        """Refuse parts whose joints would stiffen them. Collective.

        Raises:
            SceneError: On every rank, with the limit.
        """
        for body in state.bodies if self._joints else ():
            own = body.data.shapes
            if own is None or own.drift is not None:
                continue
            key = body.data.name, len(own)
            if key not in self._lowest:
                self._lowest[key] = self._found(body)
            spin, lowest = float(np.linalg.norm(body.motion.angular_velocity)), self._lowest[key]
            if off_by((spin / lowest) ** 2) > LACKING:
                limit = lowest * np.sqrt(LACKING / off_by(1.0))
                raise SceneError(
                    f"Reduced '{body.data.name}': at t = {state.t:.4g} s it spins at {spin:.4g} "
                    f"rad/s between joints, whose forces stiffen it. Its shapes hold up to "
                    f"{limit:.4g} rad/s, {limit / lowest:.1%} of its lowest frequency of "
                    f"{lowest / (2 * np.pi):.4g} Hz. Take the Reduced away: keep its cells "
                    "flexible, or name it Rigid."
                )

    def _found(self, body: Body) -> float:
        """Lowest frequency of a part that no joint holds; ∞ of others. Collective [rad/s]."""
        shapes, own = body.data.shapes, body.data.nodes
        assert shapes is not None
        faces = [a.nodes for joint in self._joints for a in joint.averages]
        if not self._scene.sum(sum(np.isin(nodes, own).sum() for nodes in faces)):
            return np.inf
        mass = np.einsum("klii->kl", shapes.moments[1:, 1:])
        return float(np.sqrt(max(eigvalsh(shapes.stiffness, mass)[0], 0.0)))
