"""Has a set of nodes turned whose springs know the place of each of them?

A spring pulls each node back to where it began. On a set of some radius it is a torsional spring as
well, which a shaft on bearings has not: it lets the shaft swing to and fro. Nodes on the axis do
not turn.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array, Ints
from rigidfx.base.warning import warn
from rigidfx.effects import Spring
from rigidfx.report.deformation import THIN
from rigidfx.report.report import Look, Report
from rigidfx.scene.scene import Scene

__all__ = ["TurnedSprings"]


TURNED = 0.3  # rad; springs that give back all of a spin may stop it before it is a radian
WORTH_A_WARNING = 1e-3  # of the largest energy: what springs have stored by the rotation
EVERY = 4  # steps from look to look


class TurnedSprings(Look):
    """Looks at the sets of springs in some reports; warns once."""

    remembered: ClassVar[Remembered] = same("_most", "_waits")

    def __init__(self, scene: Scene) -> None:
        """Find the nodes of springs. Collective.

        Args:
            scene: The problem.
        """
        self._scene, self._most, self._waits = scene, 0.0, True
        n = scene.owned_nodes
        self._X: Array = scene.space.tabulate_dof_coordinates()[:n]
        self._springs = []
        for spring in (s for s in scene.named(Spring) if s.face is None):
            weights = scene.shares(spring.where, spring.kind)[:n]
            on = np.flatnonzero(weights)
            rest = scene.start_places[on] if spring.relaxed == "start" else self._X[on]
            arms = rest - scene.sum(weights[on] @ rest)
            square = scene.sum(weights[on] @ (arms**2).sum(axis=1))
            if square > 0 and spring.K.any():
                self._springs.append((spring, on, weights[on], arms))

    def follow(self, report: Report) -> None:
        """Look at a report. Collective.

        Args:
            report: The next one, of which nothing has gone on.
        """
        if not (self._waits and self._springs):
            return
        self._most = max(self._most, report.energy)
        if report.step % EVERY:
            return
        for spring, on, w, X in self._springs:
            x = self._positions(report, on)
            x = x - self._scene.sum(w @ x)
            moved = x - X
            found = self._scene.sum(
                np.append(
                    (w[:, None] * x).T @ X, 0.5 * np.vdot(w[:, None] * moved, moved @ spring.K)
                )
            )
            angle = _angle(found[:9].reshape(3, 3))
            if angle > TURNED and found[9] > WORTH_A_WARNING * self._most:
                self._waits = False
                warn(
                    self._scene.comm,
                    f"Spring on '{spring.where}': at t = {report.t:.6g} s its nodes have turned by "
                    f"{angle:.2g} rad, and each is pulled back to where it began: {found[9]:.3g} J "
                    "are stored by the rotation alone, as in a torsional spring. For a bearing, "
                    "take the nodes on the axis (with_vertices), or a Contact with "
                    "Cylinder(inside=True); see docs/recipes.md.",
                )
                return

    def _positions(self, report: Report, on: Ints) -> Array:
        """Positions of owned nodes, those in bodies too, shape (n, 3) [m]."""
        x = self._X + report.state.u.x.array[: self._X.size].reshape(-1, 3)
        bodies = report.rigid
        for k, record in enumerate(bodies.of.records):
            inside = np.flatnonzero(np.isin(record.nodes, on))
            a = record.coordinates(inside)
            x[record.nodes[inside]] = a @ bodies.pose[k, : a.shape[1]]
        return np.asarray(x[on])


def _angle(M: Array) -> float:
    """Angle of the rotation that fits Σ w x Xᵀ best [rad]; the least one of nodes on a line."""
    U, size, V = np.linalg.svd(M)
    if size[1] <= THIN * size[0]:
        return float(np.arccos(np.clip(U[:, 0] @ V[0], -1.0, 1.0)))
    U[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(V))
    return float(np.arccos(np.clip((np.trace(U @ V) - 1) / 2, -1.0, 1.0)))
