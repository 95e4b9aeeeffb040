"""Rigid-body data by equation (35) against closed forms, and a body's own step: the free top."""

import functools

import numpy as np
import pytest
from histories import EPS, column, drift, show
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import prepared
from scipy.special import ellipk
from tumbling_l import tumbling_l

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(rho=1000.0, E=1e6, nu=0.3)
CELLS = pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])


def body_of(scene, k=0):
    """The k-th body of a scene as it is formed at the start."""
    with prepared(scene) as run:
        return run.stepper.state.bodies[k].data


def box_inertia(mass, size):
    """Inertia tensor of a homogeneous box about its centre."""
    a, b, c = np.square(size)
    return mass / 12 * np.diag([b + c, a + c, a + b])


# Mass, centre, inertia -------------------------------------------------------------------------


@CELLS
@pytest.mark.parametrize("order", [1, 2])
def test_consistent_data_of_a_box_are_exact(order, cell):
    """Rigid motions are in the space of the displacement, so (35) integrates them exactly."""
    lower, size = np.array([1.0, -2.0, 5.0]), np.array([4.0, 2.0, 1.0])
    domain = rf.box(lower, lower + size, (3, 2, 2), cell)
    body = body_of(rf.Scene(domain, SOFT, [rf.Rigid()], order=order, mass="consistent"))
    assert body.mass == pytest.approx(8000.0, rel=100 * EPS)
    assert np.abs(body.origin - lower - size / 2).max() <= 100 * EPS * 5
    J = box_inertia(8000.0, size)
    assert np.abs(body.inertia - J).max() <= 1000 * EPS * J.max()
    assert body.length == pytest.approx(np.sqrt(np.trace(J) / 16000), rel=1000 * EPS)


def test_lumped_data_of_second_order_hexahedra_are_exact():
    """Their nodal masses are a Gauss-Lobatto rule, exact for the squares in an inertia."""
    scene = rf.Scene(rf.box((0, 0, 0), (4, 2, 1), (2, 1, 1)), SOFT, [rf.Rigid()], order=2)
    body = body_of(scene)
    J = box_inertia(8000.0, (4, 2, 1))
    assert np.abs(body.inertia - J).max() <= 1000 * EPS * J.max()


@CELLS
@pytest.mark.convergence
def test_lumped_inertia_converges_with_the_square_of_the_cell_size(cell):
    """Mass and centre are exact, the inertia has the error of the trapezoidal rule."""
    J, errors = box_inertia(8000.0, (4, 2, 1)), []
    for n in (1, 2, 4):
        domain = rf.box((0, 0, 0), (4, 2, 1), (4 * n, 2 * n, n), cell)
        body = body_of(rf.Scene(domain, SOFT, [rf.Rigid()]))
        assert body.mass == pytest.approx(8000.0, rel=1000 * EPS)
        if cell == "hexahedron":
            assert np.abs(body.origin - (2, 1, 0.5)).max() <= 1000 * EPS
        errors.append(np.abs(body.inertia - J).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    show(coarse=errors[0] / J.max(), fine=errors[-1] / J.max(), slope=slopes[-1])
    assert np.abs(slopes - 2).max() <= 0.1


def _bar(across, angular, cell="hexahedron", **options):
    domain = rf.box((0, 0, 0), (10, 1, 1), (10 * across, across, across), cell)
    effects = [rf.Rigid(), rf.InitialVelocity(linear=(0, 0.1, 0), angular=angular)]
    return rf.Scene(domain, SOFT, effects, **options)


@pytest.mark.parametrize(("across", "ratio"), [(1, 3.0), (2, 1.5), (4, 1.125)])
def test_what_lumping_adds_to_the_inertia_of_a_bar_is_reported(across, ratio):
    """J/J_exact = 1 + 2/n², three for one cell across; nothing said so."""
    with pytest.warns(rf.RigidfxWarning, match="is an error of its lumped masses") as shown:
        reports = list(rf.simulate(_bar(across, (2.0, 0, 0)), 0.1, 0.3))
    assert len(shown) == 1
    body = reports[-1].bodies[0]
    assert body.inertia_ratio == pytest.approx(ratio, rel=1e4 * EPS)
    exact = 0.5 * 1e4 * (2.0**2 / 6 + 0.1**2)
    assert body.kinetic - body.kinetic_excess == pytest.approx(exact, rel=1e4 * EPS)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("scene", "ratio"),
    [
        (lambda: _bar(1, (2, 0, 0), mass="consistent"), 1.0),
        (lambda: _bar(1, (2, 0, 0), order=2), 1.0),
        (lambda: _bar(1, (0, 0, 2)), 3.0),  # about another axis a bar hardly feels it
    ],
)
def test_where_lumping_does_no_harm_nothing_is_said(scene, ratio):
    report = list(rf.simulate(scene(), 0.1, 0.3))[-1]
    assert report.bodies[0].inertia_ratio == pytest.approx(ratio, rel=1e4 * EPS)


