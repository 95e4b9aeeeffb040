"""Bad calls of what runs, records, reads and draws: each is refused by an error that names it.

The table is like that of `test_refused`.
"""

import json
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.plot import Curve, Shapes, curves, histories, pictures, web  # noqa: F401

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


def _spoiled(spoil):
    """Read a file that a function has changed."""
    content = json.loads(json.dumps(_bodies()))
    spoil(content)
    return rf.read_bodies(_file("damaged.json", json.dumps(content)), _domain())


def _read_on(upper, cells):
    """Read the bodies on another mesh."""
    path = _file("good.json", json.dumps(_bodies()))
    return rf.read_bodies(path, rf.box((0, 0, 0), upper, cells))


OCC = 'SetFactory("OpenCASCADE");\n'
LOOSE = """Box(1) = {0, 0, 0, 2, 1, 1}; Rectangle(50) = {0, 3, 0, 1, 1};
Physical Volume("v") = {1}; Physical Surface("helper") = {50};
"""
TWICE = """Box(1) = {0, 0, 0, 1, 1, 1}; Physical Volume("v") = {1};
Physical Surface("s") = {1}; Physical Surface("s") = {2};
"""
OPEN = """Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {0, 1, 0}; Point(4) = {0, 0, 1};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1}; Line(4) = {1, 4}; Line(5) = {2, 4};
Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1};
Curve Loop(2) = {1, 5, -4}; Plane Surface(2) = {2};
Surface Loop(1) = {1, 2}; Volume(1) = {1}; Physical Volume("v") = {1};
"""


def _geo(text):
    """Read a script of gmsh, one after the other in one process."""
    return rf.read_geo(_file("bad.geo", text))


def _no_part(read, name):
    return read(_file(name, "This is no part.\n"))


def _fields(name, content=b""):
    return rf.read_fields(_file(name, content))


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


