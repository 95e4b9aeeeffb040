"""What becomes of the bodies: pure functions of the observed window and of the regions found.

Deciding knows neither PETSc nor the motion; `integrator` applies what is decided here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.decide.clusters import Region

__all__ = ["Part", "assign_bodies", "qualify"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Part:
    """A body after a change.

    Attributes:
        region: Its cells and nodes.
        name: Its name.
        number: Its number.
        named: Sets of cells in it that are rigid always.
        origins: Numbers of the bodies that its cells were in before.
        kept: Whether it is one of them, unchanged.
    """

    region: Region
    name: str
    number: int
    named: tuple[str, ...]
    origins: tuple[int, ...]
    kept: bool


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


def assign_bodies(
    regions: Sequence[Region],
    origin: npt.NDArray[np.int64],
    sizes: Mapping[int, int],
    always: Mapping[str, npt.NDArray[np.int32]],
    next_number: int,
    comm: MPI.Intracomm,
) -> tuple[tuple[Part, ...], int]:
    """Give regions the identity of the bodies they come from. Collective.

    A region takes the number of the oldest body in it, unless another region that comes before has
    taken it (the body has been divided); otherwise it gets a new one. It is called by the first set
    in it that is rigid always, or by its number.

    Args:
        regions: Bodies after the change, in a fixed order.
        origin: For each owned cell the number of the body it was in, or -1.
        sizes: Number of cells, over all ranks, of each body before the change, by its number.
        always: Owned cells of each set that is rigid always, by name.
        next_number: First number that no body has had.
        comm: Ranks that share the cells.

    Returns:
        The bodies after the change, and the next number that is free.
    """
    taken: set[int] = set()
    parts = []
    for region in regions:
        mine = np.unique(origin[region.cells])
        held = [name for name, cells in always.items() if np.isin(cells, region.cells).any()]
        gathered = comm.allgather((mine.tolist(), held))
        before = {number for numbers, _ in gathered for number in numbers}
        named = tuple(name for name in always if any(name in names for _, names in gathered))
        known = tuple(sorted(before - {-1}))
        free = [number for number in known if number not in taken]
        number = free[0] if free else next_number
        next_number += not free
        name = named[0] if named else f"part {number}"
        taken.add(number)
        kept = before == {number} and region.size == sizes[number]
        parts.append(Part(region, name, number, named, known, kept))
    return tuple(sorted(parts, key=lambda part: part.number)), next_number
