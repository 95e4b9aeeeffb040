"""Rigid and flexible parts in one motion: what is conserved, what loads do, what a limit gives."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import ufl
from dolfinx import fem
from histories import EPS, NEWTON, column, drift, linear_momentum, show
from hypothesis import given, settings
from hypothesis import strategies as st

import rigidfx as rf
from rigidfx.coupling.condensed_tangent import ProductBlocks
from rigidfx.step.newton import chord

DRIFT = 1e-11  # the bound, relative
CELLS = pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])


def bar(*effects, E=300.0, cells=(8, 2, 2), cell="hexahedron", rigid=4.0, **options):
    """A bar of 8 m × 2 m × 2 m, ρ = 1 kg/m³, rigid up to x = 4 m."""
    domain = rf.box((0, 0, 0), (8, 2, 2), cells, cell)
    domain = domain.with_cells("stiff", lambda x: x[0] <= rigid + 1e-9)
    material = options.pop("material", rf.StVenantKirchhoff(rho=1.0, E=E, nu=0.3))
    return rf.Scene(domain, material, [rf.Rigid("stiff"), *effects], **options)


class PeakStrain:
    """Largest Green-Lagrange strain (Frobenius norm) over the middles of cells."""

    def __init__(self, scene):
        self._u = fem.Function(scene.space)
        F = ufl.Identity(3) + ufl.grad(self._u)
        E = (F.T * F - ufl.Identity(3)) / 2
        dg = fem.functionspace(scene.mesh, ("DG", 0))
        where = ufl.dx(domain=scene.mesh, metadata={"quadrature_degree": 1})
        self._volume = fem.assemble_vector(fem.form(ufl.TestFunction(dg) * where)).array
        self._form = fem.form(ufl.sqrt(ufl.inner(E, E)) * ufl.TestFunction(dg) * where)

    def __call__(self, report):
        report.state.rebuild()
        self._u.x.array[:] = report.state.u.x.array
        return (fem.assemble_vector(self._form).array / self._volume).max()


# Tumbling --------------------------------------------------------------------------------------

DT = 0.1  # s
# Rotation per step [rad] → E [Pa] at which strains reach 2 %: ρ (ω l)²/E is about the same.
SPEEDS = {0.06: 300.0, 0.7: 4.5e4}
BOUNDS = {0.06: 5, 0.7: 9}  # Newton iterations, the issue's
STEPS = 250


@pytest.fixture
def new_tangents(monkeypatch):
    """Each iteration has a tangent of its own, as of systems that are too small to keep one."""
    monkeypatch.setattr(chord, "DEAR", np.inf)


def tumble(mass, cell, speed):
    """Half rigid bar, strain-free at the start, with a spin about a skew axis."""
    axis = np.array([0.2, 0.3, 1.0])
    omega = 2 * np.tan(speed / 2) / DT * axis / np.linalg.norm(axis)
    cells = (8, 2, 2) if cell == "hexahedron" else (6, 2, 2)
    spin = rf.InitialVelocity(angular=tuple(omega))
    return bar(spin, E=SPEEDS[speed], cells=cells, cell=cell, mass=mass)


def histories_text(reports, most=8):
    """Residual histories of the steps that took most iterations."""
    worst = sorted(reports[1:], key=lambda r: -r.iterations)[:most]
    lines = (
        f"step {r.step}, cuts {r.cuts}: " + " ".join(f"{x:.1e}" for x in r.residuals) for r in worst
    )
    return "\n" + "\n".join(lines)


def quadratic(residuals, floor):
    """Whether the iterates below 1e-3 of the first fall as with the square, down to a floor.

    With r relative to the first residual: r₊ ≤ C r^1.8. C is 100, as ‖R‖ need not measure the
    distance to the solution in the norm in which the constant is 1.
    """
    r = np.asarray(residuals) / residuals[0]
    return all(b <= max(100 * a**1.8, floor / residuals[0]) for a, b in pairwise(r) if a < 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("speed", SPEEDS)
@CELLS
@MASSES
def test_tumbling_bar(mass, cell, speed, new_tangents):
    """H, L and J to 1e-11 in 1000 steps, none cut, Newton quadratic and quick, strains 1 to 2 %."""
    scene = tumble(mass, cell, speed)
    strain, reports, peak = PeakStrain(scene), [], 0.0
    for r in rf.simulate(scene, DT, STEPS * DT):
        reports.append(r)
        if r.step % 5 == 1:
            peak = max(peak, strain(r))
    text = histories_text(reports)
    iterations = column(reports, "iterations")[1:]
    turned = [
        np.arccos((np.trace(b.bodies[0].orientation @ a.bodies[0].orientation.T) - 1) / 2)
        for a, b in pairwise(reports)
    ]
    found = {name: drift(column(reports, name)) for name in ("energy", "angular_momentum")}
    found["linear_momentum"] = linear_momentum(reports)
    show(**found, mean=iterations.mean(), most=iterations.max(), peak_strain=peak,
         turn=np.mean(turned))  # fmt: skip
    assert max(found.values()) <= DRIFT * STEPS / 1000, text
    assert all(r.cuts == 0 for r in reports), text
    assert iterations.mean() <= 5, text
    assert iterations.max() <= BOUNDS[speed], text
    assert 0.015 < peak < 0.0225
    assert np.mean(turned) == pytest.approx(speed, rel=0.05)
    floor = 1e-12 * max(r.residuals[0] for r in reports[1:])
    assert all(quadratic(r.residuals, floor) for r in reports[1:]), text


@MASSES
def test_thrown_bar(mass):
    """A bar that flies away while it turns: L is no longer zero, J is of the distance."""
    thrown = rf.InitialVelocity(linear=(3.0, -2.0, 1.0), angular=(0.1, 0.2, 0.6))
    reports = list(rf.simulate(bar(thrown, mass=mass), DT, 30.0))
    L, J = (column(reports, name) for name in ("linear_momentum", "angular_momentum"))
    away = np.linalg.norm(reports[-1].bodies[0].centre)
    H = drift(column(reports, "energy"))
    found = {
        "L": np.abs(L - L[0]).max() / np.linalg.norm(L[0]),
        "J": np.abs(J - J[0]).max() / (away * np.linalg.norm(L[0])),
    }
    show(**found, H=H, away=away)
    assert away > 100
    assert max(H, *found.values()) <= DRIFT


@pytest.mark.parametrize("where", [None, "every"])
@MASSES
def test_free_fall_with_a_given_mass(mass, where):
    """All falls alike, whatever the body is told to weigh: nothing is strained."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_cells("every", lambda x: x[0] > -1)
    domain = domain.with_cells("stiff", lambda x: x[0] <= 2 + 1e-9)
    material = rf.StVenantKirchhoff(rho=10.0, E=1e6, nu=0.3)
    effects = rf.Rigid("stiff", mass=500.0), rf.Gravity((0, 0, -2.0), where=where)
    reports = list(rf.simulate(rf.Scene(domain, material, effects, mass=mass), 0.05, 0.5))
    last = reports[-1]
    # The flexible cells beside it have 5 kg on its nodes: of a consistent mass these stay there.
    total = 500.0 + (15.0 if mass == "lumped" else 20.0)
    assert last.bodies[0].velocity == pytest.approx([0, 0, -1.0], abs=1e-12)
    assert last.linear_momentum == pytest.approx([0, 0, -total], abs=1e-9)
    assert last.strain <= 1e-20 * last.kinetic


