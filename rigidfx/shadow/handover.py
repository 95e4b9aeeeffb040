"""What shadows of bodies hand on to those that come after them.

What is left of a body keeps its shadow, and what it has let go is in its margin. Where a body has
grown, what its shadow did would tear the new cells, which saw it move rigidly: it begins anew, at
rest under its forces.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.motion import Motion, at_rest, frozen_velocities

__all__ = ["Carried"]

Ints = npt.NDArray[np.int64]


class Carried:
    """The motion of shadows in space, whatever bodies come next."""

    def __init__(self, nodes: int, margin: Margin | None, bodies: Bodies, motion: Motion) -> None:
        """Take it out of the bodies' frames.

        Args:
            nodes: Number of owned nodes.
            margin: What has had shadows, and has moved with them; None if nothing has.
            bodies: Bodies at the end of the last accepted step.
            motion: Of their shadows.
        """
        # δ, δ̇ and its mean, K⁺ρ and its mean; NaN without a shadow.
        self._moved = np.full((5, nodes, 3), np.nan)
        # Velocity of the bodies, and what their freezes have taken out of it; NaN outside.
        self._rigid = np.full((2, nodes, 3), np.nan)
        self._before: set[int] = set()
        if margin is None:
            return
        parts = margin.parts
        of = {id(body): k for k, body in enumerate(parts.bodies)}
        self._before = set(of)
        fields = motion.u, motion.v, motion.w, motion.still, motion.mean
        for body in bodies:
            if id(body.data) in of:
                k, R = of[id(body.data)], body.motion.R
                own = np.concatenate([margin.inside[parts.at[k]], margin.round[k]])
                self._moved[:, margin.rows.nodes[own]] = [field[own] @ R.T for field in fields]
                taken = frozen_velocities(body.data) @ R.T
                self._rigid[:, body.data.nodes] = body.velocities, taken

    def by(self, scene: Scene, margin: Margin, bodies: Bodies) -> tuple[Motion, list[Ints]]:
        """Motion of shadows that go on, and of those that begin. Collective.

        Args:
            scene: The problem.
            margin: What has shadows from now on, and what moves with them.
            bodies: Bodies at present.

        Returns:
            The motion, and the rows of bodies that have just grown, with their margins.
        """
        motion, moved, parts = at_rest(margin.rows.nodes.size), self._moved, margin.parts
        present = {id(body.data): body for body in bodies}
        known = ~np.isnan(self._rigid[0, :, 0])
        local = [[known[data.nodes].sum(), data.nodes.size] for data in parts.bodies]
        counts = np.reshape(scene.sum(np.array(local)), (-1, 2))
        grown: list[Ints] = []
        each = zip(parts.bodies, parts.at, margin.round, counts, strict=True)
        for data, at, around, (old, every) in each:
            body, at = present[id(data)], margin.inside[at]
            R = body.motion.R
            u, v, w, still, mean = moved[:, data.nodes]
            if old < every:
                v = self._rigid[0, data.nodes] - body.velocities
                grown += [np.concatenate([at, around])] if old else []
            else:
                motion.u[at], motion.w[at] = u @ R, w @ R
                nodes = margin.rows.nodes[around]
                some = ~np.isnan(moved[0, nodes, 0])
                here, nodes = around[some], nodes[some]
                motion.u[here], motion.w[here] = moved[0, nodes] @ R, moved[2, nodes] @ R
                # Cells that are let go have their own velocities back.
                back = np.nan_to_num(self._rigid[1, nodes])
                motion.v[here] = (moved[1, nodes] - back) @ R
            motion.v[at] = np.where(known[data.nodes, None], v @ R, frozen_velocities(data))
            if id(data) in self._before:
                motion.still[at], motion.mean[at] = still @ R, mean @ R
        return motion, grown
