"""The parts that effects name rigid."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rigidfx.base.types import Bools, Indices
from rigidfx.decide.clusters import NONE, CellGraph, Cluster, find_clusters
from rigidfx.effects import PointMass, Resultant, Rigid, rigid_faces
from rigidfx.scene.scene import Scene

__all__ = ["NamedParts"]


class NamedParts:
    """Parts that are rigid always.

    Attributes:
        names: Their names, as they are numbered from one on.
        count: How many there are, rigid faces and carried masses among them.
        apart: Names of those whose mass or inertia is given, or on which a `Resultant` acts: no
            cell may join their bodies.
        cells: Owned cells of the others, by name.
        mask: For each owned cell, whether it is in one of these.
        rings: Owned cells round each rigid face that is in none of the parts, and round the nodes
            that move a `PointMass` at a face.
    """

    def __init__(self, scene: Scene, graph: CellGraph, alone: bool = False) -> None:
        """Look their cells up. Collective.

        Args:
            scene: The problem.
            graph: Its cells.
            alone: Whether no cell may join any of their bodies.
        """
        self._graph = graph
        loaded = {resultant.body for resultant in scene.named(Resultant)}
        parts = scene.named(Rigid)
        self.names = tuple(part.name for part in parts)
        faces = rigid_faces(scene.effects)
        carried = [effect for effect in scene.named(PointMass) if effect.is_carried]
        self.count = len(parts) + len(faces) + len(carried)
        self.apart = frozenset(
            part.name
            for part in parts
            if alone or part.given or part.deforms or part.name in loaded
        )
        self.cells: dict[str, Indices] = {
            part.name: scene.owned_cells(part.where, "Rigid")
            for part in parts
            if part.name not in self.apart
        }
        self.mask = np.zeros(graph.owned, dtype=bool)
        for own in self.cells.values():
            self.mask[own] = True
        parted = np.zeros(len(scene.nodal_mass), dtype=bool)
        for part in parts:
            at = slice(None) if part.where is None else scene.nodes(part.where, part.kind, (3,))
            parted[at] = True
        self.rings: list[Bools] = []
        masses = (e for e in scene.named(PointMass) if e.face is not None and not e.is_carried)
        together = [scene.nodes(face.where, face.name, (2,)) for face in faces]
        for nodes in (*together, *(mass.remote.place.nodes for mass in masses)):
            marks = np.zeros(parted.size, dtype=bool)
            marks[nodes] = True
            if scene.sum(np.count_nonzero(parted[nodes])) == 0:
                self.rings.append(
                    graph.touching(graph.nodes_with_ghosts(marks[: scene.owned_nodes]))
                )

    def torn(self, clusters: Sequence[Cluster]) -> Bools:
        """Owned cells round rigid faces that would be in several bodies, or in part. Collective.

        Args:
            clusters: The bodies as they would be.
        """
        out = np.zeros(self._graph.owned, dtype=bool)
        if not self.rings:
            return out
        labels = np.full(out.size, NONE)
        for cluster in clusters:
            labels[cluster.cells] = cluster.label
        for ring in self.rings:
            own = np.unique(labels[ring]).tolist()
            if len({label for some in self._graph.comm.allgather(own) for label in some}) > 1:
                out |= ring
        return out

    @cached_property
    def in_pieces(self) -> frozenset[str]:
        """Parts named rigid whose cells are not connected through facets. Collective."""
        none = np.full(self._graph.owned, NONE)
        found = set()
        for name, own in self.cells.items():
            cells = np.zeros(self._graph.owned, dtype=bool)
            cells[own] = True
            clusters = find_clusters(self._graph, cells, none, ~cells, 1)
            every = self._graph.comm.allreduce(own.size)
            if len(clusters) != 1 or clusters[0].size != every:
                found.add(name)
        return frozenset(found)
