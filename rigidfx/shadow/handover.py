"""What shadows of bodies hand on to those that come after them.

What is left of a body keeps its shadow. Where a body has grown, what its shadow did would tear the
new cells, which saw it move rigidly: it begins anew, at rest under its forces.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene
from rigidfx.shadow.motion import Motion, at_rest, frozen_velocities
from rigidfx.shadow.parts import Parts

__all__ = ["Carried"]

Ints = npt.NDArray[np.int64]


class Carried:
    """The motion of shadows in space, whatever bodies come next."""

    def __init__(self, nodes: int, parts: Parts | None, bodies: Bodies, motion: Motion) -> None:
        """Take it out of the bodies' frames.

        Args:
            nodes: Number of owned nodes.
            parts: What has had shadows; None if nothing has.
            bodies: Bodies at the end of the last accepted step.
            motion: Of their shadows.
        """
        # δ, δ̇ and its mean, K⁺ρ and its mean, the velocity of the bodies; NaN without a shadow.
        self._moved = np.full((6, nodes, 3), np.nan)
        self._before: set[int] = set()
        if parts is None:
            return
        of = dict(zip(map(id, parts.bodies), parts.at, strict=True))
        self._before = set(of)
        for body in bodies:
            if id(body.data) in of:
                at, R = of[id(body.data)], body.motion.R
                fields = motion.u, motion.v, motion.w, motion.still, motion.mean
                own = np.stack([field[at] for field in fields]) @ R.T
                self._moved[:, body.data.nodes] = [*own, body.velocities]

    def by(self, scene: Scene, parts: Parts, bodies: Bodies) -> tuple[Motion, list[Ints]]:
        """Motion of shadows that go on, and of those that begin. Collective.

        Args:
            scene: The problem.
            parts: What has shadows from now on.
            bodies: Bodies at present.

        Returns:
            The motion, and the rows of bodies that have just grown.
        """
        motion, moved = at_rest(parts.rows.nodes.size), self._moved
        present = {id(body.data): body for body in bodies}
        known = ~np.isnan(moved[0, :, 0])
        local = [[known[data.nodes].sum(), data.nodes.size] for data in parts.bodies]
        counts = np.reshape(scene.sum(np.array(local)), (-1, 2))
        grown: list[Ints] = []
        for data, at, (old, every) in zip(parts.bodies, parts.at, counts, strict=True):
            body, here = present[id(data)], known[data.nodes, None]
            u, v, w, still, mean, whole = moved[:, data.nodes]
            if old < every:
                v = whole - body.velocities
                grown += [at] if old else []
            else:
                motion.u[at], motion.w[at] = u @ body.motion.R, w @ body.motion.R
            motion.v[at] = np.where(here, v @ body.motion.R, frozen_velocities(data))
            if id(data) in self._before:
                motion.still[at], motion.mean[at] = still @ body.motion.R, mean @ body.motion.R
        return motion, grown