def test_data_of_the_tumbling_l():
    """The published mass, centre and inertia tensor, benchmarks.md."""
    material = rf.StVenantKirchhoff(rho=1.0, E=1e4, nu=0.3)
    body = body_of(rf.Scene(tumbling_l(), material, [rf.Rigid()], mass="consistent"))
    J = np.array([[1112.4231, 218.0769, 0], [218.0769, 362.4231, 0], [0, 0, 1299.3462]])
    assert body.mass == pytest.approx(117.0, rel=1000 * EPS)
    printed = 0.5e-4  # half a unit of the last printed digit
    assert np.abs(body.origin - (2.1923077, 4.1923077, 1.5)).max() <= 0.5e-7 * 1.01
    assert np.abs(body.inertia - J).max() <= printed * 1.01


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_materials_inside_a_body(mass):
    """Two halves of different density make one body; the one of a lumped mass to O(h²)."""
    n = 2 if mass == "consistent" else 8
    domain = rf.box((0, 0, 0), (4, 1, 1), (n, n // 2, n // 2))
    domain = domain.with_cells("left", lambda x: x[0] <= 2 + 1e-9)
    domain = domain.with_cells("right", lambda x: x[0] >= 2 - 1e-9)
    materials = {
        "left": rf.StVenantKirchhoff(rho=3.0, E=1e3, nu=0.3),
        "right": rf.NeoHooke(rho=1.0, E=1e5, nu=0.2),
    }
    body = body_of(rf.Scene(domain, materials, [rf.Rigid()], mass=mass))
    m = np.array([6.0, 2.0])
    centre = m @ np.array([[1, 0.5, 0.5], [3, 0.5, 0.5]]) / 8
    J = np.zeros((3, 3))
    for mass_of, x in zip(m, (1.0, 3.0), strict=True):
        arm = x - centre[0]
        J += box_inertia(mass_of, (2, 1, 1)) + mass_of * arm**2 * np.diag([0, 1, 1])
    assert body.mass == pytest.approx(8.0, rel=1000 * EPS)
    assert np.abs(body.origin - centre).max() <= (1000 * EPS)
    # trapezoidal rule per direction: + m h²/6
    h2 = 0.0 if mass == "consistent" else 8 * ((4 / n) ** 2 + (2 / n) ** 2) / 6
    assert np.abs(body.inertia - J).max() <= h2 + 1000 * EPS * J.max()


def test_given_mass_and_inertia_replace_the_computed_ones():
    """And move the body as they say: momenta and energy are theirs."""
    J = [[0.3, 0.01, 0.0], [0.01, 0.35, 0.02], [0.0, 0.02, 0.4]]
    effects = [
        rf.Rigid(mass=7.0, inertia=J),
        rf.InitialVelocity(linear=(1.0, 2.0, 3.0), angular=(0.1, 15.0, 0.1)),
    ]
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), SOFT, effects)
    (first, *_) = rf.simulate(scene, 0.01, 0.01)
    (body,) = first.bodies
    omega = np.array([0.1, 15.0, 0.1])
    assert body.mass == 7.0
    assert np.abs(body.angular_velocity - omega).max() <= 1000 * EPS
    assert np.abs(body.angular_momentum_about_centre - J @ omega).max() <= 1000 * EPS * 15
    assert first.kinetic == pytest.approx(3.5 * 14 + omega @ J @ omega / 2, rel=1000 * EPS)
    assert first.unknowns == 6


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_body_takes_the_momenta_of_its_nodes(mass):
    """(34): of a velocity field that is not rigid, a body keeps L and J and not all energy."""
    effects = [
        rf.InitialVelocity(
            linear=(1.0, 0.0, 2.0),
            angular=(0.1, 0.5, 0.2),
            function=lambda X: np.array([np.sin(3 * X[1]), X[0] ** 2, np.cos(X[0] * X[2])]),
        )
    ]
    domain = rf.box((0, 0, 0), (3, 2, 1), (3, 2, 2), "tetrahedron")
    flexible, rigid = (
        next(iter(rf.simulate(rf.Scene(domain, SOFT, e, mass=mass), 0.1, 0.1)))
        for e in (effects, [*effects, rf.Rigid()])
    )
    for name in ("linear_momentum", "angular_momentum"):
        a, b = getattr(flexible, name), getattr(rigid, name)
        assert np.abs(a - b).max() <= 1000 * EPS * np.abs(a).max()
    assert 0.1 * flexible.kinetic < rigid.kinetic < 0.99 * flexible.kinetic


