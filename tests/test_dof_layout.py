"""Which nodes of a bar are free, prescribed, moved by bodies, or without rows.

Run as a script under mpirun, this file reports what the layouts are when gathered on rank 0.
"""

from __future__ import annotations

import dolfinx
import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.coupling.dof_layout import dof_layout, nodes_of, rigid_fields
from rigidfx.mechanics.bodies import Ensemble
from rigidfx.mechanics.rigid_body import RigidBody

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)

# Cells along a bar, the intervals of x that are rigid, components held at its end.
BARS = {
    "flexible": (5, [], ""),
    "one": (5, [(0, 2)], ""),
    "two": (5, [(0, 1), (3, 4)], "z"),  # the cells between them touch both or one
    "held": (5, [(0, 2)], "xyz"),
    "alone": (2, [(0, 2)], ""),
    "short": (2, [(0, 1)], ""),  # on three ranks, one at least has no cell
}


def bar(cells, rigid):
    """A bar of unit cells along x; its scene, flexible cells and bodies, whose origin is 0."""
    scene = rf.Scene(rf.box((0, 0, 0), (cells, 1, 1), (cells, 1, 1)), MATERIAL)
    mesh, x = scene.mesh, scene.space.tabulate_dof_coordinates()[: scene.owned_nodes]
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    middle = dolfinx.mesh.compute_midpoints(mesh, 3, owned)[:, 0]
    flexible, bodies = np.ones(owned.size, dtype=bool), []
    for k, (low, high) in enumerate(rigid):
        inside = (middle > low) & (middle < high)
        nodes = np.flatnonzero((x[:, 0] > low - 1e-9) & (x[:, 0] < high + 1e-9)).astype(np.int32)
        J = np.diag([1.0, 2.0, 3.0])
        bodies.append(
            RigidBody(
                f"{k}", owned[inside], nodes, x[nodes], 0 * x[nodes], 2.0 + k, J, np.zeros(3), k + 1
            )
        )
        flexible &= ~inside
    return scene, {1: owned[flexible]}, Ensemble(bodies)


def layout_of(name):
    """The scene of a bar and its layout. Collective."""
    cells, rigid, components = BARS[name]
    scene, flexible, bodies = bar(cells, rigid)
    x = scene.space.tabulate_dof_coordinates()[: scene.owned_nodes]
    prescribed = np.zeros((len(x), 3), dtype=bool)
    for c in components:
        prescribed[x[:, 0] > cells - 1e-9, "xyz".index(c)] = True
    return scene, dof_layout(scene, flexible, bodies, prescribed.reshape(-1))


def places(scene, mask):
    """Positions x of the owned nodes in a mask, all ranks' in order, as many as there are."""
    x = scene.space.tabulate_dof_coordinates()[: scene.owned_nodes][mask, 0]
    return sorted(round(float(v)) for part in scene.comm.allgather(x) for v in part)


def facts(name):
    """What a layout says, the same on all ranks. Collective."""
    scene, layout = layout_of(name)
    comm, n = scene.comm, scene.owned_nodes
    middle = dolfinx.mesh.compute_midpoints

    def cells(groups):
        own = np.concatenate(list(groups.values()))
        x = middle(scene.mesh, 3, own)[:, 0] if own.size else own
        return sorted(float(v) for part in comm.allgather(x) for v in part)

    attached = []
    for body, at in zip(layout.bodies, layout.attached, strict=True):
        mask = np.zeros(n, dtype=bool)
        mask[body.nodes[at]] = True
        attached.append(places(scene, mask))
    kinds = np.stack([layout.free, layout.prescribed, ~np.repeat(layout.massive, 3)])
    has_row = np.zeros(n, dtype=bool)
    has_row[layout.rows.nodes] = True
    reached = np.zeros(3 * scene.space.dofmap.list.max(initial=n - 1) + 3, dtype=bool)
    reached[layout.reached] = True
    everywhere = rigid_fields(scene, layout.ensemble, layout.prescribed)
    return {
        "interior": cells(layout.interior),
        "interface": cells(layout.interface),
        "flexible": cells(layout.flexible),
        "attached": attached,
        "rows": places(scene, has_row),
        "free": [places(scene, layout.free.reshape(-1, 3)[:, c]) for c in range(3)],
        "kinds": comm.allreduce(np.bincount(kinds.sum(axis=0), minlength=4), op=MPI.SUM).tolist(),
        "first": comm.allgather((layout.rows.first, layout.rows.dofs.size)),
        "mass": scene.sum(layout.masses.sum()),
        "of flexible cells": places(scene, nodes_of(scene, layout.flexible)[:n]),
        "reached": places(scene, reached[: 3 * n : 3]),
        "all rows": comm.allreduce(everywhere.rows.nodes.size),
        "all attached": [comm.allreduce(at.size) for at in everywhere.attached],
        "cells of ranks": comm.allgather(scene.mesh.topology.index_map(3).size_local),
    }


