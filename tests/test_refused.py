"""Bad input is refused with the same error on every rank, and no rank is left waiting.

A line of the table holds an expression, in which the names of rigidfx need no prefix, and words of
the message. Run as a script under mpirun, this file goes through all lines on each rank.
"""

import gc
import subprocess
import sys
import types
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import nan  # noqa: F401
from pathlib import Path

import numpy as np
import pytest
import refusals
import ufl
from mpi4py import MPI

import rigidfx as rf
from rigidfx.domain.domain import Domain, EntitySet, kept  # noqa: F401
from rigidfx.effects.contacts.obstacles import Approach, Obstacle
from rigidfx.flexible.stress import CauchyStress

COMM = MPI.COMM_WORLD
SOFT = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
STIFF = rf.StVenantKirchhoff(rho=1.0, E=1e308, nu=0.49)
SPARSE = rf.NeoHooke(rho=5e-324, E=1.0, nu=0.3)
UNIT = (0, 0, 0), (1, 1, 1)
NO_STIFFNESS = rf.Hyperelastic(rho=1.0, W=lambda C: (C[0, 0] - 1) ** 4)  # at rest
BELOW = rf.Plane((0, 0, -1), (0, 0, 1))
CUBE = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
ONE = np.arange(8)[None]
TETS = np.array([[0, 1, 3, 7], [0, 1, 5, 7]])
FAR = np.array([3.0, 0.0, 0.0])
L_POINTS = np.array([[i, j, k] for k in (0, 1) for j in (0, 1, 2) for i in (0, 1, 2)], dtype=float)
HINGED = np.array([[0, 1, 3, 4, 9, 10, 12, 13], [4, 5, 7, 8, 13, 14, 16, 17]])
HERE = Path(__file__).resolve().parent
BRACKET = HERE.parent / "meshes" / "bracket.geo"
HINGE = rf.Revolute("ground", "a", (0, 0.5, 0.5), (0, 0, 1), name="joint")
SQUASH = rf.Traction("x1", (-4e5, 0, 0))  # twice Euler's load of the beam
NAMESPACE = types.SimpleNamespace(virtual_work=1)


@cache
def _box():
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)).with_cells("all", lambda x: x[0] < 9)
    domain = domain.with_cells("a", lambda x: x[0] < 1.1).with_cells("b", lambda x: x[0] > 0.9)
    domain = domain.with_facets("skin", lambda x: x[0] > -1)
    domain = domain.with_vertices("edge", lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0))
    domain = domain.with_vertices("far edge", lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 1))
    return domain.with_vertices("line", lambda x: np.isclose(x[1], 0) & np.isclose(x[2], 0))


def _cells(where, name="c"):
    return _box().with_cells(name, where)


def _numbered(cells):
    return _box().with_cell_set("a", cells)


def _named(cells):
    return rf.Scene(Domain(_box().mesh, [cells]), {cells.name: SOFT})


def _faces(where, name="c"):
    return _box().with_facets(name, where)


def _scene(*effects, material=SOFT, domain=None, **options):
    return rf.Scene(domain or _box(), material, effects, **options)


def _run(*effects, rigidify=None, dt=0.1, t_end=0.3, petsc_options=None, **options):
    how = {"rigidify": rigidify, "petsc_options": petsc_options}
    for _ in rf.simulate(_scene(*effects, **options), dt, t_end, **how):
        pass


def _hinged(*effects):
    return _scene(rf.Rigid("a"), HINGE, *effects)


def _pinned(a, b, at=(2.0, 0.5, 0.5)):
    """A joint of two sides of the box, which is held."""
    return _scene(rf.Revolute(a, b, at, (0, 0, 1), name="pin"), rf.Fixed("x0"))


def _spring(*ends, **places):
    return _scene(rf.Rigid("b"), rf.SpringDamper(*ends, 1.0, **places))


def _beam(*effects):
    """Run a slender bar with parts to reduce."""
    bar = rf.box((0, 0, 0), (1, 0.1, 0.1), (12, 1, 1))
    bar = bar.with_cells("half", lambda x: x[0] < 0.51).with_cells("low", lambda x: x[0] < 0.26)
    bar = bar.with_cells("next", lambda x: (x[0] > 0.49) & (x[0] < 0.76))
    metal = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
    _run(*effects, domain=bar, material=metal, dt=2e-3, t_end=2e-3)


def _static(steps, **options):
    rf.static(_scene(rf.Fixed("x0"), rf.Gravity()), steps, **options)


def _preloaded(domain, *loads):
    """Statics of a mesh that is held where x = 0."""
    domain = domain.with_facets("end", lambda x: np.abs(x[0]) < 1e-9)
    _run(rf.Fixed("end"), rf.Preload(loads or [rf.Gravity()]), domain=domain, t_end=0.1)


def _material(W, **values):
    return _scene(material=rf.Hyperelastic(rho=1.0, W=W, values=values))


def _cube(lower, upper, cells=(1, 1, 1), *more, **options):
    return rf.box(lower, upper, cells, *more, **options)


def _arrays(points, cells, *more):
    """`from_arrays` with everything on rank 0."""
    mine = slice(None) if COMM.rank == 0 else slice(0)
    return rf.from_arrays(np.asarray(points)[mine], np.asarray(cells)[mine], *more)


def _tet(points, cells):
    return _arrays(points, cells, "tetrahedron")


def _overlapping():
    """Two cells, of which one, with all of the skin, is in the other."""
    domain = _arrays(np.vstack([CUBE, CUBE + 0.2]), np.arange(16).reshape(2, 8))
    return domain.with_facets("skin", lambda x: (x < 1 + 1e-9).all(axis=0))