ranges = st.tuples(st.integers(0, 4), st.integers(1, 4)).map(lambda s: (s[0], s[0] + s[1]))
boxes = st.tuples(ranges, ranges, ranges)


def boxes_apart(a, b):
    """Whether two boxes of cells share no node."""
    return any(p[1] < q[0] or q[1] < p[0] for p, q in zip(a, b, strict=True))


def cell_box(box_):
    """Marker of the cells (edge 1) in a box of cells."""
    return lambda x: np.all(
        [(x[i] >= low - 1e-9) & (x[i] <= high + 1e-9) for i, (low, high) in enumerate(box_)],
        axis=0,
    )


@functools.cache
def _domain(cell):
    return rf.box((0, 0, 0), (5, 3, 3), (5, 3, 3), cell)


@CELLS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@settings(max_examples=12)
@given(data=st.data())
def test_no_mass_is_lost_or_counted_twice(cell, mass, data):
    """Σ free nodal masses + Σ body masses = ∫ρ0 dV, whatever is rigid.

    In uniform motion L and the kinetic energy count every mass once; under gravity, whose nodal
    forces know nothing of bodies, everything falls alike and nothing strains: the masses that the
    equations of motion use are the same.
    """
    found = []
    domain = _domain(cell)
    size = (5, 3, 3)
    for _ in range(data.draw(st.integers(1, 3), label="bodies")):
        place = data.draw(boxes, label="cells")
        place = tuple((low % n, min(high - low, n - low % n) + low % n)
                      for (low, high), n in zip(place, size, strict=True))  # fmt: skip
        if all(boxes_apart(place, other) for other in found):
            domain = domain.with_cells(f"body {len(found)}", cell_box(place))
            found.append(place)
    v, g = np.array([1.0, -2.0, 0.5]), np.array([0.2, 0.1, -0.4])
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(rho=2.0, E=100.0, nu=0.3),
        [rf.Rigid(f"body {k}") for k in range(len(found))]
        + [rf.InitialVelocity(linear=tuple(v)), rf.Gravity(tuple(g))],
        mass=mass,
    )
    total, X = 2.0 * 45.0, scene.space.tabulate_dof_coordinates()
    dt, first = 0.5, True
    for r in rf.simulate(scene, dt, 2 * dt):
        tolerance = 1e-13 if first else 1e-11  # the second is Newton's
        now = v + g * r.t
        assert np.abs(r.linear_momentum - total * now).max() <= tolerance * total
        assert abs(r.kinetic - total / 2 * now @ now) <= tolerance * total
        assert r.strain <= 1e-20 * total
        r.state.rebuild()
        fall = v * r.t + g * r.t**2 / 2
        assert np.abs(r.state.u.x.array.reshape(-1, 3) - fall).max() <= tolerance
        assert len(X) == len(r.state.u.x.array) // 3
        first = False


