"""What differs between ranks is named at the start, where it would end in ranks that wait.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

import sys

import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.same_input import digest

COMM = MPI.COMM_WORLD
RANK = COMM.rank
STEEL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
CRITERION = rf.StrainRate(10.0, 0.2)


def _run(*effects, dt=0.1, t_end=1.0, rigidify=CRITERION, **options):
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 2, 2))
    scene = rf.Scene(domain, STEEL, effects, **options)
    reports = list(rf.simulate(scene, dt, t_end, rigidify=rigidify, progress=False))
    return [(r.t, r.unknowns, [e.kind for e in r.events]) for r in reports]


def _of_rank(t):
    """A load whose changes each rank sees at another time."""
    return (1.0 if t < 0.3 + 0.2 * RANK else 2.0, 0.0, 0.0)


REFUSED = {
    "a load": (lambda: _run(rf.Traction("x1", (1 + RANK, 0, 0))), "effects[0] is not the same"),
    "a later load": (lambda: _run(rf.Gravity(), rf.Gravity((0, 0, RANK))), "effects[1] is not"),
    "a table": (lambda: _run(rf.Gravity(time=rf.Table([0, 1 + RANK], [0, 1]))), "effects[0]"),
    "a time window": (lambda: _run(rf.Gravity(until=0.3 + RANK)), "effects[0] is not the same"),
    "a number of effects": (lambda: _run(*[rf.Gravity()] * (1 + RANK)), "nothing on rank 0"),
    "a step": (lambda: _run(dt=0.1 / (1 + RANK)), "dt is not the same on all ranks: 0.1 on rank 0"),
    "steps": (lambda: _run(dt={0: 0.1, 0.5: 0.1 + 0.1 * RANK}), "dt is not the same"),
    "an end": (lambda: _run(t_end=1.0 + RANK), "t_end is not the same"),
    "a window": (lambda: _run(rigidify=rf.StrainRate(1, 0.2 + RANK)), "rigidify is not the same"),
    "a planned release": (
        lambda: _run(rigidify=rf.StrainRate(1, 0.2, release=rf.Release(at=0.3 + RANK))),
        "rigidify is not the same",
    ),
    "a criterion": (lambda: _run(rigidify=None if RANK else CRITERION), "rigidify is not the same"),
    "a material": (
        lambda: rf.Scene(
            rf.box((0, 0, 0), (1, 1, 1), (1, 1, 2)), rf.NeoHooke(rho=1.0, E=1.0 + RANK, nu=0.3)
        ),
        "material is not the same",
    ),
    "an order": (lambda: _run(order=1 + RANK), "order is not the same"),
    "a mass": (lambda: _run(mass="consistent" if RANK else "lumped"), "mass is not the same"),
    "a scheme": (lambda: _run(scheme=rf.Midpoint() if RANK else None), "scheme is not the same"),
    "a probe": (lambda: _run(probes={"tip": (RANK, 1, 1)}), "probes is not the same"),
}


@pytest.mark.parallel
def test_what_differs_between_ranks_is_named():
    ranks = parallel.run(__file__, 2, timeout=300)
    assert len(ranks) == 2
    for name, (_, message) in REFUSED.items():
        first, second = (rank.get(name, "not reached") for rank in ranks)
        assert message in first, (name, first)
        assert first == second, name
    first, second = (rank["a load that is decided on one rank"] for rank in ranks)
    assert first == second
    assert any("release" in kinds for _, _, kinds in first)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (rf.Gravity(), rf.Gravity((0, 0, 1))),
        (np.arange(3), np.arange(3.0)),
        ({"a": 1}, {"a": 2}),
        ({1, 2}, {1, 3}),
        (rf.Table([0, 1], [0, 1]), rf.Table([0, 2], [0, 1])),
        ([1.0, 2.0], [1.0]),
    ],
)
def test_differences_of_plain_data_are_seen(one, other):
    assert digest(one) == digest(one)
    assert digest(one) != digest(other)


def _script():
    found = {}
    for name, (action, _) in REFUSED.items():
        print(f"rank {RANK}: {name}", file=sys.stderr, flush=True)
        try:
            action()
            found[name] = "accepted"
        except rf.SceneError as error:
            found[name] = str(error)
        COMM.barrier()  # a rank that is still in the case would hang here
    found["a load that is decided on one rank"] = _run(rf.Traction("x1", _of_rank))
    everybody = COMM.gather(found)
    if RANK == 0:
        parallel.report(everybody)


if __name__ == "__main__":
    _script()
