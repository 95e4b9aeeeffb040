"""Ritz vectors from loads: K⁻¹f, K⁻¹M K⁻¹f, ..., made orthonormal by the mass.

E. L. Wilson, M.-W. Yuan, J. M. Dickens, Earthquake Engng Struct. Dyn. 10 (1982) 813,
doi:10.1002/eqe.4290100606.
"""

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
EPS = float(np.finfo(np.float64).eps)
CLEAN = float(np.sqrt(EPS))  # part of a follower that may be rounding
ALL = int(np.iinfo(np.int64).max)


def ritz(
    responses: Responses,
    *loads: tuple[Array, int],
    resolved: float = 0.0,
    most: int = MOST,
    clean: bool = False,
    known: Array | None = None,
) -> tuple[Array, int]:
    """Ritz vectors of forces: first the responses to all, then those to these' inertia. Collective.

    What Δt does not resolve, by 1/ω [s], follows forces at once, and has no followers. Besides,
    these would be rounding: each response to inertia makes the slowest motions' part in it larger
    by the square of its frequency over theirs. They are `clean` if they end where it is `CLEAN`.

    Each load has patterns, the most important first, shape (owned nodes, 3, k) [N], and the number
    of responses in a row; there are no followers from `most` vectors on. Vectors Y with YᵀMY = 1,
    shape (owned nodes, 3, n) [1/√kg], dependent ones left out, and the number of those that are
    called for: a few that are not resolved follow, which may fill a block. Vectors that are known
    have no part in them: rounding along slow ones would take over.
    """
    scene = responses.scene
    basis = Basis(scene.owned_nodes, scene.sum, lambda u: (u, responses.inertia(u)))
    late: list[Array] = []
    if known is not None:
        _add(responses, basis, known)
    first, most = len(basis), most + len(basis)
    next_loads, slow = [F for F, _ in loads], np.zeros(len(loads))
    rounding = np.full(len(loads), EPS if clean else 0.0)
    for level in range(max(depth for _, depth in loads)):
        for k, (_, depth) in enumerate(loads):
            F, before = next_loads[k], len(basis)
            if level == depth or (level and before >= most):
                next_loads[k] = F = F[:, :, :0]
            if not F.shape[2]:
                continue
            Y = responses.solve(F)
            if level:
                squares, T = slowest(scene.comm, responses.dot(F, Y))  # 1/ω²
                slow[k] = max(slow[k], squares[0])
                pure = rounding[k] * slow[k] <= CLEAN * squares
                squares = squares[pure & (squares > resolved**2) if level > 1 else pure]
                some = whole_groups(squares, most - before)
                rounding[k] *= slow[k] / squares[some - 1] if some else 1.0
                Y = Y @ T
                late.append(Y[:, :, some:])
                Y = Y[:, :, :some]
            _add(responses, basis, Y)
            next_loads[k] = basis.images[:, :, before:]
    count = len(basis)
    for Y in late:
        _add(responses, basis, Y[:, :, : max(count + BLOCK - len(basis), 0)])
    return basis.vectors[:, :, first:], count - first


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
    """Shapes of a part by patterns F, the most important first, that act on the whole. Collective.

    If `count` is None there are as many as are resolved, by 1/ω [s]: `DEPTH` for each pattern at
    most, `FACE_DEPTH` for each one of faces, see `of_faces`, and one for each slow one, which has
    no followers; `MOST` in all, in threes. There are fewer where the forces lead to no more.
    `SceneError` on every rank, if it can have no such number of shapes.
    """
    none = F[:, :, :0]
    each = (F, none if faces is None else faces, none if slow is None else slow)
    loads = [own[:, :, responses.act_on(part.nodes, own)] for own in each]
    if count is None:
        depths = DEPTH, FACE_DEPTH, 1
        vectors, n = ritz(responses, *zip(loads, depths, strict=True), resolved=resolved)
        wanted = min(-(-n // BLOCK) * BLOCK, MOST, part.room)
        return part.shapes(vectors, wanted, BLOCK)
    wanted, before, vectors = whole("Reduced", "shapes", count, least=1), -1, none
    k, joined, once = (own.shape[2] for own in loads)
    depth, shapes = max(1, (wanted - once) // max(k + joined, 1)), part.shapes(vectors, wanted)
    # Beyond the unknowns of a part vectors are rounding.
    while len(shapes.force) < wanted and before < vectors.shape[2] and before < part.room:
        before = vectors.shape[2]
        vectors, _ = ritz(responses, *zip(loads, (depth, depth, 1), strict=True), most=ALL)
        shapes, depth = part.shapes(vectors, wanted), 2 * depth
    return shapes
