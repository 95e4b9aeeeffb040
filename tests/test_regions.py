"""Which cells form bodies: against a reference in sets and loops, on any numbering and any ranks.

Run as a script under mpirun, this file finds the bodies of its random cases on these ranks.
"""

from functools import cache
from itertools import combinations, permutations

import numpy as np
import parallel
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpi4py import MPI

import rigidfx as rf
from rigidfx.decide.clusters import NONE, CellGraph, find_clusters

COMM, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
BOXES = {"hexahedron": (5, 4, 3), "tetrahedron": (3, 3, 2)}  # cubes along x, y, z
FACETS = {  # corners of each facet, in DOLFINx's order
    "hexahedron": (
        *((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 4, 5)),
        *((2, 3, 6, 7), (0, 2, 4, 6), (1, 3, 5, 7)),
    ),
    "tetrahedron": tuple(combinations(range(4), 3)),
}
CASES = 60  # random cases on several ranks, for each kind of cell
KINDS = pytest.mark.parametrize("cell", BOXES)
SEEDS = given(seed=st.integers(0, 2**32 - 1))


# Meshes and cases ------------------------------------------------------------------------------


@cache
def arrays(cell):
    """Points and cells of a box; each cube is one hexahedron, or six tetrahedra."""
    lowest = np.indices(BOXES[cell]).reshape(3, -1).T
    if cell == "hexahedron":
        corners = np.indices((2, 2, 2)).reshape(3, -1).T[None, :, ::-1]
    else:  # from the lowest corner to the highest, along the axes in any order
        paths = [np.eye(3, dtype=int)[list(order)] for order in permutations(range(3))]
        corners = np.stack([np.insert(path.cumsum(axis=0), 0, 0, axis=0) for path in paths])
    every = (lowest[:, None, None, :] + corners[None]).reshape(-1, 3)
    points, cells = np.unique(every, axis=0, return_inverse=True)
    return points.astype(float), cells.reshape(-1, corners.shape[1])


def graph_of(points, cells, cell, comm=SELF):
    """The neighbours as the package sees them; rank 0 gives the mesh."""
    if comm.rank > 0:
        points, cells = points[:0], cells[:0]
    domain = rf.from_arrays(points, cells, cell, comm)
    return CellGraph(rf.Scene(domain, rf.StVenantKirchhoff(rho=1.0, E=1.0, nu=0.3)))


@cache
def box_graph(cell):
    """The neighbours in the box, on one rank."""
    return graph_of(*arrays(cell), cell)


def random_case(seed, cell):
    """Cells that may be rigid, existing bodies that share no nodes, barred cells, least size."""
    rng = np.random.default_rng(seed)
    _, cells = arrays(cell)
    near, n = neighbours(cell), len(cells)
    existing, used = np.full(n, NONE), set()
    for number in rng.permutation(9)[: rng.integers(0, 4)]:
        for _ in range(rng.integers(1, 3)):  # a body that others have joined may be in pieces
            piece = grown(int(rng.integers(n)), int(rng.integers(1, 6)), near, rng)
            fits = [c for c in piece if not used & set(cells[c].tolist())]
            existing[fits] = number
        used |= set(cells[existing == number].reshape(-1).tolist())
    rigid = rng.random(n) < rng.choice([0.2, 0.5, 0.8, 0.95])
    barred = rng.random(n) < rng.choice([0.0, 0.05, 0.3])
    return rigid, existing, barred, int(rng.choice([1, 1, 2, 4, 9]))


def grown(start, size, near, rng):
    """Cells connected through facets, at most so many."""
    found = [start]
    for _ in range(size - 1):
        found.append(int(rng.choice(sorted(near[rng.choice(found)]))))
    return found


def found_regions(graph, case):
    """Bodies found, as sets of numbers in the mesh file, of cells owned by any rank."""
    rigid, existing, barred, min_cells = case
    mine = graph.numbers[: graph.owned]
    regions = find_clusters(graph, rigid[mine], existing[mine], barred[mine], min_cells)
    found = []
    for region in regions:
        cells = np.concatenate(graph.comm.allgather(mine[region.cells]))
        assert len(set(cells.tolist())) == cells.size == region.size
        found.append(frozenset(cells.tolist()))
    assert [r.label for r in regions] == sorted(r.label for r in regions)
    return found


# The reference ---------------------------------------------------------------------------------


@cache
def neighbours(cell):
    """For each cell the cells it shares a facet with."""
    at_facet = {}
    for c, corners in enumerate(arrays(cell)[1].tolist()):
        for facet in FACETS[cell]:
            at_facet.setdefault(frozenset(corners[k] for k in facet), []).append(c)
    near = {c: set() for c in range(len(arrays(cell)[1]))}
    for a, b in (pair for pair in at_facet.values() if len(pair) == 2):
        near[a].add(b)
        near[b].add(a)
    return near


def components(members, near, groups=()):
    """Connected components of a set of cells; each group counts as connected in itself."""
    left, found = set(members), []
    while left:
        part, edge = set(), {left.pop()}
        while edge:
            part |= edge
            edge = {b for a in edge for b in near[a]} & members
            edge |= {b for group in groups if group & part for b in group}
            edge -= part
        left -= part
        found.append(part)
    return found


