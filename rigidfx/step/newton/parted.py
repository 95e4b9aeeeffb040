"""Ports of joints on parts that a tangent does not couple: they share a solve.

A part is a set of unknowns that are connected by entries of the matrix or by a port. A⁻¹ e is zero
outside the part of e, so one solve serves one port of each part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.types import Array, Ints


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

    def responses(self, solve: Callable[[Array], Array], ksp: PETSc.KSP | None = None) -> csr_array:
        """A⁻¹ of single ports, shape (unknowns, ports), by solves that they share. Collective.

        Args:
            solve: A⁻¹ of a vector of this rank's unknowns.
            ksp: Factors of one rank that solve for all at once, if there are such.
        """
        if ksp is not None and ksp.comm.size == 1 and len(self.right):
            found = _all_at_once(ksp, self.right)
        else:
            found = np.empty_like(self.right)
            for k in range(len(found)):
                found[k] = solve(self.right[k])
        unknown, number = self.places
        shape = self.right.shape[1], self.count
        return csr_array((found[number, unknown], *self.pattern), shape=shape)


def _all_at_once(ksp: PETSc.KSP, right: Array) -> Array:
    """A⁻¹ of the rows of a matrix: a sixth of the time of single solves with MUMPS."""
    B = PETSc.Mat().createDense(right.shape[::-1], array=right.T, comm=ksp.comm)
    X = B.duplicate()
    ksp.matSolve(B, X)
    found = np.array(X.getDenseArray().T)
    B.destroy()
    X.destroy()
    return found


def parted(A: PETSc.Mat, E: csr_array) -> Shared:
    """Ports that share solves with a matrix. Collective.

    Args:
        A: The matrix.
        E: Ports by this rank's unknowns, shape (unknowns, ports).
    """
    part, comm = _parts(A, E), A.comm.tompi4py()
    entries = E.tocoo()
    own: Ints = np.full(E.shape[1], -1, dtype=np.int64)
    own[entries.coords[1]] = part[entries.coords[0]]
    of_port = np.empty_like(own)
    comm.Allreduce(own, of_port, op=MPI.MAX)
    order = np.argsort(of_port, kind="stable")
    firsts = np.searchsorted(of_port[order], of_port[order])
    turn = np.empty_like(order)  # which of the ports of its part each is
    turn[order] = np.arange(order.size) - firsts
    turn[of_port < 0] = -1  # no unknown moves it
    ports = [
        order[turn[order] == k] for k in range(int(turn.max(initial=-1)) + 1)
    ]  # by their parts
    owners = np.full((len(ports), part.size), -1, dtype=np.int64)
    for row, numbers in zip(owners, ports, strict=True):
        at = np.searchsorted(of_port[numbers], part)
        at[at == numbers.size] = 0
        here = of_port[numbers][at] == part
        row[here] = numbers[at[here]]
    unknown, number = np.nonzero(owners.T >= 0)
    ends = np.searchsorted(unknown, np.arange(part.size + 1))
    right = [np.asarray(E[:, numbers].sum(axis=1)) for numbers in ports]
    pattern = owners.T[unknown, number], ends
    whole = np.reshape(right, (len(ports), part.size))
    return Shared(whole, (unknown, number), pattern, E.shape[1])


def _parts(A: PETSc.Mat, E: csr_array) -> Ints:
    """The part of each of this rank's unknowns, numbered alike on all ranks. Collective.

    The unknowns of a port are in one part, whether entries of the matrix connect them or not.
    """
    comm = A.comm.tompi4py()
    n, count = E.shape[0], E.shape[1]
    rows = A.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()) if A.getBlockSize() > 1 else A
    offsets, columns, _ = rows.getValuesCSR()
    if rows is not A:
        rows.destroy()
    first, last = A.getOwnershipRange()
    pairs = np.repeat(np.arange(first, last), np.diff(offsets)), columns
    inside = (columns >= first) & (columns < last)
    unknowns, ports = E.tocoo().coords
    i, j = (own[inside] - first for own in pairs)
    edges = np.concatenate([i, unknowns]), np.concatenate([j, n + ports])
    graph = csr_array((np.ones(edges[0].size), edges), shape=(n + count,) * 2)
    labels, part = connected_components(graph, directed=False)
    part = part.astype(np.int64)
    if comm.size == 1:
        return part[:n]
    part += comm.exscan(labels) or 0
    every = np.concatenate(comm.allgather(part[:n]))
    across = np.unique(np.stack([every[own[~inside]] for own in pairs]), axis=1)
    of_ports = np.stack(comm.allgather(part[n:]))
    met = [across, np.stack([of_ports[0].repeat(comm.size), of_ports.T.ravel()])]
    links = np.concatenate(comm.allgather(np.concatenate(met, axis=1)), axis=1)
    shape = (comm.allreduce(labels),) * 2
    whole = csr_array((np.ones(links.shape[1]), (links[0], links[1])), shape=shape)
    _, joined = connected_components(whole, directed=False)
    return np.asarray(joined[part[:n]], dtype=np.int64)
