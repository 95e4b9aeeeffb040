"""Bad calls of what runs, records, reads and draws: each is refused by an error that names it.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.plot import Curve, Shapes, curves, histories, pictures

COMM = MPI.COMM_WORLD
STEEL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
SPIN = rf.InitialVelocity(angular=(0.0, 0.0, 0.1))


@cache
def _domain():
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 2, 2))
    return domain.with_cells("left", lambda x: x[0] < 2.0 + 1e-9)


@cache
def _scene():
    return rf.Scene(_domain(), STEEL, [SPIN])


@cache
def _other():
    return rf.Scene(_domain(), STEEL, [SPIN, rf.Rigid("left")])


@cache
def _folder():
    return Path(COMM.bcast(mkdtemp(prefix="bad_calls_") if COMM.rank == 0 else None))


def _file(name, content):
    """A file of some content; its path."""
    path = _folder() / name
    if COMM.rank == 0:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    COMM.barrier()
    return path


def _run(dt=0.1, t_end=0.2, scene=None, **options):
    return list(rf.simulate(scene or _scene(), dt, t_end, **{"progress": False} | options))


def _first(scene=None):
    return next(rf.simulate(scene or _scene(), 0.1, 0.2, progress=False))


def _record(report, scene=None, **options):
    with rf.Recorder(scene or _scene(), _folder() / "run", **options) as recorder:
        recorder.write(report)


def _twice():
    report = _first()
    with rf.Recorder(_scene(), _folder() / "run") as recorder:
        recorder.write(report)
        recorder.write(report)


def _after_close():
    recorder = rf.Recorder(_scene(), _folder() / "run")
    recorder.close()
    recorder.write(_first())


def _two_recorders():
    with rf.Recorder(_scene(), _folder() / "run"):
        rf.Recorder(_scene(), _folder() / "run")


@cache
def _bodies():
    """What `write_bodies` leaves, as data."""
    path = _folder() / "good.json"
    rf.write_bodies(path, _other(), _first(_other()))
    return COMM.bcast(json.loads(path.read_text()) if COMM.rank == 0 else None)


def _damaged(**changes):
    """Read a file whose content or body is changed; None takes an entry out."""
    content = json.loads(json.dumps(_bodies()))
    for key, value in changes.items():
        place = content if key in content else content["bodies"][0]
        if value is None:
            del place[key]
        else:
            place[key] = value
    return rf.read_bodies(_file("damaged.json", json.dumps(content)), _domain())


def _history(content):
    return rf.read_history(_file("history.csv", content))


def _write(path):
    refusals.write_bodies_of(_scene(), path)


def _rate(*arguments, **options):
    return rf.StrainRate(*(arguments or (0.1, 1.0)), **options)


def _asked(condition):
    """A run with a release on a condition."""
    return _run(rigidify=_rate(release=rf.Release(when=condition)))


def _shapes(**options):
    return Shapes(_scene(), **{"times": [0.0]} | options)


def _drawn(add=True, **options):
    shapes = _shapes()
    if add:
        shapes.add(_first())
    shapes.draw(**{"path": _folder() / "shapes.png"} | options)


def _stale_shape():
    shapes = _shapes()
    shapes.add(_run()[0])


LINE = Curve("a line", [0.0, 1.0], [0.0, 1.0])
LABELS = {"xlabel": "x", "ylabel": "y"}


def _curves(panels, path="curves.png", **options):
    curves(panels, _folder() / path if isinstance(path, str) else path, **LABELS | options)


def _histories(history, path="histories.png", **options):
    histories(history, _folder() / path if isinstance(path, str) else path, **options)


COLUMNS = ["t", "energy", "kinetic", "strain", "stored", "momentum_scale"]
COLUMNS += [f"{vector}_{axis}" for vector in "LJ" for axis in "xyz"]
GOOD = {name: np.linspace(1.0, 2.0, 5) for name in COLUMNS}


SIMULATE = {
    "no scene": (lambda: _run(scene=7), "scene must be a Scene, got int"),
    "a list of steps": (lambda: _run(dt=[0.1, 0.2]), "dt must be a finite number"),
    "true for a step": (lambda: _run(dt=True), "dt must be a finite number"),
    "an infinite step": (lambda: _run(dt=np.inf), "dt must be a finite number"),
    "text for a time of a step": (lambda: _run(dt={0: 0.1, "a": 1}), "a time of dt must be"),
    "a time of a step twice": (lambda: _run(dt={0: 0.1, 0.1: 0.1, "0.1": 0.2}), "a time of dt"),
    "a time of a step before the start": (lambda: _run(dt={-1: 0.1, 0: 0.1}), "begins with the"),
    "an end before the start": (lambda: _run(t_end=-0.1), "t_end must be a finite number > 0"),
    "a step that time cannot resolve": (lambda: _run(dt=1e-16, t_end=1.0), "cannot be resolved"),
    "a late step that time cannot resolve": (
        lambda: _run(dt={0: 100.0, 86400.0: 1e-11}, t_end=86401.0),
        "cannot be resolved",
    ),
    "a number for a criterion": (lambda: _run(rigidify=1e-3), "rigidify must be a StrainRate"),
    "text for progress": (lambda: _run(progress="yes"), "progress must be True, False or None"),
}

CRITERIA = {
    "a negative tolerance": (lambda: _rate(-1.0, 1.0), "tol must be ≥ 0"),
    "a window of no length": (lambda: _rate(0.1, 0.0), "window must be"),
    "an unknown window": (lambda: _rate(0.1, "long"), "window must be a time in s or 'auto'"),
    "an unknown measure": (lambda: _rate(measure="max"), "measure must be"),
    "a list of tolerances": (lambda: _rate(tolerances=[0.1]), "tolerances must be a dict"),
    "a tolerance below zero": (lambda: _rate(tolerances={"left": -1}), "tolerance of 'left' must"),
    "a tolerance of an unknown set": (
        lambda: _run(rigidify=_rate(tolerances={"right": 0.1})),
        "StrainRate (tolerances): there are no cells named 'right'",
    ),
    "a number that is never rigid": (lambda: _rate(never=5), "never must be names"),
    "bodies of no cells": (lambda: _rate(min_cells=0), "min_cells must be a whole number"),
    "text for a release": (lambda: _rate(release="at once"), "release must be Release records"),
    "no change of load": (lambda: _rate(load_change=0.0), "load_change must be"),
    "impatience": (lambda: _rate(patience=0.5), "patience must be ≥ 1"),
    "a release that repeats oddly": (
        lambda: rf.Release(when=lambda r: True, repeat="yes"),
        "must be True or False",
    ),
    "a release of nothing": (lambda: rf.Release(), "a time (at) or a condition (when)"),
    "a release before the start": (lambda: rf.Release(at=-1.0), "later than the start"),
    "a release of numbers": (lambda: rf.Release(at=1.0, where=5), "where must be the name"),
    "a release of an unknown set": (
        lambda: _run(rigidify=_rate(release=rf.Release(at=0.1, where="right"))),
        "Release: there are no cells named 'right'",
    ),
    "a condition that says a number": (lambda: _asked(lambda r: 1), "must give True, False or"),
    "a condition that fails": (lambda: _asked(lambda r: r.tip), "its condition failed with Attr"),
    "a condition that names no body": (
        lambda: _asked(lambda r: ["part 9"]),
        "names the body 'part 9'; there are none",
    ),
}

RECORDER = {
    "no scene to record": (
        lambda: rf.Recorder(None, _folder()),
        "scene must be a Scene, got NoneType",
    ),
    "no folder": (lambda: rf.Recorder(_scene(), None), "folder must be the name"),
    "a folder without a name": (lambda: rf.Recorder(_scene(), ""), "folder must be the name"),
    "a folder with a NUL": (lambda: rf.Recorder(_scene(), "a\0b"), "folder must be the name"),
    "a name that is too long": (lambda: rf.Recorder(_scene(), "x" * 300), "cannot write to"),
    "text for every": (lambda: _record(None, every="10"), "every must be a whole number"),
    "a negative interval": (lambda: _record(None, interval=-1.0), "interval must be"),
    "text for stress": (lambda: _record(None, stress="no"), "stress must be True or False"),
    "a report of another scene": (lambda: _record(_first(_other())), "is of another scene"),
    "an old report": (lambda: _record(_run()[1]), "the run has gone on"),
    "a report twice": (_twice, "step 0 comes after step 0"),
    "a report after the end": (_after_close, "is closed"),
    "two recorders": (_two_recorders, "another recorder writes to the folder"),
}

FILES = {
    "a history without a possible name": (
        lambda: rf.read_history("\ud800.csv"),
        "cannot be read",
    ),
    "a recorder without a possible name": (
        lambda: rf.Recorder(_scene(), _folder() / "\ud800"),
        "no folder can be called",
    ),
    "bodies without a possible name": (
        lambda: _write("\ud800.json"),
        "can be the name of no file",
    ),
    "geometry of no file": (lambda: rf.list_cad(None), "list_cad: path must be the name of a file"),
    "geometry to mesh of no file": (lambda: rf.read_cad(None), "read_cad: path must be the name"),
    "no history": (lambda: rf.read_history(None), "path must be the name"),
    "a missing history": (lambda: rf.read_history(_folder() / "none.csv"), "there is no file"),
    "an empty history": (lambda: _history(""), "no whole line"),
    "a history of text": (lambda: _history("t,u\n0,1\nhello,2\n"), "row 2"),
    "a history that is a picture": (lambda: _history(b"\x89PNG\r\n\x1a\n\xff\xfe"), "history.csv"),
    "a history with a column twice": (lambda: _history("t,t\n0,1\n"), "column 't' twice"),
    "bodies of no scene": (lambda: rf.write_bodies("b.json", None, _first()), "scene must be a"),
    "bodies of another scene": (
        lambda: rf.write_bodies("b.json", _scene(), _first(_other())),
        "is of another scene",
    ),
    "bodies of an old report": (
        lambda: rf.write_bodies("b.json", _scene(), _run()[0]),
        "the run has gone on",
    ),
    "bodies on no domain": (lambda: rf.read_bodies("b.json", None), "domain must be a Domain"),
    "a missing file of bodies": (
        lambda: rf.read_bodies(_folder() / "none.json", _domain()),
        "cannot be read",
    ),
    "a list for bodies": (
        lambda: rf.read_bodies(_file("list.json", "[1, 2]"), _domain()),
        "is no file of write_bodies",
    ),
    "bodies of an older format": (lambda: _damaged(format="rigidfx bodies 1"), "is no file of"),
    "bodies of more cells": (lambda: _damaged(cells=99), "damaged.json"),
    "a body of negative mass": (lambda: _damaged(mass=-1.0), "mass of body 'left'"),
    "a body that is not rotated but stretched": (
        lambda: _damaged(orientation=[[2, 0, 0], [0, 1, 0], [0, 0, 1]]),
        "orientation of body 'left'",
    ),
    "a body with half an inertia": (lambda: _damaged(inertia=[1, 2, 3]), "inertia of body 'left'"),
    "a body somewhere else": (lambda: _damaged(place=[9.0, 9.0, 9.0]), "another mesh"),
}

PLOTS = {
    "pictures of nothing": (lambda: pictures(None), "folder must be the name"),
    "pictures of no shapes": (lambda: pictures("out", shapes=0), "shapes must be"),
    "a film of half a picture": (lambda: pictures("out", frames=0.5), "frames must be"),
    "a view from nowhere": (lambda: pictures("out", view=(0, 0, 0)), "view must be"),
    "up along the view": (lambda: pictures("out", view=(0, 0, 2), up=(0, 0, -1)), "parallel"),
    "pictures free since text": (lambda: pictures("out", free_since="now"), "free_since must be"),
    "histories without columns": (lambda: _histories({}), "no column 't'"),
    "histories of an unknown kind": (lambda: _histories(GOOD, path="a.docx"), "a.docx"),
    "histories free after the end": (lambda: _histories(GOOD, free_since=9.0), "after the last"),
    "curves in no panel": (lambda: _curves({}), "at least one panel"),
    "a panel of numbers": (lambda: _curves({"a": [1.0]}), "panel 'a' must hold Curve records"),
    "two labels for one panel": (
        lambda: _curves({"a": [LINE]}, ylabel=["y", "z"]),
        "ylabel must be one text, or one for each of the 1 panels",
    ),
    "a curve of two lengths": (lambda: Curve("a", [0, 1], [0, 1, 2]), "of the same length"),
    "shapes of no scene": (lambda: Shapes(None, [0.0]), "scene must be a Scene"),
    "shapes in red": (lambda: _shapes(colour="red"), "colour must be one of"),
    "shapes of another scene": (lambda: _shapes().add(_first(_other())), "is of another scene"),
    "shapes of an old report": (_stale_shape, "the run has gone on"),
    "a sheet of no shapes": (lambda: _drawn(add=False), "no shape has been added"),
}

CASES = SIMULATE | CRITERIA | RECORDER | FILES | PLOTS


def test_cases_are_many():
    """No two of them have one name."""
    assert len(CASES) == sum(map(len, (SIMULATE, CRITERIA, RECORDER, FILES, PLOTS))) >= 60


@pytest.mark.parametrize("name", CASES)
def test_is_refused(name):
    """By an error of this package, whose message names what is wrong."""
    refusals.check(*CASES[name], rf.RigidfxError)


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    """The same cases on two ranks: the same message on both, and no rank waits for the other."""
    found = dict(refusals.found_on_two_ranks(__file__))
    assert found.keys() == CASES.keys()
    for name, (_, message) in CASES.items():
        assert message in found[name][1], (name, found[name])


if __name__ == "__main__":
    refusals.on_each_rank({name: action for name, (action, _) in CASES.items()})
