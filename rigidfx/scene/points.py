"""Points of a scene as fixed weights on nodes: its probes; nodes that stand for all of a structure.

Connected parts act on each other by joints that link them and by contacts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import names, shown
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.domain.connected import ConnectedParts
from rigidfx.effects import Contact
from rigidfx.scene.scene import Scene


@dataclass(frozen=True)
class Point:
    """A point of the body as a weighted sum of those nodes of its cell that this rank owns."""

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


def probe_names(owner: str, at: Any) -> tuple[str, ...] | None:
    """Names of probes that a user gives, sorted; None if none are given."""
    if at is None:
        return None
    given = names(owner, "at", at, "probes")
    if not given:
        raise SceneError(f"{owner}: at must be names of probes, got {shown(at)}.")
    return tuple(sorted(set(given)))


def check_probes(owner: str, names: Sequence[str], scene: Scene) -> None:
    """Refuse names of probes that the scene does not have."""
    for name in names:
        if name not in scene.probes:
            raise SceneError(
                f"{owner}: at names the probe '{name}'; the scene has "
                f"{sorted(scene.probes) or 'none'}. Name one of these, or give it to the Scene."
            )


def parts_of_nodes(scene: Scene, parts: ConnectedParts | None = None) -> Ints:
    """Connected part of each local node, ghosts included, of the scene's or given ones. Collective.

    A node that given parts share counts for one of them.
    """
    dofmap, parts = scene.space.dofmap.list, scene.parts if parts is None else parts
    of_node = np.zeros(scene.space.tabulate_dof_coordinates().shape[0], dtype=np.int64)
    of_node[dofmap] = parts.of_cell[: len(dofmap), None]
    return of_node


def weights_at(scene: Scene, cell: int, point: Array) -> tuple[Ints, Array]:
    """Global nodes of a cell of this rank and their shape functions at a point of it [m]."""
    mesh, element = scene.mesh, scene.space.element
    corners = mesh.geometry.x[cell_geometry_dofs(mesh)[cell]]
    reference = coordinate_map(mesh).pull_back(point.reshape(1, 3), corners)
    scalar: Any = element.basix_element
    weights = scalar.tabulate(0, reference)[0, 0, :, 0]
    nodes = scene.space.dofmap.cell_dofs(cell).astype(np.int32)
    return scene.space.dofmap.index_map.local_to_global(nodes), weights


def owned_part(scene: Scene, nodes: Ints, weights: Array) -> Point:
    """The part of a weighted sum of global nodes that this rank owns."""
    first, end = scene.space.dofmap.index_map.local_range
    mine = (nodes >= first) & (nodes < end)
    return Point(nodes[mine] - first, weights[mine])


def far_apart(scene: Scene, count: int, among: Bools | None = None) -> tuple[Ints, Ints]:
    """So many nodes, each the farthest from those before; any ranks agree. Collective.

    Of owned nodes, or those `among` them, the local numbers on this rank, and the place of each in
    the order of choice.
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


def met(scene: Scene, contact: Contact) -> Bools:
    """Connected parts that a contact may touch, shape (parts,). Collective."""
    names = sorted({contact.where, *contact.keeps_apart})
    own = np.concatenate([scene.nodes(name, contact.owner, (2,)) for name in names])
    of_node = parts_of_nodes(scene)[own[own < scene.owned_nodes]]
    here = np.bincount(of_node, minlength=scene.parts.count).astype(np.float64)
    return np.asarray(scene.sum(here) > 0)


Place = tuple[int, int, int]

# Parts of the longest side to which places are told, for their last bits depend on the rank.
BITS = 30


def spread(comm: MPI.Intracomm, X: Array, most: int) -> Ints:
    """One node of each box of a lattice that is as fine as so many nodes allow. Collective.

    They are told by their places X alone, so that they are the same on any number of ranks; of
    nodes in one place all are taken. They are numbers of owned nodes, sorted; of all of them if
    there are no more.
    """
    if comm.allreduce(len(X)) <= most:
        return np.arange(len(X))
    low, high = X.min(axis=0, initial=np.inf), X.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    side = float((high - low).max()) or 1.0
    places = np.rint((X - low) / side * 2**BITS).astype(np.int64)
    fits, fails = 1, most + 1  # boxes along the longest side
    while fails - fits > 1:
        middle = (fits + fails) // 2
        if _count(comm, np.unique(_boxes(places, middle)), most) <= most:
            fits = middle
        else:
            fails = middle
    return _first_of_each(comm, _boxes(places, fits), places)


def _boxes(places: Ints, along: int) -> Ints:
    """Number of the box in which each node is."""
    at = np.minimum((along * places) >> BITS, along - 1)
    return np.asarray((at[:, 0] * along + at[:, 1]) * along + at[:, 2])


def _count(comm: MPI.Intracomm, found: Ints, most: int) -> int:
    """Number of boxes on all ranks, or more than asked for if it is. Collective."""
    every = np.concatenate(comm.allgather(found[: most + 1]))
    return int(np.unique(every).size)


def _first_of_each(comm: MPI.Intracomm, boxes: Ints, places: Ints) -> Ints:
    """Of each box the nodes whose places come first, on any rank. Collective."""
    order = np.lexsort((*places.T[::-1], boxes))
    first = order[np.unique(boxes[order], return_index=True)[1]]
    mine = dict(zip(boxes[first].tolist(), map(tuple, places[first].tolist()), strict=True))
    least: dict[int, Place] = {}
    for part in comm.allgather(mine):
        for box, place in part.items():
            least[box] = min(place, least.get(box, place))
    known = sorted(least)
    own = np.array([least[box] for box in known])[np.searchsorted(known, boxes)]
    return np.flatnonzero((own == places).all(axis=1))
