"""What differs between ranks is named at the start, where it would end in ranks that wait.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import parallel
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.taken import digest

COMM = MPI.COMM_WORLD
RANK = COMM.rank
STEEL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
CRITERION = rf.StrainRate(10.0, 0.2, wake="all")


def _run(*effects, dt=0.1, t_end=1.0, rigidify=CRITERION, monitor=None, **options):
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 2, 2))
    scene = rf.Scene(domain, STEEL, effects, **options)
    run = rf.simulate(scene, dt, t_end, rigidify=rigidify, progress=False, monitor=monitor)
    reports = list(run)
    return [(r.t, r.unknowns, [e.kind for e in r.events]) for r in reports]


def _scene():
    return rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), STEEL)


def _record(**options):
    """A recorder whose folder is a rank's own, which is nobody's business but rank 0's."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = rf.Recorder(_scene(), folder, **options)
        recorder.close()
        named = MPI.COMM_WORLD.allgather(recorder.folder)
        assert set(named) == {named[0]}


def _contact(**options):
    return rf.Contact("z0", **{"against": rf.Plane((0, 0, -1), (0, 0, 1))} | options)


def _write(path):
    refusals.write_bodies_of(_scene(), path)


def _listen(iteration, norm):
    if RANK == 1:
        raise KeyError("on rank 1")


def _monitor():
    """The one rank raises what the function has, the other what it is told of it."""
    try:
        _run(rf.Traction("x1", (1, 0, 0)), monitor=_listen)
    except KeyError as error:
        raise rf.SceneError(f"simulate: monitor failed with KeyError: {error}") from None


def _materials():
    """Two materials, named in another order on each rank."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    domain = domain.with_cells("a", lambda x: x[0] < 2 + 1e-9)
    domain = domain.with_cells("b", lambda x: x[0] > 2 - 1e-9)
    given = {"a": STEEL, "b": rf.NeoHooke(rho=1.0, E=50.0, nu=0.3)}
    names = list(given)[:: 1 - 2 * RANK]
    scene = rf.Scene(domain, {name: given[name] for name in names})
    return [material.rho for material, _ in scene.materials]


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
    "late in a table": (
        lambda: _run(rf.Gravity(time=rf.Table([*range(60), 60.25 + RANK / 8], [1] * 61))),
        "60.25), values=",
    ),
    "late in an array": (
        lambda: _run(rf.Gravity(time=rf.Table(np.r_[:2000, 2000.25 + RANK / 8], [1] * 2001))),
        "2000.25",
    ),
    "a number of steps": (lambda: _record(every=1 + RANK), "every is not the same"),
    "an interval": (lambda: _record(interval=0.1 + RANK), "interval is not the same"),
    "stresses": (lambda: _record(stress=RANK == 0), "stress is not the same"),
    "no folder": (
        lambda: rf.Recorder(_scene(), "nowhere" if RANK else None),
        "folder must be the name",
    ),
    "no file": (lambda: _write("nowhere.json" if RANK else None), "path must be the name"),
    "a monitor that fails": (_monitor, "simulate: monitor failed with KeyError: 'on rank 1'"),
    "a box": (lambda: rf.box((0, 0, 0), (1, 1, 1 + RANK), (1, 1, 2)), "box: upper[2] is not"),
    "cells of a box": (lambda: rf.box((0, 0, 0), (1, 1, 1), [1, 1, 2 + RANK]), "box: cells[2] is"),
    "a control": (lambda: _run(dt=rf.StepControl(0.05 * (1 + RANK), largest=0.1)), "simulate: dt"),
    "a control or a number": (
        lambda: _run(dt=rf.StepControl(0.05, largest=0.1) if RANK else 0.1),
        "simulate: dt",
    ),
    "stiffness of a contact": (lambda: _run(_contact(stiffness=1.0 + RANK)), "Scene: effects"),
    "place of a plane": (
        lambda: _run(_contact(against=rf.Plane((0, 0, -1 - RANK), (0, 0, 1)))),
        "Scene: effects",
    ),
    "a contact or none": (lambda: _run(*[_contact()][:RANK]), "Scene: effects"),
    "an axis": (
        lambda: _run(rf.PrescribedRotation("x0", axis=(1, RANK, 0), angle=np.sin)),
        "Scene: effects",
    ),
    "an element": (lambda: _run(element=("standard", "enhanced")[RANK]), "Scene: element"),
    "a relative tolerance": (
        lambda: _run(rigidify=rf.StrainRate(rf.Relative(0.1 + 0.1 * RANK), 0.1)),
        "simulate: rigidify",
    ),
    "no cells but the same ones": (
        lambda: rf.from_arrays(np.argwhere(np.ones((2, 2, 2)))[:, ::-1], [range(8)]),
        "from_arrays: ranks 0 and 1 give the same cells, so that each would be there twice",
    ),
    "integration points": (
        lambda: _record(integration_points=bool(RANK)),
        "Recorder: integration_points",
    ),
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
    assert [rank["accepted"] for rank in ranks] == [[[2.0, 1.0], 2]] * 2


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (rf.Gravity(), rf.Gravity((0, 0, 1))),
        (np.arange(3), np.arange(3.0)),
        (np.arange(3.0), np.ones(3)),
        ({"a": 1}, {"a": 2}),
        ({1, 2}, {1, 3}),
        (rf.Table([0, 1], [0, 1]), rf.Table([0, 2], [0, 1])),
        ([1.0, 2.0], [1.0]),
        (Path("a"), Path("b")),
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
    _record()
    heard = set()
    listen = (lambda k, norm: heard.add(k)) if RANK == 0 else None
    _run(rf.Traction("x1", (1, 0, 0)), t_end=0.1, monitor=listen)
    found["accepted"] = [_materials(), COMM.bcast(min(len(heard), 2))]
    everybody = COMM.gather(found)
    if RANK == 0:
        parallel.report(everybody)


if __name__ == "__main__":
    _script()
