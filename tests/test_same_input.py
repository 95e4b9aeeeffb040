"""What differs between ranks is named at the start, where it would end in ranks that wait.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

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


def _scene(material=STEEL):
    return rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), material)


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


CUBE = np.argwhere(np.ones((2, 2, 2)))[:, ::-1]
REFUSED = refusals.table(r"""
_run(Traction("x1", (1 + RANK, 0, 0))) :: effects[0] is not the same
_run(Gravity(), Gravity((0, 0, RANK))) :: effects[1] is not
_run(Gravity(time=Table([0, 1 + RANK], [0, 1]))) :: effects[0]
_run(Gravity(until=0.3 + RANK)) :: effects[0] is not the same
_run(*[Gravity()] * (1 + RANK)) :: nothing on rank 0
_run(dt=0.1 / (1 + RANK)) :: dt is not the same on all ranks: 0.1 on rank 0
_run(dt={0: 0.1, 0.5: 0.1 + 0.1 * RANK}) :: dt is not the same
_run(t_end=1.0 + RANK) :: t_end is not the same
_run(rigidify=StrainRate(1, 0.2 + RANK)) :: rigidify is not the same
_run(rigidify=StrainRate(1, 0.2, release=Release(at=0.3 + RANK))) :: rigidify is not the same
_run(rigidify=None if RANK else CRITERION) :: rigidify is not the same
_scene(NeoHooke(rho=1.0, E=1.0 + RANK, nu=0.3)) :: material is not the same
_run(order=1 + RANK) :: order is not the same
_run(mass="consistent" if RANK else "lumped") :: mass is not the same
_run(scheme=Midpoint() if RANK else None) :: scheme is not the same
_run(Gravity(time=Table([*range(60), 60.25 + RANK / 8], [1] * 61))) :: 60.25), values=
_run(Gravity(time=Table(np.r_[:2000, 2000.25 + RANK / 8], [1] * 2001))) :: 2000.25
_record(every=1 + RANK) :: every is not the same
_record(interval=0.1 + RANK) :: interval is not the same
_record(stress=RANK == 0) :: stress is not the same
Recorder(_scene(), "nowhere" if RANK else None) :: folder must be the name
_write("nowhere.json" if RANK else None) :: path must be the name
_monitor() :: simulate: monitor failed with KeyError: 'on rank 1'
box((0, 0, 0), (1, 1, 1 + RANK), (1, 1, 2)) :: box: upper[2] is not
box((0, 0, 0), (1, 1, 1), [1, 1, 2 + RANK]) :: box: cells[2] is
_run(dt=StepControl(0.05 * (1 + RANK), largest=0.1)) :: simulate: dt
_run(dt=StepControl(0.05, largest=0.1) if RANK else 0.1) :: simulate: dt
_run(_contact(stiffness=1.0 + RANK)) :: Scene: effects
_run(_contact(against=Plane((0, 0, -1 - RANK), (0, 0, 1)))) :: Scene: effects
_run(*[_contact()][:RANK]) :: Scene: effects
_run(PrescribedRotation("x0", axis=(1, RANK, 0), angle=np.sin)) :: Scene: effects
_run(element=("standard", "enhanced")[RANK]) :: Scene: element
_run(rigidify=StrainRate(Relative(0.1 + 0.1 * RANK), 0.1)) :: simulate: rigidify
from_arrays(CUBE, [range(8)]) :: from_arrays: ranks 0 and 1 give the same cells
_record(integration_points=bool(RANK)) :: Recorder: integration_points
_run(probes={"tip": (RANK, 1, 1)}) :: probes is not the same
""")


def _action(expression):
    return lambda: eval(expression, vars(rf) | globals())


@pytest.mark.parallel
def test_what_differs_between_ranks_is_named():
    refusals.check_on_two_ranks(__file__, REFUSED)


@pytest.mark.parallel
def test_what_one_rank_decides_is_the_same_on_all():
    """A load that changes at a rank's own time; materials in another order; one rank's monitor."""
    ranks = parallel.run(__file__, 2, 300, "accepted")
    (first, accepted), second = ranks
    assert second == [first, accepted]
    assert any("release" in kinds for _, _, kinds in first)
    assert accepted == [[2.0, 1.0], 2]


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


def _accepted():
    decided = _run(rf.Traction("x1", _of_rank))
    _record()
    heard = set()
    listen = (lambda k, norm: heard.add(k)) if RANK == 0 else None
    _run(rf.Traction("x1", (1, 0, 0)), t_end=0.1, monitor=listen)
    return [decided, [_materials(), COMM.bcast(min(len(heard), 2))]]


if __name__ == "__main__":
    if sys.argv[1:] == ["accepted"]:
        parallel.report(COMM.gather(_accepted()))
    else:
        refusals.on_each_rank({case: _action(case) for case in REFUSED})
