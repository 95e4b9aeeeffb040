"""Decisions: pure functions of observed cells and of the clusters found.

Deciding knows neither PETSc nor the motion; `rigidfx.switch` applies the decisions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Literal

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.decide.clusters import Cluster
from rigidfx.mechanics.rigid_body import RigidBody


@dataclass(frozen=True)
class PlannedBody:
    """A body as it is to be.

    Attributes:
        cells: Owned cells, sorted.
        nodes: All owned nodes of these cells, sorted.
        name: Its name.
        number: Its number.
        named: Sets of cells in it that are rigid always.
        kept: Whether there is such a body already, which stays as it is.
    """

    cells: Indices
    nodes: Indices
    name: str
    number: int
    named: tuple[str, ...] = ()
    kept: bool = False


@dataclass(frozen=True)
class Decision:
    """A freeze or a release that is to be applied.

    Attributes:
        kind: Reported as such.
        reason: Reported as such.
        bodies: The bodies from then on, but for those apart.
        apart: Names of bodies that stay as they are in any case.
        next_number: First number that no body has had, nor has one of these.
        qualified: Owned cells that have qualified in the window that ends, if one does.
        closeness: How close the nearest decision was: the least |ε/tol - 1| of any cell, ε its
            strain rate; NaN if no window ends.
        loads_changed: Whether a change of a load or a support is the reason.
        woken: Owned cells that withheld forces strain; None if the reason is another one.
        loads_at: Time of the loads with which later ones are compared [s]; None if it stays.
    """

    kind: Literal["freeze", "release"]
    reason: str
    bodies: tuple[PlannedBody, ...]
    apart: frozenset[str]
    next_number: int
    qualified: Bools | None = None
    closeness: float = nan
    loads_changed: bool = False
    woken: Indices | None = None
    loads_at: float | None = None


def qualify(worst: Array, tol: Array, observed: Bools, comm: MPI.Intracomm) -> tuple[Bools, float]:
    """Cells whose largest strain rate in a window is at most the tolerance. Collective.

    Args:
        worst: Largest strain rate of each owned cell in the window.
        tol: Tolerance of each owned cell, in the same unit.
        observed: Owned cells that were flexible in the whole window.
        comm: Ranks that share the cells.

    Returns:
        The cells that qualify, and how close the nearest decision was: the least |worst/tol - 1|,
        infinity where nothing was compared.
    """
    compared = observed & (tol > 0)
    closeness = np.abs(worst[compared] / tol[compared] - 1).min(initial=np.inf)
    return observed & (worst <= tol), float(comm.allreduce(closeness, op=MPI.MIN))


def kept_bodies(bodies: Iterable[RigidBody]) -> tuple[PlannedBody, ...]:
    """Bodies that stay as they are."""
    return tuple(PlannedBody(b.cells, b.nodes, b.name, b.number, kept=True) for b in bodies)


def plan_bodies(
    clusters: Sequence[Cluster],
    origin: Ints,
    sizes: Mapping[int, int],
    always: Mapping[str, Indices],
    next_number: int,
    comm: MPI.Intracomm,
) -> tuple[tuple[PlannedBody, ...], int]:
    """Give clusters the identity of the bodies they come from. Collective.

    A cluster takes the number of the oldest body in it, unless another cluster that comes before
    has taken it (the body has been divided); otherwise it gets a new one. It is called by the first
    set in it that is rigid always, or by its number.

    Args:
        clusters: Bodies after the change, in a fixed order.
        origin: For each owned cell the number of the body it was in, or -1.
        sizes: Number of cells, over all ranks, of each body before the change, by its number.
        always: Owned cells of each set that is rigid always, by name.
        next_number: First number that no body has had.
        comm: Ranks that share the cells.

    Returns:
        The bodies after the change by increasing number, and the next number that is free.
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
