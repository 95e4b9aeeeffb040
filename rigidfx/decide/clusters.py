"""From cells that may be rigid to bodies: components, hinges, least size, enclosed cells.

The rules of bodies that never form a hinge or a chain:

1. Bodies are the connected components, through facets, of the cells that may be rigid. Existing
   bodies are kept whole: they can only grow or merge.
2. Components of too few cells are no bodies, unless they hold an existing one.
3. No two bodies share a node, which would be a hinge. One component keeps its cells there, all
   others lose their new cells round the node. Priority: a cell of an existing body at the node,
   then an existing body anywhere, then the number of cells, then the first cell in the mesh file.
   In one pass a component either loses cells or takes them from others. Passes are repeated until
   nothing changes. So a large body stays whole.
4. A cell all of whose nodes belong to one body cannot strain: it joins it.

Components are named by the least of their cells' numbers in the mesh file, as on any ranks.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.errors import agree
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.coupling.dof_layout import AtNodes
from rigidfx.scene.scene import Scene

NONE = -1  # label of a cell, or a node, that belongs to no body


@dataclass(frozen=True)
class Cluster:
    """Cells that are to be a rigid body."""

    cells: Indices  # owned cells on this rank, sorted
    nodes: Indices  # owned nodes on this rank, sorted; some may belong to cells of other ranks only
    # Least number in the mesh file of its cells, but for those that joined it because they are
    # enclosed
    label: int
    size: int  # number of its cells over all ranks


class CellGraph:
    """Cells as neighbours through facets and through nodes, over all ranks.

    Attributes:
        comm: Communicator of the mesh.
        owned: Number of owned cells; they come first.
        numbers: Number in the mesh file of each local cell, ghosts included.
        nodes: Local nodes of each owned cell, shape (owned, nodes of a cell).
    """

    def __init__(self, scene: Scene) -> None:
        """Find the neighbours. Collective.

        Raises:
            SceneError: If the mesh is distributed without the cells across its ranks' facets.
        """
        topology = scene.mesh.topology
        self.comm = scene.comm
        self.owned = topology.index_map(3).size_local
        self.numbers = np.asarray(topology.original_cell_index, dtype=np.int64)
        self.nodes, self._at_nodes = scene.space.dofmap.list[: self.owned], AtNodes(scene)
        self._owned_nodes = scene.owned_nodes
        topology.create_entities(2)
        topology.create_connectivity(2, 3)
        facets = topology.connectivity(2, 3)
        ends = facets.offsets
        inner = np.flatnonzero(np.diff(ends) == 2)
        self._pairs = np.stack([facets.array[ends[inner]], facets.array[ends[inner] + 1]])
        between = topology.interprocess_facets if self.comm.size > 1 else ends[:0]
        alone = np.setdiff1d(between() if callable(between) else between, inner).size
        agree(
            self.comm,
            "Bodies are sought across ranks, and this mesh was distributed without ghost cells. "
            "Create it with GhostMode.shared_facet."
            if alone
            else None,
        )
        self._cell_field = fem.Function(scene.cell_space)
        self._cell_dofs = self._cell_field.function_space.dofmap.list[:, 0]

    def with_ghosts(self, values: npt.NDArray[np.generic]) -> Array:
        """Values of owned cells as values of all local cells. Collective."""
        x = self._cell_field.x
        x.array[self._cell_dofs[: self.owned]] = values
        x.scatter_forward()
        return x.array[self._cell_dofs]

    def largest_at_nodes(self, values: Array) -> Array:
        """The largest value of owned cells round each local node. Collective."""
        return self._at_nodes.largest(self.nodes, values)

    def nodes_with_ghosts(self, marks: Bools) -> Bools:
        """Marks of owned nodes as marks of all local nodes. Collective."""
        return np.asarray(self._at_nodes.of_owners(marks) > 0)

    def touching(self, nodes: Bools) -> Bools:
        """Owned cells that have a marked node."""
        return np.asarray(nodes[self.nodes].any(axis=1))

    def components(self, members: Bools, groups: Ints) -> Ints:
        """Connected components of member cells through facets, and through groups. Collective.

        Numbers of groups are at least 0, NONE for cells in none. The result is the least number of
        a cell in the component of each owned cell, NONE without one.
        """
        inside = self.with_ghosts(members) > 0
        a, b = self._pairs[:, inside[self._pairs].all(axis=0)]
        n = len(inside)
        _, part = connected_components(coo_array((np.ones(a.size), (a, b)), (n, n)), directed=False)
        labels = np.where(inside, self.numbers, np.iinfo(np.int64).max)
        grouped = np.flatnonzero(members & (groups >= 0))
        count = self.comm.allreduce(int(groups.max(initial=NONE)) + 1, op=MPI.MAX)
        while True:
            least = np.full(n, np.iinfo(np.int64).max)
            np.minimum.at(least, part, labels)
            new = least[part]
            if count:
                first = np.full(count, np.iinfo(np.int64).max)
                np.minimum.at(first, groups[grouped], new[grouped])
                self.comm.Allreduce(MPI.IN_PLACE, first, op=MPI.MIN)
                new[grouped] = np.minimum(new[grouped], first[groups[grouped]])
            own = np.where(members, new[: self.owned], NONE)
            spread = self.with_ghosts(own).astype(np.int64)
            new = np.where(inside, spread, np.iinfo(np.int64).max)
            changed = bool((new != labels).any())
            labels = new
            if not self.comm.allreduce(changed, op=MPI.LOR):
                return own

    def nodes_of(self, labels: Ints) -> Ints:
        """The body of each local node, NONE without one; no two share a node. Collective."""
        most = self.largest_at_nodes(np.where(labels >= 0, labels.astype(np.float64), -np.inf))
        return np.where(np.isfinite(most), most, NONE).astype(np.int64)

    def sizes(self, labels: Ints) -> dict[int, int]:
        """Number of cells of each body, over all ranks, in the order of the labels. Collective."""
        found, counts = np.unique(labels[labels >= 0], return_counts=True)
        total: dict[int, int] = {}
        for part in self.comm.allgather((found, counts)):
            for label, count in zip(*part, strict=True):
                total[int(label)] = total.get(int(label), 0) + int(count)
        return dict(sorted(total.items()))

    def enclosed(self, labels: Ints, body_of_node: Ints) -> Ints:
        """For each owned cell outside bodies the one that has all its nodes, NONE without one."""
        around = body_of_node[self.nodes]
        same = (around[:, 0] >= 0) & (around == around[:, :1]).all(axis=1)
        return np.where(same & (labels < 0), around[:, 0], NONE)

    def clusters(self, labels: Ints) -> tuple[Cluster, ...]:
        """The bodies as cells and nodes, ordered by label. Collective."""
        body_of_node = self.nodes_of(labels)[: self._owned_nodes]
        return tuple(
            Cluster(
                np.flatnonzero(labels == label).astype(np.int32),
                np.flatnonzero(body_of_node == label).astype(np.int32),
                label,
                size,
            )
            for label, size in self.sizes(labels).items()
        )


def find_clusters(
    graph: CellGraph, rigid: Bools, existing: Ints, barred: Bools, min_cells: int = 2
) -> tuple[Cluster, ...]:
    """Bodies by the rules above, ordered by their labels. Collective.

    For each owned cell it is given whether it may be rigid, the number of the existing body that it
    is in, or NONE, and whether it has to stay flexible in none. No two existing bodies share a
    node, and a new one has `min_cells` at least.
    """
    old = existing >= 0
    new = rigid & ~barred & ~old
    while True:
        labels, precedence = _large_enough(
            graph, graph.components(old | new, existing), old, min_cells
        )
        new &= labels != NONE
        loose = _loose(graph, labels, precedence, old)
        if not graph.comm.allreduce(bool(loose.any()), op=MPI.LOR):
            break
        new &= ~loose
    body_of_node = graph.nodes_of(labels)
    joining = graph.enclosed(labels, body_of_node)
    labels = np.where((joining >= 0) & ~barred, joining, labels)
    return graph.clusters(labels)


def _large_enough(graph: CellGraph, labels: Ints, old: Bools, min_cells: int) -> tuple[Ints, Ints]:
    """The cells without small components that hold no existing body, as labels. Collective.

    And the labels that are left in the order of precedence, of which the last goes first.
    """
    kept = set(np.concatenate(graph.comm.allgather(np.unique(labels[old]))).tolist())
    left = {k: n for k, n in graph.sizes(labels).items() if n >= min_cells or k in kept}
    precedence = sorted(left, key=lambda label: (label in kept, left[label], -label))
    order = np.array(precedence, dtype=np.int64)
    return np.where(np.isin(labels, order), labels, NONE), order


def _loose(graph: CellGraph, labels: Ints, precedence: Ints, old: Bools) -> Bools:
    """Owned cells to be taken out since another body keeps a node of theirs. Collective.

    Of labels of components the last in precedence goes first; old cells of bodies are never taken
    out.
    """
    count = max(len(precedence), 1)
    by_label = np.argsort(precedence)
    mine = np.full(graph.owned, NONE, dtype=np.int64)
    member = labels != NONE
    mine[member] = by_label[np.searchsorted(precedence[by_label], labels[member])]
    claims = np.where(member, mine + count * old, float(NONE))
    first = np.where(member[:, None], graph.largest_at_nodes(claims)[graph.nodes] % count, NONE)
    losing = first != mine[:, None]
    parts = graph.comm.allgather(np.unique(mine[losing.any(axis=1)]))
    giving = losing & ~np.isin(first, np.concatenate(parts))
    some = graph.comm.allreduce(bool(giving.any()), op=MPI.LOR)
    return np.asarray((giving if some else losing).any(axis=1))
