"""Nodes that stand for all of a structure: a fixed number, spread evenly."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Ints

Place = tuple[int, int, int]

# Parts of the longest side to which places are told, for their last bits depend on the rank.
BITS = 30


def spread(comm: MPI.Intracomm, X: Array, most: int) -> Ints:
    """One node of each box of a lattice that is as fine as so many nodes allow. Collective.

    They are told by their places alone, so that they are the same on any number of ranks; of
    nodes in one place all are taken.

    Args:
        comm: Ranks that share the nodes.
        X: Reference positions of the owned nodes, shape (nodes, 3) [m].
        most: Number of boxes on all ranks.

    Returns:
        Owned nodes, sorted; all of them if there are no more than that.
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
