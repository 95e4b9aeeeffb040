"""Input that is refused by name: odd values, functions, containers, names, energies and sizes.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

import datetime
import enum
import math
import types
import warnings

import numpy as np
import pytest
import refusals
import ufl
from mpi4py import MPI

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
STIFF = rf.StVenantKirchhoff(rho=1.0, E=1e308, nu=0.49)
LOOP: list[object] = []
LOOP.append(LOOP)


def _box():
    return rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))


def _of_one_rank(points, cells):
    """Nothing on all others, where each rank would have given the same cells."""
    mine = slice(None) if MPI.COMM_WORLD.rank == 0 else slice(0)
    return np.asarray(points)[mine], np.asarray(cells)[mine]


def _scene(*effects, material=SOFT, domain=None, **options):
    return rf.Scene(domain or _box(), material, effects, **options)


def _run(*effects, criterion=None, dt=0.1, t_end=0.3, **options):
    for _ in rf.simulate(_scene(*effects, **options), dt, t_end, rigidify=criterion):
        pass


def _material(W, **values):
    return _scene(material=rf.Hyperelastic(rho=1.0, W=W, values=values))


class Kind(enum.Enum):
    """Members that stand for a name and a number."""

    A = "x0"
    B = 1.0


class Unasked:
    """A function that takes no time."""

    def __call__(self):
        return 0


class Liar:
    """A number that is none."""

    def __float__(self):
        return math.nan


class Shy:
    """A number that cannot be read."""

    def __float__(self):
        raise RuntimeError("shy")


class Ragged:
    """Three items that cannot be read."""

    def __len__(self):
        return 3

    def __getitem__(self, k):
        raise RuntimeError("gone")


def _yields(t):
    yield 0.0


async def _later(t):
    return 1.0


def _endless(t):
    return _endless(t)


def _stops(t):
    raise StopIteration


# name: (what is done, part of the message)
CASES = {
    "class of an effect": (
        lambda: _scene(rf.Gravity),
        "Scene: <class 'rigidfx.effects.loads.gravity.Gravity'> is not an",
    ),
    "None among effects": (
        lambda: _scene(rf.Gravity(), None),
        "Scene: None is not an effect. See rigidfx.effects.",
    ),
    "list in list": (
        lambda: _scene([rf.Gravity()]),
        "Scene: [Gravity(since=-inf, until=inf, time=None, value=(0.0,",
    ),
    "dict of effects": (
        lambda: rf.Scene(_box(), SOFT, {"g": rf.Gravity()}),
        "Scene: 'g' is not an effect. See rigidfx.effects.",
    ),
    "one effect": (
        lambda: rf.Scene(_box(), SOFT, rf.Gravity()),
        "Scene: effects must be a list of effects, got",
    ),
    "a criterion as an effect": (
        lambda: _scene(rf.StrainRate(1.0, 1.0)),
        "Scene: StrainRate(tol=1.0, window=1.0, measure='rms',",
    ),
    "a material as an effect": (
        lambda: _scene(SOFT),
        "Scene: StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3) is not an",
    ),
    "a release as an effect": (
        lambda: _scene(rf.Release(at=0.1)),
        "Scene: Release(at=(0.1,), when=None, where=None, repeat=False) is not an",
    ),
    "a scene as a material": (
        lambda: _scene(material=_scene()),
        "Scene: material must be a Material or a dict of cell-set names",
    ),
    "class of materials": (
        lambda: _scene(material=rf.NeoHooke),
        "Scene: material must be a Material or a dict of cell-set names",
    ),
    "list of materials": (
        lambda: _scene(material=[SOFT]),
        "Scene: material must be a Material or a dict of cell-set names",
    ),
    "nested materials": (
        lambda: _scene(
            material={"a": {"b": SOFT}}, domain=_box().with_cells("a", lambda x: x[0] < 9)
        ),
        "Scene: the material of 'a' must be a Material, got {'b':",
    ),
    "materials by number": (
        lambda: _scene(material={1: SOFT}),
        "Scene: materials are given by names of cell sets, got {1:",
    ),
    "materials by enum": (
        lambda: _scene(material={Kind.A: SOFT}),
        "Scene: materials are given by names of cell sets, got {<Kind.A:",
    ),
    "overlapping materials": (
        lambda: _scene(
            material={"a": SOFT, "b": SOFT},
            domain=_box().with_cells("a", lambda x: x[0] < 9).with_cells("b", lambda x: x[0] < 9),
        ),
        "Scene: every cell needs exactly one material; 0 cells have none",
    ),
    "material of facets": (
        lambda: _scene(material={"x0": SOFT}),
        "Scene (material): there are no cells named 'x0'. Known names:",
    ),
    "where by enum": (lambda: _scene(rf.Fixed(Kind.A)), "Fixed: where must be the name of a set,"),
    "where by bytes": (
        lambda: _scene(rf.Fixed(b"x0")),
        "Fixed: where must be the name of a set, got b'x0'.",
    ),
    "where by tuple": (
        lambda: _scene(rf.Fixed(("x0", "x1"))),
        "Fixed: where must be the name of a set, got ('x0', 'x1').",
    ),
    "where empty": (
        lambda: _scene(rf.Fixed("")),
        "Fixed: there are no facets or cells or edges or vertices named",
    ),
    "where with a space": (
        lambda: _scene(rf.Fixed("x0 ")),
        "Fixed: there are no facets or cells or edges or vertices named",
    ),
    "where in capitals": (
        lambda: _scene(rf.Fixed("X0")),
        "Fixed: there are no facets or cells or edges or vertices named",
    ),
    "where with NUL": (lambda: _scene(rf.Fixed("x0\0")), "Fixed: there are no facets or cells"),
    "support on None": (
        lambda: _scene(rf.Fixed(None)),
        "Fixed: where must be the name of a set, got None.",
    ),
    "traction on cells": (
        lambda: _scene(
            rf.Traction("a", (1, 0, 0)), domain=_box().with_cells("a", lambda x: x[0] < 9)
        ),
        "Traction: there are no facets named 'a'. Known names: 'a'",
    ),
    "a force as the total": (
        lambda: rf.Traction("x1", (1, 0, 0), total=50.0),
        "Traction on 'x1': total must be True or False, got 50.0; the force itself is its value.",
    ),
    "pressure on nodes": (
        lambda: _scene(
            rf.Pressure("a", 1.0), domain=_box().with_vertices("a", lambda x: x[0] < 1e-9)
        ),
        "Pressure: there are no facets named 'a'. Known names: 'x0'",
    ),
    "pressure inside": (
        lambda: _scene(
            rf.Pressure("a", 1.0), domain=_box().with_facets("a", lambda x: np.abs(x[0] - 1) < 1e-9)
        ),
        "inside the mesh and for none of its boundary, which with_facets names",
    ),
    "gravity on facets": (
        lambda: _scene(rf.Gravity(where="x0")),
        "Gravity: there are no cells named 'x0'. Known names: 'x0'",
    ),
    "rigid facets": (
        lambda: _scene(rf.Rigid("x0")),
        "Rigid: there are no cells named 'x0'. Known names: 'x0'",
    ),
    "viscous facets": (
        lambda: _scene(rf.KelvinVoigt(1.0, "x0")),
        "KelvinVoigt: there are no cells named 'x0'. Known names: 'x0'",
    ),
    "probe name surrogate": (
        lambda: _scene(probes={"\ud800": (0, 0, 0)}),
        "Scene: the name of a probe must be one that can be printed, got",
    ),
    "probe name newline": (
        lambda: _scene(probes={"a\nb": (0, 0, 0)}),
        "Scene: the name of a probe must be one that can be printed, got",
    ),
    "probe name empty": (
        lambda: _scene(probes={"": (0, 0, 0)}),
        "Scene: the name of a probe must be one that can be printed, got",
    ),
    "probe of columns": (
        lambda: _scene(probes={"p": [[0], [0], [0]]}),
        "Scene: probe 'p' must be three finite numbers, got [[0], [0],",
    ),
    "probe of function": (
        lambda: _scene(probes={"p": lambda: 0}),
        "Scene: probe 'p' must be three finite numbers,",
    ),
    "probe of none": (
        lambda: _scene(probes={"p": None}),
        "Scene: probe 'p' must be three finite numbers, got None.",
    ),
    "probe of inf": (
        lambda: _scene(probes={"p": (np.inf, 0, 0)}),
        "Scene: probe 'p' must be three finite numbers, got (inf, 0, 0).",
    ),
    "probes text": (
        lambda: _scene(probes="tip"),
        "Scene: probes must be a dict of names to three numbers each,",
    ),
    "set name with newline": (
        lambda: _box().with_facets("a\nb", lambda x: x[0] < 1e-9),
        "The name of a set must be a text that is not empty, and can be",
    ),
    "set name surrogate": (
        lambda: _box().with_facets("\ud800", lambda x: x[0] < 1e-9),
        "The name of a set must be a text that is not empty, and can be",
    ),
    "set name bytes": (
        lambda: _box().with_facets(b"a", lambda x: x[0] < 1e-9),
        "The name of a set must be a text that is not empty, and can be",
    ),
    "marker text": (
        lambda: _box().with_facets("a", "x[0]<1"),
        "The marker of 'a' failed with TypeError: 'str' object is not",
    ),
    "marker None": (
        lambda: _box().with_facets("a", None),
        "The marker of 'a' failed with TypeError: 'NoneType' object is",
    ),
    "marker array": (
        lambda: _box().with_facets("a", np.array([True])),
        "The marker of 'a' failed with TypeError: 'numpy.ndarray' object",
    ),
    "marker no arg": (
        lambda: _box().with_facets("a", lambda: True),
        "The marker of 'a' failed with TypeError: ",
    ),
    "marker generator": (
        lambda: _box().with_facets("a", _yields),
        "The marker of 'a' must give a boolean for each point, shape",
    ),
    "marker nan": (
        lambda: _box().with_facets("a", lambda x: np.where(x[0] < 1, np.nan, 0)),
        "The marker of 'a' must give a boolean for each point, shape",
    ),
    "marker that stops an iteration": (
        lambda: _box().with_facets("a", _stops),
        "The marker of 'a' failed with StopIteration:",
    ),
    "marker without end": (
        lambda: _box().with_facets("a", _endless),
        "The marker of 'a' failed with RecursionError: maximum recursion",
    ),
    "window swapped": (
        lambda: rf.Gravity(since=2.0, until=1.0),
        "Gravity: the time window needs since < until, got 2.0 … 1.0.",
    ),
    "window empty": (
        lambda: rf.Gravity(since=1.0, until=1.0),
        "Gravity: the time window needs since < until, got 1.0 … 1.0.",
    ),
    "window nan": (
        lambda: rf.Gravity(since=np.nan),
        "Gravity: since must be a finite number, got nan.",
    ),
    "window text": (
        lambda: rf.Gravity(until="1"),
        "Gravity: until must be a finite number, got '1'.",
    ),
    "window list": (
        lambda: rf.Gravity(until=[1.0]),
        "Gravity: until must be a finite number, got (1.0,).",
    ),
    "window true": (
        lambda: rf.Gravity(since=True),
        "Gravity: since must be a finite number, got True.",
    ),
    "window None": (
        lambda: rf.Gravity(until=None),
        "Gravity: until must be a finite number, got None.",
    ),
    "window complex": (
        lambda: rf.Gravity(until=1j),
        "Gravity: until must be a finite number, got 1j.",
    ),
    "window datetime": (
        lambda: rf.Gravity(until=datetime.datetime(2020, 1, 1)),
        "Gravity: until must be a finite number, got",
    ),
    "window from infinity": (
        lambda: rf.Gravity(since=np.inf),
        "Gravity: the time window needs since < until, got inf … inf.",
    ),
    "window until -inf": (
        lambda: rf.Gravity(until=-np.inf),
        "Gravity: the time window needs since < until, got -inf … -inf.",
    ),
    "gravity of a function of nothing": (
        lambda: _run(rf.Gravity(lambda: (0, 0, 1))),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "gravity of three args": (
        lambda: _run(rf.Gravity(lambda t, x, y: (0, 0, 1))),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "gravity of a dict": (
        lambda: _run(rf.Gravity({"x": 1, "y": 0, "z": 0})),
        "Gravity: value must be three finite numbers, got",
    ),
    "gravity of a set": (
        lambda: _run(rf.Gravity({1, 2, 3})),
        "Gravity: value must be three finite numbers, got frozenset({1,",
    ),
    "gravity of an iterator": (
        lambda: _run(rf.Gravity(iter((0, 0, 1)))),
        "Gravity: value must be three finite numbers,",
    ),
    "load that contains itself": (
        lambda: _run(rf.Gravity(LOOP)),
        "Gravity: value must be three finite numbers, got ",
    ),
    "gravity of None": (
        lambda: _run(rf.Gravity(None)),
        "Gravity: value must be three finite numbers, got None.",
    ),
    "gravity structured": (
        lambda: _run(rf.Gravity(np.zeros(3, dtype=[("a", float)]))),
        "Gravity: value must be three finite numbers, got",
    ),
    "gravity datetimes": (
        lambda: _run(rf.Gravity(np.zeros(3, dtype="M8[s]"))),
        "Gravity: value must be three finite numbers, got",
    ),
    "gravity coroutine": (
        lambda: _run(rf.Gravity(time=_later)),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "gravity generator": (
        lambda: _run(rf.Gravity(time=_yields)),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "factor that stops an iteration": (
        lambda: _run(rf.Gravity(time=_stops)),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "factor without end": (
        lambda: _run(rf.Gravity(time=_endless)),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "factor that later stops an iteration": (
        lambda: _run(rf.Gravity(time=lambda t: 1.0 if t < 0.2 else _stops(t))),
        "Gravity on 'all cells': its value or time function failed at t",
    ),
    "factor that later is a text": (
        lambda: _run(rf.Gravity(time=lambda t: 1.0 if t < 0.2 else "1")),
        "Gravity on 'all cells': at t = 0.25 s three finite components",
    ),
    "load that later has two numbers": (
        lambda: _run(rf.Gravity(lambda t: (0, 0, 1.0) if t < 0.2 else (0, 1.0))),
        "Gravity on 'all cells': at t = 0.25 s three finite components",
    ),
    "gravity function of function": (
        lambda: _run(rf.Gravity(lambda t: lambda s: (0, 0, 1))),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "factor number": (
        lambda: _run(rf.Gravity(time=1.0)),
        "Gravity: time must be a function of t, got 1.0.",
    ),
    "factor of no argument": (
        lambda: _run(rf.Gravity(time=Unasked())),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "factor class": (
        lambda: _run(rf.Gravity(time=Liar)),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "factor overflow": (
        lambda: _run(rf.Gravity(time=lambda t: 10**400)),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "factor that is not what it says": (
        lambda: _run(rf.Gravity(time=lambda t: Liar())),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "factor that fails as a number": (
        lambda: _run(rf.Gravity(time=lambda t: Shy())),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "load whose items fail": (
        lambda: _run(rf.Gravity(Ragged())),
        "Gravity: value must be three finite numbers,",
    ),
    "modulus that is no number after all": (
        lambda: rf.NeoHooke(rho=1.0, E=Liar(), nu=0.3),
        "NeoHooke: E must be a finite number, got nan.",
    ),
    "modulus that fails as a number": (
        lambda: rf.NeoHooke(rho=1.0, E=Shy(), nu=0.3),
        "NeoHooke: E must be a finite number,",
    ),
    "modulus enum": (
        lambda: rf.NeoHooke(rho=1.0, E=Kind.B, nu=0.3),
        "NeoHooke: E must be a finite number,",
    ),
    "modulus function": (
        lambda: rf.NeoHooke(rho=1.0, E=lambda: 1, nu=0.3),
        "NeoHooke: E must be a finite number,",
    ),
    "modulus field": (
        lambda: rf.NeoHooke(rho=1.0, E=np.ones(5), nu=0.3),
        "NeoHooke: E must be a finite number, got",
    ),
    "modulus ufl": (
        lambda: rf.NeoHooke(
            rho=1.0, E=ufl.as_ufl(3.0) * ufl.SpatialCoordinate(_box().mesh)[0], nu=0.3
        ),
        "NeoHooke: E must be a finite number, got",
    ),
    "modulus nan": (
        lambda: rf.NeoHooke(rho=1.0, E=np.nan, nu=0.3),
        "NeoHooke: E must be a finite number, got nan.",
    ),
    "modulus inf": (
        lambda: rf.NeoHooke(rho=1.0, E=np.inf, nu=0.3),
        "NeoHooke: E must be a finite number, got inf.",
    ),
    "density subnormal": (
        lambda: _run(material=rf.NeoHooke(rho=5e-324, E=1.0, nu=0.3)),
        "Scene: a node has the lumped mass 0 kg ≤ 0 (strongly curved",
    ),
    "density inf": (
        lambda: rf.NeoHooke(rho=np.inf, E=1.0, nu=0.3),
        "NeoHooke: rho must be a finite number, got inf.",
    ),
    "nu nan": (
        lambda: rf.NeoHooke(rho=1.0, E=1.0, nu=np.nan),
        "NeoHooke: nu must be a finite number, got nan.",
    ),
    "mooney negative": (
        lambda: rf.MooneyRivlin(rho=1.0, c10=-1.0, c01=0.0, kappa=1.0),
        "MooneyRivlin: c10 + c01 must be a finite number > 0, got -1.0.",
    ),
    "mooney zero": (
        lambda: rf.MooneyRivlin(rho=1.0, c10=0.0, c01=0.0, kappa=1.0),
        "MooneyRivlin: c10 + c01 must be a finite number > 0, got 0.0.",
    ),
    "energy constant": (
        lambda: _material(lambda C: 1.0),
        "Scene: the stored energy of Hyperelastic does not depend on C.",
    ),
    "energy zero": (
        lambda: _material(lambda C: 0 * C[0, 0]),
        "Scene: the stored energy of Hyperelastic does not depend on C.",
    ),
    "energy None": (
        lambda: _material(lambda C: None),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy text": (
        lambda: _material(lambda C: "C"),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy tensor": (
        lambda: _material(lambda C: C),
        "Scene: the stored energy of Hyperelastic must be a scalar.",
    ),
    "energy numpy": (
        lambda: _material(lambda C: np.trace(C)),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy math": (
        lambda: _material(lambda C: math.exp(C[0, 0])),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy no argument": (
        lambda: _material(lambda: 1),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy not called": (
        lambda: _material(3.0),
        "Hyperelastic: W must be a function of C giving UFL, got 3.0.",
    ),
    "energy index": (
        lambda: _material(lambda C: C[3, 3]),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy of other mesh": (
        lambda: _material(lambda C: C[0, 0] * ufl.SpatialCoordinate(_box().mesh)[0]),
        "Scene: the stored energy of Hyperelastic is of another mesh",
    ),
    "energy recursion": (
        lambda: _material(_endless),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy with parameter too many": (
        lambda: _material(lambda C: C[0, 0], mu=1.0),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy parameter named C": (
        lambda: _material(lambda C: C[0, 0], C=1.0),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy parameter array": (
        lambda: _material(lambda C, mu: mu * C[0, 0], mu=np.ones(3)),
        "Hyperelastic: parameter mu must be a finite number, got",
    ),
    "energy parameter None": (
        lambda: _material(lambda C, mu: mu * C[0, 0], mu=None),
        "Hyperelastic: parameter mu must be a finite number, got None.",
    ),
    "energy parameter nan": (
        lambda: _material(lambda C, mu: mu * C[0, 0], mu=np.nan),
        "Hyperelastic: parameter mu must be a finite number, got nan.",
    ),
    "point mass zero": (
        lambda: rf.PointMass("x1", 0.0),
        "PointMass: mass must be a finite number > 0, got 0.0.",
    ),
    "point mass negative": (
        lambda: rf.PointMass("x1", -1.0),
        "PointMass: mass must be a finite number > 0, got -1.0.",
    ),
    "point mass field": (
        lambda: rf.PointMass("x1", [1.0]),
        "PointMass: mass must be a finite number, got (1.0,).",
    ),
    "spring negative": (
        lambda: rf.Spring("x1", -1.0),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring asym": (
        lambda: rf.Spring("x1", np.triu(np.ones((3, 3)))),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring two": (
        lambda: rf.Spring("x1", (1.0, 2.0)),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring indefinite": (
        lambda: rf.Spring("x1", [[0, 1, 0], [1, 0, 0], [0, 0, 0]]),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring nan": (
        lambda: rf.Spring("x1", np.nan),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring function": (
        lambda: rf.Spring("x1", lambda t: 1.0),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring damping negative": (
        lambda: rf.Spring("x1", 1.0, damping=-1.0),
        "Spring on 'x1': damping must be a number ≥ 0, three of them, or",
    ),
    "spring none": (
        lambda: rf.Spring("x1", None),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "damping zero": (
        lambda: rf.MassDamping(0.0),
        "MassDamping: alpha must be a finite number > 0, got 0.0.",
    ),
    "damping inf": (
        lambda: rf.MassDamping(np.inf),
        "MassDamping: alpha must be a finite number, got inf.",
    ),
    "viscosity negative": (
        lambda: rf.KelvinVoigt(-1.0),
        "KelvinVoigt: eta must be a finite number > 0, got -1.0.",
    ),
    "xi one": (
        lambda: rf.NumericalDamping(1.0),
        "NumericalDamping: xi must lie in [0, 1/2], got 1.0.",
    ),
    "xi negative": (
        lambda: rf.NumericalDamping(-1e-300),
        "NumericalDamping: xi must lie in [0, 1/2], got -1e-300.",
    ),
    "xi nan": (
        lambda: rf.NumericalDamping(np.nan),
        "NumericalDamping: xi must be a finite number, got nan.",
    ),
    "xi overlap": (
        lambda: _scene(rf.NumericalDamping(0.1), rf.NumericalDamping(0.2)),
        "Scene: two NumericalDamping effects overlap in time.",
    ),
    "xi with midpoint": (
        lambda: _scene(rf.NumericalDamping(0.1), scheme=rf.Midpoint()),
        "Scene: numerical damping (22) goes with EnergyMomentum, not",
    ),
    "rigid mass zero": (
        lambda: rf.Rigid(mass=0.0),
        "Rigid: mass must be a finite number > 0, got 0.0.",
    ),
    "rigid inertia triangle": (
        lambda: rf.Rigid(inertia=np.diag([1.0, 1.0, 3.0])),
        "Rigid: no body has the principal moments of inertia 1, 1, 3:",
    ),
    "rigid inertia vector": (
        lambda: rf.Rigid(inertia=(1, 1, 1)),
        "Rigid: inertia must be a symmetric 3×3 matrix, got (1, 1, 1).",
    ),
    "rigid inertia nan": (
        lambda: rf.Rigid(inertia=np.diag([1, 1, np.nan])),
        "Rigid: inertia must be a symmetric 3×3 matrix, got",
    ),
    "rigid twice": (
        lambda: _scene(rf.Rigid(), rf.Rigid()),
        "Scene: a cell can be in one Rigid body only, and Rigid on 'all cells' and "
        "Rigid on 'all cells' hold the same ones.",
    ),
    "rigid overlap": (
        lambda: _run(
            rf.Rigid("a"),
            rf.Rigid("b"),
            domain=_box()
            .with_cells("a", lambda x: x[0] < 9)
            .with_cells("b", lambda x: x[0] < 1 + 1e-9),
        ),
        "Rigid 'b' shares nodes with another body, Rigid 'a', which",
    ),
    "rigid hinge": (
        lambda: _run(
            rf.Rigid("a"),
            rf.Rigid("b"),
            domain=_box()
            .with_cells("a", lambda x: x[0] > 1 - 1e-9)
            .with_cells("b", lambda x: x[0] < 1 + 1e-9),
        ),
        "Rigid 'b' shares nodes with another body, Rigid 'a', which",
    ),
    "rigid half held": (
        lambda: _run(rf.Fixed("x0", "x"), rf.Rigid()),
        "Rigid 'all cells' has nodes held by the support on 'x0'. A body",
    ),
    "rigid trapezoidal": (
        lambda: _scene(rf.Rigid(), scheme=rf.Trapezoidal()),
        "Scene: Trapezoidal does not couple to rigid bodies; take",
    ),
    "resultant without body": (
        lambda: _scene(rf.Resultant(force=(1, 0, 0))),
        "Resultant: 'None' is not the name of a Rigid body; there are",
    ),
    "resultant unknown": (
        lambda: _scene(rf.Rigid(), rf.Resultant("b", force=(1, 0, 0))),
        "Resultant: 'b' is not the name of a Rigid body; there are",
    ),
    "fixed components": (
        lambda: rf.Fixed("x0", "xx"),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "fixed components none": (
        lambda: rf.Fixed("x0", ""),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "fixed components list": (
        lambda: rf.Fixed("x0", ["x"]),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "fixed components number": (
        lambda: rf.Fixed("x0", 0),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "fixed components w": (
        lambda: rf.Fixed("x0", "xw"),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "fixed components capitals": (
        lambda: rf.Fixed("x0", "XYZ"),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "motion number": (
        lambda: rf.PrescribedMotion("x0", displacement=1.0),
        "PrescribedMotion on 'x0': displacement must be a function of t,",
    ),
    "motion tuple": (
        lambda: rf.PrescribedMotion("x0", displacement=(1, 0, 0)),
        "PrescribedMotion on 'x0': displacement must be a function of t,",
    ),
    "motion table": (
        lambda: _scene(rf.PrescribedMotion("x0", displacement=rf.Table((0, 1), (0, 1)))),
        "PrescribedMotion on 'x0': at t = 0 s three finite components",
    ),
    "motion coroutine": (
        lambda: _scene(rf.PrescribedMotion("x0", displacement=_later)),
        "PrescribedMotion on 'x0': at t = 0 s three finite components",
    ),
    "motion nan later": (
        lambda: _run(
            rf.PrescribedMotion("x0", displacement=lambda t: (np.nan if t > 0.15 else 0, 0, 0))
        ),
        "PrescribedMotion on 'x0': near t = 0.2 s its path or velocity",
    ),
    "preload none": (
        lambda: rf.Preload([]),
        "Preload: loads must be one or more dead loads, got ()",
    ),
    "preload of a support": (
        lambda: rf.Preload([rf.Fixed("x0")]),
        "Preload: loads must be one or more dead loads, got",
    ),
    "preload of a pressure": (
        lambda: _scene(rf.Fixed("x0"), rf.Preload([rf.Pressure("x1", 1.0)])),
        "Preload: loads must be one or more dead loads, got",
    ),
    "preload increments zero": (
        lambda: rf.Preload([rf.Gravity()], increments=0),
        "Preload: increments must be a whole number ≥ 1, got 0.",
    ),
    "preload increments 2.0": (
        lambda: rf.Preload([rf.Gravity()], increments=2.0),
        "Preload: increments must be a whole number ≥ 1, got 2.0.",
    ),
    "preload increments true": (
        lambda: rf.Preload([rf.Gravity()], increments=True),
        "Preload: increments must be a whole number ≥ 1, got True.",
    ),
    "preload increments text": (
        lambda: rf.Preload([rf.Gravity()], increments="2"),
        "Preload: increments must be a whole number ≥ 1, got '2'.",
    ),
    "preload of a set": (
        lambda: rf.Preload({rf.Gravity()}),
        "Preload: loads must be one or more dead loads, got",
    ),
    "preload twice": (
        lambda: _scene(rf.Preload([rf.Gravity()]), rf.Preload([rf.Gravity()])),
        "Scene: only one Preload makes sense; give it all static loads.",
    ),
    "preload rigid": (
        lambda: _run(
            rf.Fixed("x0"),
            rf.Rigid("a"),
            rf.Preload([rf.Gravity()], spin=(0, 0, 1)),
            domain=_box().with_cells("a", lambda x: x[0] > 1 - 1e-9),
        ),
        "Preload: a spin with parts that are Rigid is not supported.",
    ),
    "velocity two": (
        lambda: rf.InitialVelocity(linear=(1, 0)),
        "InitialVelocity: linear must be three finite numbers, got (1,",
    ),
    "velocity function const": (
        lambda: _scene(rf.InitialVelocity(function=(1, 0, 0))),
        "InitialVelocity: function must be callable.",
    ),
    "velocity function shape": (
        lambda: _scene(rf.InitialVelocity(function=lambda x: np.zeros((2, x.shape[1])))),
        "InitialVelocity: function must map (3, n) to (3, n); it failed",
    ),
    "velocity function transposed": (
        lambda: _scene(rf.InitialVelocity(function=lambda x: x.T)),
        "InitialVelocity: function must map (3, n) to (3, n); it failed",
    ),
    "velocity function none": (
        lambda: _scene(rf.InitialVelocity(function=lambda x: None)),
        "InitialVelocity: function must map (3, n) to (3, n); it failed",
    ),
    "velocity function complex": (
        lambda: _scene(rf.InitialVelocity(function=lambda x: x * 1j)),
        "InitialVelocity: function must map (3, n) to (3, n); it failed",
    ),
    "velocity centre text": (
        lambda: rf.InitialVelocity(angular=(0, 0, 1), centre="middle"),
        "InitialVelocity: centre must be three finite numbers, got",
    ),
    "table empty": (
        lambda: rf.Table((), ()),
        "Table: times and values must be lists of numbers, of the same",
    ),
    "table down": (
        lambda: rf.Table((1, 0), (0, 1)),
        "Table: times must increase strictly; a jump takes a time",
    ),
    "table same": (
        lambda: rf.Table((0, 0), (0, 1)),
        "Table: times must increase strictly; a jump takes a time",
    ),
    "table lengths": (
        lambda: rf.Table((0, 1), (0,)),
        "Table: times and values must be lists of numbers, of the same",
    ),
    "table nan": (lambda: rf.Table((0, np.nan), (0, 1)), "Table: times and values must be finite."),
    "table 2d": (
        lambda: rf.Table(((0, 1),), ((0, 1),)),
        "Table: times and values must be lists of numbers, of the same",
    ),
    "table function": (
        lambda: rf.Table(lambda t: t, (0, 1)),
        "Table: times and values must be lists of numbers, of the same",
    ),
    "table numbers": (
        lambda: rf.Table(0, 1),
        "Table: times and values must be lists of numbers, of the same",
    ),
    "order three": (lambda: _scene(order=3), "Scene: order must be 1 or 2, got 3."),
    "order zero": (lambda: _scene(order=0), "Scene: order must be 1 or 2, got 0."),
    "order text": (lambda: _scene(order="1"), "Scene: order must be 1 or 2, got '1'."),
    "order 1.0": (lambda: _scene(order=1.0), "Scene: order must be 1 or 2, got 1.0."),
    "mass list": (
        lambda: _scene(mass=["lumped"]),
        "Scene: mass must be 'lumped' or 'consistent', got ['lumped'].",
    ),
    "mass none": (
        lambda: _scene(mass=None),
        "Scene: mass must be 'lumped' or 'consistent', got None.",
    ),
    "scheme text": (
        lambda: _scene(scheme="midpoint"),
        "Scene: scheme must be EnergyMomentum(), Midpoint() or",
    ),
    "scheme class": (
        lambda: _scene(scheme=rf.Midpoint),
        "Scene: scheme must be EnergyMomentum(), Midpoint() or",
    ),
    "scheme material": (
        lambda: _scene(scheme=SOFT),
        "Scene: scheme must be EnergyMomentum(), Midpoint() or",
    ),
    "scheme namespace": (
        lambda: _scene(scheme=types.SimpleNamespace(virtual_work=1)),
        "Scene: scheme must be EnergyMomentum(), Midpoint() or",
    ),
    "tets second lumped": (
        lambda: _scene(domain=rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), "tetrahedron"), order=2),
        "Scene: second-order tetrahedra have negative lumped masses at",
    ),
    "domain path": (
        lambda: rf.Scene("bar.msh", SOFT),
        "Scene: domain must be a Domain (box, from_arrays, read_msh, or",
    ),
    "domain mesh": (
        lambda: rf.Scene(_box().mesh, SOFT),
        "Scene: domain must be a Domain (box, from_arrays, read_msh, or",
    ),
    "domain none": (
        lambda: rf.Domain(None),
        "Domain: mesh must be a mesh of DOLFINx, got None. Files are",
    ),
    "domain sets text": (
        lambda: rf.Domain(_box().mesh, "x0"),
        "Domain: sets must be a list of EntitySet, got 'x0'. Sets are",
    ),
    "domain sets tuples": (
        lambda: rf.Domain(_box().mesh, [("x0", 2, [0])]),
        "Domain: sets must be a list of EntitySet, got [('x0', 2, [0])].",
    ),
    "box true": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (True, True, True)),
        "box: cells must be three whole numbers ≥ 1, got (True, True,",
    ),
    "box numpy true": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), np.array([True, True, True])),
        "box: cells must be three whole numbers ≥ 1, got array([ True,  True,  True])",
    ),
    "box floats": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1.0, 1.0, 1.0)),
        "box: lower and upper must be three numbers each and cells three",
    ),
    "box zero": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (0, 1, 1)),
        "box: cells must be three whole numbers ≥ 1, got (0, 1, 1).",
    ),
    "box negative": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (-1, 1, 1)),
        "box: cells must be three whole numbers ≥ 1, got (-1, 1, 1).",
    ),
    "box number": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), 2),
        "box: lower and upper must be three numbers each and cells three",
    ),
    "box two": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1)),
        "box: cells must be three whole numbers ≥ 1, got (1, 1).",
    ),
    "box of more cells than are counted": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (10**6, 10**6, 10**6)),
        "box: (1000000, 1000000, 1000000) cells are more than the 2147483647 that are counted",
    ),
    "order of 5000 digits": (
        lambda: _scene(order=10**5000),
        "Scene: order must be 1 or 2, got something of type int",
    ),
    "box four": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1, 1)),
        "box: cells must be three whole numbers ≥ 1, got (1, 1, 1, 1).",
    ),
    "box text": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), "111"),
        "box: lower and upper must be three numbers each and cells three",
    ),
    "box swapped": (
        lambda: rf.box((1, 1, 1), (0, 0, 0), (1, 1, 1)),
        "box: lower and upper must be three finite numbers each, and",
    ),
    "box flat": (
        lambda: rf.box((0, 0, 0), (1, 0, 1), (1, 1, 1)),
        "box: lower and upper must be three finite numbers each, and",
    ),
    "box thin as rounding": (
        lambda: rf.box((1e16, 0, 0), (1e16 + 2, 1, 1), (4, 1, 1)),
        "The mesh has inverted or flat cells, the first around (1e+16,",
    ),
    "box overflow": (
        lambda: rf.box((-1.7e308, 0, 0), (1.7e308, 1, 1), (2, 1, 1)),
        "The mesh has nodes whose coordinates are not finite.",
    ),
    "box subnormal": (
        lambda: _scene(domain=rf.box((0, 0, 0), (1e-320, 1, 1), (2, 1, 1))),
        "box: from (0, 0, 0) m to (1e-320, 1, 1) m: Box seems to have",
    ),
    "box tiny": (
        lambda: _scene(domain=rf.box((0, 0, 0), (1e-110, 1e-110, 1e-110), (2, 1, 1))),
        "box: from (0, 0, 0) m to (1e-110, 1e-110, 1e-110) m: Box seems",
    ),
    "box huge": (
        lambda: _scene(domain=rf.box((0, 0, 0), (1e110, 1e110, 1e110), (2, 1, 1))),
        "The mesh has inverted or flat cells, the first around",
    ),
    "box comm": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), comm="world"),
        "box: comm must be a communicator of mpi4py, such as",
    ),
    "box comm null": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), comm=MPI.COMM_NULL),
        "box: comm must be a communicator of mpi4py, such as",
    ),
    "box cell prism": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), "prism"),
        "box: cell must be one of ['hexahedron', 'tetrahedron'], got",
    ),
    "box cell 2D": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), "triangle"),
        "box: cell must be one of ['hexahedron', 'tetrahedron'], got",
    ),
    "arrays comm": (
        lambda: rf.from_arrays(np.zeros((8, 3)), np.arange(8)[None], comm=0),
        "from_arrays: comm must be a communicator of mpi4py, such as",
    ),
    "arrays index out": (
        lambda: rf.from_arrays(np.eye(4, 3), [[0, 1, 2, 9]], "tetrahedron"),
        "from_arrays: cells name points outside 0 … 3.",
    ),
    "arrays index negative": (
        lambda: rf.from_arrays(np.eye(4, 3), [[0, 1, 2, -1]], "tetrahedron"),
        "from_arrays: cells name points outside 0 … 3.",
    ),
    "arrays corner twice": (
        lambda: rf.from_arrays(*_of_one_rank(np.eye(4, 3), [[0, 1, 2, 2]]), "tetrahedron"),
        "from_arrays: cell 0 names node 2 2 times: it is flat.",
    ),
    "arrays points twice": (
        lambda: rf.from_arrays(*_of_one_rank(np.zeros((4, 3)), [[0, 1, 2, 3]]), "tetrahedron"),
        "The mesh has inverted or flat cells, the first around (0, 0,",
    ),
    "arrays None": (
        lambda: rf.from_arrays(None, None),
        "from_arrays: points must be real numbers of shape (n, 3), got",
    ),
    "criterion period 0": (
        lambda: rf.StrainRate(1.0, 0.0),
        "StrainRate: window must be a finite number > 0, got 0.0.",
    ),
    "criterion kappa": (
        lambda: rf.StrainRate(1.0, 1.0, wake="local", kappa=0.0),
        "StrainRate: kappa must be ≥ 1, got 0.0.",
    ),
    "criterion kappa nan": (
        lambda: rf.StrainRate(1.0, 1.0, wake="local", kappa=np.nan),
        "StrainRate: kappa must be a finite number, got nan.",
    ),
    "criterion wake": (
        lambda: rf.StrainRate(1.0, 1.0, wake="never"),
        "StrainRate: wake must be 'all', 'local' or 'none', got 'never'.",
    ),
    "criterion wake list": (
        lambda: rf.StrainRate(1.0, 1.0, wake=["all"]),
        "StrainRate: wake must be 'all', 'local' or 'none', got ['all'].",
    ),
    "criterion until before since": (
        lambda: rf.StrainRate(1.0, 1.0, since=2.0, until=1.0),
        "StrainRate: needs since < until, got 2.0 … 1.0.",
    ),
    "criterion with trapezoidal": (
        lambda: _run(criterion=rf.StrainRate(1.0, 1.0), scheme=rf.Trapezoidal()),
        "simulate: Trapezoidal does not couple to rigid bodies; take",
    ),
    "dt empty dict": (
        lambda: _run(dt={}),
        "simulate: dt must be a finite number > 0, or a dict of times to",
    ),
    "dt dict late": (
        lambda: _run(dt={1.0: 0.1}),
        "simulate: dt must be a finite number > 0, or a dict of times to",
    ),
    "dt dict nan": (
        lambda: _run(dt={0: 0.1, np.nan: 0.1}),
        "simulate: a time of dt must be a finite number, got nan.",
    ),
    "dt dict None": (lambda: _run(dt={0: None}), "simulate: dt must be a finite number, got None."),
    "dt timedelta": (
        lambda: _run(dt=datetime.timedelta(seconds=1)),
        "simulate: dt must be a finite number, got",
    ),
    "dt nan": (lambda: _run(dt=np.nan), "simulate: dt must be a finite number, got nan."),
    "dt huge": (
        lambda: _run(dt=1e300, t_end=1e308),
        "simulate: dt = 1e+300 s is no step to compute with",
    ),
    "dt tiny": (
        lambda: _run(dt=1e-300, t_end=3e-300),
        "simulate: dt = 1e-300 s is no step to compute with",
    ),
    "t_end datetime": (
        lambda: _run(t_end=np.datetime64("2020")),
        "simulate: t_end must be a finite number, got",
    ),
    "t_end zero": (
        lambda: _run(t_end=0.0),
        "simulate: t_end must be a finite number > 0, got 0.0.",
    ),
    "petsc list": (
        lambda: rf.simulate(_scene(), 0.1, 0.2, petsc_options=["ksp_type"]),
        "simulate: petsc_options must be a dict of PETSc's options",
    ),
    "petsc text": (
        lambda: rf.simulate(_scene(), 0.1, 0.2, petsc_options="-ksp_type cg"),
        "simulate: petsc_options must be a dict of PETSc's options",
    ),
    "petsc number name": (
        lambda: rf.simulate(_scene(), 0.1, 0.2, petsc_options={1: "cg"}),
        "simulate: petsc_options: 1 is no option of the solver; names",
    ),
    "petsc value list": (
        lambda: rf.simulate(_scene(), 0.1, 0.2, petsc_options={"ksp_type": ["cg"]}),
        "simulate: petsc_options: ksp_type must be a text or a number,",
    ),
    "petsc unknown type": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"ksp_type": "fast"})),
        "PETSc cannot solve with the options -rigidfx_ksp_type fast:",
    ),
    "petsc unknown pc": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"pc_type": "magic"})),
        "PETSc cannot solve with the options -rigidfx_pc_type magic:",
    ),
    "petsc rtol text": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"ksp_rtol": "small"})),
        "PETSc cannot solve with the options -rigidfx_ksp_rtol small:",
    ),
    "petsc rtol nan": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"snes_rtol": np.nan})),
        "PETSc cannot solve with the options -rigidfx_snes_rtol nan:",
    ),
    "petsc negative": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"snes_rtol": -1.0})),
        "The option -rigidfx_snes_rtol -1.0 cannot be honoured: a",
    ),
    "petsc dash": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"-ksp_type": "cg"})),
        "simulate: petsc_options: '-ksp_type' is no option of the",
    ),
    "petsc space": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"ksp_type cg": ""})),
        "simulate: petsc_options: 'ksp_type cg' is no option of the",
    ),
    "monitor number": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, monitor=3)),
        "simulate: monitor must be a function of the number of an",
    ),
    "progress list": (
        lambda: rf.simulate(_scene(), 0.1, 0.2, progress=[]),
        "simulate: progress must be True, False or None, got [].",
    ),
    "geo path none": (
        lambda: rf.read_geo(None),
        "gmsh: 'None' failed with TypeError: argument should be a str or",
    ),
    "geo params list": (
        lambda: rf.read_geo("x.geo", [1]),
        "read_geo: parameters must be a dict of names to numbers or",
    ),
    "msh scale": (
        lambda: rf.read_msh("tests/none.msh", scale=-1.0),
        "read_msh: scale must be a finite number > 0, got -1.0.",
    ),
    "gmsh no function": (
        lambda: rf.from_gmsh(3),
        "from_gmsh: the function that builds the model failed with",
    ),
    "gmsh empty": (
        lambda: rf.from_gmsh(lambda g: None),
        "The model has no physical group of volume cells (dimension 3)",
    ),
    "gmsh fails": (
        lambda: rf.from_gmsh(lambda g: 1 / 0),
        "from_gmsh: the function that builds the model failed with",
    ),
    "gmsh no arg": (
        lambda: rf.from_gmsh(lambda: None),
        "from_gmsh: the function that builds the model failed with",
    ),
    "gmsh surface": (
        lambda: rf.from_gmsh(
            lambda g: (
                g.model.occ.addRectangle(0, 0, 0, 1, 1),
                g.model.occ.synchronize(),
                g.model.mesh.generate(2),
            )
        ),
        "The model has no physical group of volume cells (dimension 3)",
    ),
    "gmsh finalizes": (lambda: rf.from_gmsh(lambda g: g.finalize()), "has ended gmsh (finalize)"),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CASES)
def test_is_refused(name):
    refusals.check(*CASES[name])


@pytest.mark.parametrize(
    "fails",
    [
        lambda: _run(rf.Fixed("x0"), rf.Traction("x1", (1e308, 1e308, 1e308))),
        lambda: _run(rf.Fixed("x0"), rf.Gravity(), material=STIFF),
        lambda: _run(rf.PrescribedMotion("x0", displacement=lambda t: (1e300 * t, 0, 0))),
        lambda: _run(rf.InitialVelocity(linear=(1e200, 0, 0))),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_numbers_that_overflow_in_a_step(fails):
    """They are finite, so that only the step can tell: by its own error, not one of NumPy's."""
    with pytest.raises(rf.StepError, match="did not converge"):
        fails()


SPRUNG = {
    "stressed at rest": (lambda C: ufl.tr(C), "has a stress of 2 Pa at rest"),
    "of the wrong sign": (
        lambda C: -ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3)),
        "falls where rest is strained, by",
    ),
}


@pytest.mark.parametrize("name", SPRUNG)
def test_energy_that_is_not_at_rest_is_warned_of(name):
    energy, message = SPRUNG[name]
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
        domain = _box()
        x = ufl.SpatialCoordinate(domain.mesh)
        placed = rf.Hyperelastic(
            rho=1.0, W=lambda C: (1 + x[0]) * ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3))
        )
        _scene(material=placed, domain=domain)


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    """The same cases on two ranks: the same message on both, and no rank waits for the other."""
    refusals.check_on_two_ranks(__file__, CASES)


if __name__ == "__main__":
    refusals.on_each_rank({name: action for name, (action, _) in CASES.items()})
