"""Ritz vectors from loads: K⁻¹f, K⁻¹M K⁻¹f, ..., made orthonormal by the mass.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthquake Engng Struct. Dyn. 10 (1982) 813,
doi:10.1002/eqe.4290100606.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.shapes.orthonormal import Basis
from rigidfx.shapes.responses import Responses

__all__ = ["ritz"]

Array = npt.NDArray[np.float64]


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
    for _ in range(depth):
        if F.shape[2] == 0:
            break
        Y = responses.solve(F)
        MY = responses.inertia(Y)
        sizes = np.sqrt(np.asarray(responses.scene.sum(np.einsum("nak,nak->k", Y, MY))))
        before = len(basis)
        basis.grow(Y, MY, sizes, before + F.shape[2])
        F = basis.images[:, :, before:]
    return basis.vectors