CASES = refusals.table(r"""
  # Runs
_run(scene=7) :: scene must be a Scene, got int
_run(dt=[0.1, 0.2]) :: dt must be a finite number
_run(dt={0: 0.1, "a": 1}) :: a time of dt must be
_run(dt={0: 0.1, 0.1: 0.1, "0.1": 0.2}) :: a time of dt
_run(dt={-1: 0.1, 0: 0.1}) :: begins with the
_run(dt=1.0, t_end=1e-11) :: would have no step: times
_run(dt=0.1, t_end=1e-300) :: would have no step: times
_run(dt=1e-16, t_end=1.0) :: cannot be resolved
_run(dt={0: 100.0, 86400.0: 1e-11}, t_end=86401.0) :: cannot be resolved
_run(rigidify=0.001) :: rigidify must be a StrainRate
_run(progress="yes") :: progress must be True, False or None
_run(monitor="show") :: monitor must be a function
_run(petsc_options=[("ksp_type", "cg")]) :: must be a dict
_run(petsc_options={"-ksp_type": "cg"}) :: '-ksp_type' is no option of the solver
_run(petsc_options={"rigidfx_ksp_type": "cg"}) :: is no option of the solver
_run(petsc_options={"kps_type": "cg"}) :: is no option of the solver
_run(petsc_options={5: "cg"}) :: 5 is no option of the solver
_run(petsc_options={"ksp_type\0": "cg"}) :: is no option of the solver
_run(petsc_options={"ksp_type": ["cg"]}) :: ksp_type must be a text or a number
_run(petsc_options={"ksp_type": "cg\0"}) :: ksp_type must be a text or a number
_run(petsc_options={"ksp_max_it": 10**5000}) :: ksp_max_it must be a text or a number
_run(petsc_options={"pc_type": "gamg"}) :: with the options -rigidfx_pc_type gamg:
_run(petsc_options={"snes_rtol": "a"}) :: with the options -rigidfx_snes_rtol a:
  # Criteria
_rate(-1.0, 1.0) :: tol must be ≥ 0
_rate(0.1, 0.0) :: window must be
_rate(0.1, "long") :: window must be a time in s or 'auto'
_rate(measure="max") :: measure must be
_rate(tolerances=[0.1]) :: tolerances must be a dict
_rate(tolerances={"left": -1}) :: tolerance of 'left' must
_run(rigidify=_rate(tolerances={"right": 0.1})) :: StrainRate (tolerances): there are no cells named
_rate(never=5) :: never must be names
_rate(min_cells=0) :: min_cells must be a whole number
_rate(release="at once") :: release must be Release records
_rate(load_change=0.0) :: load_change must be
_rate(patience=0.5) :: patience must be ≥ 1
Release(when=lambda r: True, repeat="yes") :: must be True or False
Release() :: a time (at) or a condition (when)
Release(at=-1.0) :: later than the start
Release(at=1.0, where=5) :: where must be the name
_run(rigidify=_rate(release=Release(at=0.1, where="right"))) :: Release: there are no cells named 'r
_asked(lambda r: 1) :: must give True, False or
_asked(lambda r: r.tip) :: its condition failed with Attr
_asked(lambda r: ["part 9"]) :: names the body 'part 9'; there are none
  # Recorders
Recorder(None, _folder()) :: scene must be a Scene, got NoneType
Recorder(_scene(), None) :: folder must be the name
Recorder(_scene(), "") :: folder must be the name
Recorder(_scene(), "a\x00b") :: folder must be the name
Recorder(_scene(), "x" * 300) :: cannot write to
Recorder(_scene(), _file("in the way", "kept")) :: Name a folder
_write(_file("in the way", "kept") / "bodies.json") :: cannot be written
_record(None, every="10") :: every must be a whole number
_record(None, interval=-1.0) :: interval must be
_record(None, stress="no") :: stress must be True or False
_record(_first(_other())) :: is of another scene
_record(_run()[1]) :: the run has gone on
_record(None, format="xdmf") :: format must be one of 'pvd', 'vtkhdf', 'both', got 'xdmf'
_record(None, peaks="fillet") :: named 'fillet'
_record(None, peaks=3) :: peaks must be names of sets of the mesh, got 3
_record(None, peaks="x0", stress=False) :: peaks are of stresses, which stress=False leaves out
_twice() :: step 0 comes after step 0
_after_close() :: is closed
_two_recorders() :: another recorder writes to the folder
  # Files
read_history("\ud800.csv") :: cannot be read
Recorder(_scene(), _folder() / "\ud800") :: no folder can be called
_write("\ud800.json") :: can be the name of no file
list_cad(None) :: list_cad: path must be the name of a file
read_cad(None) :: read_cad: path must be the name
read_history(None) :: path must be the name
read_history(_folder() / "none.csv") :: there is no file
_history("") :: no whole line
_history("t,u\n0,1\nhello,2\n") :: row 2
_history(b"\x89PNG\r\n\x1a\n\xff\xfe") :: history.csv
_history("t,t\n0,1\n") :: column 't' twice
write_bodies("b.json", None, _first()) :: scene must be a
write_bodies("b.json", _scene(), _first(_other())) :: is of another scene
write_bodies("b.json", _scene(), _run()[0]) :: the run has gone on
read_bodies("b.json", None) :: domain must be a Domain
read_bodies(_folder() / "none.json", _domain()) :: cannot be read
read_bodies(_file("list.json", "[1, 2]"), _domain()) :: is no file of write_bodies
_damaged(format="rigidfx bodies 1") :: is no file of
_damaged(cells=99) :: damaged.json
_damaged(mass=-1.0) :: mass of body 'left'
_damaged(orientation=[[2, 0, 0], [0, 1, 0], [0, 0, 1]]) :: orientation of body 'left'
_damaged(inertia=[1, 2, 3]) :: inertia of body 'left'
_damaged(place=[9.0, 9.0, 9.0]) :: another mesh
_damaged(place=[1.0]) :: place of body 'left'
_damaged(cells=None) :: damaged
_damaged(name=None) :: damaged
_damaged(name=3) :: name 3
_damaged(name="") :: name ''
_damaged(given=2) :: given of body
_damaged(box=[[np.nan] * 3] * 2) :: a mesh in
_spoiled(lambda c: c["bodies"][0]["cells"].append(999)) :: cells that the mesh has not
_spoiled(lambda c: c["bodies"][0].update(cells=[])) :: no cells
_spoiled(lambda c: c["bodies"].append(c["bodies"][0])) :: that of two
_spoiled(lambda c: c["bodies"].append({**c["bodies"][0], "name": "b"})) :: in two bodies
_read_on((4, 1, 1), (4, 1, 1)) :: 16 cells, this has 4
_read_on((4, 2, 1), (4, 2, 2)) :: a mesh in
_read_on((4, 1, 1), (2, 2, 4)) :: another mesh: the cells of 'left'
_geo("Point(1) = {0, 0, 0\nfoo\n") :: syntax error
_geo("Point(1) = {0, 0, x};\n") :: Unknown variable 'x'
_geo(OCC + 'Rectangle(1) = {0, 0, 0, 1, 1}; Physical Surface("s") = {1};\n') :: 's' (facets)
_geo(OCC + "Disk(1) = {0, 0, 0, 1};\n") :: there: none
_geo(OCC + LOOSE) :: bound no volume cell
_geo(OCC + TWICE) :: already exists
_geo(OPEN) :: olume
_no_part(list_cad, "bad.step") :: bad.step
_no_part(read_cad, "bad.step") :: bad.step
_no_part(list_cad, "bad.brep") :: bad.brep
_no_part(read_cad, "bad.xyz") :: bad.xyz
read_fields(_folder()) :: there is no file
_fields("bad.vtkhdf", b"no file of HDF5") :: cannot be read: no file of a Recorder, or a damaged one
_fields("bad.pvd", b"<VTKFile/>") :: has no time yet
_fields("bad.txt") :: neither a folder nor a .vtkhdf or .pvd
read_fields(None) :: path must be the name
  # Pictures
pictures(None) :: folder must be the name
pictures("out", shapes=0) :: shapes must be
pictures("out", frames=0.5) :: frames must be
pictures("out", view=(0, 0, 0)) :: view must be
pictures("out", view=(0, 0, 2), up=(0, 0, -1)) :: parallel
pictures("out", free_since="now") :: free_since must be
web("out", frames=0) :: frames must be a whole number ≥ 1, got 0
web(_folder()) :: could not be drawn: read_fields: there is no file
_histories({}) :: no column 't'
_histories(GOOD, path="a.docx") :: a.docx
_histories(GOOD, free_since=9.0) :: after the last
_curves({}) :: at least one panel
_curves({"a": [1.0]}) :: panel 'a' must hold Curve records
_curves({"a": [LINE]}, ylabel=["y", "z"]) :: ylabel must be one text, or one for each of the 1 panel
Curve("a", [0, 1], [0, 1, 2]) :: of the same length
Shapes(None, [0.0]) :: scene must be a Scene
_shapes(colour="red") :: colour must be one of
_shapes().add(_first(_other())) :: is of another scene
_stale_shape() :: the run has gone on
_drawn(add=False) :: no shape has been added
""")


def _action(expression):
    return lambda: eval(expression, vars(rf) | globals())


@pytest.mark.parametrize("case", CASES)
def test_is_refused(case):
    refusals.check(_action(case), CASES[case], rf.RigidfxError)


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    refusals.check_on_two_ranks(__file__, CASES)


if __name__ == "__main__":
    refusals.on_each_rank({case: _action(case) for case in CASES})
