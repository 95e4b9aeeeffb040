"""The structure that effects are bound to: nodes that take part in a step, bodies, mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.failures import Failures
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.surface import Surface
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene

__all__ = ["BoundStructure"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BoundStructure:
    """A division of a scene, as effects see it: see `rigidfx.effects.action.Structure`.

    Attributes:
        scene: The problem.
        rows: Rows of the nodes that take part in a step.
        own: For each of these nodes, whether it belongs to no body.
        bodies: The rigid bodies.
        mass: Mass operator of these nodes; None in statics.
        u: Displacements of all local dofs at the start of a step [m].
        surface: The deformed boundary.
        failures: Keeps exceptions of a user's functions until all ranks are told.
        notes: Memory of effects from step to step; None where bodies are treated as if they were
            flexible.
        static: Whether forces are those at the end of a step, and nothing moves.
    """

    scene: Scene
    rows: Rows
    own: npt.NDArray[np.bool_]
    bodies: Bodies
    mass: Mass | None
    u: Array
    surface: Surface
    failures: Failures
    notes: dict[int, Any] | None = None
    static: bool = False

    @property
    def once(self) -> float:
        """1 on the first rank, 0 on others: counts once what all ranks know."""
        return float(self.scene.comm.rank == 0)

    def moments(self, values: Array) -> Array:
        """Σ a v of numbers of this rank's nodes over each body, shape (bodies, n, k).

        Args:
            values: Of owned nodes, shape (nodes, k).
        """
        body, a, _ = self.bodies.of.holding(self.u.size // 3)
        held = np.flatnonzero(body[: len(values)] >= 0)
        out = np.zeros((*self.bodies.pose.shape[:2], values.shape[1]))
        np.add.at(out, body[held], a[held, :, None] * values[held, None])
        return out

    def outward_moments(self, where: str, owner: str) -> Array:
        """See `rigidfx.flexible.surface.Surface.outward_moments`. Collective."""
        return self.surface.outward_moments(where, owner, self.bodies)

    def outward_slopes(self, where: str, owner: str) -> Array:
        """See `rigidfx.flexible.surface.Surface.outward_slopes`. Collective."""
        return self.surface.outward_slopes(where, owner, self.bodies)
