"""Values are taken as they are when they are given, and what is shown cannot change a run."""

import copy
import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from dolfinx import fem
from records import RECORDS, nothing

import rigidfx as rf
from rigidfx.domain.domain import EntitySet
from rigidfx.effects.supports import Support
from rigidfx.plot import Curve
from rigidfx.report.report import Report

# Supports that move from t = 0 on, and a spring that turns with its end.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.* acts with a jolt"),
    pytest.mark.filterwarnings("ignore:Spring on .* have turned by"),
]

SOFT = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)


NOT_GIVEN = {
    rf.Checkpoint,
    rf.Domain,
    rf.Modes,
    rf.Report,
    rf.Material,
}  # made by rigidfx, or a base
SCHEMES = {rf.EnergyMomentum, rf.Midpoint, rf.Trapezoidal}


def _spoil(value):
    """Change whatever can be changed, in place."""
    if isinstance(value, np.ndarray):
        value.setflags(write=True)
        value[...] = 77
    elif isinstance(value, dict):
        list(map(_spoil, value.values()))
        value.clear()
    elif isinstance(value, list):
        list(map(_spoil, value))
        value.clear()


def _fixed(value):
    """Whether nobody can change a value."""
    if isinstance(value, np.ndarray):
        return not value.flags.writeable
    if isinstance(value, Mapping):
        return not hasattr(value, "clear") and all(map(_fixed, value.values()))
    if isinstance(value, tuple):
        return all(map(_fixed, value))
    return not isinstance(value, (list, set))


def test_every_record_has_a_case():
    """A new effect has to say what it is made from."""
    everything = [getattr(rf, name) for name in rf.__all__]
    records = {item for item in everything if inspect.isclass(item) and is_dataclass(item)}
    assert records - NOT_GIVEN - SCHEMES == RECORDS.keys() - {Curve, EntitySet}


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_record_follows_no_later_change(record):
    given = RECORDS[record]()
    made, expected = record(**given), record(**copy.deepcopy(given))
    for value in given.values():
        _spoil(value)
    for field in fields(record):
        found = getattr(made, field.name)
        assert _fixed(found), field.name
        assert repr(found) == repr(getattr(expected, field.name)), field.name


def test_constant_of_dolfinx_is_a_number():
    """It can be called, as can all of UFL; its kinetic energy was negative once it changed."""
    domain = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1))
    constant = fem.Constant(domain.mesh, 50.0)
    effects = [rf.PointMass("x1", constant), rf.InitialVelocity(linear=(1.0, 0, 0))]
    rigid, pressure = rf.Rigid(mass=constant), rf.Pressure("x1", constant)
    constant.value = -50.0
    assert rigid.mass == pressure.value == pressure.intensity(0.0) == 50.0
    reports = rf.simulate(rf.Scene(domain, SOFT, effects), 0.1, 0.1)
    assert next(reports).kinetic == pytest.approx(0.5 * (50.0 + 2.0), rel=1e-14)
    reports.close()
    with pytest.raises(rf.SceneError, match="time must be a function of t"):
        rf.Traction("x1", (0, 0, 1), time=constant)


def test_single_precision_is_that_of_the_value_only():
    """Parameters that are computed from it have all digits."""
    given = rf.NeoHooke(rho=1.0, E=np.float32(50.0), nu=0.3)
    assert given.parameters == rf.NeoHooke(rho=1.0, E=50.0, nu=0.3).parameters


def test_breakpoints_of_a_function_are_taken():
    def pushed(t):
        return (t, 0.0, 0.0)

    pushed.breakpoints = instants = [0.2]
    load = rf.Traction("x1", pushed, until=2.0)
    motion = rf.PrescribedMotion("x1", displacement=pushed, since=0.1)
    instants.append(0.3)
    pushed.breakpoints = [0.4]
    assert load.breakpoints == (2.0, 0.2)
    assert motion.breakpoints == (0.1, 0.2)
    assert load.value is motion.displacement is pushed


def test_names_in_a_set_have_an_order():
    """That of a set is another one on each rank."""
    names = {f"part {k}" for k in range(9)}
    assert rf.StrainRate(1.0, 1.0, never=names).never == tuple(sorted(names))
    assert rf.StrainRate(1.0, 1.0, never=["b", "a"]).never == ("b", "a")


# Functions that change one array in place -------------------------------------------------------


def _fresh(function):
    return function


def _in_place(function):
    """A function that gives one array each time, with other numbers in it."""
    array = np.zeros(np.shape(function(0.1)))

    def changed(t):
        array[...] = function(t)
        return array

    return changed


class Lifted(Support):
    """A support of a user's own, whose motion is a function's."""

    moves = True
    path = staticmethod(nothing)

    def displacements_at(self, t, X):
        return self.path(t)

    def velocities_at(self, t, dt, X, x):
        return np.array([0.0, 0.0, 0.05])

    def same_motion(self, other):
        return self is other