@MASSES
def test_gravity_on_a_part_of_a_given_mass(mass):
    """Half of the body's cells weigh half of what it is told to, at their own place."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_cells("end", lambda x: x[0] <= 2 + 1e-9)
    material = rf.StVenantKirchhoff(rho=10.0, E=1e6, nu=0.3)
    effects = rf.Rigid(None, mass=500.0), rf.Gravity((0, 0, -2.0), where="end")
    *_, last = rf.simulate(rf.Scene(domain, material, effects, mass=mass), 0.01, 0.01)
    assert last.linear_momentum == pytest.approx([0, 0, -500.0 * 0.01], rel=1e-12)
    spin = last.angular_momentum - np.cross(last.bodies[0].centre, last.linear_momentum)
    assert spin == pytest.approx([0, -500.0 * 0.01 * 1.0, 0], rel=1e-4, abs=1e-9)  # lever 1 m


@pytest.mark.parametrize("speed", SPEEDS)
def test_consistent_tangent(speed, monkeypatch, new_tangents):
    """With P in place of L in the tangent Newton ends at the same motion, but linearly."""
    insert, found = ProductBlocks.insert_into, {}
    for consistent in (True, False):
        reports = list(rf.simulate(tumble("lumped", "hexahedron", speed), DT, 3.0))
        found[consistent] = reports
        monkeypatch.setattr(
            ProductBlocks, "insert_into", lambda self, A, C, L, P: insert(self, A, C, P, P)
        )
    iterations = {consistent: column(r, "iterations")[1:] for consistent, r in found.items()}
    show(with_it=iterations[True].mean(), without=iterations[False].mean())
    text = histories_text(found[False], 3) + histories_text(found[True], 3)
    assert iterations[False].mean() >= iterations[True].mean() + 1, text
    floor = 1e-12 * found[True][1].residuals[0]
    assert all(quadratic(r.residuals, floor) for r in found[True][1:]), text
    assert not all(quadratic(r.residuals, floor) for r in found[False][1:]), text
    a, b = (found[consistent][10].bodies[0].orientation for consistent in (True, False))
    assert np.abs(a - b).max() <= 1e-8


@pytest.mark.parametrize("material", ["NeoHooke", "two bodies", "second order", "Midpoint"])
def test_other_parts_in_the_same_motion(material):
    """The discrete gradient, two bodies with different materials inside, order 2, Midpoint."""
    spin = rf.InitialVelocity(angular=(0.2, 0.3, 0.6), linear=(1.0, 2.0, 0.0))
    if material == "NeoHooke":
        scene = bar(spin, material=rf.NeoHooke(rho=1.0, E=300.0, nu=0.3))
    elif material == "second order":
        scene = bar(spin, cells=(4, 1, 1), order=2)
    elif material == "Midpoint":
        scene = bar(spin, scheme=rf.Midpoint())
    else:
        domain = rf.box((0, 0, 0), (8, 2, 2), (8, 2, 2))
        for name, low, high in (("a", 0, 1), ("b", 1, 6), ("c", 6, 8), ("left", 0, 3),
                                ("right", 5, 8)):  # fmt: skip
            domain = domain.with_cells(
                name, lambda x, low=low, high=high: (x[0] >= low - 1e-9) & (x[0] <= high + 1e-9)
            )
        materials = {
            "a": rf.StVenantKirchhoff(rho=3.0, E=1e9, nu=0.2),
            "b": rf.StVenantKirchhoff(rho=1.0, E=300.0, nu=0.3),
            "c": rf.NeoHooke(rho=2.0, E=500.0, nu=0.1),
        }
        scene = rf.Scene(domain, materials, [rf.Rigid("left"), rf.Rigid("right"), spin])
    reports = list(rf.simulate(scene, DT, 20.0))
    assert max(r.strain for r in reports) > 1e-4 * reports[0].energy
    assert drift(column(reports, "linear_momentum")) <= DRIFT
    assert drift(column(reports, "angular_momentum")) <= DRIFT
    H = drift(column(reports, "energy"))
    show(H=H)
    if material == "Midpoint":
        assert 100 * DRIFT < H < 0.1  # the paper's other integrator couples, and loses energy
    else:
        assert H <= DRIFT
    if material == "two bodies":
        assert [b.name for b in reports[0].bodies] == ["left", "right"]
        # with the lumped halves of the cells next to them
        assert [b.mass for b in reports[0].bodies] == pytest.approx([12 + 8 + 2, 2 + 4 + 16])


def test_newton_ends_where_every_flexible_cell_touches_a_body(new_tangents):
    """A flexible layer on a rigid one: Newton knows the rounding of cells at a body's rim, too."""
    domain = rf.box((0, 0, 0), (12, 2, 2), (12, 2, 2))
    domain = domain.with_cells("stiff", lambda x: x[2] <= 1 + 1e-9)
    start = rf.InitialVelocity(
        angular=(0.5, 0.2, 0.3),
        function=lambda X: np.array([0 * X[0], 0.3 * (X[2] > 1.5), 0 * X[0]]),
    )
    material = rf.NeoHooke(rho=1.0, E=1e3, nu=0.3)
    reports = list(rf.simulate(rf.Scene(domain, material, [rf.Rigid("stiff"), start]), 0.1, 5.0))
    text = histories_text(reports)
    show(most=max(r.iterations for r in reports))
    assert all(r.cuts == 0 for r in reports), text
    # three iterations, and one that finds out that nothing but rounding is left
    assert max(r.iterations for r in reports) <= 4, text
    assert drift(column(reports, "energy")) <= DRIFT


