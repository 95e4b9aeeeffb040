"""Ports of joints on parts that a tangent does not couple: they share a solve.

Unknowns that the entries of a matrix connect are a part. A⁻¹ e is zero outside the part of e, so
that one solve serves a port of each part, and tells each its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

__all__ = ["Shared", "parted"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Shared:
    """Ports that share solves.

    Attributes:
        right: Sum of the ports of each solve, shape (solves, unknowns).
        places: Numbers of unknowns and of solves, of all that a port has a part in, by unknowns.
        pattern: The ports of these, and where each unknown begins among them.
        count: Number of ports.
    """

    right: Array
    places: tuple[Ints, Ints]
    pattern: tuple[Ints, Ints]
    count: int

    def spread(self, solutions: Array) -> csr_array:
        """Solutions of single ports, shape (unknowns, ports), from those of the solves."""
        unknown, solve = self.places
        shape = solutions.shape[1], self.count
        return csr_array((solutions[solve, unknown], *self.pattern), shape=shape)


def parted(A: PETSc.Mat, E: csr_array) -> Shared:
    """Ports that share solves with a matrix. Collective.

    Args:
        A: The matrix.
        E: Ports by this rank's unknowns, shape (unknowns, ports).
    """
    part, comm = _parts(A), A.comm.tompi4py()
    entries = E.tocoo()
    own: Ints = np.full(E.shape[1], -1, dtype=np.int64)
    own[entries.coords[1]] = part[entries.coords[0]]
    of_port = np.empty_like(own)
    comm.Allreduce(own, of_port, op=MPI.MAX)
    order = np.argsort(of_port, kind="stable")
    firsts = np.searchsorted(of_port[order], of_port[order])
    turn = np.empty_like(order)  # which of the ports of its part each is
    turn[order] = np.arange(order.size) - firsts
    ports = [
        order[turn[order] == k] for k in range(int(turn.max(initial=-1)) + 1)
    ]  # by their parts
    owners = np.full((len(ports), part.size), -1, dtype=np.int64)
    for row, numbers in zip(owners, ports, strict=True):
        at = np.searchsorted(of_port[numbers], part)
        at[at == numbers.size] = 0
        here = of_port[numbers][at] == part
        row[here] = numbers[at[here]]
    places = np.nonzero(owners.T >= 0)
    ends = np.searchsorted(places[0], np.arange(part.size + 1))
    right = [np.asarray(E[:, numbers].sum(axis=1)) for numbers in ports]
    pattern = owners.T[places], ends
    return Shared(np.reshape(right, (len(ports), part.size)), places, pattern, E.shape[1])


def _parts(A: PETSc.Mat) -> Ints:
    """The part of each of this rank's unknowns, numbered alike on all ranks. Collective."""
    comm = A.comm.tompi4py()
    rows = A.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()) if A.getBlockSize() > 1 else A
    offsets, columns, _ = rows.getValuesCSR()
    if rows is not A:
        rows.destroy()
    first, last = A.getOwnershipRange()
    pairs = np.repeat(np.arange(first, last), np.diff(offsets)), columns
    inside = (columns >= first) & (columns < last)
    graph = np.ones(int(inside.sum())), tuple(own[inside] - first for own in pairs)
    _, part = connected_components(csr_array(graph, shape=(last - first,) * 2), directed=False)
    part = part.astype(np.int64) + first
    if comm.size == 1:
        return part
    every = np.concatenate(comm.allgather(part))
    across = np.unique(np.stack([every[own[~inside]] for own in pairs]), axis=1)
    edges = np.concatenate(comm.allgather(across), axis=1)
    shape = every.size, every.size
    whole = csr_array((np.ones(edges.shape[1]), tuple(edges)), shape=shape)
    _, joined = connected_components(whole, directed=False)
    return np.asarray(joined[part], dtype=np.int64)