def of_faces(*planes):
    """Nodes on planes across the bar: four each."""
    return sorted(4 * list(planes))


@pytest.fixture(scope="module")
def found():
    """Facts by the number of ranks and the name of the bar."""
    return {n: parallel.run(__file__, n, timeout=300) for n in (1, 3)}


@parallel.on_1_and_3_ranks
def test_cells_at_bodies_are_the_interface(found, ranks):
    """All other flexible cells are interior."""
    wanted = {
        "flexible": ([0.5, 1.5, 2.5, 3.5, 4.5], []),
        "one": ([3.5, 4.5], [2.5]),
        "two": ([], [1.5, 2.5, 4.5]),
        "held": ([3.5, 4.5], [2.5]),
        "alone": ([], []),
        "short": ([], [1.5]),
    }
    for name, (interior, interface) in wanted.items():
        facts = found[ranks][name]
        assert (facts["interior"], facts["interface"]) == (interior, interface), name
        assert facts["flexible"] == sorted(interior + interface)


@parallel.on_1_and_3_ranks
def test_nodes_of_bodies_have_rows_where_flexible_cells_pull(found, ranks):
    """They are attached there; inside a body they have none."""
    wanted = {
        "flexible": ([], of_faces(0, 1, 2, 3, 4, 5)),
        "one": ([of_faces(2)], of_faces(2, 3, 4, 5)),
        "two": ([of_faces(1), of_faces(3, 4)], of_faces(1, 2, 3, 4, 5)),
        "held": ([of_faces(2)], of_faces(2, 3, 4, 5)),
        "alone": ([[]], []),
        "short": ([of_faces(1)], of_faces(1, 2)),
    }
    for name, (attached, rows) in wanted.items():
        facts = found[ranks][name]
        assert facts["attached"] == attached, name
        assert facts["rows"] == facts["of flexible cells"] == facts["reached"] == rows, name


@parallel.on_1_and_3_ranks
def test_a_dof_is_of_one_kind(found, ranks):
    """It is free, prescribed or of a body; rows of ranks follow one another."""
    free = {
        "flexible": 3 * [of_faces(0, 1, 2, 3, 4, 5)],
        "one": 3 * [of_faces(3, 4, 5)],
        "two": [of_faces(2, 5), of_faces(2, 5), of_faces(2)],
        "held": 3 * [of_faces(3, 4)],
        "alone": 3 * [[]],
        "short": 3 * [of_faces(2)],
    }
    for name, wanted in free.items():
        facts = found[ranks][name]
        assert facts["free"] == wanted, name
        assert facts["kinds"] == [0, 12 * (BARS[name][0] + 1), 0, 0], name
        firsts, sizes = np.transpose(facts["first"])
        assert firsts.tolist() == np.r_[0, np.cumsum(sizes)[:-1]].tolist()


@parallel.on_1_and_3_ranks
def test_mass_is_of_nodes_outside_bodies(found, ranks):
    """Of ρ = 2 kg/m³ a body has half a cell more than its own."""
    inside = {"flexible": 0.0, "one": 2.5, "two": 3.5, "held": 2.5, "alone": 2.0, "short": 1.5}
    for name, volume in inside.items():
        wanted = 2.0 * (BARS[name][0] - volume)
        assert found[ranks][name]["mass"] == pytest.approx(wanted, rel=1e-14, abs=1e-14), name


@parallel.on_1_and_3_ranks
def test_rigid_fields_know_all_nodes(found, ranks):
    """All nodes have rows and all nodes of bodies are attached."""
    for name, (cells, rigid, _) in BARS.items():
        facts = found[ranks][name]
        assert facts["all rows"] == 4 * (cells + 1)
        assert facts["all attached"] == [4 * (high - low + 1) for low, high in rigid]


@pytest.mark.parallel
def test_a_rank_had_no_cell(found):
    """The scenes have what they are meant for."""
    assert min(found[3]["short"]["cells of ranks"]) == 0


if __name__ == "__main__":
    results = {name: facts(name) for name in BARS}
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(results)
