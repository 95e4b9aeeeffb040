"""The fading stress of released cells, which rigidity withheld."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.error.error_motion import ErrorMotion
from rigidfx.mechanics.eased import Eased
from rigidfx.step.stepper import Stepper

__all__ = ["let_down"]


def let_down(
    error: ErrorMotion, stepper: Stepper, leaving: npt.NDArray[np.integer], span: float
) -> Eased | None:
    """Cells with the stress that they are to bear on, before they are released. Collective.

    Args:
        error: The error motion.
        stepper: Solves the steps.
        leaving: Owned cells that are to be released, sorted.
        span: Time in which that is to fade [s].

    Returns:
        None where e is zero there.
    """
    scene, state = stepper.scene, stepper.state
    moved, known = error.moved()
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