def test_reports_of_bodies_add_up():
    """Body and flexible part give the totals: m ṙ, r × m ṙ + spin, ½ m ṙ² + ½ ω·spin."""
    scene = bar(rf.InitialVelocity(angular=(0.2, 0.3, 0.6), linear=(1.0, 2.0, 0.0)))
    X, free = scene.space.tabulate_dof_coordinates(), None
    for r in rf.simulate(scene, DT, 1.0):
        (b,) = r.bodies
        if free is None:
            free, origin = np.flatnonzero(X[:, 0] > 4 + 1e-9), b.centre
        m = scene.nodal_mass[free, None]
        x, v = X + r.state.u.x.array.reshape(-1, 3), r.state.v.x.array.reshape(-1, 3)
        p = m * v[free]
        assert np.allclose(b.linear_momentum, b.mass * b.velocity, rtol=1e-14, atol=0)
        spin = np.cross(b.centre, b.linear_momentum) + b.angular_momentum_about_centre
        assert np.allclose(b.angular_momentum, spin, rtol=1e-13, atol=0)
        T = (
            b.velocity @ b.linear_momentum / 2
            + b.angular_velocity @ b.angular_momentum_about_centre / 2
        )
        assert b.kinetic == pytest.approx(T, rel=1e-12)
        size = r.momentum_scale * 10
        L, J = p.sum(axis=0), np.cross(x[free], p).sum(axis=0)
        assert np.abs(b.linear_momentum + L - r.linear_momentum).max() <= 100 * EPS * size
        assert np.abs(b.angular_momentum + J - r.angular_momentum).max() <= 100 * EPS * size
        assert b.kinetic + (p * v[free]).sum() / 2 == pytest.approx(r.kinetic, rel=1e-13)
        own = X[:, 0] <= 4 + 1e-9
        r.state.rebuild()
        now = (X + r.state.u.x.array.reshape(-1, 3))[own]
        rigid = b.centre + (X[own] - origin) @ b.orientation.T
        assert np.abs(now - rigid).max() <= 1e-13 * np.abs(now).max()
        v = r.state.v.x.array.reshape(-1, 3)[own]  # (2), interface nodes too
        assert np.abs(v - b.velocity - np.cross(b.angular_velocity, now - b.centre)).max() <= 1e-12


