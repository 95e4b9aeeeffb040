"""Makes the bodies of a decision from the cells that freeze or leave, and the parts named rigid."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Bools, Indices, Ints
from rigidfx.decide.clusters import NONE, CellGraph, Cluster, find_clusters
from rigidfx.decide.criteria.judging import Observation
from rigidfx.decide.decision import Decision, kept_bodies, plan_bodies
from rigidfx.effects import PointMass, Resultant, Rigid, rigid_faces
from rigidfx.scene.scene import Scene


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
        """Owned cells round rigid faces that would be in several bodies, or in part. Collective."""
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


class Planner:
    """Makes decisions of cells; it remembers nothing."""

    def __init__(self, graph: CellGraph, named: NamedParts, least: int) -> None:
        """Keep the cells.

        Args:
            graph: Neighbours of the cells.
            named: Parts that are rigid always.
            least: Least number of cells of a new body.
        """
        self._graph, self._named, self._least = graph, named, least

    def numbers(self, seen: Observation) -> Ints:
        """For each owned cell the number of the body it is in and may leave or grow, or NONE."""
        numbers = np.full(self._graph.owned, NONE, dtype=np.int64)
        for body in seen.bodies:
            if body.name not in self._named.apart:
                numbers[body.cells] = body.number
        return numbers

    def free(self, seen: Observation) -> Bools:
        """Owned cells of bodies that may leave them."""
        return (self.numbers(seen) != NONE) & ~self._named.mask

    def chained(self, seen: Observation) -> Bools:
        """Owned cells at nodes that supports hold, or that bodies apart hold. Collective."""
        nodes = seen.supported.copy()
        for body in seen.bodies:
            if body.name in self._named.apart:
                nodes[body.nodes] = True
        return self._graph.touching(self._graph.nodes_with_ghosts(nodes))

    def unchanged(self, reason: str, seen: Observation, next_number: int) -> Decision:
        """A freeze that adds nothing: all bodies stay as they are."""
        stay = kept_bodies(b for b in seen.bodies if b.name not in self._named.apart)
        return Decision("freeze", reason, stay, self._named.apart, next_number)

    def release(self, seen: Observation, reason: str, cells: Bools, next_number: int) -> Decision:
        """Release owned cells from their bodies; the other cells stay rigid. Collective."""
        numbers = self.numbers(seen)
        leaving = cells & (numbers != NONE) & ~self._named.mask
        mine = np.unique(numbers[leaving]).tolist()
        concerned = sorted({k for part in self._graph.comm.allgather(mine) for k in part})
        inside = np.isin(numbers, concerned)
        # What is left of a body is a new find, but for cells that are rigid always.
        able = inside & ~leaving
        existing = np.where(inside, NONE, numbers)
        first = max((body.number for body in seen.bodies), default=0) + 1
        for k, own in enumerate(self._named.cells.values()):
            existing[own[inside[own]]] = first + k
        barred = ~able & (existing == NONE)
        return self.plan("release", reason, seen, able, existing, barred, next_number)

    def plan(
        self,
        kind: Literal["freeze", "release"],
        reason: str,
        seen: Observation,
        able: Bools,
        existing: Ints,
        barred: Bools,
        next_number: int,
    ) -> Decision:
        """Find the bodies. Collective.

        Args:
            kind: Its kind in the report.
            reason: Why, in words.
            seen: The state.
            able: Owned cells that may be rigid.
            existing: For each owned cell the number of the body that it stays in, or NONE.
            barred: Owned cells that have to stay flexible if they are in no existing body.
            next_number: First number that no body has had.
        """
        while True:
            clusters = find_clusters(self._graph, able, existing, barred, self._least)
            torn = self._named.torn(clusters) & (existing == NONE) & ~barred
            if not self._graph.comm.allreduce(bool(torn.any()), op=MPI.LOR):
                break
            barred = barred | torn
        sizes = {body.number: body.size for body in seen.bodies}
        numbers, named = self.numbers(seen), self._named
        bodies, following = plan_bodies(
            clusters, numbers, sizes, named.cells, next_number, self._graph.comm
        )
        return Decision(kind, reason, bodies, named.apart, following)