def _moved_nodes(where, by):
    """A mesh with some nodes moved, so that cells are inverted or flat."""
    mesh = rf.box((0, 0, 0), (4, 1, 1), (4, 2, 2)).mesh
    x = mesh.geometry.x
    x[where(x)] += by(x[where(x)])
    return Domain(mesh)


def _dragged():
    return _moved_nodes(
        lambda x: np.linalg.norm(x - [1, 0.5, 0.5], axis=1) < 1e-9, lambda x: [1.7, 0.1, 0.0]
    )


def _squashed():
    return _moved_nodes(lambda x: x[:, 0] > -1, lambda x: -x * [0, 1, 0])


def _surface(gmsh):
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(2)


def _moved(displacement, velocity=None, where="x0"):
    return rf.PrescribedMotion(where, displacement=displacement, velocity=velocity)


def _turned(**options):
    return rf.PrescribedRotation("x0", **{"axis": (1, 0, 0), "angle": lambda t: t} | options)


def _contact(where="z0", **options):
    return rf.Contact(where, **{"against": BELOW} | options)


def _moving(path):
    return _contact(against=rf.Plane((0, 0, -1), (0, 0, 1), path=path))


def _control(tol=0.05, **options):
    return rf.StepControl(tol, **{"largest": 0.1} | options)


def _rate(**options):
    return rf.StrainRate(1.0, 1.0, **options)


def _watched(condition):
    return _rate(release=rf.Release(when=lambda report: condition(report.t)))


def _budgeted(accuracy, **more):
    scene = _scene(probes={"tip": (2, 1, 1)})
    rf.simulate(scene, **{"dt": 0.1, "t_end": 1.0, "accuracy": accuracy} | more)


@dataclass(frozen=True)
class Told(Obstacle):
    """An obstacle of a user's own, whose gap is what a function tells."""

    told: Callable = None

    def gap(self, y):
        return self.told(y)

    def approach(self, y0, y1):
        return Approach(y0 * np.nan, None, y1)


def _told(function):
    return _scene(_contact(against=Told(function)))


@cache
def _stress():
    return CauchyStress(_scene())


def _recovered_elsewhere():
    report = list(rf.simulate(_scene(), 0.1, 0.1))[-1]
    rf.recovered_stress(report, CauchyStress(rf.Scene(_cube((0, 0, 0), (1, 1, 1)), SOFT)))


# Functions of users.


def _path(t):
    return (0.1 * t, 0.0, 0.0)


def _speed(t):
    return (0.1, 0.0, 0.0)


def _kinked(t):
    return (max(t - 0.2, 0.0), 0.0, 0.0)


_kinked.breakpoints = (0.2,)


def _with(breakpoints):
    """A path at rest with breakpoints of any kind."""

    def path(t):
        return (0.0, 0.0, 0.0)

    path.breakpoints = breakpoints
    return path


def _stops(t):
    raise StopIteration


def _then(first, later, since=0.2):
    """A function of time that changes."""
    return lambda t: first if t < since else later


def _fails(value, since=0.2):
    """A function of time (or place) that raises on the last rank only, after a while."""

    def function(t):
        if COMM.rank == COMM.size - 1 and np.max(t) > since:
            raise KeyError("lost")
        return value

    return function


def _nan_on_one_rank(t):
    return (np.nan if COMM.rank == COMM.size - 1 and t > 0.2 else 1.0, 0.0, 0.0)


def _infinite_on_one_rank(X):
    return np.full_like(X, np.inf if COMM.rank == 0 else 0.0)


