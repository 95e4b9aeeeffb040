"""Cells handed out anew: the same mesh and names, each set shared alike, the same motion.

Run as a script under mpirun, this file redistributes its meshes and reports what it finds.
"""

from contextlib import closing

import dolfinx.mesh as dmesh
import numpy as np
import parallel
import pytest
from common import on_first_rank
from mpi4py import MPI
from tumbling_l import tumbling_l

import rigidfx as rf
from rigidfx.base.compat import cell_geometry_dofs

COMM = MPI.COMM_WORLD
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))


def _hexahedra():
    """The L of which two pieces have names, and edges and vertices."""
    domain = tumbling_l(2)
    domain = domain.with_cells("foot", lambda x: x[1] <= 3 + 1e-9)
    domain = domain.with_cells("head", lambda x: x[1] >= 8 - 1e-9)
    domain = domain.with_edges("rim", lambda x: (x[1] > 10 - 1e-9) & (x[2] < 1e-9))
    return domain.with_vertices("edge", lambda x: (x[1] > 10 - 1e-9) & (x[0] < 1e-9))


def _curved():
    """Tetrahedra of ten nodes, whose middles of edges lie on a bent bar."""
    box = rf.box((0, 0, 0), (6, 1, 1), (12, 2, 2), "tetrahedron", comm=MPI.COMM_SELF)
    x, corners = box.mesh.geometry.x, cell_geometry_dofs(box.mesh)
    ends = np.sort(corners[:, EDGES], axis=2).reshape(-1, 2)
    pairs, middle = np.unique(ends, axis=0, return_inverse=True)
    points = np.concatenate([x, x[pairs].mean(axis=1)])
    points[:, 2] += 0.02 * points[:, 0] ** 2
    cells = np.c_[corners, len(x) + middle.reshape(-1, 6)]
    domain = on_first_rank(points, cells, "tetrahedron")
    domain = domain.with_cells("head", lambda x: x[0] >= 4 - 1e-9)
    domain = domain.with_edges(
        "keel", lambda x: np.abs(x[1]) + np.abs(x[2] - 0.02 * x[0] ** 2) < 1e-3
    )
    return domain.with_facets("end", lambda x: x[0] > 6 - 1e-9)


MESHES = {"hexahedra": (_hexahedra, ["foot", "head"]), "curved": (_curved, ["head"])}


def _owned(domain, dim, entities=None):
    """Owned ones, of a set or of all."""
    owned = domain.mesh.topology.index_map(dim).size_local
    every = np.arange(owned, dtype=np.int32) if entities is None else entities
    return every[every < owned]


def _middles(domain, dim, entities=None):
    """Middles of entities of all ranks, sorted."""
    own = _owned(domain, dim, entities)
    here = dmesh.compute_midpoints(domain.mesh, dim, own) if own.size else np.empty((0, 3))
    x = np.round(np.concatenate(COMM.allgather(here)), 9)
    return x[np.lexsort(x.T)]


def _by_number(domain):
    """Middles of cells in the order of the mesh file."""
    own = _owned(domain, 3)
    numbers = domain.mesh.topology.original_cell_index[own]
    rows = np.c_[numbers, dmesh.compute_midpoints(domain.mesh, 3, own)]
    rows = np.concatenate(COMM.allgather(rows))
    return rows[np.argsort(rows[:, 0])]


def _compared(make, names):
    """Whether meshes and sets are the same, and the cells of each group on each rank."""
    old = make()
    new = rf.redistribute(old, names)
    same = {"numbers": np.abs(_by_number(old) - _by_number(new)).max() < 1e-9}
    for (name, dim), found in new.sets.items():
        before = _middles(old, dim, old.sets[name, dim].entities)
        same[name] = bool(np.array_equal(_middles(new, dim, found.entities), before))
    facets = new.mesh.topology.connectivity(2, 3)  # a rank knows both cells of each of its facets
    outer = dmesh.exterior_facet_indices(new.mesh.topology).size
    inner = np.count_nonzero(np.diff(facets.offsets[: 1 + _owned(new, 2).size]) == 2)
    same["ghosts"] = COMM.allreduce(int(inner + outer - _owned(new, 2).size)) == 0
    sets = [_owned(new, 3, new.sets[name, 3].entities).size for name in names]
    counts = COMM.allgather([*sets, _owned(new, 3).size - sum(sets)])
    return {k: bool(v) for k, v in same.items()}, np.transpose(counts).tolist()


def _history(handed_out):
    """Of the L with its foot rigid: what momentum, energy and a probe were."""
    domain = _hexahedra()
    domain = rf.redistribute(domain, ["foot"]) if handed_out else domain
    push = rf.Traction("top", (3.0, 5.0, 8.0), until=0.5)
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(rho=10.0, E=1e4, nu=0.3),
        [push, rf.Rigid("foot")],
        probes={"tip": (0.0, 10.0, 0.0)},
    )
    with closing(rf.simulate(scene, 0.1, 1.0, progress=False)) as reports:
        return [[r.energy, *r.angular_momentum, *r.probes["tip"]] for r in reports]


@pytest.fixture(scope="module")
def found():
    return {n: parallel.run(__file__, n, timeout=300) for n in (1, 3)}


@parallel.on_1_and_3_ranks
@pytest.mark.parametrize("name", MESHES)
def test_mesh_and_sets_are_the_same(found, name, ranks):
    """Numbers in files, entities of each name, and all neighbours of a rank's cells."""
    same, _ = found[ranks]["compared"][name]
    assert len(same) >= 4
    assert all(same.values()), same


@pytest.mark.parallel
@pytest.mark.parametrize("name", MESHES)
def test_each_set_is_shared_alike(found, name):
    """And so are the cells of none; SCOTCH allows for some hundredths."""
    for counts in found[3]["compared"][name][1]:
        print(counts)
        assert max(counts) <= 1.1 * sum(counts) / 3 + 1


@pytest.mark.parallel
def test_the_motion_is_the_same(found):
    one, several = (np.array(found[n]["history"]) for n in (1, 3))
    assert np.abs(several - one).max(axis=0) == pytest.approx(
        0.0, abs=1e-9 * np.abs(one).max(axis=0).min()
    )


if __name__ == "__main__":
    compared = {name: _compared(*case) for name, case in MESHES.items()}
    history = _history(COMM.size > 1)
    parallel.report({"compared": compared, "history": history})