def _lifted(function):
    effect = Lifted("x0")
    object.__setattr__(effect, "path", function(lambda t: np.array([0.0, 0.0, 0.05 * t])))
    return effect


def _wave(t):
    return (0.0, 0.0, 0.3 * np.sin(2 * t))


def _ramp(t):
    return (0.05 * t, 0.0, 0.0)


def _speed(t):
    return (0.05, 0.0, 0.0)


FUNCTIONS = {
    "path": lambda f: [rf.PrescribedMotion("x0", displacement=f(_ramp))],
    "path and velocity": lambda f: [
        rf.PrescribedMotion("x0", displacement=f(_ramp), velocity=f(_speed))
    ],
    "support of one's own": lambda f: [_lifted(f)],
    "traction": lambda f: [rf.Traction("x1", f(_wave))],
    "nodal force": lambda f: [rf.NodalForce("x1", f(_wave))],
    "body force": lambda f: [rf.BodyForce(f(_wave))],
    "gravity": lambda f: [rf.Gravity(f(_wave))],
    "one function of two loads": lambda f: [
        rf.Traction("x1", shared := f(_wave)),
        rf.BodyForce(shared),
    ],
    "factor": lambda f: [rf.Traction("x1", (0, 0, 1), time=f(np.sin))],
    "pressure": lambda f: [rf.Pressure("x1", f(np.sin))],
    "factor of a pressure": lambda f: [rf.Pressure("x1", 1.0, time=f(np.sin))],
    "factor of a resultant": lambda f: [
        rf.Rigid(),
        rf.Resultant(force=(0, 0, 1), time=f(np.sin)),
    ],
    "preload": lambda f: [rf.Fixed("x0"), rf.Preload(rf.Gravity(f(lambda t: (0, 0, -0.1))))],
}