# Loads -----------------------------------------------------------------------------------------


def _face_weights(X, axis, value, spacing):
    """Share of each node in the area of a face of a box with equal cells: the trapezoidal rule."""
    on = np.isclose(X[:, axis], value)
    w = on.astype(float)
    for other in set(range(3)) - {axis}:
        edge = np.isclose(X[:, other], X[:, other].min()) | np.isclose(
            X[:, other], X[:, other].max()
        )
        w *= np.where(edge, 0.5, 1.0) * spacing
    return w


@MASSES
@pytest.mark.parametrize("rigid", [4.0, 8.0], ids=["half rigid", "all rigid"])
@settings(max_examples=6)
@given(data=st.data())
def test_books_of_loads_on_bodies(mass, rigid, data):
    """ΔH = work, ΔL = Δt Σf, ΔJ = Δt Σ x½ × f each step.

    Traction on a body's face, gravity, forces on nodes inside the body and on some of both parts,
    and the body's resultant force and torque, in any mixture.
    """
    force = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
    traction, g, inside, both, push, torque = (data.draw(force) for _ in range(6))
    dt = data.draw(st.floats(0.05, 0.3))
    effects = [
        rf.Traction("x0", tuple(traction)),
        rf.Gravity(tuple(g)),
        rf.NodalForce("inner", tuple(inside)),
        rf.NodalForce("y0", tuple(both)),
        rf.Resultant("stiff", force=tuple(push), torque=tuple(3 * torque)),
        rf.InitialVelocity(angular=(0.2, 0.3, 0.6), linear=(1.0, 2.0, 0.0)),
    ]
    domain = rf.box((0, 0, 0), (8, 2, 2), (8, 2, 2))
    domain = domain.with_cells("stiff", lambda x: x[0] <= rigid + 1e-9)
    domain = domain.with_vertices("inner", lambda x: np.isclose(x[0], 2) & (x[1] > 0.5))
    material = rf.StVenantKirchhoff(rho=1.0, E=300.0, nu=0.3)
    scene = rf.Scene(domain, material, [rf.Rigid("stiff"), *effects], mass=mass)
    X = scene.space.tabulate_dof_coordinates()
    inner, side = scene.nodes("inner", "test"), scene.nodes("y0", "test")
    f = np.outer(_face_weights(X, 0, 0.0, 1.0), traction) + np.outer(scene.nodal_mass, g)
    f[inner] += inside / inner.size
    f[side] += both / side.size
    x_before = before = None
    for r in rf.simulate(scene, dt, 6 * dt):
        r.state.rebuild()
        x = X + r.state.u.x.array.reshape(-1, 3)
        if before is not None:
            middle = (x + x_before) / 2
            a, b = before.bodies[0], r.bodies[0]
            centre = (a.centre + b.centre) / 2
            impulse = r.dt * (f.sum(axis=0) + push)
            twist = np.cross(middle, f).sum(axis=0) + np.cross(centre, push) + 3 * torque
            turn = b.orientation @ a.orientation.T
            angle = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0],
                              turn[1, 0] - turn[0, 1]])  # fmt: skip
            theta = 2 * angle / (1 + np.trace(turn))  # Cayley vector
            work = (f * (x - x_before)).sum() + push @ (b.centre - a.centre) + 3 * torque @ theta
            size = r.momentum_scale + before.momentum_scale + r.dt * np.abs(f).sum()
            dL = r.linear_momentum - before.linear_momentum
            dJ = r.angular_momentum - before.angular_momentum
            energy = r.energy + before.energy + np.abs(f * (x - x_before)).sum()
            assert np.abs(dL - impulse).max() <= 20 * NEWTON * size
            assert np.abs(dJ - r.dt * twist).max() <= 20 * NEWTON * size * np.abs(x).max()
            assert abs(work - r.work_of_loads) <= 20 * NEWTON * energy
            assert abs(r.energy - before.energy - work) <= 20 * NEWTON * energy
        x_before, before = x, r


