"""The numbers of cells and nodes in a mesh as it was given, and a hash of it: alike on any ranks.

A cell has the number that it has in the file, or in the box. A node has its place in the list of
the nodes of cell 0, of cell 1, and so on, without those that were there before: a cell lists its
nodes alike on any ranks.
"""

import hashlib

import numpy as np
from dolfinx import mesh as dmesh

from rigidfx.base import compat
from rigidfx.base.remembered import MeshOrder
from rigidfx.base.taken import digest, items
from rigidfx.base.types import Array, Ints
from rigidfx.domain.domain import EntitySet
from rigidfx.effects import Contact
from rigidfx.scene.scene import Scene


def mesh_order(scene: Scene) -> MeshOrder:
    """Numbers of this rank's cells and nodes. Collective."""
    nodes, cells = scene.space.dofmap.index_map, scene.mesh.topology.index_map(3)
    local = nodes.local_to_global(np.arange(nodes.size_local + nodes.num_ghosts, dtype=np.int32))
    of_cells = _owned_cells(scene)
    listed = _listed(scene, local[scene.space.dofmap.list[: cells.size_local]])
    number: Ints | None = None
    if listed is not None:
        number = np.empty(nodes.size_global, dtype=np.int64)
        number[listed] = np.arange(listed.size)
    everywhere: Ints = scene.comm.bcast(number)
    against = (contact.against for contact in scene.named(Contact))
    return MeshOrder(
        first=scene.comm.rank == 0,
        cells=of_cells,
        nodes=everywhere[local],
        owned=scene.owned_nodes,
        named=(*scene.effects, *(one for one in against if not isinstance(one, str))),
    )


def mesh_hash(scene: Scene) -> str:
    """A hash of the cells and the nodes of the mesh's geometry, on all ranks. Collective."""
    geometry = scene.mesh.geometry
    owned = scene.mesh.topology.index_map(3).size_local
    gathered = scene.comm.gather(
        (_owned_cells(scene), geometry.x[compat.cell_geometry_dofs(scene.mesh)[:owned]])
    )
    found = None
    if gathered is not None:
        every = np.concatenate([own for _, own in gathered])
        every = every[np.argsort(np.concatenate([cells for cells, _ in gathered]))]
        found = hashlib.sha256(np.ascontiguousarray(every).tobytes()).hexdigest()
    return str(scene.comm.bcast(found))


def scene_hashes(scene: Scene) -> dict[str, str]:
    """Hashes of all that a scene was made of, by its name: mesh and sets, too. Collective.

    Functions cannot be compared; of them only their breakpoints are.
    """
    out = {"the mesh": mesh_hash(scene)}
    for name, value in items(scene.given):
        of = f" ({type(value).__name__})" if name.startswith("effects") else ""
        out[name + of] = digest(value)
    sets = scene.domain.sets
    for name, dim in sorted(sets):
        out[f"the set '{name}'"] = _set_hash(scene, sets[name, dim])
    return out


def _set_hash(scene: Scene, entities: EntitySet) -> str:
    """A hash of the corners of a set's entities, on all ranks. Collective."""
    mesh, dim = scene.mesh, entities.dim
    own = entities.entities[entities.entities < mesh.topology.index_map(dim).size_local]
    mesh.topology.create_connectivity(dim, 3)
    mesh.topology.create_connectivity(3, dim)
    rows: list[Array] = []  # none where a rank owns none of them
    if own.size:
        corners = mesh.geometry.x[dmesh.entities_to_geometry(mesh, dim, own)]
        order = np.lexsort(np.moveaxis(corners, 2, 0)[::-1], axis=-1)
        sorted_corners = np.take_along_axis(corners, order[:, :, None], axis=1)
        rows = [sorted_corners.reshape(own.size, -1)]
    gathered = scene.comm.gather(rows)
    found = None
    if gathered is not None:
        every = np.concatenate([one for rows in gathered for one in rows] or [np.empty((0, 3))])
        every = np.ascontiguousarray(every[np.lexsort(every.T[::-1])])
        found = hashlib.sha256(every.tobytes()).hexdigest()
    return str(scene.comm.bcast(found))


def _owned_cells(scene: Scene) -> Ints:
    topology = scene.mesh.topology
    owned = topology.index_map(3).size_local
    return np.asarray(topology.original_cell_index[:owned], dtype=np.int64)


def _listed(scene: Scene, of_cells: Ints) -> Ints | None:
    """Nodes in the order in which cells name them first, on rank 0. Collective.

    Each owned cell has the numbers of its nodes over all ranks.
    """
    gathered = scene.comm.gather((_owned_cells(scene), of_cells))
    if gathered is None:
        return None
    cells = np.concatenate([own for own, _ in gathered])
    nodes = np.concatenate([own for _, own in gathered])[np.argsort(cells)]
    every, first = np.unique(nodes, return_index=True)
    return np.asarray(every[np.argsort(first)])