def _bar(*effects, cells=(2, 1, 1), **options):
    domain = rf.box((0, 0, 0), (4, 1, 1), cells)
    domain = domain.with_cells("left", lambda x: x[0] < 2.0 + 1e-9)
    return rf.Scene(domain, SOFT, effects, **options)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_may_change_its_array_in_place(name):
    """The run is the same to the last bit as with an array of its own each time."""
    ends = []
    for function in (_fresh, _in_place):
        scene = _bar(*FUNCTIONS[name](function), probes={"foot": (0, 0, 0), "tip": (4, 1, 1)})
        *_, last = rf.simulate(scene, 0.1, 0.5)
        ends.append([*last.probes["foot"], *last.probes["tip"], last.energy, last.kinetic])
    assert np.any(ends[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-14)  # places in memory make one digit
    if name.startswith("path"):
        assert ends[1][0] == pytest.approx(0.025, rel=1e-14)


def test_change_of_a_load_in_place_is_seen():
    """A load that swings releases what has become rigid, whoever owns its array."""
    runs = []
    for function in (_fresh, _in_place):
        scene = _bar(rf.Fixed("x0"), rf.Traction("x1", function(_wave)), cells=(4, 1, 1))
        rule = rf.StrainRate(1.0, 0.2, wake="all")
        with pytest.warns(rf.RigidfxWarning, match="released again and again"):
            reports = list(rf.simulate(scene, 0.1, 3.0, rigidify=rule))
        runs.append((sum(len(report.events) for report in reports), reports[-1].energy))
    assert runs[0][0] >= 6
    assert runs[0] == pytest.approx(runs[1], rel=1e-12)


def test_initial_velocity_may_change_the_positions_in_place():
    """They are its own: neither the centre of the spin nor a second function sees that."""

    def doubled(x):
        x *= 2
        return x

    spin = {"angular": (0, 0, 1.0), "centre": (0.0, 0, 0)}
    kinetic = []
    for function in (doubled, lambda x: 2 * x):
        effects = [rf.InitialVelocity(function=function) for _ in range(2)]
        reports = rf.simulate(_bar(*effects, rf.InitialVelocity(**spin)), 0.1, 0.1)
        kinetic.append(next(reports).kinetic)
        reports.close()
    assert kinetic[0] == kinetic[1] > 0


# What scenes and runs are made from -------------------------------------------------------------


def test_inertia_is_the_one_that_was_checked():
    """½ ω·J ω of the given inertia; it was negative."""
    inertia = np.eye(3)
    rigid = rf.Rigid(mass=1.0, inertia=inertia)
    inertia *= -1
    reports = rf.simulate(_bar(rigid, rf.InitialVelocity(angular=(1, 1, 1))), 0.1, 0.1)
    assert next(reports).kinetic == pytest.approx(1.5, rel=1e-14)
    reports.close()


def test_scene_follows_no_later_change():
    domain = rf.box(corner := [0.0, 0, 0], size := np.array([4.0, 1, 1]), (4, 1, 1))
    cells = np.arange(domain.mesh.topology.index_map(3).size_local)
    domain = domain.with_cell_set("all", cells)
    given = {
        "material": {"all": SOFT},
        "effects": [rf.Gravity(np.array([0, 0, -1.0]))],
        "probes": {"tip": np.array([4.0, 1, 1]), "foot": [0, 0, 0]},
    }
    scene = rf.Scene(domain, **given)
    for value in (corner, size, cells, *given.values()):
        _spoil(value)
    assert scene.materials[0][0] is SOFT
    assert [effect.kind for effect in scene.effects] == ["Gravity"]
    assert {name: point.tolist() for name, point in scene.probes.items()} == {
        "tip": [4, 1, 1],
        "foot": [0, 0, 0],
    }
    assert scene.mesh.geometry.x.max() == 4.0
    assert domain.find("all", (3,), "test").entities.size == scene.materials[0][1].size > 0


def test_mesh_follows_no_later_change_of_its_arrays():
    points = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    cells = np.arange(8)[None]
    domain = rf.from_arrays(points, cells)
    _spoil(points)
    _spoil(cells)
    assert (domain.mesh.geometry.x.min(), domain.mesh.geometry.x.max()) == (0.0, 1.0)


def test_run_follows_no_later_change():
    """Steps and options are those that `simulate` was given, though it begins when asked."""
    steps = {0: 0.1, 0.2: np.array(0.05)}
    end, options = np.array(0.3), {"snes_max_it": 20}
    reports = rf.simulate(_bar(rf.Gravity()), steps, end, petsc_options=options)
    for value in (steps, end, options):
        _spoil(value)
    assert [report.dt for report in reports] == pytest.approx([0, 0.1, 0.1, 0.05, 0.05])


# What is shown ----------------------------------------------------------------------------------

FUNCTIONS_OF_DOLFINX = {"u", "v"}  # of a state: whole functions, documented as not to be changed


def _arrays(item, seen):
    """All arrays that can be reached from an object of rigidfx by attributes and items."""
    if isinstance(item, np.ndarray):
        yield item
    elif isinstance(item, Mapping):
        for value in item.values():
            yield from _arrays(value, seen)
    elif isinstance(item, (tuple, list)):
        for value in item:
            yield from _arrays(value, seen)
    elif type(item).__module__.startswith("rigidfx.") and id(item) not in seen:
        seen[id(item)] = item
        names = {name for name in dir(item) if not name.startswith("_")} - FUNCTIONS_OF_DOLFINX
        for name in names - {"at_rest"}:  # new bodies each time
            value = getattr(item, name)
            if not callable(value):
                yield from _arrays(value, seen)


def test_what_is_shown_cannot_change_a_run():
    """With every array of every report overwritten that can be, a run goes on as without."""
    release = rf.Release(at=0.7)
    ends = []
    for spoils in (False, True):
        scene = _bar(
            rf.InitialVelocity(angular=(0.1, 0.2, 0.3)),
            rf.Rigid("left", mass=3.0),
            rf.Spring("x0", 1.0),
            cells=(6, 1, 1),
            probes={"tip": (4, 1, 1)},
        )
        criterion = rf.StrainRate(10.0, 0.3, release=release, min_cells=1, patience=1)
        count, reports = 0, rf.simulate(scene, 0.1, 1.5, rigidify=criterion)
        for report in reports:
            last = [report.energy, report.kinetic, *report.angular_momentum, *report.probes["tip"]]
            count += len(report.events)
            for array in _arrays(report, {}) if spoils else ():
                if array.flags.writeable:
                    array[...] = 77
        ends.append([count, *last])
    assert ends[0][0] >= 2
    assert ends[0] == pytest.approx(
        ends[1], rel=1e-10
    )  # sums end in another last bit where arrays lie elsewhere


def test_arrays_of_a_scene_are_read_only():
    scene = _bar(rf.Fixed("x0"), rf.PointMass("x1", 2.0), probes={"tip": (4, 1, 1)})
    shown = [scene.nodal_mass, scene.point_masses, *scene.probes.values()]
    shown += [nodes for _, nodes in scene.supports] + [cells for _, cells in scene.materials]
    shown += [found.entities for found in scene.domain.sets.values()]
    assert len(shown) > 9
    assert not any(array.flags.writeable for array in shown)


def test_strain_rates_of_a_report_are_read_only():
    reports = rf.simulate(_bar(rf.Gravity()), 0.1, 0.1, rigidify=rf.StrainRate(1.0, 0.1))
    for report in reports:
        assert isinstance(report, Report)
        assert not report.strain_rate.flags.writeable
