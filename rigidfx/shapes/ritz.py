"""Ritz vectors from loads: K⁻¹f, K⁻¹M K⁻¹f, ..., made orthonormal by the mass.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthquake Engng Struct. Dyn. 10 (1982) 813,
doi:10.1002/eqe.4290100606.
"""

from __future__ import annotations

import numpy as np

from rigidfx.base.inputs import whole
from rigidfx.base.types import Array
from rigidfx.shapes.orthonormal import Basis, columns, slowest, whole_groups
from rigidfx.shapes.part import BLOCK, MOST, Part, PartShapes
from rigidfx.shapes.responses import Responses

# Vectors from each load, at most. A bar that falls on one end errs by 29, 15, 1 % of the peak force
# with 4, 6, 10.
DEPTH = 10
FACE_DEPTH = 2  # from each load of a face that a joint holds
# ωΔt up to which motions have more than one follower: those that samples at Δt can show. A plate
# that is struck twice errs by 4.8e-4, 4e-5, 2.5e-5 of its way and by 12, 0.5, 0.4 % of its peak
# stress where that is 1, 2, 4 (`reduced.py`).
RESOLVED = np.pi
ALL = int(np.iinfo(np.int64).max)


def ritz(
    responses: Responses, *loads: tuple[Array, int], resolved: float = 0.0, most: int = MOST
) -> tuple[Array, int]:
    """Ritz vectors of forces: first the responses to all, then those to these' inertia. Collective.

    What Δt does not resolve follows forces at once, and has no followers. Besides, these would be
    rounding: each response to inertia makes the slowest motions' part in it larger by the square
    of its frequency over theirs.

    Args:
        responses: Of the whole structure.
        loads: Patterns of forces, the most important first, shape (owned nodes, 3, k) [N], and the
            number of responses in a row.
        resolved: 1/ω above which motions have more than one follower, the slowest first [s].
        most: Number of vectors from which on there are no followers.

    Returns:
        Vectors Y with YᵀMY = 1, dependent ones left out, shape (owned nodes, 3, n) [1/√kg], and the
        number of those that are called for: a few that are not resolved follow, which may fill a
        block.
    """
    basis, late = Basis(responses.scene.owned_nodes, responses.scene.sum), []
    next_loads = [F for F, _ in loads]
    for level in range(max(depth for _, depth in loads)):
        for k, (_, depth) in enumerate(loads):
            F, before = next_loads[k], len(basis)
            if level == depth or (level and before >= most):
                next_loads[k] = F = F[:, :, :0]
            if not F.shape[2]:
                continue
            Y = responses.solve(F)
            if level:
                squares, T = slowest(responses.scene.comm, responses.dot(F, Y))  # 1/ω²
                squares = squares[squares > resolved**2] if level > 1 else squares
                some = whole_groups(squares, most - before)
                Y = Y @ T
                late.append(Y[:, :, some:])
                Y = Y[:, :, :some]
            _add(responses, basis, Y)
            next_loads[k] = basis.images[:, :, before:]
    count = len(basis)
    for Y in late:
        _add(responses, basis, Y[:, :, : max(count + BLOCK - len(basis), 0)])
    return basis.vectors, count


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
    resolved: float = 0.0,
) -> PartShapes:
    """Shapes of a part by the forces that act on the whole. Collective.

    Args:
        part: The part.
        responses: Of the whole structure.
        F: Patterns of forces, the most important first, shape (owned nodes, 3, k).
        count: How many shapes; if None as many as are resolved, `DEPTH` for each pattern at most,
            `FACE_DEPTH` for each one of faces and one for each slow one, `MOST` in all, in threes.
        slow: Patterns of forces that vary slowly, whose responses have no followers; none if None.
        faces: Patterns of forces of joints: see `of_faces`; none if None.
        resolved: 1/ω above which responses to patterns have followers, if `count` is None [s].

    Returns:
        The shapes; fewer than asked for where the forces lead to no more.

    Raises:
        SceneError: On every rank, if it can have no such number of shapes.
    """
    none = F[:, :, :0]
    each = (F, none if faces is None else faces, none if slow is None else slow)
    loads = [own[:, :, part.bears(own)] for own in each]
    if count is None:
        depths = DEPTH, FACE_DEPTH, 1
        vectors, n = ritz(responses, *zip(loads, depths, strict=True), resolved=resolved)
        wanted = min(-(-n // BLOCK) * BLOCK, MOST, part.room)
        return part.shapes(vectors, wanted, BLOCK)
    wanted, before, vectors = whole("Reduced", "shapes", count, least=1), -1, none
    k, joined, once = (own.shape[2] for own in loads)
    depth, shapes = max(1, (wanted - once) // max(k + joined, 1)), part.shapes(vectors, wanted)
    while len(shapes.force) < wanted and vectors.shape[2] > before:
        before = vectors.shape[2]
        vectors, _ = ritz(responses, *zip(loads, (depth, depth, 1), strict=True), most=ALL)
        shapes, depth = part.shapes(vectors, wanted), depth + 1
    return shapes
