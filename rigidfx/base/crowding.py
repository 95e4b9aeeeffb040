"""Ranks that share cores: each that waits for another takes the time of those that work."""

import os
from collections.abc import Collection, Sequence

from mpi4py import MPI

from rigidfx.base.log import remind


def tell_of_crowding(comm: MPI.Intracomm) -> None:
    """Say at the start if a machine has more ranks of a run than cores for them. Collective."""
    if comm.size == 1:
        return
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    told = crowded(here.allgather(_cores()))
    here.Free()
    lines = [line for line in comm.allgather(told) if line]
    if lines:
        remind(comm, lines[0])


def crowded(cores: Sequence[Collection[int]]) -> str:
    """A line of advice where ranks of a machine are more than the cores of them all, or nothing."""
    free = len(set().union(*cores))
    if len(cores) <= free:
        return ""
    return (
        f"{len(cores)} ranks share {free} {'core' if free == 1 else 'cores'}: a rank that waits "
        "for another takes the time of those that work, and a run may take several times as long. "
        "Take no more ranks than there are cores, or have them yield: docs/parallel.md says how."
    )


def _cores() -> frozenset[int]:
    """Numbers of the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return frozenset(os.sched_getaffinity(0))
    return frozenset(range(os.cpu_count() or 1))