def test_resultant_in_time():
    """A force and a torque in their window and with their factor turn a body as Newton says."""
    table = rf.Table((0.0, 1.0), (0.0, 2.0))
    push = rf.Resultant(None, force=(4.0, 0.0, 0.0), torque=(0.0, 0.0, 3.0), time=table, until=1.0)
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)),
        rf.StVenantKirchhoff(rho=2.0, E=1.0, nu=0.3),
        [rf.Rigid(), push],
        mass="consistent",
    )
    reports = list(rf.simulate(scene, 0.05, 1.5))
    b = reports[-1].bodies[0]
    # ∫ 2 t dt = 1; J = m/6 = 1/3; Δt divides the window, and the table is linear
    assert np.abs(b.linear_momentum - (4.0, 0, 0)).max() <= 1e-12
    assert np.abs(b.angular_momentum_about_centre - (0, 0, 3.0)).max() <= 1e-12
    assert np.abs(b.angular_velocity - (0, 0, 9.0)).max() <= 1e-11
    work = sum(r.work_of_loads for r in reports)
    assert work == pytest.approx(reports[-1].energy, rel=1e-12)


# Units -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("units", ["mm, t, s", "km, g, h", "powers of two"])
def test_units(units):
    """The same motion in other units: to some ε even, where units are powers of two."""
    length, mass, time = {
        "mm, t, s": (1e3, 1e-3, 1.0),
        "km, g, h": (1e-3, 1e3, 1 / 3600),
        "powers of two": (2.0**20, 2.0**-13, 2.0**5),
    }[units]

    def run(length, mass, time):
        domain = rf.box((0, 0, 0), np.array([8, 2, 2]) * length, (6, 2, 2))
        domain = domain.with_cells("stiff", lambda x: x[0] <= 4.01 * length)
        pressure, force = mass / length / time**2, mass * length / time**2
        scene = rf.Scene(
            domain,
            rf.StVenantKirchhoff(rho=mass / length**3, E=3e4 * pressure, nu=0.3),
            [
                rf.Rigid("stiff"),
                rf.InitialVelocity(angular=(1.5 / time, 0.3 / time, 5.0 / time)),
                rf.Traction("x0", (0.0, 50.0 * pressure, 0.0)),
                rf.Resultant("stiff", torque=(0.0, 70 * force * length, 0.0)),
            ],
            probes={"tip": (8.0 * length, 2.0 * length, 2.0 * length)},
        )
        reports = list(rf.simulate(scene, 0.1 * time, 3.0 * time))
        return (
            np.array([r.probes["tip"] / length for r in reports]),
            np.array([r.energy / (force * length) for r in reports]),
            np.array([r.bodies[0].orientation for r in reports]),
            [r.iterations for r in reports],
        )

    *one, iterations = run(1.0, 1.0, 1.0)
    *other, others = run(length, mass, time)
    assert sum(abs(a - b) for a, b in zip(iterations, others, strict=True)) <= 2
    for a, b in zip(one, other, strict=True):
        error = np.abs(a - b).max() / np.abs(a).max()
        show(error=error)
        assert error <= (100 * EPS if units == "powers of two" else 1e-10)


