"""Decisions on bodies: those to be made, kept and released, and whether that pays.

Deciding changes nothing; `rigidfx.switch` applies the decisions. Shapes follow what forces do to a
body, so only the cost decides whether quiet parts freeze where bodies get shapes: flexible steps
that a switch costs, and those that a part has been quiet for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import Literal

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.decide.clusters import NONE, CellGraph, Cluster, find_clusters
from rigidfx.decide.memory import Memory
from rigidfx.decide.rules import Observation
from rigidfx.effects import PointMass, Resultant, Rigid, rigid_faces
from rigidfx.scene.scene import Scene

SWITCHES = 7.0  # flexible steps that a freeze and a release of a body take


@dataclass(frozen=True)
class PlannedBody:
    """A body as it is to be."""

    cells: Indices  # owned cells, sorted
    nodes: Indices  # all owned nodes of these cells, sorted
    name: str  # its name
    number: int  # its number
    named: tuple[str, ...] = ()  # sets of cells in it that are rigid always
    kept: bool = False  # whether there is such a body already, which stays as it is


@dataclass(frozen=True)
class Decision:
    """A freeze or a release that is to be applied."""

    kind: Literal["freeze", "release"]  # reported as such
    reason: str  # reported as such
    bodies: tuple[PlannedBody, ...]  # the bodies from then on, but for those apart
    apart: frozenset[str]  # names of bodies that stay as they are in any case
    next_number: int  # first number that no body has had, nor has one of these
    # Owned cells that have qualified in the window that ends, if one does
    qualified: Bools | None = None
    # How close the nearest decision was: the least |ε/tol - 1| of any cell, ε its strain rate; NaN
    # if no window ends
    closeness: float = nan
    loads_changed: bool = False  # whether a change of a load or a support is the reason
    # Owned cells that withheld forces strain; None if the reason is another one
    woken: Indices | None = None
    # Time of the loads with which later ones are compared [s]; None if it stays
    loads_at: float | None = None


Plan = Callable[[Bools, Bools], Decision]  # of cells that are able, without those barred


def qualify(worst: Array, tol: Array, observed: Bools, comm: MPI.Intracomm) -> tuple[Bools, float]:
    """Observed cells with rates in a window up to tolerances in the same unit. Collective.

    And how close the nearest decision was: the least |worst/tol - 1|, infinity where nothing was
    compared.
    """
    compared = observed & (tol > 0)
    closeness = np.abs(worst[compared] / tol[compared] - 1).min(initial=np.inf)
    return observed & (worst <= tol), float(comm.allreduce(closeness, op=MPI.MIN))


def plan_bodies(
    clusters: Sequence[Cluster],
    origin: Ints,
    sizes: Mapping[int, int],
    always: Mapping[str, Indices],
    next_number: int,
    comm: MPI.Intracomm,
) -> tuple[tuple[PlannedBody, ...], int]:
    """Give clusters in a fixed order the identity of the bodies they come from. Collective.

    A cluster takes the number of the oldest body in it, by the origin of its cells, unless another
    cluster that comes before has taken it (the body has been divided); otherwise it gets a new one.
    It is called by the first set in it that is rigid always, or by its number. The result are the
    bodies by increasing number, and the next number that is free.
    """
    taken: set[int] = set()
    bodies = []
    for cluster in clusters:
        mine = np.unique(origin[cluster.cells])
        inside = [name for name, cells in always.items() if np.isin(cells, cluster.cells).any()]
        gathered = comm.allgather((mine.tolist(), inside))
        before = {number for numbers, _ in gathered for number in numbers}
        named = tuple(name for name in always if any(name in names for _, names in gathered))
        free = [number for number in sorted(before - {-1}) if number not in taken]
        number = free[0] if free else next_number
        next_number += not free
        name = named[0] if named else f"part {number}"
        taken.add(number)
        kept = before == {number} and cluster.size == sizes[number]
        bodies.append(PlannedBody(cluster.cells, cluster.nodes, name, number, named, kept))
    return tuple(sorted(bodies, key=lambda body: body.number)), next_number


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
        """Look their cells up; whether no cell may join any of their bodies. Collective."""
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
        """Find the bodies of a decision of some kind and reason. Collective.

        Cells that are able may be rigid, and those barred stay flexible if they are in no existing
        body, whose number is given, or NONE.
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


def paying(
    plan: Plan, memory: Memory, seen: Observation, able: Bools, barred: Bools, comm: MPI.Intracomm
) -> Decision:
    """The freeze of the parts that pay, of those that are able and not barred. Collective.

    The steps of a part while it was quiet have to have cost as much as switches.
    """
    window, observed = memory.window, memory.back_off.observed
    quiet = np.asarray(window.steps * (1 + observed / (seen.t - window.start)))
    while True:
        found, dear = plan(able, barred), np.zeros(able.size, dtype=bool)
        new = (body.cells for body in found.bodies if not body.kept)
        parts = [cells[seen.flexible[cells]] for cells in new]
        sums = np.array([seen.flexible.sum(), *(quiet[own].sum() for own in parts)])
        comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        for own, wasted in zip(parts, sums[1:], strict=True):
            dear[own] = wasted < SWITCHES * sums[0]
        if not comm.allreduce(bool(dear.any()), op=MPI.LOR):
            return found
        able, barred = able & ~dear, barred | dear