CASES = refusals.table(r"""
  # Meshes and sets
Domain(None) :: Domain: mesh must be a mesh of DOLFINx, got None. Files are
Domain(_box().mesh, [("x0", 2, [0])]) :: Domain: sets must be a list of EntitySet, got [('x0', 2
_named(EntitySet("core", 3, np.empty(0, np.int32))) :: stands for no cells
_dragged() :: inverted
_squashed() :: inverted or flat
_numbered(np.array([True, False])) :: whole numbers, got bool of shape (2,). Of a mask, take np.flat
_numbered([2**32]) :: no cell 4294967296
_numbered(np.ma.array([0, 1], mask=[0, 1])) :: Some are masked; take compressed()
_faces(lambda x: x[0] > 9, "far") :: true for no facets
_faces(lambda x: x[0] < 1e-9, "\ud800") :: The name of a set must be a text that is not empty
_faces(_stops) :: The marker of 'c' failed with StopIteration:
_cells(lambda x: (x[0] < 2).astype(int)) :: The marker of 'c' must give a boolean for each point
_cells(lambda x: _fails(x[0] < 2, -1.0)(x), "some") :: The marker of 'some' failed
_arrays(CUBE[:, :2], ONE) :: points must be real numbers of shape
_arrays(CUBE + np.inf, ONE) :: points must be finite
_arrays(CUBE, ONE[:0]) :: there are no cells
_arrays(CUBE, ONE, ["hexahedron"]) :: cell must be
_arrays(CUBE, np.repeat(ONE, 2, axis=0)) :: cell 0 is there 2 times
from_arrays(np.ma.masked_equal(CUBE, 1.0), ONE) :: from_arrays: some of the points are masked
_tet(CUBE, ONE) :: (n, 4)
_tet(CUBE, np.vstack([TETS, TETS[:1, [1, 3, 0, 2]]])) :: cell 0 is there 2 times
_tet(np.eye(4, 3), [[0, 1, 2, 9]]) :: from_arrays: cells name points outside 0 … 3.
_tet(np.eye(4, 3), [[0, 1, 2, 2]]) :: from_arrays: cell 0 names node 2 2 times: it is flat.
_tet(np.zeros((4, 3)), [[0, 1, 2, 3]]) :: The mesh has inverted or flat cells, the first around (0,
_cube((0, 0, 0), (1, 1, 1), (True,) * 3) :: box: cells must be three whole numbers ≥ 1, got (True,
_cube((0, 0, 0), (1, 1, 1), (1.0,) * 3) :: box: lower and upper must be three numbers each and cells
_cube((0, 0, 0), (1, 1, 1), (10**6,) * 3) :: cells are more than the 2147483647 that are counted
_cube((0, 0, 0), (1, 0, 1)) :: box: lower and upper must be three finite numbers each, and
_cube((1e16, 0, 0), (1e16 + 2, 1, 1), (4, 1, 1)) :: inverted or flat cells, the first around (1e+16,
_cube((-1.7e308, 0, 0), (1.7e308, 1, 1), (2, 1, 1)) :: has nodes whose coordinates are not finite
_scene(domain=_cube((0, 0, 0), (1e-320, 1, 1))) :: box: from (0, 0, 0) m to (1e-320, 1, 1) m: Box se
_cube((0, 0, 0), (1, 1, 1), comm=MPI.COMM_NULL) :: box: comm must be a communicator of mpi4py, such
_cube((0, 0, 0), (1, 1, 1), (1, 1, 1), "prism") :: box: cell must be one of ['hexahedron', 'tetrahe
read_msh(HERE / "nothing.msh") :: There is no mesh file
read_msh(HERE / "conftest.py") :: conftest.py
read_msh("tests/none.msh", scale=-1.0) :: read_msh: scale must be a finite number > 0, got -1.0.
read_geo(None) :: gmsh: 'None' failed with TypeError: argument should be a str or
read_geo("x.geo", [1]) :: read_geo: parameters must be a dict of names to numbers or
read_msh(BRACKET) :: Take read_geo
read_msh("part.STEP") :: Take read_cad
read_geo("nothing.geo") :: There is no geometry file 'nothing
read_cad("nothing.step") :: There is no CAD file 'nothing
read_geo(BRACKET, order=3) :: order must be 1 or 2
read_geo(BRACKET, size=0) :: size must be a finite number > 0
read_geo(BRACKET, {"no": 1}) :: no parameter 'no'
read_cad("part.step", volumes={3: [1]}) :: volumes must be a dict of names to numbers
read_cad("part.step", surfaces="end") :: surfaces must be a dict of names to numbers
from_gmsh(lambda g: 1 / 0) :: from_gmsh: the function that builds the model failed with
from_gmsh(_surface) :: The model has no physical group of volume cells (dimension 3)
from_gmsh(lambda g: g.finalize()) :: has ended gmsh (finalize)
read_inp(None) :: path must be the name
read_inp("x.inp", scale=0) :: scale must be
read_inp("x.inp", corners="yes") :: corners must be True or False
redistribute("bar", ["head"]) :: domain must be a Domain
redistribute(_box(), ["hat"]) :: no cells named 'hat'
redistribute(_box(), ["x0"]) :: no cells named 'x0'
redistribute(_box(), [1]) :: must be names of sets of cells
  # Scenes
_scene(Gravity) :: Scene: <class 'rigidfx.effects.loads.dead_load.Gravity'> is not an
_scene(_control()) :: is not an effect
Scene(_box(), SOFT, Gravity()) :: Scene: effects must be a list of effects, got
_scene(material=_scene()) :: Scene: material must be a Material or a dict of cell-set names
_scene(material={"a": {"b": SOFT}}) :: Scene: the material of 'a' must be a Material, got {'b':
_scene(material={1: SOFT}) :: Scene: materials are given by names of cell sets, got {1:
_scene(material={"a": SOFT}) :: cells have none
_scene(material={"a": SOFT, "all": SOFT}) :: every cell needs exactly one material; 0 cells have non
_scene(material={"x0": SOFT}) :: Scene (material): there are no cells named 'x0'. Known names:
_scene(probes={"\ud800": (0, 0, 0)}) :: Scene: the name of a probe must be one that can be printed,
_scene(probes="tip") :: Scene: probes must be a dict of names to three numbers each,
_scene(probes={"p": (9, 9, 9)}) :: lies in no cell
_scene(probes={1: (0, 0, 0), "1": (1, 1, 1)}) :: 1 and '1' would have the same columns 'u_1' in hist
_scene(order=3) :: Scene: order must be 1 or 2, got 3.
_scene(order=10**5000) :: Scene: order must be 1 or 2, got something of type int
_scene(mass=["lumped"]) :: Scene: mass must be 'lumped' or 'consistent', got ['lumped'].
_scene(scheme=NAMESPACE) :: Scene: scheme must be EnergyMomentum(), Midpoint() or
_scene(element="Enhanced") :: element must be 'standard', 'enhanced' or AssumedStrains
_scene(element=None) :: element must be 'standard', 'enhanced' or AssumedStrains
_scene(element="enhanced", order=2) :: is for order 1, got order 2
_scene(element=AssumedStrains("z0"), order=2) :: is for order 1, got order 2
_scene(element="enhanced", scheme=Midpoint()) :: goes with EnergyMomentum, not with Midpoint
_scene(element=AssumedStrains("z0"), scheme=Midpoint()) :: goes with EnergyMomentum, not with Mid
_scene(element="enhanced", material=NO_STIFFNESS) :: of Hyperelastic cannot be told
_scene(element=AssumedStrains("z0"), material=NO_STIFFNESS) :: of Hyperelastic cannot be told
_scene(element="enhanced", domain=_cube(*UNIT, (1, 1, 1), "tetrahedron")) :: is for hexahedra
_scene(element=AssumedStrains("z0"), domain=_cube(*UNIT, (1, 1, 1), "tetrahedron")) :: is for hexah
_scene(element=AssumedStrains("no")) :: AssumedStrains: there are no facets named 'no'
_scene(element=AssumedStrains("skin")) :: thickness goes two ways
_scene(element=AssumedStrains(3)) :: name of a surface
_scene(domain=_cube((0, 0, 0), (1, 1, 1), (1, 1, 1), "tetrahedron"), order=2) :: negative lumped mas
_scene(Rigid("part 2"), domain=_cells(lambda x: x[0] < 1.5, "part 2")) :: is what a part that is fou
  # Materials
MooneyRivlin(rho=1.0, c10=-1.0, c01=0.0, kappa=1.0) :: c10 + c01 must be a finite number > 0, got -1
_run(material=SPARSE) :: Scene: a node has the lumped mass 0 kg ≤ 0 (strongly curved
_run(material=Hyperelastic(rho=1.0, W=lambda C, mu: mu * C[0, 0])) :: cannot be formed
_material(3.0) :: Hyperelastic: W must be a function of C giving UFL, got 3.0.
_material(lambda C: 1.0) :: Scene: the stored energy of Hyperelastic does not depend on C.
_material(lambda C: None) :: Scene: the stored energy of Hyperelastic cannot be formed:
_material(lambda C: C) :: Scene: the stored energy of Hyperelastic must be a scalar.
_material(lambda C: C[0, 0] * ufl.SpatialCoordinate(_overlapping().mesh)[0]) :: is of another mesh
Hyperelastic(rho=1.0, W=lambda C, mu: C[0, 0] * mu, values=[("mu", 3)]) :: values must be a dict of
StVenantKirchhoff(rho=1.0, E=1.0, nu=0.5) :: nu
MooneyRivlin(rho=1.0, c10=1, c01=-0.5, kappa=1) :: MooneyRivlin
  # Loads
_scene(Traction("a", (1, 0, 0))) :: Traction: there are no facets named 'a'. Known names: '
Traction("x1", (1, 0, 0), total=50.0) :: must be True or False, the force being its value, got
_faces(lambda x: np.abs(x[0] - 1) < 1e-9) :: inside the mesh and for none of its boundary, which wit
_run(Pressure("x1", lambda t: "1")) :: it is nan
Gravity(since=2.0, until=1.0) :: Gravity: the time window needs since < until, got 2.0 … 1.0.
Gravity(time=1.0) :: Gravity: time must be a function of t, got 1.0.
_scene(Gravity(lambda x, t: x)) :: value must be a function
_run(Gravity(lambda: (0, 0, 1))) :: Gravity on 'all cells': its function of time failed with
_run(Gravity(lambda t: (0, 0, 1j))) :: finite components are expected, got what is no array of real
_run(Gravity(time=lambda t: 1.0 if t < 0.2 else _stops(t))) :: its value or time function failed at
_run(Gravity(_then((0, 0, 1.0), (0, 1.0)))) :: Gravity on 'all cells': at t = 0.221132 s three
_run(Gravity(time=lambda t: 10**400)) :: Gravity on 'all cells': at t = 0 s three finite components
_run(Gravity(_fails((0, 0, 1)))) :: failed at t = 0.221132 s with KeyError
Gravity(time=_with(0.5)) :: breakpoints of time must be a list
_run(Traction("x1", _nan_on_one_rank)) :: at t = 0.221132 s three
_run(Traction("x1", lambda x, t: x[0])) :: three finite components for each of
_run(BodyForce(lambda x, t: _fails(x, 0.08)(t))) :: BodyForce on 'all cells': its function failed at
Table((1, 0), (0, 1)) :: Table: times must increase strictly; a jump takes a time
Table((0, 1), (0,)) :: Table: times and values must be lists of numbers, of the same
Preload([Gravity()], increments=0) :: Preload: increments must be a whole number ≥ 1, got 0.
Preload([Pressure("x1", 1.0)]) :: Preload: loads must be one or more dead loads, got
Preload([_contact()]) :: Preload: loads must be one or more dead loads
_scene(Preload([Gravity()]), Preload([Gravity()])) :: Scene: only one Preload makes sense; give it a
_run(Fixed("x0"), Rigid("a"), Preload([Gravity()], spin=(0, 0, 1))) :: a spin with parts that are Ri
_run(Preload([Gravity()])) :: rigid motion free
_run(Fixed("x0", "xy"), Fixed("y0", "y"), Preload([Gravity()])) :: rigid motion free
_run(Fixed("edge"), Preload([Gravity()])) :: rigid motion free
_run(Fixed("x0", "x"), Spring("line", 3.0), Preload([Gravity()])) :: rigid motion free
_run(Fixed("x0", since=1.0), Preload([Gravity()])) :: rigid motion free
_preloaded(_arrays([*CUBE, *CUBE + FAR], [range(8), range(8, 16)])) :: of the part of 1 × 1 × 1 m ar
_preloaded(_arrays(L_POINTS, HINGED)) :: of the part of 1 × 1 × 1 m around (1.5, 1.5, 0.5) m
_preloaded(_box(), Gravity(since=0.2)) :: Gravity on 'all cells' does not act at t = 0
_preloaded(_box(), Gravity(time=np.sin)) :: its loads are zero at t = 0
  # Supports and what moves them
Fixed("x0", "xx") :: Fixed on 'x0': components must be some of 'xyz', each once, got
_run(Fixed("x0"), _moved(_path)) :: different motions of the same nodes
_run(_turned(), _turned(angle=lambda t: 2 * t)) :: prescribe different motions of the same nodes
_moved(1.0) :: PrescribedMotion: displacement must be a function of t,
_scene(_moved(Table((0, 1), (0, 1)))) :: PrescribedMotion on 'x0': at t = 0 s three finite component
_run(_moved(_then((0.0,) * 3, (0.1, 0.2), 0.15))) :: is not three finite numbers but [0.1 0.2]
_run(_moved(_then((0.0,) * 3, (nan, 0, 0), 0.15))) :: near t = 0.2 s its path or velocity
_run(_moved(_fails((0, 0, 0), since=0.25))) :: path failed near t = 0.3 s
_moved(lambda x, t: 0 * x, _speed) :: displacement and velocity must be functions of the same argume
_scene(_moved(_path, lambda t: (0.2, 0, 0))) :: at t = 0 s its velocity is [0.2 0.  0. ] m/s, and it
_scene(_moved(_kinked, lambda t: (1.0 if t > 0.2 else 0.0, 0, 0))) :: at t = 0.2 s its velocity is
_turned(axis=(0, 0, 0)) :: axis must have a direction
_turned(angle=3.0) :: angle must be a function of t, got 3.0
_run(_turned(angle=_fails(0.0, since=0.08))) :: PrescribedRotation on 'x0': its path failed near t =
_scene(_turned(speed=lambda t: 7.0)) :: its velocity is [7. 0. 0.] rad/s, and its path moves by [1.
_scene(Symmetry("skin")) :: must lie in one plane
  # Starts
_scene(InitialVelocity(function=(1, 0, 0))) :: function must be a function of x, got (1, 0, 0).
_scene(InitialVelocity(function=lambda x: x[:2])) :: function must map (3, n) to (3, n); it failed
_run(InitialVelocity(function=lambda X: X.astype(str))) :: it gives no real numbers
_run(InitialVelocity(function=_infinite_on_one_rank)) :: not finite
_run(Fixed("x0"), InitialVelocity(linear=(1, 0, 0))) :: contradicts
_scene(Symmetry("x0"), InitialVelocity(linear=(1, 0, 0))) :: contradicts Symmetry on 'x0' (component
InitialDisplacement((1, 0, 0)) :: must be a function
_scene(InitialDisplacement(lambda x: 0.01 * x.T)) :: InitialDisplacement: function must map (3, n)
_scene(InitialDisplacement(lambda x: _fails(x, -1.0)(x))) :: it failed with KeyError: 'lost'
_scene(Rigid("a"), InitialDisplacement(lambda x: 0 * x)) :: an InitialDisplacement goes neither with
  # Masses, springs and damping
_run(PointMass("x1", 1e308)) :: masses of the nodes add up to
Spring("x1", [[0, 1, 0], [1, 0, 0], [0, 0, 0]]) :: stiffness must be a number ≥ 0, three of them,
KelvinVoigt(-1.0) :: KelvinVoigt: eta must be a finite number > 0, got -1.0.
NumericalDamping(1.0) :: NumericalDamping: xi must lie in [0, 1/2], got 1.0.
_scene(NumericalDamping(0.1), NumericalDamping(0.2)) :: two NumericalDamping effects overlap in time
_scene(NumericalDamping(0.1), scheme=Midpoint()) :: numerical damping (22) goes with EnergyMomentum,
  # Bodies
Rigid(inertia=np.diag([1.0, 1.0, 3.0])) :: no body has the principal moments of inertia 1, 1, 3:
_scene(Rigid(), Rigid()) :: Rigid on 'all cells' and Rigid on 'all cells' hold the same ones.
_run(Rigid("a"), Rigid("b")) :: Rigid 'b' shares nodes with another body, Rigid 'a', which
_run(Fixed("x0", "x"), Rigid()) :: Rigid 'all cells' has nodes held by the support on 'x0'. A body
Rigid("a", inertia=[[1e-9, 1e-10, 0], [0, 1e-9, 0], [0, 0, 1e-9]]) :: symmetric
Rigid("a", inertia=np.diag([1, 1, -1])) :: positive
_run(Rigid("a"), Fixed("edge", since=3.0)) :: leave a layer of flexible cells
_run(Rigid("a"), Fixed("x0"), Fixed("line", "y")) :: leave a layer of flexible cells
_run(Rigid("a"), Fixed("edge"), _moved(_path, where="far edge")) :: one motion
_run(Rigid("a", mass=9.0), Fixed("x0", since=3.0)) :: its mass or inertia is given, and at t = 3 s
_run(Rigid("a"), Fixed("x0", since=3.0), Resultant("a", force=(1, 0, 0))) :: at t = 3 s a support cl
_scene(Rigid(), scheme=Trapezoidal()) :: Scene: Trapezoidal does not couple to rigid bodies; take
_scene(Rigid(), Resultant("b", force=(1, 0, 0))) :: Resultant: 'b' is not the name of a Rigid body;
  # Parts that shapes deform
Reduced("half", shapes=2.5) :: whole number ≥ 1
Reduced("half", mass=3.0) :: another rho
_beam(Reduced("half", shapes=9999)) :: shapes=9999
_beam(Reduced("half"), Rigid("half")) :: hold the same
_beam(Reduced(), Reduced("half")) :: hold the same
_beam(Reduced("half"), Rigid("next", mass=1.0)) :: Merge the two sets
_beam(Reduced("half"), Rigid("low")) :: Merge the two sets
_beam(Reduced("half"), Fixed("x0", "x")) :: Reduced 'half' has
_beam(Reduced("half"), Fixed("x0", until=0.02)) :: begins or ends on it
_beam(Reduced("half"), Fixed("half")) :: hold
_beam(Reduced("half"), Resultant("half", force=(1.0, 0, 0))) :: Resultant at a MeanFace
_beam(Reduced("half"), Revolute("ground", "x0", (0, 0, 0), (0, 1, 0))) :: joined by MeanFace
_beam(Reduced("half"), Fixed("x0"), Preload(SQUASH), SQUASH) :: before the limit load
_run(Reduced(), domain=_cube(*UNIT)) :: 1 cell
  # Joints, springs between two points, remote points
_hinged(Stop("joint", 1.0, stiffness=1.0, along="travel")) :: leaves angle free, and travel is asked
_hinged(Motor("door", torque=1.0)) :: no joint 'door'; there are
_hinged(Motor("joint", force=1.0)) :: leaves angle free, and travel
_hinged(Motor("joint", speed=1.0), Motor("joint", angle=abs)) :: two motors prescribe its angle at
_hinged(*[Motor("joint", speed=1.0)] * 2) :: by speed and by speed
_hinged(HINGE) :: Revolute 'joint': two joints are called 'joint'
_run(Rigid("a"), HINGE, Motor("joint", torque=_then(1.0, nan))) :: Motor of 'joint' at t = 0.221132
_scene(Rigid("a"), Tied("a", MeanFace("x0"), (0, 0.5, 0.5))) :: both sides are of one part, Rigid
_pinned("A", MeanFace("x1")) :: 'A' is no Rigid part; there are none.
_pinned(MeanFace("ende"), MeanFace("x1")) :: 'ende'
_pinned(MeanFace("x0"), MeanFace("x1")) :: Fixed on 'x0' holds all of MeanFace 'x0'
_pinned(MeanFace("y0"), MeanFace("x1"), (99, 0, 0)) :: its sides do not meet: it is at
_pinned(RigidFace("y0"), MeanFace("x1")) :: RigidFace 'y0': Fixed on 'x0' holds some
_pinned(RigidFace("x1"), MeanFace("x1")) :: both sides are the same
_spring("x0", "nobody") :: 'nobody'
_spring("edge", "x1", at_a=(0, 0, 0)) :: 'edge' is the mean place of the
_spring(MeanFace("x0"), "b", at_a=(99, 0, 0)) :: it is at (99, 0, 0)
_spring("ground", "x1", at_a=(2, 0.5, 0.5)) :: no direction. Place them apart, or give length=0
_scene(*[SpringDamper("ground", "x1", 1.0, at_a=(9, 0, 0), name="s")] * 2) :: two springs are call
Resultant("x1", at=(0, 0, 0)) :: on 'x1': at is the place of a remote point
_scene(Resultant(MeanFace("end"))) :: MeanFace 'end': there are no facets named
Spring(MeanFace("x1"), 1.0, at=(0, 0)) :: at must be three finite numbers
_scene(Spring(MeanFace("x1"), 1.0, at=(99, 0, 0))) :: it is at (99, 0, 0)
Traction(MeanFace("x1"), (1, 0, 0)) :: Traction: where must be the name
Motor("joint") :: give exactly one of torque, angle
Motor("joint", torque=1.0, angle=0.0) :: got torque, angle
Stop("joint", 1.0, 0.5, stiffness=1.0) :: low must be below high
Stop("joint", stiffness=1.0) :: give low, high or both
Universal("ground", "a", (0, 0, 0), (1, 0, 0), (1, 1, 0)) :: are at 45°
Revolute("a", "a", (0, 0, 0), (0, 0, 1)) :: both sides are the same
Revolute("a", "ground", (0, 0, 0), (0, 0, 0)) :: axis must have a direction
Spherical(1.0, "ground", (0, 0, 0)) :: a must be 'ground', the name of a Rigid part
SpringDamper("a", "a", 1.0) :: both sides are the same
SpringDamper("a", 3, 1.0) :: b must be 'ground', the name of a Rigid part or
SpringDamper("a", "b") :: give a stiffness, a damping or both
SpringDamper("a", "b", -1.0) :: stiffness must be ≥ 0, got -1.0
SpringDamper("a", "b", 1.0, pulls_only=2) :: pulls_only must be True or False
SpringDamper("ground", "b", 1.0) :: give at_a, the place of its end on the gr
SpringDamper("a", "b", 1.0, at_b=(0, 0)) :: at_b must be three finite numbers
  # Contacts
_contact(against=Plane) :: against must be a Plane
_contact(against="z1", friction=0.1, creep=1) :: friction is for obstacles, not for 'z1' yet
_contact(title="a\nb") :: title must be a text that can be printed, got 'a\nb'
_scene(_contact(against="z0")) :: is flat, so it does not meet
_scene(_contact(against="a")) :: there are no facets named 'a'
_scene(_contact(), _contact()) :: two contacts are called 'z0_plane'; give one another title
_scene(_contact("skin", against="skin"), domain=_overlapping()) :: the mesh overlaps itself at (
_run(_contact(), InitialDisplacement(lambda x: (0, 0, -1.9))) :: at the start it is 0.9 m inside the
_contact(against=None) :: against must be a Plane or another obstacle
_contact(friction=0.1) :: friction needs creep
Plane((0, 0, 0), (0, 0, 0)) :: must have a direction
Cylinder((0, 0, 0), 1.0, axis=(0, 0, 0)) :: axis must have a direction
Sphere((0, 0, 0), 1, inside=1) :: inside must be True or False
_scene(_moving(lambda x, t: x)) :: its function of time failed
_run(_moving(_then((0.0,) * 3, (nan,) * 3, 0.08))) :: got [nan nan nan]. Check its path of the Plane
_run(_moving(_fails((0, 0, 0), since=0.08))) :: Contact on 'z0': its path of the Plane failed at t =
_moving(_with(3)) :: breakpoints of against must be a list of instants, got 3
_scene(_contact(against=Obstacle())) :: its gap of the Obstacle failed with NotImplementedError
_told(lambda y: y[:, 3]) :: Contact on 'z0': its gap of the Told failed with IndexError
_told(lambda y: np.full(len(y) or 1, nan)) :: gap of the Told must give finite numbers of shape (
_told(lambda y: 1 + y[:, 2]) :: approach of the Told must give finite numbers of shape (
  # Steps, criteria and stresses
_control(2.0) :: tol must be
_control(1e-320) :: and 1e-12 or more
_control(smallest=1.0) :: needs smallest ≤ largest
_control(at=[(0, 0, 0)]) :: at must be names of probes
_control(at={"tip": 2.0}) :: at must be names of probes, got {'tip': 2.0}
_run(dt=_control(at="tip"), probes={"top": (1, 0.5, 0.5)}) :: at names the probe 'tip'; the scene ha
_run(dt={1.0: 0.1}) :: simulate: dt must be a finite number > 0, or a dict of times to
_run(dt={0: None}) :: simulate: dt must be a finite number, got None.
_run(dt=1e300, t_end=1e308) :: simulate: dt = 1e+300 s is no step to compute with
_run(dt=1e-300, t_end=3e-300) :: simulate: dt = 1e-300 s is no step to compute with
_run(t_end=0.0) :: simulate: t_end must be a finite number > 0, got 0.0.
_run(petsc_options={"ksp_type": "fast"}) :: cannot solve with the options -rigidfx_ksp_type fast:
_run(petsc_options={"snes_rtol": -1.0}) :: option -rigidfx_snes_rtol -1.0 cannot be honoured: a
_rate(wake="never") :: StrainRate: wake must be 'all', 'local' or 'none', got 'never'.
_rate(since=2.0, until=1.0) :: StrainRate: needs since < until, got 2.0 … 1.0.
_rate(tolerances={"a": Relative(0.1)}) :: of 'a' must be a finite number, got Relative(part=0.1)
_rate(wake="local", load_change=0.2) :: with wake='local' none does. Take wake='all', or leave it
_run(rigidify=_rate(never=["x0"])) :: StrainRate (never): there are no cells named 'x0'
_run(rigidify=_watched(_fails(False, -1.0))) :: Release: its condition failed with KeyError
_run(rigidify=_rate(), scheme=Trapezoidal()) :: simulate: Trapezoidal does not couple to rigid bodie
Relative(1.0) :: Relative: part must be
Accuracy(1.0) :: Accuracy: budget
Accuracy(0.01, at=()) :: Accuracy: at
Accuracy(0.01, never=3) :: Accuracy: never
Accuracy(0.01, check="yes") :: Accuracy: check
_budgeted(0.01) :: must be an Accuracy
_budgeted(Accuracy(0.01, "top")) :: the probe 'top'
_budgeted(Accuracy(0.01), rigidify=_rate()) :: rigidify: give one
_budgeted(Accuracy(0.01), dt=_control()) :: StepControl
_budgeted(Accuracy(0.01), dt={0: 0.1, 1: 0.01}) :: several values
_budgeted(Accuracy(0.01), dt=0.0) :: dt must be
_budgeted(Accuracy(0.01, smallest=0.5)) :: smallest ≤ dt
_budgeted(Accuracy(0.01, never="nowhere")) :: Accuracy (never): there are no cells named 'nowhere'
simulate(_scene(), 0.1, 1.0, accuracy=Accuracy(0.01, check=True)) :: the scene has none
StepControl(0.05) :: StepControl: needs largest, the longest step in s
StepControl(0.05, "tip", largest=None) :: StepControl: needs largest, the longest step in s
static(None) :: static: scene must be a Scene
_static(0) :: static: steps must be a whole number
_static([2.0, 1.0]) :: static: steps must be a whole number
_static(1, t_end=0.0) :: t_end must be
static(_scene(Fixed("x0", "xy"), Gravity())) :: leave a rigid motion free, of the whole
static(_scene(Fixed("x0"), InitialVelocity())) :: static: InitialVelocity has no meaning
simulate(_scene(), 0.1, 0.1, start=3) :: simulate: a Report is expected
periods(_scene(), 0) :: periods: count must be a whole number ≥ 1
periods(None) :: periods: scene must be a Scene, got NoneType
modes(_scene(), 2, about=0.5) :: modes: a Report is expected, got float
_scene().describe(periods=-1) :: describe: periods must be a whole number ≥ 0
Checkpoint("out", every=0.0) :: Checkpoint
Checkpoint("out", steps=0) :: Checkpoint
Checkpoint("out", time=-1.0) :: Checkpoint
Checkpoint("out", steps=3, time=1.0) :: Checkpoint
CauchyStress(None) :: CauchyStress: scene must be a Scene
recovered_stress(None, _stress()) :: recovered_stress: report must be a Report, got NoneType
_recovered_elsewhere() :: recovered_stress: stress is that of a scene on another mesh
Recorder(_scene(), "nowhere", integration_points=1) :: integration_points must be True or False, got
""")


