"""Points of a scene as fixed weights on nodes: its probes, and nodes that lie far apart.

Connected parts act on each other by joints that link them and by contacts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.effects import Contact
from rigidfx.effects.joints.joint import Between
from rigidfx.scene.scene import Scene


@dataclass(frozen=True)
class Point:
    """A point of the body as a weighted sum of nodes.

    Attributes:
        nodes: Those nodes of its cell that this rank owns.
        weights: Shape functions there.
    """

    nodes: Ints
    weights: Array


def find_probes(scene: Scene) -> Mapping[str, Point]:
    """The probes of a scene. Collective."""
    found = {}
    for name, (root, cell) in scene.probe_cells.items():
        here = root == scene.comm.rank
        mine = weights_at(scene, cell, scene.probes[name]) if here else None
        found[name] = owned_part(scene, *scene.comm.bcast(mine, root=root))
    return found


def parts_of_nodes(scene: Scene) -> Ints:
    """Connected part of each local node, ghosts included. Collective."""
    dofmap = scene.space.dofmap.list
    of_node = np.zeros(scene.space.tabulate_dof_coordinates().shape[0], dtype=np.int64)
    of_node[dofmap] = scene.parts.of_cell[: len(dofmap), None]
    return of_node


def weights_at(scene: Scene, cell: int, point: Array) -> tuple[Ints, Array]:
    """Global nodes of a cell and their shape functions at a point of it.

    Args:
        scene: The problem.
        cell: A cell of this rank.
        point: Shape (3,) [m].
    """
    mesh, element = scene.mesh, scene.space.element
    corners = mesh.geometry.x[cell_geometry_dofs(mesh)[cell]]
    reference = coordinate_map(mesh).pull_back(point.reshape(1, 3), corners)
    scalar: Any = element.basix_element
    weights = scalar.tabulate(0, reference)[0, 0, :, 0]
    nodes = scene.space.dofmap.cell_dofs(cell).astype(np.int32)
    return scene.space.dofmap.index_map.local_to_global(nodes), weights


def owned_part(scene: Scene, nodes: Ints, weights: Array) -> Point:
    """The part of a weighted sum that this rank owns.

    Args:
        scene: The problem.
        nodes: Global nodes.
        weights: Of each.
    """
    first, end = scene.space.dofmap.index_map.local_range
    mine = (nodes >= first) & (nodes < end)
    return Point(nodes[mine] - first, weights[mine])


def far_apart(scene: Scene, count: int, among: Bools | None = None) -> tuple[Ints, Ints]:
    """Nodes chosen one by one, each the farthest from those before; any ranks agree. Collective.

    Args:
        scene: The problem.
        count: How many are wanted.
        among: Which of the owned nodes may be chosen; all of them if None.

    Returns:
        Local numbers of those that this rank owns, and the place of each in the order of choice.
    """
    comm, X = scene.comm, scene.space.tabulate_dof_coordinates()[: scene.owned_nodes]
    own = np.arange(len(X)) if among is None else np.flatnonzero(among)
    X = X[own]
    distance = np.linalg.norm(X - scene.centre_of_mass, axis=1)
    size = comm.allreduce(float(distance.max(initial=0.0)), op=MPI.MAX)
    X, distance = X / size, distance / size  # so that digits are those of any unit of length
    mine, places = [], []
    for place in range(count):
        rounded = distance.round(9)
        far = np.flatnonzero(rounded == rounded.max(initial=0.0))
        # Of equally far nodes the one with the greatest coordinates, whoever owns it. Distances
        # are from where it is, not from rounded coordinates, which would make them differ.
        best = max(
            ((float(rounded[i]), *X[i].round(9).tolist(), *X[i].tolist()) for i in far),
            default=(-1.0,) + 6 * (0.0,),
        )
        offers = comm.allgather(best)
        winner = max(offers)
        point = np.asarray(winner[4:])
        if offers.index(winner) == comm.rank:
            mine.append(int(own[np.argmin(np.linalg.norm(X - point, axis=1))]))
            places.append(place)
        distance = np.minimum(distance, np.linalg.norm(X - point, axis=1))
    return np.asarray(mine, dtype=np.int64), np.asarray(places, dtype=np.int64)


def linked(scene: Scene) -> Ints:
    """Number of the group of each connected part, shape (parts,). Collective.

    Parts that a joint or a spring links are in one group.
    """
    nodes = [np.concatenate([a.nodes for a in own.averages]) for own in scene.named(Between)]
    holds = _held(scene, nodes)
    pairs = csr_array(holds.T.astype(np.float64) @ holds.astype(np.float64))
    return np.asarray(connected_components(pairs, directed=False)[1], dtype=np.int64)


def met(scene: Scene, contact: Contact) -> Bools:
    """Connected parts that a contact may touch, shape (parts,). Collective."""
    names = sorted({contact.where, *contact.keeps_apart})
    own = np.concatenate([scene.nodes(name, contact.owner, (2,)) for name in names])
    return np.asarray(_held(scene, [own[own < scene.owned_nodes]])[0])


def _held(scene: Scene, sets: list[Ints]) -> Bools:
    """Connected parts that each set of owned nodes of all ranks is in, shape (sets, parts)."""
    of_node, count = parts_of_nodes(scene), scene.parts.count
    here = [np.bincount(of_node[nodes], minlength=count) for nodes in sets]
    return np.asarray(scene.sum(np.reshape(here, (len(sets), count)).astype(np.float64)) > 0)
