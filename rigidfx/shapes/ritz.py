"""Ritz vectors from loads: K⁻¹f, K⁻¹M K⁻¹f, ..., made orthonormal by the mass.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthquake Engng Struct. Dyn. 10 (1982) 813,
doi:10.1002/eqe.4290100606.

On springs f is in balance with springs in K⁻¹f, with inertia soon after it begins: the response to
the inertia of the rigid motion that f starts is among the first vectors. Rigid motions themselves,
which may be many times as large, are taken out of all.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.base.inputs import whole
from rigidfx.shapes.orthonormal import Basis
from rigidfx.shapes.part import MOST, Part, PartShapes
from rigidfx.shapes.responses import Responses

__all__ = ["ritz", "shapes_of"]

Array = npt.NDArray[np.float64]

DEPTH = 4  # vectors from each load: a struck plate with two loads errs by 1.3e-4 of its way


def ritz(responses: Responses, F: Array, depth: int) -> Array:
    """Ritz vectors of forces: first the responses to all, then those to these' inertia. Collective.

    Args:
        responses: Of the whole structure.
        F: Patterns of forces, the most important first, shape (owned nodes, 3, k) [N].
        depth: Number of responses in a row.

    Returns:
        Vectors Y with YᵀMY = 1, dependent ones left out, shape (owned nodes, 3, n) [1/√kg].
    """
    basis = Basis(len(F), responses.scene.sum)
    if responses.swings.shape[2]:
        F = np.concatenate([F, responses.swinging(F)], axis=2)
    for _ in range(depth):
        if F.shape[2] == 0:
            break
        Y = responses.deformed(F)
        MY = responses.inertia(Y)
        sizes = np.sqrt(np.asarray(responses.scene.sum(np.einsum("nak,nak->k", Y, MY))))
        before = len(basis)
        basis.grow(Y, MY, sizes, before + F.shape[2])
        F = basis.images[:, :, before:]
    return basis.vectors


def shapes_of(part: Part, responses: Responses, F: Array, count: int | None = None) -> PartShapes:
    """Shapes of a part by the forces that act on the whole. Collective.

    Args:
        part: The part.
        responses: Of the whole structure.
        F: Patterns of forces, the most important first, shape (owned nodes, 3, k).
        count: How many shapes; if None `DEPTH` for each pattern, `MOST` at most, in threes.

    Returns:
        The shapes; fewer than asked for where the forces lead to no more.

    Raises:
        SceneError: On every rank, if it can have no such number of shapes.
    """
    wanted = MOST if count is None else whole("Reduced", "shapes", count, least=1)
    patterns = max(F.shape[2], 1)
    depth = -(-wanted // patterns)
    depth = min(depth, DEPTH) if count is None else depth
    vectors = ritz(responses, F, depth)
    shapes, before = part.shapes(vectors, count), -1
    while count is not None and len(shapes.force) < count and vectors.shape[2] > before:
        before, depth = vectors.shape[2], depth + 1
        vectors = ritz(responses, F, depth)
        shapes = part.shapes(vectors, count)
    return shapes
