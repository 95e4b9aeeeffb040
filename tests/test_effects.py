"""Effects: balances, closed forms, where and when loads arrive, what a scene without them pays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from balances import follow
from dolfinx import fem
from histories import EPS, NEWTON, between, column, drift, show
from hypothesis import given, settings
from hypothesis import strategies as st
from parallel import check_the_same
from parallel import run as run_on

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.rotation import cayley

# Supports that begin on moving bodies, and a body that rocks on its springs.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.* acts with a jolt"),
    pytest.mark.filterwarnings("ignore:Spring on .* have turned by"),
]

BALANCE = 1e-11  # relative; Newton stops at 1e-12
SPIN = rf.InitialVelocity(linear=(0.3, 0.0, 0.1), angular=(0.4, 0.9, -0.3))

PUSH = rf.Resultant("middle", force=(3.0, 0.0, 9.0), torque=(1.0, 5.0, 2.0), until=0.6)

# One of each, strong enough to bend the bar by some per cent.
EFFECTS = {
    "Pressure": rf.Pressure("top", 4.0, time=rf.Table((0.0, 0.4), (0.0, 1.0))),
    "KelvinVoigt": rf.KelvinVoigt(5.0, until=0.65),
    "KelvinVoigt of some": rf.KelvinVoigt(8.0, "end"),
    "MassDamping": rf.MassDamping(0.4, since=0.25),
    "NumericalDamping": rf.NumericalDamping(0.1, until=0.55),
    "PointMass": rf.PointMass("tip", 3.0),
    "Spring": rf.Spring("foot", (40.0, 5.0, 20.0), damping=2.0),
    "Gravity": rf.Gravity((0.0, -2.0, -9.81)),
    "Traction": rf.Traction("top", (1.0, 2.0, 0.0), until=0.35),
    "NodalForce": rf.NodalForce("tip", (1.0, 4.0, -3.0), since=0.15),
    "Fixed": rf.Fixed("foot", since=0.45),
    "PrescribedMotion": rf.PrescribedMotion(
        "tip", "yz", displacement=lambda t: (0.0, 0.02 * np.sin(3 * t), 0.01 * t), since=0.2
    ),
}


def bar(*effects, cells=(4, 1, 1), E=2e3, cell="hexahedron", **options):
    """A bar of 4 m × 1 m × 1 m, ρ = 2 kg/m³, with named ends and a part that may be rigid."""
    domain = rf.box((0, 0, 0), (4, 1, 1), cells, cell)
    domain = (
        domain.with_cells("middle", between(1, 3))
        .with_cells("end", lambda x: x[0] >= 3 - 1e-9)
        .with_cells("root", lambda x: x[0] <= 1 + 1e-9)
        .with_facets("top", lambda x: np.isclose(x[2], 1))
        .with_facets("foot", lambda x: np.isclose(x[0], 0))
        .with_facets("tip", lambda x: np.isclose(x[0], 4))
    )
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    material = options.pop("material", rf.StVenantKirchhoff(rho=2.0, E=E, nu=0.3))
    return rf.Scene(domain, material, effects, **options)


# Balances --------------------------------------------------------------------------------------


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("name", EFFECTS)
def test_balances_of_each_effect(name, mass, rigid):
    """Energy, momenta, work and dissipation, by forces that the test computes itself."""
    parts = [rf.Rigid("middle")] if rigid else []
    books, _ = follow(bar(EFFECTS[name], SPIN, *parts, mass=mass), 0.1, 1.0)
    show(**dict(vars(books).items()))
    assert books.worst <= BALANCE
    assert books.iterations <= 6


@settings(max_examples=16)
@given(
    names=st.sets(st.sampled_from(sorted(EFFECTS)), min_size=2, max_size=6),
    rigid=st.booleans(),
    mass=st.sampled_from(["lumped", "consistent"]),
    cell=st.sampled_from(["hexahedron", "tetrahedron"]),
)
def test_balances_of_combinations(names, rigid, mass, cell):
    """The same for effects together, in any combination."""
    effects = [EFFECTS[name] for name in sorted(names)]
    parts = [rf.Rigid("middle"), PUSH] if rigid else []
    books, _ = follow(bar(*effects, SPIN, *parts, mass=mass, cell=cell), 0.1, 1.0)
    show(**dict(vars(books).items()))
    assert books.worst <= BALANCE


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_balances_of_a_clamped_part(mass):
    """A rigid part that follows a moving support: the support bears what acts on it."""
    path = rf.PrescribedMotion("foot", displacement=lambda t: (0.0, 0.05 * np.sin(3 * t), 0.0))
    names = ("Pressure", "KelvinVoigt", "MassDamping", "PointMass", "Spring", "Gravity")
    parts = rf.Rigid("root"), rf.Rigid("end"), rf.Spring("top", 30.0), rf.PointMass("top", 1.0)
    scene = bar(*(EFFECTS[n] for n in names), path, *parts, mass=mass, cells=(8, 1, 1))
    books, _ = follow(scene, 0.1, 1.0)
    show(**dict(vars(books).items()))
    assert books.worst <= BALANCE


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_balances_through_switches(mass):
    """Parts freeze and are released under pressure, springs, point masses and damping."""
    # A pressure that hardly changes, and a load that comes at 1.2 s and releases.
    names = ("KelvinVoigt", "PointMass", "Spring", "MassDamping")
    hit = rf.Traction("tip", (0.0, 30.0, 0.0), since=1.2, until=1.4)
    scene = bar(rf.Pressure("top", 4.0), *(EFFECTS[n] for n in names), SPIN, hit, mass=mass)
    criterion = rf.StrainRate(0.5, 0.3, wake="all")
    books, reports = follow(scene, 0.1, 2.0, rigidify=criterion)
    kinds = [event.kind for r in reports for event in r.events]
    show(**dict(vars(books).items()))
    assert "freeze" in kinds
    assert "release" in kinds
    assert books.energy <= BALANCE
    assert books.linear <= BALANCE
    assert books.angular <= BALANCE


def test_pressure_on_a_closed_surface_moves_nothing():
    """L and J stay, whatever is rigid; the bar is squeezed."""
    for parts in ([], [rf.Rigid("middle")], [rf.Rigid()]):
        scene = bar(rf.Pressure("skin", 60.0), SPIN, *parts)
        reports = list(rf.simulate(scene, 0.1, 1.0))
        assert drift(column(reports, "angular_momentum")) <= 1e-12
        assert drift(column(reports, "linear_momentum")) <= 1e-12
        assert parts or reports[-1].strain > 1e-3


# Closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("parts", [(), (rf.Rigid("middle"),), (rf.Rigid(),)])
def test_drag_of_a_translation(parts, mass):
    """v falls by (1 - αΔt/2)/(1 + αΔt/2) per step, flexible or rigid."""
    alpha, dt = 0.7, 0.2
    scene = bar(rf.MassDamping(alpha), rf.InitialVelocity((1.0, 2.0, 3.0)), *parts, mass=mass)
    L = column(list(rf.simulate(scene, dt, 2.0)), "linear_momentum")
    factor = (1 - alpha * dt / 2) / (1 + alpha * dt / 2)
    assert np.allclose(L, L[0] * factor ** np.arange(11)[:, None], rtol=1e-12)


@pytest.mark.parametrize("parts", [(rf.Rigid("middle"),), (rf.Rigid(),)])
def test_a_mass_on_a_spring(parts):
    """A body, with a point mass, swings on springs at tan(ωΔt/2) = ω₀Δt/2, ω₀² = k/m."""
    dt, k = 0.05, 40.0
    spring, point = rf.Spring("skin", k), rf.PointMass("tip", 4.0)
    scene = bar(spring, point, rf.InitialVelocity((0.0, 0.0, 0.1)), *parts, E=2e9)
    assert scene.nodal_mass[: scene.owned_nodes].sum() == pytest.approx(12.0, rel=1e-12)
    # All nodes on the skin carry the same part of k, but not of the mass: let it only translate.
    reports = list(rf.simulate(bar(spring, *parts, rf.InitialVelocity((0, 0, 0.1)), E=2e9), dt, 4))
    L = column(reports, "linear_momentum")[:, 2]
    omega = 2 / dt * np.arctan(np.sqrt(k / 8.0) * dt / 2)
    t = column(reports, "t")
    assert np.allclose(L, 0.8 * np.cos(omega * t), atol=2e-4 * 0.8)
    assert drift(column(reports, "energy")) <= 1e-11


def test_weight_of_a_point_mass():
    """Gravity pulls at it everywhere, and on cells that hold its nodes."""
    for gravity, weight in ((rf.Gravity(), 12.0), (rf.Gravity(where="end"), 6.0)):
        scene = bar(gravity, rf.PointMass("tip", 4.0))
        (_, last) = list(rf.simulate(scene, 0.1, 0.1))
        assert last.linear_momentum[2] == pytest.approx(-9.81 * 0.1 * weight, rel=1e-12)


def test_viscous_damping_ratio():
    """Axial vibration of a bar (ν = 0) decays by ζ = η ω/(2 E) per radian."""
    E, eta = 2e3, 4.0
    shape = rf.InitialVelocity(function=lambda x: 1e-4 * np.sin(np.pi * x / 8) * [[1], [0], [0]])
    material = rf.StVenantKirchhoff(rho=2.0, E=E, nu=0.0)
    scene = bar(
        rf.Fixed("foot"),
        rf.KelvinVoigt(eta),
        shape,
        cells=(16, 1, 1),
        material=material,
        probes={"tip": (4.0, 0.5, 0.5)},
    )
    reports = list(rf.simulate(scene, 0.005, 2.0))
    x, t = np.array([r.probes["tip"][0] for r in reports]), column(reports, "t")
    omega = np.pi / 8 * np.sqrt(E / 2.0)
    decay = eta * omega**2 / (2 * E)
    basis = np.exp(-decay * t) * np.array([np.cos(omega * t), np.sin(omega * t)])
    rest = x - basis.T @ np.linalg.lstsq(basis.T, x, rcond=None)[0]
    assert np.abs(rest).max() <= 0.01 * np.abs(x).max()


def test_static_preload_on_springs():
    """Springs alone hold a preload: the sag is the weight over the stiffness."""
    k = 500.0
    preload = rf.Preload([rf.Gravity()])
    scene = bar(preload, rf.Gravity(), rf.Spring("skin", k), E=2e7, probes={"a": (2, 0.5, 0.5)})
    reports = list(rf.simulate(scene, 0.1, 1.0))
    sag = column([reports[0]], "probes")[0]["a"][2]
    assert sag == pytest.approx(-9.81 * 8.0 / k, rel=1e-2)
    moved = np.ptp([r.probes["a"][2] for r in reports])
    assert moved <= 1e-9 * abs(sag)  # it rests


def test_rotating_the_scene_rotates_the_solution():
    """Mesh, vectors and tensors turned: the motion is turned with them, to rounding."""
    R = cayley(np.array([0.3, -0.7, 0.5]))

    def motion(Q):
        domain = bar().domain
        domain.mesh.geometry.x[:] = domain.mesh.geometry.x @ Q.T
        K = Q @ np.diag((40.0, 5.0, 20.0)) @ Q.T
        turned = [
            rf.InitialVelocity(
                linear=tuple(Q @ (0.3, 0, 0.1)), angular=tuple(Q @ (0.4, 0.9, -0.3))
            ),
            rf.Pressure("top", 4.0),
            rf.KelvinVoigt(5.0),
            rf.MassDamping(0.4),
            rf.Spring("foot", K.tolist()),
            rf.PointMass("tip", 3.0),
            rf.Gravity(tuple(Q @ (0, -2, -9.81))),
            rf.Rigid("middle"),
        ]
        scene = rf.Scene(domain, rf.StVenantKirchhoff(rho=2.0, E=2e3, nu=0.3), turned)
        *_, last = rf.simulate(scene, 0.1, 1.0)
        last.state.rebuild()
        return last.state.u.x.array.reshape(-1, 3).copy()

    straight, turned = motion(np.eye(3)), motion(R)
    assert np.abs(turned - straight @ R.T).max() <= 1e-11 * np.abs(straight).max()


def test_clamped_parts_are_shown_and_bear_no_resultant():
    """A part that a support carries is rigid in the fields; a force on it as a body is refused."""
    scene = bar(rf.Fixed("foot"), rf.Rigid("root"), rf.Gravity())
    *_, last = rf.simulate(scene, 0.1, 0.2)
    assert np.count_nonzero(last.state.body_numbers()) == 1
    held = rf.Fixed("foot", since=0.3, until=0.6)
    late = bar(held, rf.Rigid("root"), rf.Resultant("root", force=(1, 0, 0)))
    with pytest.raises(rf.SceneError, match=r"t = 0\.3 s a support clamps"):
        rf.simulate(late, 0.1, 1.0)
    apart = bar(held, rf.Rigid("root"), rf.Resultant("root", force=(1, 0, 0), until=0.2))
    assert list(rf.simulate(apart, 0.1, 0.7))


# Only what a scene calls for -------------------------------------------------------------------


def terms_of(scene, t=0.0):
    """Integrals, coefficients and constants of the compiled residual at a time."""
    forces = InternalForces(scene, fem.Function(scene.space), [scene.acting(t + 1e-12)])
    form = forces.residual_form
    kinds = sorted(i.integral_type() for i in form.integrals())
    return kinds, len(form.coefficients()), len(form.constants())


# What each adds to the bare scene's form: kinds of integrals, constants.
ADDED = {
    "Pressure": (["exterior_facet"], 1),
    "KelvinVoigt": ([], 1),
    "KelvinVoigt of some": (["cell"], 3),  # a second kernel, with material constants of its own
    "MassDamping": ([], 0),
    "NumericalDamping": ([], 1),
    "PointMass": ([], 0),
    "Spring": ([], 0),
    "Gravity": ([], 0),
    "Traction": ([], 0),
    "NodalForce": ([], 0),
    "Fixed": ([], 0),
    "PrescribedMotion": ([], 0),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_adds_its_own_terms_only(name):
    """Integrals, coefficients and constants of the form, while it acts and when it does not."""
    kinds, coefficients, constants = terms_of(bar())
    more, of_constants = ADDED[name]
    effect = EFFECTS[name]
    inside, outside = max(getattr(effect, "since", 0.0), 0.0), getattr(effect, "until", np.inf)
    scene = bar(effect)
    assert terms_of(scene, inside) == (
        sorted([*kinds, *more]),
        coefficients,
        constants + of_constants,
    )
    if np.isfinite(outside):
        assert terms_of(scene, outside + 0.1) == (kinds, coefficients, constants)


def test_describe(capsys):
    """All effects with where and when, and the spans of time they act in."""
    scene = bar(*EFFECTS.values(), SPIN, rf.Rigid("middle"))
    text = scene.describe()
    assert capsys.readouterr().out == text + "\n"
    for effect in (*EFFECTS.values(), SPIN):
        assert type(effect).__name__ in text
    assert "from 0.25 s" in text
    assert "until 0.65 s" in text
    assert "0.45 … 0.55 s: " in text
    lines = [line for line in text.splitlines() if line.strip().startswith("from 0.65 s on")]
    assert lines
    assert "KelvinVoigt 'end'" in lines[0]
    assert "NumericalDamping" not in lines[0]


def test_describe_shows_what_acts_by_default():
    """The number behind a default, but none that changes nothing; springs, without a window."""
    text = bar(rf.Gravity(), rf.Spring("foot", 40.0), rf.Rigid("middle")).describe()
    assert "value (0, 0, -9.81)" in text
    assert "stiffness 40" in text
    for idle in ("damping", "mass None", "inertia", "time"):
        assert idle not in text.split("Effects")[1]
    assert text.endswith("from 0 s on: Gravity, Spring 'foot'")
    assert "from 0 s on: Spring 'foot'" in bar(rf.Spring("foot", 40.0)).describe()


# Several ranks ---------------------------------------------------------------------------------

SCRIPT = Path(__file__).parent / "effects_on_ranks.py"


@pytest.mark.parallel
@pytest.mark.parametrize(("mass", "ranks"), [("lumped", 2), ("consistent", 3)])
def test_the_same_on_several_ranks(mass, ranks):
    """Histories of a scene with every effect, with and without a rigid part."""
    check_the_same(SCRIPT, ranks, run_on(SCRIPT, 1, 300, mass), mass)


MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
STIFF = rf.StVenantKirchhoff(rho=2.0, E=5e3, nu=0.3)  # bears a force on one vertex


def _domain(cell="hexahedron"):
    return (
        rf.box((0, 0, 0), (4, 2, 1), (4, 2, 1), cell)
        .with_vertices("corner", lambda x: np.isclose(x.sum(axis=0), 7.0))
        .with_cells("left", lambda x: x[0] < 1 + 1e-9)
    )


def _impulse(load, dt=0.125, t_end=1.0, material=MATERIAL, **options):
    """Momentum of a free body at the end, which is the impulse of its loads."""
    *_, last = rf.simulate(rf.Scene(_domain(), material, [load], **options), dt, t_end)
    return last.linear_momentum


Q = np.array([1.0, -2.0, 0.5])


@pytest.mark.parametrize(
    ("load", "total"),
    [
        (rf.NodalForce("x1", tuple(Q)), 1.0),  # facets
        (rf.NodalForce("corner", tuple(Q)), 1.0),  # a vertex
        (rf.NodalForce("left", tuple(Q)), 1.0),  # cells
        (rf.Traction("x1", tuple(Q)), 2.0),  # area 2 × 1
        (rf.Traction("z0", tuple(Q)), 8.0),
        (rf.BodyForce(tuple(Q)), 8.0),
        (rf.BodyForce(tuple(Q), where="left"), 2.0),
        (rf.Gravity(tuple(Q)), 16.0),
        (rf.Gravity(tuple(Q), where="left"), 4.0),
    ],
)
@pytest.mark.parametrize("order", [1, 2])
def test_total_force(load, total, order):
    """What arrives is what was asked: a total, a traction × area, a density × volume."""
    impulse = _impulse(load, material=STIFF, order=order)
    assert np.abs(impulse - total * Q).max() <= 100 * NEWTON * total


def test_nodal_force_is_shared_equally():
    """Each node of the set gets the same part, corners too."""
    scene = rf.Scene(_domain(), MATERIAL, [rf.NodalForce("x1", tuple(Q))])
    *_, last = rf.simulate(scene, 1e-6, 1e-6)
    # In so short a step only inertia answers: m v = q Δt / n.
    p = scene.nodal_mass[:, None] * last.state.v.x.array.reshape(-1, 3)
    nodes = scene.nodes("x1", "test")
    assert nodes.size == 6
    assert np.abs(p[nodes] - Q * 1e-6 / 6).max() <= 1e-10 * 1e-6


@pytest.mark.parametrize(
    "make",
    [
        lambda **w: rf.NodalForce("x1", tuple(Q), **w),
        lambda **w: rf.Traction("x1", tuple(Q / 2), **w),
        lambda **w: rf.BodyForce(tuple(Q / 8), **w),
        lambda **w: rf.Gravity(tuple(Q / 16), **w),
    ],
)
def test_window(make):
    """A load acts from since to until, wherever these lie on the grid of steps."""
    assert np.abs(_impulse(make(since=0.2, until=0.77)) - 0.57 * Q).max() <= 100 * NEWTON
    assert np.abs(_impulse(make(since=0.9)) - 0.1 * Q).max() <= 100 * NEWTON
    assert np.abs(_impulse(make(until=0.4)) - 0.4 * Q).max() <= 100 * NEWTON
    for window in ({"since": 2.0}, {"since": -3.0, "until": -1.0}):
        with pytest.warns(rf.RigidfxWarning, match="does nothing from 0 to 1 s"):
            assert np.abs(_impulse(make(**window))).max() == 0.0


@given(
    times=st.lists(st.integers(0, 40), min_size=1, max_size=5, unique=True).map(sorted),
    data=st.data(),
)
def test_table_is_piecewise_linear(times, data):
    """Values at its times, straight in between, constant outside; kinks are breakpoints."""
    times = [t / 20 for t in times]
    values = data.draw(st.lists(st.floats(-10, 10), min_size=len(times), max_size=len(times)))
    table = rf.Table(times, values)
    assert [table(t) for t in times] == pytest.approx(values, abs=20 * EPS)
    assert table(times[0] - 1) == pytest.approx(values[0], abs=20 * EPS)
    assert table(times[-1] + 1) == pytest.approx(values[-1], abs=20 * EPS)
    for a, b, p, q in zip(times, times[1:], values, values[1:], strict=False):
        assert table((3 * a + b) / 4) == pytest.approx((3 * p + q) / 4, abs=100 * EPS)
    assert list(table.breakpoints) == times


def test_impulse_of_a_table_is_exact():
    """Steps end at the kinks, so that midpoint values integrate the table exactly."""
    table = rf.Table((0.1, 0.33, 0.8), (0.0, 3.0, 1.0))
    area = 0.23 * 1.5 + 0.47 * 2 + 0.2 * 1.0
    load = rf.NodalForce("x1", tuple(Q), time=table)
    assert np.abs(_impulse(load) - area * Q).max() <= 100 * NEWTON


@pytest.mark.parametrize("load", [rf.Traction("x1", (0, 0, 0.1)), rf.Pressure("x1", 0.1)])
def test_loads_are_asked_within_a_run_only(load):
    """Stresses that are recovered in rigid parts are under the loads of their instant."""

    def within(t):
        assert 0.0 <= t <= 0.5
        return np.sin(4 * t)

    box = rf.box((0, 0, 0), (4, 1, 1), (8, 2, 2)).with_cells("stiff", lambda x: x[0] > 2 - 1e-9)
    effects = [rf.Fixed("x0"), replace(load, time=within), rf.Rigid("stiff")]
    scene = rf.Scene(box, MATERIAL, effects, probes={"tip": (4, 0.5, 0.5)})
    for report in rf.simulate(scene, 0.05, 0.5, rigidify=rf.StrainRate(1e-9, 5.0)):
        assert np.isfinite(report.stresses["tip"].von_mises)


def test_value_as_a_function_of_time():
    """The value may itself turn in time; its mean over a step acts, to fourth order."""

    def value(t):
        return (np.cos(t), np.sin(t), 0.0)

    expected = np.array([np.sin(1.0), 1 - np.cos(1.0), 0.0])
    assert np.abs(_impulse(rf.NodalForce("x1", value)) - expected).max() <= 1e-7
    both = rf.NodalForce("x1", value, time=lambda t: 2.0)
    assert np.abs(_impulse(both) - 2 * expected).max() <= 2e-7