def _action(expression):
    return lambda: eval(expression, vars(rf) | globals())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("case", CASES)
def test_is_refused(case):
    refusals.check(_action(case), CASES[case])


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    refusals.check_on_two_ranks(__file__, CASES)


@pytest.mark.parametrize(
    ("effects", "material"),
    [
        ([rf.Fixed("x0"), rf.Traction("x1", (1e308, 1e308, 1e308))], SOFT),
        ([rf.Fixed("x0"), rf.Gravity()], STIFF),
        ([_moved(lambda t: (1e300 * t, 0, 0))], SOFT),
        ([rf.InitialVelocity(linear=(1e200, 0, 0))], SOFT),
        ([rf.Fixed("x0"), rf.Traction("x1", (1e20, 0, 0), since=0.25)], SOFT),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_numbers_that_overflow_in_a_step(effects, material):
    """They are finite, so that only the step can tell: by its own error, not one of NumPy's."""
    with pytest.raises(rf.StepError, match="did not converge"):
        _run(*effects, material=material)


@pytest.mark.parametrize(
    ("energy", "message"),
    [
        (lambda C: ufl.tr(C), "has a stress of 2 Pa at rest"),
        (lambda C: -ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3)), "falls where rest is"),
    ],
)
def test_energy_that_is_not_at_rest_is_warned_of(energy, message):
    with pytest.warns(rf.RigidfxWarning, match=message):
        _material(energy)