# The free top ----------------------------------------------------------------------------------

INERTIA = np.diag([0.3, 0.35, 0.4])
BOX_OMEGA, BOX_PERIOD = np.array([0.05, 1.0, 0.0]), 27.908466  # rad/s, s


def exact_period(moments, omega):
    """4K(k²)/τ of a free top with the given principal moments [s]."""
    A, B, C = np.sort(moments)
    w = omega[np.argsort(moments)]
    J = np.sort(moments)
    T2, h2 = J @ w**2, (J * w) @ (J * w)
    if h2 < T2 * B:  # about the axis of the least moment instead
        A, C = C, A
    k2 = (B - A) * (T2 * C - h2) / ((C - B) * (h2 - T2 * A))
    return 4 * ellipk(k2) / np.sqrt((C - B) * (h2 - T2 * A) / (A * B * C))


def crossings(values, dt):
    """Times at which a history changes sign, by cubic interpolation."""
    values, out = np.asarray(values), []
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        points = np.arange(k - 1, k + 3)
        inverse = np.polyfit(values[points], points - k, 3)  # t as a function of the value
        out.append((k + inverse[-1]) * dt)
    return np.array(out)


def test_exact_period():
    """The formula of this file gives the published figure."""
    J = np.diag(box_inertia(8000.0, (4, 2, 1)))
    assert exact_period(J, BOX_OMEGA) == pytest.approx(BOX_PERIOD, abs=0.51e-6)


def test_a_tensor_of_single_precision_keeps_momenta():
    """What of a given inertia is not symmetric is averaged out: it would turn momenta."""
    rounded = INERTIA + 1e-7 * np.triu(np.ones((3, 3)), 1)
    effects = [rf.Rigid(mass=2.0, inertia=rounded), rf.InitialVelocity(angular=(1.0, 15.0, 2.0))]
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (2, 2, 2)), SOFT, effects)
    reports = list(rf.simulate(scene, 0.01, 1.0))
    assert drift(column(reports, "energy")) <= 1e-13
    assert drift(column(reports, "angular_momentum")) <= 1e-13


@pytest.mark.convergence
def test_tumbling_box():
    """Consistent mass: the exact period to O(Δt²), through simulate."""
    errors = []
    for dt in (0.2, 0.1):
        scene = rf.Scene(
            rf.box((0, 0, 0), (4, 2, 1), (2, 1, 1)),
            SOFT,
            [rf.Rigid(), rf.InitialVelocity(angular=tuple(BOX_OMEGA))],
            mass="consistent",
        )
        reports = list(rf.simulate(scene, dt, 28.0))
        W = [(r.bodies[0].orientation.T @ r.bodies[0].angular_velocity)[1] for r in reports]
        times = crossings(W, dt)
        errors.append(abs(2 * (times[1] - times[0]) - BOX_PERIOD))
        assert drift(column(reports, "energy")) <= 1e-12
        assert drift(column(reports, "angular_momentum")) <= 1e-12
    slope = np.log2(errors[0] / errors[1])
    show(error=errors[1], slope=slope)
    assert abs(slope - 2) <= 0.1


@pytest.mark.filterwarnings("ignore:.*rad per step:rigidfx.RigidfxWarning")
def test_large_rotation_through_simulate():
    """The same for all cells rigid: no step is cut."""
    effects = [
        rf.Rigid(mass=2.0, inertia=INERTIA.tolist()),
        rf.InitialVelocity(angular=(1.0, 5.8, 1.2)),
    ]
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), SOFT, effects)
    reports = list(rf.simulate(scene, 1.0, 20.0))
    before = np.eye(3)
    largest = 0.0
    for r in reports[1:]:
        increment = r.bodies[0].orientation @ before.T
        before = r.bodies[0].orientation
        largest = max(largest, np.arccos((np.trace(increment) - 1) / 2))
        assert r.cuts == 0, r.residuals
    show(angle=largest, iterations=max(r.iterations for r in reports))
    assert largest > 2.45
    assert drift(column(reports, "energy")) <= 1e-11
    assert drift(column(reports, "angular_momentum")) <= 1e-11
