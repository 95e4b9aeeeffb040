"""Ritz vectors from loads: K⁻¹f, K⁻¹M K⁻¹f, ..., made orthonormal by the mass.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthquake Engng Struct. Dyn. 10 (1982) 813,
doi:10.1002/eqe.4290100606.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.base.inputs import whole
from rigidfx.shapes.orthonormal import Basis, columns, slowest, whole_groups
from rigidfx.shapes.part import BLOCK, MOST, Part, PartShapes
from rigidfx.shapes.responses import Responses

__all__ = ["grown", "ritz", "shapes_of"]

Array = npt.NDArray[np.float64]

# Vectors from each load, at most. A bar that falls on one end errs by 29, 15, 1 % of the peak force
# with 4, 6, 10. A plate of 6534 unknowns that is struck twice errs by 3e-5 of its way with 4 to 10,
# and takes 1.16 times as long with 10 as with 4 (`reduced.py`).
DEPTH = 10
FACE_DEPTH = 2  # from each load of a face that a joint holds


def ritz(responses: Responses, *loads: tuple[Array, int]) -> Array:
    """Ritz vectors of forces: first the responses to all, then those to these' inertia. Collective.

    Args:
        responses: Of the whole structure.
        loads: Patterns of forces, the most important first, shape (owned nodes, 3, k) [N], and the
            number of responses in a row.

    Returns:
        Vectors Y with YᵀMY = 1, dependent ones left out, shape (owned nodes, 3, n) [1/√kg].
    """
    basis = Basis(responses.scene.owned_nodes, responses.scene.sum)
    next_loads = [F for F, _ in loads]
    for level in range(max(depth for _, depth in loads)):
        for k, (_, depth) in enumerate(loads):
            if level < depth:
                before = len(basis)
                _respond(responses, basis, next_loads[k])
                next_loads[k] = basis.images[:, :, before:]
    return basis.vectors


def grown(responses: Responses, F: Array, most: int, resolved: float) -> Array:
    """Ritz vectors of nodes that begin to press: as of `ritz`, but the slowest first. Collective.

    What Δt does not resolve follows forces at once: its responses to inertia are left out.

    Args:
        responses: Of the whole structure.
        F: Patterns of forces, `most` at most, shape (owned nodes, 3, k) [N].
        most: Number of vectors, at most.
        resolved: Time step [s]; periods below 2π times this are not resolved.

    Returns:
        As of `ritz`, the k responses to the patterns first, of which none may be dependent.
    """
    basis, before = Basis(len(F), responses.scene.sum), 0
    _respond(responses, basis, F)
    for _ in range(DEPTH - 1 if resolved < np.inf else 0):
        F, before = basis.images[:, :, before:], len(basis)
        Y = responses.solve(F)
        squares, T = slowest(responses.scene.comm, responses.dot(F, Y))  # 1/ω²
        squares = squares[squares > resolved**2]
        _add(responses, basis, Y @ T[:, : whole_groups(squares, most - before)])
    return basis.vectors


def _respond(responses: Responses, basis: Basis, F: Array) -> None:
    """Add responses to forces to a basis. Collective."""
    if F.shape[2]:
        _add(responses, basis, responses.solve(F))


def _add(responses: Responses, basis: Basis, Y: Array) -> None:
    """Add displacements to a basis. Collective."""
    if Y.shape[2]:
        MY = responses.inertia(Y)
        sizes = np.sqrt(responses.scene.sum((columns(Y) * columns(MY)).sum(axis=0)))
        basis.grow(Y, MY, sizes, len(basis) + Y.shape[2])


def shapes_of(
    part: Part,
    responses: Responses,
    F: Array,
    count: int | None = None,
    slow: Array | None = None,
    faces: Array | None = None,
) -> PartShapes:
    """Shapes of a part by the forces that act on the whole. Collective.

    Args:
        part: The part.
        responses: Of the whole structure.
        F: Patterns of forces, the most important first, shape (owned nodes, 3, k).
        count: How many shapes; if None `DEPTH` for each pattern, `FACE_DEPTH` for each one of faces
            and one for each slow one, `MOST` at most, in threes.
        slow: Patterns of forces that vary slowly, whose responses have no followers; none if None.
        faces: Patterns of forces of joints: see `of_faces`; none if None.

    Returns:
        The shapes; fewer than asked for where the forces lead to no more.

    Raises:
        SceneError: On every rank, if it can have no such number of shapes.
    """
    none = F[:, :, :0]
    given = (F, none if faces is None else faces, none if slow is None else slow)
    loads = [own[:, :, part.bears(own)] for own in given]
    k, joined, once = (own.shape[2] for own in loads)
    if count is None:
        wanted = DEPTH * k + FACE_DEPTH * joined + once
        wanted = min(-(-wanted // BLOCK) * BLOCK, MOST, part.room)
        most = wanted, FACE_DEPTH, 1
    else:
        wanted = whole("Reduced", "shapes", count, least=1)
        most = wanted, wanted, 1
    depth, before, vectors = max(1, (wanted - once) // max(k + joined, 1)), -1, none
    shapes = part.shapes(vectors, wanted)
    while len(shapes.force) < wanted and vectors.shape[2] > before:
        before = vectors.shape[2]
        depths = (min(depth, own) for own in most)
        vectors = ritz(responses, *zip(loads, depths, strict=True))
        shapes, depth = part.shapes(vectors, wanted), depth + 1
    return shapes if count is not None else part.shapes(vectors, wanted, BLOCK)