def reference(cell, case, seen=None, numbers=None):
    """The rules as they are written: docs/theory/waking.md, rule 2.

    A case is rigid, existing, barred, min_cells; `seen` counts how often each rule decided
    something.
    """
    rigid, existing, barred, min_cells = case
    nodes = [set(corners) for corners in arrays(cell)[1].tolist()]
    seen = {} if seen is None else seen
    number = np.arange(len(nodes)) if numbers is None else numbers

    def count(rule, times):
        seen[rule] = seen.get(rule, 0) + times

    groups = [set(np.flatnonzero(existing == k)) for k in np.unique(existing[existing >= 0])]
    old = {c for group in groups for c in group}
    new = {c for c in np.flatnonzero(rigid & ~barred) if c not in old}
    while True:
        bodies = components(old | new, neighbours(cell), groups)
        small = [body for body in bodies if not body & old and len(body) < min_cells]
        count("too small", len(small))
        new -= set().union(*small)
        bodies = [body for body in bodies if body not in small]
        bodies.sort(key=lambda body: (not body & old, -len(body), min(number[c] for c in body)))
        giving = []  # who gives up cells, for whose sake, and which
        for node in {n for c in set().union(*bodies) for n in nodes[c]}:
            round_it = {k: {c for c in body if node in nodes[c]} for k, body in enumerate(bodies)}
            meeting = [k for k, here in round_it.items() if here]
            best = next((k for k in meeting if round_it[k] & old), meeting[0])
            giving += [(k, best, round_it[k]) for k in meeting if k != best]
        if not giving:
            break
        count("hinge", 1)
        losers = {k for k, _, _ in giving}
        final = [cells for _, m, cells in giving if m not in losers]
        new -= set().union(*(final or [cells for _, _, cells in giving]))
    count("merge", sum(sum(bool(group & body) for group in groups) > 1 for body in bodies))
    count("growth", sum(bool(old & body) and bool(new & body) for body in bodies))
    count("two bodies", len(bodies) > 1)
    found = []
    for body in bodies:
        of_body = {n for c in body for n in nodes[c]}
        inside = {c for c in range(len(nodes)) if nodes[c] <= of_body and c not in body}
        joining = {c for c in inside if not barred[c]}
        count("enclosed", len(joining))
        count("enclosed but barred", len(inside - joining))
        found.append(frozenset(int(c) for c in body | joining))
    return found


# Properties ------------------------------------------------------------------------------------


@KINDS
@SEEDS
def test_bodies_are_those_of_the_reference(cell, seed):
    case = random_case(seed, cell)
    assert set(found_regions(box_graph(cell), case)) == set(reference(cell, case))


@KINDS
@SEEDS
def test_numbering_does_not_matter(cell, seed):
    """The mesh with its cells and points in another order has the same bodies."""
    points, cells = arrays(cell)
    case = random_case(seed, cell)
    rng = np.random.default_rng(seed)
    order, place = rng.permutation(len(cells)), rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[place] = points  # point p is now place[p], cell order[k] is now k
    graph = graph_of(shuffled, place[cells[order]], cell)
    rigid, existing, barred, min_cells = case
    other = found_regions(graph, (rigid[order], existing[order], barred[order], min_cells))
    back = {frozenset(order[list(body)].tolist()) for body in other}
    # The order of cells decides between parts on a hinge that have as many of them, and only there.
    assert back == set(reference(cell, case, numbers=np.argsort(order)))


@pytest.mark.parallel
@KINDS
def test_partition_does_not_matter(on_ranks, cell):
    """Several ranks find the same bodies in the same order; most of these lie on several."""
    cases = [random_case(seed, cell) for seed in range(CASES)]
    one = [found_regions(box_graph(cell), case) for case in cases]
    assert on_ranks[3][cell] == [[sorted(body) for body in bodies] for bodies in one]
    shared, every = on_ranks[3]["shared"][cell], sum(map(len, one))
    print(f"{shared} of {every} bodies lie on several ranks")
    assert shared > every / 3


@KINDS
def test_cases_have_what_the_rules_are_about(cell):
    seen = {}
    for seed in range(CASES):
        reference(cell, random_case(seed, cell), seen)
    print(seen)
    assert len(seen) == 7
    assert min(seen.values()) >= 3


@pytest.fixture(scope="module")
def on_ranks():
    """What this file as a script reports, by the number of ranks."""
    return {n: parallel.run(__file__, n, timeout=600) for n in (3,)}


def _script():
    results, shared = {}, {}
    for cell in BOXES:
        graph = graph_of(*arrays(cell), cell, COMM)
        mine = set(graph.numbers[: graph.owned].tolist())
        found = [found_regions(graph, random_case(seed, cell)) for seed in range(CASES)]
        results[cell] = [[sorted(body) for body in bodies] for bodies in found]
        held = [[bool(mine & body) for body in bodies] for bodies in found]
        ranks = COMM.allgather([h for of_case in held for h in of_case])
        shared[cell] = int((np.sum(ranks, axis=0) > 1).sum())
    parallel.report({**results, "shared": shared})


if __name__ == "__main__":
    _script()
