"""Forces at some instants, and the patterns that differ among them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dpstrf

from rigidfx.base.types import Array
from rigidfx.effects import Effect
from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.responses import Responses

# Size of a pattern over the largest one of its load: to leave it out alters the load's response by
# a tenth of the error that is allowed, 0.01.
DIFFERS = 1e-3
# Beside the breakpoints: a force that moves along a part is known at each twentieth of its way, an
# amplitude, which costs little, at the square of so many instants.
INSTANTS = 20


def compressed(scene: Scene, F: Array) -> Array:
    """An orthonormal basis of forces, (owned nodes, 3, k) [N], the main one first. Collective."""
    flat = columns(F)
    squares, turn = scene.comm.bcast(np.linalg.eigh(scene.sum(flat.T @ flat)))
    some = squares > DIFFERS**2 * squares.max(initial=np.finfo(np.float64).tiny)
    return np.asarray((F @ (turn[:, some] / np.sqrt(squares[some])))[:, :, ::-1])


def interleaved(responses: Responses, each: Sequence[Array]) -> Array:
    """Patterns of all effects in balance with inertia, the first ones of each first. Collective.

    They have the shape (owned nodes, 3, k) and the norm 1; those that vanish are left out.
    """
    none = np.zeros((responses.scene.owned_nodes, 3, 0))
    rank = np.concatenate([np.arange(F.shape[2]) for F in (none, *each)])
    every = np.concatenate([none, *each], axis=2)[:, :, np.argsort(rank, kind="stable")]
    every = responses.balanced(every)
    sizes = np.sqrt(responses.scene.sum((columns(every) ** 2).sum(axis=0)))
    return np.asarray(every[:, :, sizes > 0] / sizes[sizes > 0])


def instants(
    scene: Scene,
    effects: Sequence[Effect],
    span: tuple[float, float],
    of: Callable[[float], Array] | None = None,
) -> Array:
    """Instants in a span while all of some effects act, sorted; none if they do not [s].

    `of` gives numbers of this rank at an instant, all of whose patterns are to be met. Collective.
    """
    start, end = span
    windowed: list[Any] = [effect for effect in effects if effect.is_windowed]
    for effect in windowed:
        start, end = max(start, effect.since), min(end, effect.until)
    if not start < end:
        return np.empty(0)
    kinks = [t for effect in effects for t in effect.breakpoints if start <= t < end]
    # Parts of the golden section, which are no multiples of a period.
    parts = np.modf((np.arange(INSTANTS**2) + 0.5) * (np.sqrt(5) - 1) / 2)[0]
    dense = start + (end - start) * parts
    found = np.r_[start, dense[:INSTANTS], kinks]
    if of is not None:
        found = np.r_[found, dense[_spanning(scene, np.stack([of(t) for t in dense], axis=1))]]
    return np.unique(found)


def _spanning(scene: Scene, values: Array) -> npt.NDArray[np.intp]:
    """Columns of which all others are combinations, on all ranks, but for `DIFFERS`. Collective."""
    gram = np.asarray(scene.sum(values.T @ values))
    least = max(DIFFERS**2 * gram.diagonal().max(), np.finfo(np.float64).tiny)
    _, order, count, _ = dpstrf(gram, tol=least)  # Cholesky's, the largest that is left first
    return np.asarray(scene.comm.bcast(order[:count] - 1))
