"""Parts of a mesh that share nodes and no facet: each turns about these nodes like a door."""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx.mesh as dmesh
import numpy as np

from rigidfx.base.types import Array
from rigidfx.domain.connected import ConnectedParts

__all__ = ["Hinge", "hinges"]

STRAIGHT = 1e-6  # of the length of a row of nodes: how far beside a line they may lie


@dataclass(frozen=True)
class Hinge:
    """Vertices that two parts share.

    Attributes:
        parts: Numbers of both parts.
        nodes: Positions of the vertices, shape (n, 3) [m].
    """

    parts: tuple[int, int]
    nodes: Array

    def __str__(self) -> str:
        """How many vertices, of which shape, and where."""
        arms = self.nodes - self.nodes.mean(axis=0)
        middle = ", ".join(f"{x:.4g}" for x in self.nodes.mean(axis=0))
        sizes = np.linalg.svd(arms, compute_uv=False)
        if len(self.nodes) == 1:
            return f"one node at ({middle}) m"
        kind = "nodes" if sizes[1] > STRAIGHT * sizes[0] else "nodes of one edge"
        return f"{len(self.nodes)} {kind} around ({middle}) m"


def hinges(mesh: dmesh.Mesh, parts: ConnectedParts) -> list[Hinge]:
    """Find the vertices that parts share, a record for each pair of parts. Collective.

    Args:
        mesh: The mesh.
        parts: Its parts that are connected through facets.
    """
    topology = mesh.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(2, 0)
    topology.create_connectivity(0, 3)
    facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)
    found = np.empty((0, 2), np.int64)
    x = np.empty((0, 3))
    if facets.size:
        skin = dmesh.compute_incident_entities(topology, facets, 2, 0).astype(np.int32)
        cells = topology.connectivity(0, 3)
        starts, ends = cells.offsets[skin], cells.offsets[skin + 1]
        number = topology.index_map(0).local_to_global(skin)
        at = np.concatenate([cells.array[a:b] for a, b in zip(starts, ends, strict=True)])
        rows = np.repeat(np.arange(skin.size), ends - starts)
        pairs = np.unique(np.stack([rows, parts.of_cell[at]], axis=1), axis=0)
        nodes = dmesh.entities_to_geometry(mesh, 0, skin).reshape(-1)
        found = np.stack([number[pairs[:, 0]], pairs[:, 1]], axis=1)
        x = mesh.geometry.x[nodes[pairs[:, 0]]]
    every = mesh.comm.allgather((found, x))
    found, first = np.unique(np.concatenate([f for f, _ in every]), axis=0, return_index=True)
    x = np.concatenate([own for _, own in every])[first]
    _, begin, count = np.unique(found[:, 0], return_index=True, return_counts=True)
    shared: dict[tuple[int, int], list[Array]] = {}
    for k in np.flatnonzero(count > 1):
        mine = [int(part) for part in found[begin[k] : begin[k] + count[k], 1]]
        for i, a in enumerate(mine):
            for b in mine[i + 1 :]:
                shared.setdefault((a, b), []).append(x[begin[k]])
    # Positions in an order that does not depend on the partition.
    return [
        Hinge(pair, np.array(sorted(map(tuple, points)))) for pair, points in sorted(shared.items())
    ]