# The limit of a stiff body -----------------------------------------------------------------------


def stiff_half(E, dt, t_end, **motion):
    """Position of the tip at the end; the left half is rigid if E is None."""
    domain = rf.box((0, 0, 0), (8, 2, 2), (8, 2, 2))
    domain = domain.with_cells("stiff", lambda x: x[0] <= 4 + 1e-9)
    domain = domain.with_cells("soft", lambda x: x[0] >= 4 - 1e-9)
    soft = rf.StVenantKirchhoff(rho=1.0, E=300.0, nu=0.3)
    stiff = rf.StVenantKirchhoff(rho=1.0, E=300.0 if E is None else E, nu=0.3)
    effects = [*([rf.Rigid("stiff")] if E is None else []), rf.InitialVelocity(**motion)]
    scene = rf.Scene(domain, {"stiff": stiff, "soft": soft}, effects)
    for r in rf.simulate(scene, dt, t_end):
        last = r
    return last.state.u.x.array.reshape(-1, 3)[scene.nodes("x1", "test")]


def pull(X):
    """Velocities along the bar, of the soft half only: a motion without rotation."""
    return np.array([np.maximum(X[0] - 4, 0) * 0.05, 0 * X[0], 0 * X[0]])


@pytest.mark.convergence
def test_stiff_half_tends_to_a_rigid_one():
    """In a motion without rotation the difference falls with 1/E until rounding."""
    limit = stiff_half(None, 0.05, 1.0, function=pull)
    moduli = 300.0 * np.array([1e2, 1e4, 1e6, 1e8])
    d = [np.abs(stiff_half(E, 0.05, 1.0, function=pull) - limit).max() for E in moduli]
    slopes = np.diff(np.log10(d)) / np.diff(np.log10(moduli))
    show(first=d[0], last=d[-1], **{f"slope{k}": s for k, s in enumerate(slopes)})
    assert np.abs(slopes[1:] + 1).max() <= 0.05
