"""The patterns that differ among many forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.responses import Responses

__all__ = ["compressed", "interleaved"]

Array = npt.NDArray[np.float64]

# Size of a pattern over the largest one of its load: to leave it out alters the load's response by
# a tenth of the error that is allowed, 0.01.
DIFFERS = 1e-3


def compressed(scene: Scene, F: Array) -> Array:
    """An orthonormal basis of forces, the main pattern first. Collective.

    Args:
        scene: The problem.
        F: Forces, shape (owned nodes, 3, k) [N].

    Returns:
        Of the same shape with as many as differ, none of vanishing forces.
    """
    flat = columns(F)
    squares, turn = scene.comm.bcast(np.linalg.eigh(scene.sum(flat.T @ flat)))
    some = squares > DIFFERS**2 * squares.max(initial=np.finfo(np.float64).tiny)
    return np.asarray((F @ (turn[:, some] / np.sqrt(squares[some])))[:, :, ::-1])


def interleaved(responses: Responses, each: Sequence[Array]) -> Array:
    """All patterns in balance with inertia, the first ones of all effects first. Collective.

    Args:
        responses: Of the whole structure.
        each: Patterns of each effect, shape (owned nodes, 3, k).

    Returns:
        Those that do not vanish, of norm 1, likewise.
    """
    rank = np.concatenate([np.arange(F.shape[2]) for F in each])
    every = np.concatenate(each, axis=2)[:, :, np.argsort(rank, kind="stable")]
    every = responses.balanced(every)
    sizes = np.sqrt(responses.scene.sum((columns(every) ** 2).sum(axis=0)))
    return np.asarray(every[:, :, sizes > 0] / sizes[sizes > 0])
