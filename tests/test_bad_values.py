"""Input that is refused by name: odd values, functions, containers, names, energies and sizes.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

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


def _stops(t):
    raise StopIteration


# name: (what is done, part of the message)
CASES = {
    "class of an effect": (
        lambda: _scene(rf.Gravity),
        "Scene: <class 'rigidfx.effects.loads.dead_load.Gravity'> is not an",
    ),
    "one effect": (
        lambda: rf.Scene(_box(), SOFT, rf.Gravity()),
        "Scene: effects must be a list of effects, got",
    ),
    "a scene as a material": (
        lambda: _scene(material=_scene()),
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
    "where empty": (
        lambda: _scene(rf.Fixed("")),
        "Fixed: there are no facets or cells or edges or vertices named",
    ),
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
    "pressure inside": (
        lambda: _scene(
            rf.Pressure("a", 1.0), domain=_box().with_facets("a", lambda x: np.abs(x[0] - 1) < 1e-9)
        ),
        "inside the mesh and for none of its boundary, which with_facets names",
    ),
    "probe name surrogate": (
        lambda: _scene(probes={"\ud800": (0, 0, 0)}),
        "Scene: the name of a probe must be one that can be printed, got",
    ),
    "probes text": (
        lambda: _scene(probes="tip"),
        "Scene: probes must be a dict of names to three numbers each,",
    ),
    "set name surrogate": (
        lambda: _box().with_facets("\ud800", lambda x: x[0] < 1e-9),
        "The name of a set must be a text that is not empty, and can be",
    ),
    "marker that stops an iteration": (
        lambda: _box().with_facets("a", _stops),
        "The marker of 'a' failed with StopIteration:",
    ),
    "window swapped": (
        lambda: rf.Gravity(since=2.0, until=1.0),
        "Gravity: the time window needs since < until, got 2.0 … 1.0.",
    ),
    "gravity of a function of nothing": (
        lambda: _run(rf.Gravity(lambda: (0, 0, 1))),
        "Gravity on 'all cells': its function of time failed with",
    ),
    "factor that later stops an iteration": (
        lambda: _run(rf.Gravity(time=lambda t: 1.0 if t < 0.2 else _stops(t))),
        "Gravity on 'all cells': its value or time function failed at t",
    ),
    "load that later has two numbers": (
        lambda: _run(rf.Gravity(lambda t: (0, 0, 1.0) if t < 0.2 else (0, 1.0))),
        "Gravity on 'all cells': at t = 0.25 s three finite components",
    ),
    "factor number": (
        lambda: _run(rf.Gravity(time=1.0)),
        "Gravity: time must be a function of t, got 1.0.",
    ),
    "factor overflow": (
        lambda: _run(rf.Gravity(time=lambda t: 10**400)),
        "Gravity on 'all cells': at t = 0 s three finite components are",
    ),
    "density subnormal": (
        lambda: _run(material=rf.NeoHooke(rho=5e-324, E=1.0, nu=0.3)),
        "Scene: a node has the lumped mass 0 kg ≤ 0 (strongly curved",
    ),
    "mooney negative": (
        lambda: rf.MooneyRivlin(rho=1.0, c10=-1.0, c01=0.0, kappa=1.0),
        "MooneyRivlin: c10 + c01 must be a finite number > 0, got -1.0.",
    ),
    "energy constant": (
        lambda: _material(lambda C: 1.0),
        "Scene: the stored energy of Hyperelastic does not depend on C.",
    ),
    "energy None": (
        lambda: _material(lambda C: None),
        "Scene: the stored energy of Hyperelastic cannot be formed:",
    ),
    "energy tensor": (
        lambda: _material(lambda C: C),
        "Scene: the stored energy of Hyperelastic must be a scalar.",
    ),
    "energy not called": (
        lambda: _material(3.0),
        "Hyperelastic: W must be a function of C giving UFL, got 3.0.",
    ),
    "energy of other mesh": (
        lambda: _material(lambda C: C[0, 0] * ufl.SpatialCoordinate(_box().mesh)[0]),
        "Scene: the stored energy of Hyperelastic is of another mesh",
    ),
    "point mass zero": (
        lambda: rf.PointMass("x1", 0.0),
        "PointMass: mass must be a finite number > 0, got 0.0.",
    ),
    "spring negative": (
        lambda: rf.Spring("x1", -1.0),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring indefinite": (
        lambda: rf.Spring("x1", [[0, 1, 0], [1, 0, 0], [0, 0, 0]]),
        "Spring on 'x1': stiffness must be a number ≥ 0, three of them,",
    ),
    "spring damping negative": (
        lambda: rf.Spring("x1", 1.0, damping=-1.0),
        "Spring on 'x1': damping must be a number ≥ 0, three of them, or",
    ),
    "damping zero": (
        lambda: rf.MassDamping(0.0),
        "MassDamping: alpha must be a finite number > 0, got 0.0.",
    ),
    "viscosity negative": (
        lambda: rf.KelvinVoigt(-1.0),
        "KelvinVoigt: eta must be a finite number > 0, got -1.0.",
    ),
    "xi one": (
        lambda: rf.NumericalDamping(1.0),
        "NumericalDamping: xi must lie in [0, 1/2], got 1.0.",
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
    "rigid twice": (
        lambda: _scene(rf.Rigid(), rf.Rigid()),
        "Scene: a cell can be in one Rigid body only, and Rigid on 'all cells' and "
        "Rigid on 'all cells' hold the same ones.",
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
    "resultant unknown": (
        lambda: _scene(rf.Rigid(), rf.Resultant("b", force=(1, 0, 0))),
        "Resultant: 'b' is not the name of a Rigid body; there are",
    ),
    "fixed components": (
        lambda: rf.Fixed("x0", "xx"),
        "Fixed on 'x0': components must be some of 'xyz', each once, got",
    ),
    "motion number": (
        lambda: rf.PrescribedMotion("x0", displacement=1.0),
        "PrescribedMotion on 'x0': displacement must be a function of t,",
    ),
    "motion table": (
        lambda: _scene(rf.PrescribedMotion("x0", displacement=rf.Table((0, 1), (0, 1)))),
        "PrescribedMotion on 'x0': at t = 0 s three finite components",
    ),
    "motion nan later": (
        lambda: _run(
            rf.PrescribedMotion("x0", displacement=lambda t: (np.nan if t > 0.15 else 0, 0, 0))
        ),
        "PrescribedMotion on 'x0': near t = 0.2 s its path or velocity",
    ),
    "preload of a pressure": (
        lambda: _scene(rf.Fixed("x0"), rf.Preload([rf.Pressure("x1", 1.0)])),
        "Preload: loads must be one or more dead loads, got",
    ),
    "preload increments zero": (
        lambda: rf.Preload([rf.Gravity()], increments=0),
        "Preload: increments must be a whole number ≥ 1, got 0.",
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
    "velocity function const": (
        lambda: _scene(rf.InitialVelocity(function=(1, 0, 0))),
        "InitialVelocity: function must be callable.",
    ),
    "velocity function shape": (
        lambda: _scene(rf.InitialVelocity(function=lambda x: np.zeros((2, x.shape[1])))),
        "InitialVelocity: function must map (3, n) to (3, n); it failed",
    ),
    "table down": (
        lambda: rf.Table((1, 0), (0, 1)),
        "Table: times must increase strictly; a jump takes a time",
    ),
    "table lengths": (
        lambda: rf.Table((0, 1), (0,)),
        "Table: times and values must be lists of numbers, of the same",
    ),
    "order three": (lambda: _scene(order=3), "Scene: order must be 1 or 2, got 3."),
    "mass list": (
        lambda: _scene(mass=["lumped"]),
        "Scene: mass must be 'lumped' or 'consistent', got ['lumped'].",
    ),
    "scheme namespace": (
        lambda: _scene(scheme=types.SimpleNamespace(virtual_work=1)),
        "Scene: scheme must be EnergyMomentum(), Midpoint() or",
    ),
    "tets second lumped": (
        lambda: _scene(domain=rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), "tetrahedron"), order=2),
        "Scene: second-order tetrahedra have negative lumped masses at",
    ),
    "domain none": (
        lambda: rf.Domain(None),
        "Domain: mesh must be a mesh of DOLFINx, got None. Files are",
    ),
    "domain sets tuples": (
        lambda: rf.Domain(_box().mesh, [("x0", 2, [0])]),
        "Domain: sets must be a list of EntitySet, got [('x0', 2, [0])].",
    ),
    "box true": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (True, True, True)),
        "box: cells must be three whole numbers ≥ 1, got (True, True,",
    ),
    "box floats": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1.0, 1.0, 1.0)),
        "box: lower and upper must be three numbers each and cells three",
    ),
    "box of more cells than are counted": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (10**6, 10**6, 10**6)),
        "box: (1000000, 1000000, 1000000) cells are more than the 2147483647 that are counted",
    ),
    "order of 5000 digits": (
        lambda: _scene(order=10**5000),
        "Scene: order must be 1 or 2, got something of type int",
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
    "box comm null": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), comm=MPI.COMM_NULL),
        "box: comm must be a communicator of mpi4py, such as",
    ),
    "box cell prism": (
        lambda: rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), "prism"),
        "box: cell must be one of ['hexahedron', 'tetrahedron'], got",
    ),
    "arrays index out": (
        lambda: rf.from_arrays(np.eye(4, 3), [[0, 1, 2, 9]], "tetrahedron"),
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
    "criterion kappa": (
        lambda: rf.StrainRate(1.0, 1.0, wake="local", kappa=0.0),
        "StrainRate: kappa must be ≥ 1, got 0.0.",
    ),
    "criterion wake": (
        lambda: rf.StrainRate(1.0, 1.0, wake="never"),
        "StrainRate: wake must be 'all', 'local' or 'none', got 'never'.",
    ),
    "criterion until before since": (
        lambda: rf.StrainRate(1.0, 1.0, since=2.0, until=1.0),
        "StrainRate: needs since < until, got 2.0 … 1.0.",
    ),
    "criterion with trapezoidal": (
        lambda: _run(criterion=rf.StrainRate(1.0, 1.0), scheme=rf.Trapezoidal()),
        "simulate: Trapezoidal does not couple to rigid bodies; take",
    ),
    "dt dict late": (
        lambda: _run(dt={1.0: 0.1}),
        "simulate: dt must be a finite number > 0, or a dict of times to",
    ),
    "dt dict None": (lambda: _run(dt={0: None}), "simulate: dt must be a finite number, got None."),
    "dt huge": (
        lambda: _run(dt=1e300, t_end=1e308),
        "simulate: dt = 1e+300 s is no step to compute with",
    ),
    "dt tiny": (
        lambda: _run(dt=1e-300, t_end=3e-300),
        "simulate: dt = 1e-300 s is no step to compute with",
    ),
    "t_end zero": (
        lambda: _run(t_end=0.0),
        "simulate: t_end must be a finite number > 0, got 0.0.",
    ),
    "petsc unknown type": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"ksp_type": "fast"})),
        "PETSc cannot solve with the options -rigidfx_ksp_type fast:",
    ),
    "petsc negative": (
        lambda: list(rf.simulate(_scene(), 0.1, 0.2, petsc_options={"snes_rtol": -1.0})),
        "The option -rigidfx_snes_rtol -1.0 cannot be honoured: a",
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
    "gmsh fails": (
        lambda: rf.from_gmsh(lambda g: 1 / 0),
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