def test_sound_energies_pass():
    """Also where UFL cannot evaluate them, as they depend on the place."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _scene(material=rf.NeoHooke(rho=1.0, E=1e-6, nu=0.3))
        _scene(material=rf.MooneyRivlin(rho=1.0, c10=1.0, c01=0.2, kappa=10.0))
        _material(lambda C, mu: mu * (ufl.tr(C) - 3 - ufl.ln(ufl.det(C))), mu=2.0)
        _material(lambda C: ufl.exp(1e4 * ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3))))
        x = ufl.SpatialCoordinate(_box().mesh)
        _material(lambda C: (1 + x[0]) * ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3)))


def test_what_is_right_is_taken():
    """Neighbours of the cases above that are sound."""
    assert _numbered(np.array([0], dtype=np.uint8)).sets["a", 3].entities.size == 1
    rf.from_arrays(CUBE.astype(np.float32), ONE.astype(np.uint16))
    rf.from_arrays(CUBE.astype(int).tolist(), ONE.tolist())
    rf.from_arrays(CUBE, TETS, "tetrahedron")
    _scene(_moved(_path, _speed))
    _scene(_moved(_path, _speed), rf.PrescribedMotion("y0", displacement=_path, velocity=_speed))
    _scene(_moved(_kinked, lambda t: (1.0 if t >= 0.2 else 0.0, 0, 0)))
    fast = 2 * np.pi * 3e4  # a path of 30 kHz
    _scene(
        _moved(
            lambda t: (1e-6 * np.sin(fast * t), 0, 0),
            lambda t: (1e-6 * fast * np.cos(fast * t), 0, 0),
        )
    )
    _run(rf.Gravity(lambda t: [0, 0, np.float32(-1)], time=lambda t: np.array(0.5)))
    assert rf.Traction("x1", (Fraction(1, 2), 1, 2)).intensity(0.0).tolist() == [0.5, 1, 2]
    assert rf.Gravity((0, 0, 1), time=lambda t: t < 1).intensity(0.5)[2] == 1.0  # a switch
    whole = np.ma.array([1.0, 2, 3])
    assert rf.Traction("x1", whole).intensity(0.0).tolist() == [1, 2, 3]
    assert rf.Gravity(time=np.poly1d([2.0, 1.0])).intensity(1.0)[2] == pytest.approx(-3 * 9.81)


DROPPED = """
import rigidfx as rf
from rigidfx.flexible.stress import CauchyStress
from rigidfx.state import State

material = rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=1.0)


def box():
    return rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1))


for line in (
    "rf.Recorder(rf.Scene(box(), material), 'out', evry=1)",
    "print(State(rf.Scene(box(), material)), on=1)",
    "print(CauchyStress(rf.Scene(box(), material)), on=1)",
    "print(next(rf.simulate(rf.Scene(box(), material), 0.1, 1.0)), on=1)",
):
    try:
        exec(line)
    except TypeError:
        continue
rf.Scene(box(), material, [rf.Rigid(3)])
"""


def test_error_while_a_mesh_is_dropped():
    """A process ends where an error meets a mesh that has no name; mpi4py 4.0 kept a lock."""
    words = [sys.executable, "-c", DROPPED]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "SceneError: Rigid: where must be" in done.stderr
    assert "SystemError" not in done.stderr


def test_meshes_go_when_nothing_is_left_of_them():
    def unnamed():
        return rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))

    gc.collect()
    unnamed()
    before = kept()
    for _ in range(3):
        _run(rf.Gravity(), domain=unnamed())
    gc.collect()
    unnamed()
    assert kept() == before


if __name__ == "__main__":
    refusals.on_each_rank({case: _action(case) for case in CASES})
