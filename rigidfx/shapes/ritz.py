"""Ritz vectors from loads: K⁻¹f, K⁻¹M K⁻¹f, ..., made orthonormal by the mass.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthquake Engng Struct. Dyn. 10 (1982) 813,
doi:10.1002/eqe.4290100606.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.base.inputs import whole
from rigidfx.shapes.orthonormal import Basis, columns
from rigidfx.shapes.part import BLOCK, MOST, Part, PartShapes
from rigidfx.shapes.responses import Responses

__all__ = ["GROWN_DEPTH", "ritz", "shapes_of"]

Array = npt.NDArray[np.float64]

# Vectors from each load that is known at the start, and from a node that begins to press. A plate
# of 6534 unknowns that is struck twice errs by 9.2e-4, 4.3e-4, 1.9e-4, 5.4e-5 of its way with 12,
# 18, 24, 36 shapes, and its steps take 1.3 times as long with 36 as with 12 (`reduced.py`); a
# device that falls on a corner errs by 0.3 % of the peak force with 4.
DEPTH, GROWN_DEPTH = 10, 4


def ritz(responses: Responses, F: Array, depth: int, slow: Array | None = None) -> Array:
    """Ritz vectors of forces: first the responses to all, then those to these' inertia. Collective.

    Args:
        responses: Of the whole structure.
        F: Patterns of forces, the most important first, shape (owned nodes, 3, k) [N].
        depth: Number of responses in a row.
        slow: Patterns of forces that vary slowly, whose responses have no followers; none if None.

    Returns:
        Vectors Y with YᵀMY = 1, dependent ones left out, shape (owned nodes, 3, n) [1/√kg].
    """
    basis = Basis(len(F), responses.scene.sum)
    for level in range(depth):
        before = len(basis)
        _respond(responses, basis, F)
        F = basis.images[:, :, before:]
        if level == 0 and slow is not None:
            _respond(responses, basis, slow)
    return basis.vectors


def _respond(responses: Responses, basis: Basis, F: Array) -> None:
    """Add responses to forces to a basis. Collective."""
    if F.shape[2]:
        Y = responses.solve(F)
        MY = responses.inertia(Y)
        sizes = np.sqrt(responses.scene.sum((columns(Y) * columns(MY)).sum(axis=0)))
        basis.grow(Y, MY, sizes, len(basis) + F.shape[2])


def shapes_of(
    part: Part,
    responses: Responses,
    F: Array,
    count: int | None = None,
    slow: Array | None = None,
) -> PartShapes:
    """Shapes of a part by the forces that act on the whole. Collective.

    Args:
        part: The part.
        responses: Of the whole structure.
        F: Patterns of forces, the most important first, shape (owned nodes, 3, k).
        count: How many shapes; if None `DEPTH` for each pattern and one for each slow one, `MOST`
            at most, in threes.
        slow: See `ritz`.

    Returns:
        The shapes; fewer than asked for where the forces lead to no more.

    Raises:
        SceneError: On every rank, if it can have no such number of shapes.
    """
    k, once = F.shape[2], 0 if slow is None else slow.shape[2]
    if count is None:
        wanted = min(-(-(DEPTH * k + once) // BLOCK) * BLOCK, MOST, part.room)
    else:
        wanted = whole("Reduced", "shapes", count, least=1)
    depth, before, vectors = max(1, (wanted - once) // max(k, 1)), -1, F[:, :, :0]
    shapes = part.shapes(vectors, wanted)
    while len(shapes.force) < wanted and vectors.shape[2] > before:
        before, vectors = vectors.shape[2], ritz(responses, F, depth, slow)
        shapes, depth = part.shapes(vectors, wanted), depth + 1
    return shapes if count is not None else part.shapes(vectors, wanted, BLOCK)
