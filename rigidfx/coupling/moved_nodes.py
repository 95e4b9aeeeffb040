"""Motion of the nodes that a rank knows, its ghosts included: unknowns of their own, or a body.

So the entries that rows of a reduced matrix have are counted: exactly without bodies, and somewhat
too many where interior cells and cells at the interface share nodes. Superfluous room is given back
in the first assembly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.types import Array, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Lengths, couplings, parted


@dataclass(frozen=True)
class MovedNodes:
    """The motion of some nodes."""

    unknowns: Ints  # number of each of a node's dofs as an unknown, -1 if it is none, shape (n, 3)
    body: Ints  # body that moves the node, -1 if none
    # a = [1, V, Φ₁, ..., Φ_m] in the frame of that body, shape (n, 4 + 3 m), with the largest m of
    # all; zero beyond its own [1, m]
    coordinates: Array

    def __getitem__(self, chosen: Ints) -> MovedNodes:
        return MovedNodes(self.unknowns[chosen], self.body[chosen], self.coordinates[chosen])


def moved_nodes(prolongation: Prolongation, known: Any) -> MovedNodes:
    """The motion of the nodes of an index map, ghosts included. Collective.

    Its owned nodes are those of the prolongation's space.
    """
    layout, dealt = prolongation.layout, prolongation.dealt
    n = int(layout.ensemble.frozen.shape[1])
    of_rows: Array = np.zeros((layout.rows.nodes.size, 1 + n))  # body, a
    of_rows[:, 0] = -1.0
    for k, (body, at) in enumerate(zip(layout.bodies, layout.attached, strict=True)):
        places = layout.rows.positions(body.nodes[at])
        a = body.coordinates(at)
        of_rows[places, 0], of_rows[places, 1 : 1 + a.shape[1]] = k, a
    found = la.vector(known, 4 + n)
    values = found.array.reshape(-1, 4 + n)  # three unknowns, body, a
    values[:, :4] = -1.0
    if dealt is None:
        values[layout.rows.nodes, 3:] = of_rows
    else:
        own_nodes = prolongation.space.dofmap.index_map.size_local
        values[:own_nodes, 3:] = dealt.give_nodes(of_rows, -1.0)[:own_nodes]
    dofs = prolongation.dofs
    values[dofs // 3, dofs % 3] = prolongation.first_column + np.arange(dofs.size)
    found.scatter_forward()
    numbers: Ints = values[:, :4].astype(np.int64)
    return MovedNodes(numbers[:, :3], numbers[:, 3], values[:, 4:].copy())


def condensed_row_lengths(
    prolongation: Prolongation, interior: fem.Form, interface: fem.Form
) -> Lengths:
    """Of a reduced tangent, in its blocks where it has some, as PETSc takes them. Collective.

    Forms are over flexible cells that touch no body, and over those that do.
    """
    lengths = np.zeros((prolongation.owned, 2))
    widths = prolongation.layout.ensemble.unknowns[prolongation.owned_bodies]
    lengths[prolongation.own_free :, 0] = np.repeat(widths, widths)  # the bodies' own blocks
    for form in (interior, interface) if prolongation.touched else (interior,):
        _add_coupled(lengths, prolongation, form)
    most = np.array([prolongation.owned, prolongation.size - prolongation.owned])
    block = 3 if prolongation.nodal else 1
    inside, outside = (np.minimum(lengths, most)[::block] // block).astype(PETSc.IntType).T
    return inside, outside


def _add_coupled(lengths: Array, prolongation: Prolongation, form: fem.Form) -> None:
    """Add couplings of the cells of a form to the lengths of rows, shape (rows, 2). Collective."""
    pattern, known = couplings(form)
    nodes = moved_nodes(prolongation, known)
    unknowns = np.count_nonzero(nodes.unknowns >= 0, axis=1)
    rank_of_node = prolongation.rank_of(nodes.unknowns.max(axis=1, initial=-1))
    rank_of_body = prolongation.rank_of(prolongation.body_columns.max(axis=1, initial=-1))
    rank = prolongation.comm.rank
    coupled = pattern @ parted(unknowns, rank_of_node == rank)
    if prolongation.touched:
        slaves = np.flatnonzero(nodes.body >= 0)
        entries = np.ones(slaves.size), (slaves, nodes.body[slaves])
        slave_of = csr_array(entries, shape=(nodes.body.size, rank_of_body.size))
        bodies_at_nodes, widths = _ones(pattern @ slave_of), prolongation.layout.ensemble.unknowns
        coupled += bodies_at_nodes @ parted(widths, rank_of_body == rank)
        nodes_at_bodies = _ones(slave_of[: pattern.shape[0]].T.tocsr() @ pattern)
        bodies_at_bodies = _ones(nodes_at_bodies @ slave_of)
        of_bodies = _summed(nodes_at_bodies, unknowns, rank_of_node, rank_of_body)
        of_bodies += _summed(bodies_at_bodies, widths, rank_of_body, rank_of_body)
        prolongation.comm.Allreduce(MPI.IN_PLACE, of_bodies)
        own = prolongation.owned_bodies
        lengths[prolongation.own_free :] += np.repeat(of_bodies[own], widths[own], axis=0)
    node, axis = np.nonzero(nodes.unknowns[: pattern.shape[0]] >= 0)
    lengths[nodes.unknowns[node, axis] - prolongation.first_column] += coupled[node]


def _summed(at_bodies: csr_array, widths: Any, ranks: Any, rank_of_body: Any) -> Array:
    """Columns that each body's rows have, of its own rank and of others, shape (bodies, 2).

    Partners of the rows are bodies by nodes, or bodies by bodies, each with its width and rank.
    """
    body, other = at_bodies.nonzero()
    halves = parted(widths[other], ranks[other] == rank_of_body[body])
    out = np.zeros((rank_of_body.size, 2))
    np.add.at(out, body, halves)
    return out


def _ones(counts: csr_array) -> csr_array:
    counts.data[:] = 1.0
    return counts
