"""Do supports, springs and joints exclude every small rigid motion, of every part of a mesh?

Cells joined through facets move as one where nothing strains: six numbers each such part, about its
own centre. Parts that share nodes only are hinged to each other, those that share none are loose.
The conditions on the motions, to vanish at prescribed dofs and springs and to agree at hinges, are
B y = 0; the eigenvalues of BᵀB tell whether y = 0 is the only solution, and if not, which motion is
free.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from rigidfx.base.matrices import dense
from rigidfx.base.types import TINY, Array, Ints
from rigidfx.domain.connected import ConnectedParts, connected_parts
from rigidfx.effects import Joint, SpringDamper, Windowed
from rigidfx.effects.joints.elements import coordinate_of
from rigidfx.effects.joints.pieces import Coordinates, Terms
from rigidfx.effects.joints.vectors import Vector, slopes_of
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.scene.weights import inertial_masses
from rigidfx.step.equations.constraints import elements_of
from rigidfx.step.equations.supports import PrescribedDofs

EPS = np.finfo(np.float64).eps
FREE = float(np.cbrt(EPS * EPS))  # of the largest eigenvalue of BᵀB: motions that B does not see
NOTHING = float(np.sqrt(EPS))  # of a motion: what asks less asks nothing


def joint_rows(scene: Any, acting: Sequence[Windowed], motions: Callable[[Ints], Array]) -> Array:
    """Rows of size one that motions fulfil which joints and springs leave, (rows, n). Collective.

    `motions` gives displacements of owned nodes by the motions of all parts, shape (nodes, 3, n).
    """
    out: list[Array] = []
    joints = {joint.title: joint for joint in scene.named(Joint)}
    places, moved = {}, {}

    def look(vectors: Sequence[Vector]) -> tuple[Array, Array]:
        by = [np.einsum("nij,njm->im", slopes_of(a), motions(a.nodes)) for a in vectors]
        return np.array([a.start for a in vectors]), np.asarray(scene.sum(by))

    for title, joint in joints.items():
        averages = joint.pieces.averages
        places[title], moved[title] = look(averages)
        terms = Terms([joint.pieces.rows], [0], len(averages))
        gradient = dense(terms.gradient(places[title]))
        out.append(gradient @ moved[title].reshape(gradient.shape[1], -1))
    for effect in elements_of(scene, acting):
        if effect.resists:
            joint, name = coordinate_of(scene, effect.owner, effect.joint, effect.acts_along)
            p = places[joint.title]
            q = Coordinates([joint.pieces.coordinates[name]], [0], len(p))
            out.append(dense(q.chained(q.slopes(p), p)) @ moved[joint.title].reshape(p.size, -1))
    for spring in scene.named(SpringDamper):
        (a, b), by = look(spring.averages)
        if spring.taut:
            out.append(((b - a) @ (by[1] - by[0]))[None])
    none = motions(np.empty(0, np.int64))
    rows = np.concatenate([none.reshape(0, none.shape[2]), *out])
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, sizes, out=np.zeros_like(rows), where=sizes > NOTHING))


def free_to_move(
    scene: Scene,
    prescribed: PrescribedDofs,
    further: Sequence[tuple[Ints, Array]] = (),
    acting: Sequence[Windowed] = (),
) -> str:
    """Where a part is that some rigid motion is left to, "" if there is none. Collective.

    Owned nodes may be held in `further` directions, shape (nodes, n, 3). Of the effects with a time
    window those given act, locks of joints among them.
    """
    parts, n = connected_parts(scene.mesh, 2), scene.owned_nodes
    X, part = scene.space.tabulate_dof_coordinates(), parts_of_nodes(scene, parts)
    gram = np.zeros((6 * parts.count, 6 * parts.count))
    held = np.flatnonzero(prescribed.mask)
    rows = motions_of_parts(X[held // 3], part[held // 3], parts)[np.arange(held.size), held % 3]
    _add(gram, rows[:, None], part[held // 3])
    at_points: list[tuple[Array, Vector]] = []
    for effect in scene.effects:
        K = effect.ground_stiffness
        if K is None:
            continue
        values, vectors = np.linalg.eigh(K / max(float(np.linalg.norm(K)), TINY))
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        if effect.face is not None:
            at_points.append((root, effect.remote.place))
            continue
        own = np.flatnonzero(scene.shares(getattr(effect, "where", ""), effect.kind)[:n] > 0)
        _add(gram, root @ motions_of_parts(X[own], part[own], parts), part[own])
    for own, directions in further:
        _add(gram, directions @ motions_of_parts(X[own], part[own], parts), part[own])
    gram = np.asarray(scene.sum(gram))
    for root, place in at_points:
        moved = every_motion(X, part, parts, place.nodes)
        rows = root @ np.asarray(scene.sum(np.einsum("nij,njm->im", slopes_of(place), moved)))
        gram += rows.T @ rows
    if scene.named(Joint) or scene.named(SpringDamper):
        rows = joint_rows(scene, acting, partial(every_motion, X, part, parts))
        gram += rows.T @ rows
    if parts.count > 1:
        _add_hinges(scene, gram, parts)
    values, vectors = np.linalg.eigh(gram)
    if values[0] > FREE * max(values[-1], TINY):
        return ""
    moving = np.linalg.norm(vectors[:, 0].reshape(-1, 6), axis=1)
    return parts.place(int(np.argmax(moving))) if parts.count > 1 else "the whole"


def motions_of_parts(X: Array, part: Ints, parts: ConnectedParts) -> Array:
    """Displacements of points by the six motions of the parts they are in, shape (points, 3, 6)."""
    return rigid_motions(X - parts.middle[part], parts.size[part, None])


def every_motion(X: Array, part: Ints, parts: ConnectedParts, nodes: Ints) -> Array:
    """Displacements of nodes by the motions of all parts, shape (nodes, 3, 6 · parts)."""
    out = np.zeros((nodes.size, 3, parts.count, 6))
    out[np.arange(nodes.size), :, part[nodes]] = motions_of_parts(X[nodes], part[nodes], parts)
    return out.reshape(nodes.size, 3, 6 * parts.count)


def _add(gram: Array, rows: Array, part: Ints) -> None:
    """Add rows of shape (points, rows, 6), each of one part, to BᵀB."""
    blocks = gram.reshape(len(gram) // 6, 6, len(gram) // 6, 6)  # of a view: gram is changed
    for k in np.unique(part):
        own = rows[part == k].reshape(-1, 6)
        blocks[k, :, k] += own.T @ own


def _add_hinges(scene: Scene, gram: Array, parts: ConnectedParts) -> None:
    """Add that parts agree in the displacement of the nodes they share. Collective."""
    dofmap = scene.space.dofmap
    nodes = dofmap.list.astype(np.int64)
    names = dofmap.index_map.local_to_global(nodes.reshape(-1)).astype(np.int64)
    of_cell = np.repeat(parts.of_cell[: len(nodes)], nodes.shape[1])
    pairs, where = np.unique(np.stack([names, of_cell]), axis=1, return_index=True)
    X = scene.space.tabulate_dof_coordinates()[nodes.reshape(-1)[where]]
    found = scene.comm.allgather((pairs, X))
    pairs, first = np.unique(
        np.concatenate([own for own, _ in found], axis=1), axis=1, return_index=True
    )
    X = np.concatenate([points for _, points in found])[first]
    k = np.flatnonzero(pairs[0, 1:] == pairs[0, :-1])  # a node's parts come one after another
    a, b = pairs[1, k], pairs[1, k + 1]
    A, B = motions_of_parts(X[k], a, parts), motions_of_parts(X[k], b, parts)
    blocks = gram.reshape(parts.count, 6, parts.count, 6).swapaxes(1, 2)
    for i, P, j, Q in ((a, A, a, A), (b, B, b, B), (a, A, b, -B), (b, -B, a, A)):
        np.add.at(blocks, (i, j), P.swapaxes(1, 2) @ Q)


def following_energy(scene: Scene, held: Ints, jump: Array, u: Array) -> float:
    """The kinetic energy of the fitted rigid motion [J]. Collective.

    The velocities that supports give to their nodes at an instant are fitted by a rigid motion of
    each connected part, the slowest one where several fit, and that is given to all mass of the
    part. The energy of the held nodes alone depends on the size of the cells, and hides the blow
    that is to come. Owned, held dofs jump by velocities [m/s] at displacements u of local dofs [m].
    """
    n, parts = scene.owned_nodes, scene.parts
    part = parts_of_nodes(scene)[:n]
    x = scene.space.tabulate_dof_coordinates()[:n] + u.reshape(-1, 3)[:n]
    motions = motions_of_parts(x, part, parts)
    nodes = held // 3
    rows = motions[nodes, held % 3]
    weighted = scene.averaging_mass[nodes, None] * rows
    fits = np.zeros((parts.count, 6, 7))  # normal equations, and their right sides
    np.add.at(fits, part[nodes], weighted[:, :, None] * np.c_[rows, jump][:, None])
    fits = np.asarray(scene.sum(fits))
    inverse = np.linalg.pinv(fits[:, :, :6], rcond=FREE, hermitian=True)
    v = (motions @ (inverse @ fits[:, :, 6:])[part])[:, :, 0]
    return 0.5 * float(scene.sum(inertial_masses(scene) @ (v * v).sum(axis=1)))
