"""What released cells bear on: the stress by which their bodies' shadows have moved."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.mechanics.eased import Eased
from rigidfx.step.stepper import Stepper

__all__ = ["let_down"]


class Moved(Protocol):
    """Knows what bodies have withheld."""

    def moved(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
        """Displacements in space of owned nodes [m], and the bodies' cells. Collective."""
        ...


def let_down(
    shadow: Moved, stepper: Stepper, leaving: npt.NDArray[np.integer], span: float
) -> Eased | None:
    """Cells with what they are to bear on, before they are released. Collective.

    Args:
        shadow: Shadows of the bodies, or the error motion.
        stepper: Solves the steps.
        leaving: Owned cells that are to be released, sorted.
        span: Time in which that is to fade [s].

    Returns:
        None where shadows know nothing of them, or have not moved.
    """
    scene, state = stepper.scene, stepper.state
    moved, known = shadow.moved()
    cells = np.intersect1d(leaving, known).astype(np.int32)
    further = fem.Function(scene.space)
    further.x.array[: moved.size] = moved.reshape(-1)
    further.x.scatter_forward()
    nodes = np.unique(scene.space.dofmap.list[cells]).astype(np.int32)
    by = further.x.array.reshape(-1, 3)[nodes]
    if not scene.sum(float(np.abs(by).sum())) > 0:
        return None
    state.rebuild()
    shape = state.u.x.array.reshape(-1, 3)[nodes]
    return Eased(cells, nodes, shape, shape + by, state.t, span)
