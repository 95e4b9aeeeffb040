"""Ranks: one without cells, one with frozen cells only, one body across all of them.

Each scene is run on all ranks and, as a reference, by every rank alone.
"""

from collections.abc import Callable, Iterator

import numpy as np
from mpi4py import MPI

import rigidfx as rf

from .case import ANY, History, Run, between, case, middles, release_at

MATERIAL = rf.StVenantKirchhoff(E=300.0, nu=0.3, rho=1.0)
SPIN = rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.3, 0.2, 0.5))
BOTH = {"alone": MPI.COMM_SELF, "all ranks": MPI.COMM_WORLD}


def _compare() -> Callable[[History], str]:
    """A check that keeps its first history and compares the others with it, to 1e-9."""
    first: list[History] = []

    def is_the_same(history: History) -> str:
        first.append(history)
        for name in ("energy", "L", "J"):
            a, b = (np.array(getattr(h, name)) for h in (first[0], history))
            if a.shape != b.shape or np.abs(a - b).max() > 1e-9 * np.abs(a).max():
                return f"{name} differs from that on one rank"
        if history.cells != first[0].cells:
            return "other cells are rigid than on one rank"
        return ""

    return is_the_same


@case("parallel", "a body of one cell: all ranks but one have none")
def rank_without_cells(short: bool) -> Iterator[Run]:
    """The history is that on one rank to 1e-9, with all balances."""
    t_end = 2.4 if short else 5.0
    check = _compare()
    for way, comm in BOTH.items():
        domain = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), comm=comm)
        criterion = rf.StrainRate(ANY, 0.5, release=release_at(2.0), min_cells=1)
        yield Run(way, rf.Scene(domain, MATERIAL, [SPIN]), 0.1, t_end, criterion, check=check)


@case("parallel", "the last rank has frozen cells only")
def rank_with_frozen_cells_only(short: bool) -> Iterator[Run]:
    """The history is that on one rank to 1e-9, with all balances."""
    t_end = 2.4 if short else 5.0
    world = MPI.COMM_WORLD
    size, cells = (8.0, 2.0, 1.0), (8, 2, 1)
    on_all = rf.box((0, 0, 0), size, cells)
    owned = on_all.mesh.topology.index_map(3).size_local
    theirs = world.bcast(middles(on_all)[:owned], root=world.size - 1)
    if world.size == 1:
        theirs = theirs[theirs[:, 0] < 4]

    def among(points: np.ndarray) -> np.ndarray:
        near = np.linalg.norm(points[:, None] - theirs, axis=2).min(axis=1, initial=np.inf) < 1e-6
        return np.flatnonzero(near)

    def frozen(comm: MPI.Intracomm) -> rf.Domain:
        domain = rf.box((0, 0, 0), size, cells, comm=comm)
        # A rank marks the cells it owns; those it has as ghosts are marked by their owners.
        return domain.with_cell_set("frozen", among(middles(domain)))

    criterion = rf.StrainRate(0.0, 0.5, tolerances={"frozen": ANY})
    yield from _named_and_found(frozen, "frozen", criterion, t_end)


def _named_and_found(
    domain: Callable[[MPI.Intracomm], rf.Domain], name: str, rule: rf.StrainRate, t_end: float
) -> Iterator[Run]:
    """Cells of some name are rigid, by this name or by a rule, on one rank and on all."""
    for kind in ("named", "adaptive"):
        check, given = _compare(), [SPIN, *[rf.Rigid(name)] * (kind == "named")]
        for way, comm in BOTH.items():
            scene = rf.Scene(domain(comm), MATERIAL, given)
            yield Run(f"{kind}, {way}", scene, 0.1, t_end, rule if kind == "adaptive" else None,
                      check=check)  # fmt: skip


@case("parallel", "one body has cells on every rank")
def body_across_all_ranks(short: bool) -> Iterator[Run]:
    """The history is that on one rank to 1e-9, with all balances."""

    def core(comm: MPI.Intracomm) -> rf.Domain:
        return rf.box((0, 0, 0), (9, 1, 1), (9, 1, 1), comm=comm).with_cells("core", between(1, 8))

    rule = rf.StrainRate(0.0, 0.5, tolerances={"core": ANY}, release=release_at(2.0))
    yield from _named_and_found(core, "core", rule, 2.4 if short else 5.0)
