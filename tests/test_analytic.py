"""Problems with known answers: frequencies, end loads, free fall, an earthquake."""

import numpy as np
import pytest
from histories import NEWTON, show
from known.motions import DEFORMATION, INCH, RATIO, by_gravity, by_support, el_centro, shaken
from scipy.linalg import expm
from scipy.optimize import brentq, root
from scipy.signal import lsim

import rigidfx as rf

SOFT = 1e-6  # amplitude of small vibrations, relative to a length: so small is what bends the wave


def _frequency(reports, probe, axis):
    """Angular frequency [rad/s] of a probe from its zero crossings, interpolated by sines."""
    t = np.array([r.t for r in reports])
    u = np.array([r.probes[probe][axis] for r in reports])
    k = np.flatnonzero(u[:-1] * u[1:] < 0)
    crossings = t[k] + (t[k + 1] - t[k]) * u[k] / (u[k] - u[k + 1])
    return np.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])


def _in_time(omega, dt):
    """What the scheme makes of an angular frequency: 2/Δt arctan(ωΔt/2)."""
    return 2 / dt * np.arctan(omega * dt / 2)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("name", ["StVenantKirchhoff", "NeoHooke"])
def test_bar_vibrates_at_its_analytic_frequency(name, mass):
    """Lengthwise, one end held, ν = 0: ω = π/(2ℓ) √(E/ρ), but for the known error of the cells."""
    length, n, E, rho = 2.0, 10, 200.0, 8.0
    wave, k, h = np.sqrt(E / rho), np.pi / 2 / length, length / n
    s, c = np.sin(k * h / 2), np.cos(k * h)
    # Free vibration of equal linear cells, exact: lumped, and consistent.
    cells = {"lumped": 2 / h * wave * s, "consistent": 2 / h * wave * s * np.sqrt(3 / (2 + c))}
    assert abs(cells[mass] / (k * wave) - 1) <= 1.1 * (k * h) ** 2 / 24
    dt = 2 * np.pi / (k * wave) / 50
    scene = rf.Scene(
        rf.box((0, 0, 0), (length, 0.3, 0.3), (n, 1, 1)),
        getattr(rf, name)(E=E, nu=0.0, rho=rho),
        [
            rf.Fixed("x0"),
            rf.InitialVelocity(
                function=lambda X: SOFT * wave * np.outer([1, 0, 0], np.sin(k * X[0]))
            ),
        ],
        mass=mass,
        probes={"end": (length, 0.15, 0.15)},
    )
    measured = _frequency(list(rf.simulate(scene, dt, 205 * dt)), "end", 0)
    expected = _in_time(cells[mass], dt)
    show(measured=measured, analytic=k * wave, error=measured / expected - 1)
    # The crossings' chords are off by (ωΔt)³/16 of a phase at most, over 8 half periods.
    assert abs(measured / expected - 1) <= (cells[mass] * dt) ** 3 / 16 / (8 * np.pi) * 2


def _timoshenko_cantilever(E, rho, nu, length, a):
    """First frequency of a clamped-free beam of square section a, with shear and rotary inertia."""
    area, inertia, shear = a**2, a**4 / 12, E / 2 / (1 + nu) * 10 * (1 + nu) / (12 + 11 * nu)

    def determinant(w):
        # w'' etc. of Timoshenko's equations for harmonic motion, by its transfer matrix.
        A = np.array(
            [
                [0, 1, 0, 1 / (shear * area)],  # deflection' = rotation + Q/(κGA)
                [0, 0, 1 / (E * inertia), 0],  # rotation' = M/EI
                [0, -rho * inertia * w**2, 0, -1],  # M' = -Q - ρI ω² rotation
                [-rho * area * w**2, 0, 0, 0],  # Q' = -ρA ω² deflection
            ]
        )
        return np.linalg.det(expm(A * length)[2:, 2:])

    euler = 1.8751040687**2 * np.sqrt(E * inertia / (rho * area * length**4))
    return euler, brentq(determinant, 0.5 * euler, 1.2 * euler, xtol=1e-12 * euler)


def test_cantilever_sags_and_vibrates_as_a_beam():
    """Sag under an end load, then let go: deflection and first frequency of Timoshenko's beam."""
    length, a, E, rho = 10.0, 1.0, 1e6, 2.0
    euler, omega = _timoshenko_cantilever(E, rho, 0.0, length, a)
    force = -SOFT * E * a**4 / 12 / length**2
    dt = 2 * np.pi / omega / 60
    scene = rf.Scene(
        rf.box((0, 0, 0), (length, a, a), (10, 1, 1)),
        rf.StVenantKirchhoff(E=E, nu=0.0, rho=rho),
        [rf.Fixed("x0"), rf.Preload([rf.Traction("x1", (0.0, force / a**2, 0.0))])],
        order=2,
        probes={"end": (length, a / 2, a / 2)},
    )
    reports = list(rf.simulate(scene, dt, 245 * dt))
    sag = reports[0].probes["end"][1]
    bending, shear = force * length**3 / (E * a**4 / 4), force * length / (E / 2 * 5 / 6 * a**2)
    measured = _frequency(reports, "end", 1)
    show(
        sag_error=sag / (bending + shear) - 1,
        euler_error=measured / _in_time(euler, dt) - 1,
        timoshenko_error=measured / _in_time(omega, dt) - 1,
    )
    # Beam theory leaves out the clamped end's own stress field: a length of order (a/ℓ)² of the
    # deflection's shear part. Euler's beam leaves out shear: some (a/ℓ)².
    assert abs(sag / (bending + shear) - 1) <= 0.2 * (a / length) ** 2
    assert abs(measured / _in_time(omega, dt) - 1) <= 0.2 * (a / length) ** 2
    assert abs(measured / _in_time(euler, dt) - 1) <= 3 * (a / length) ** 2


def _uniaxial_bar(material, traction, cell="hexahedron", order=1):
    """Stretches of a unit cube under a dead end traction, free to contract, shape (3,)."""
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (2, 1, 1), cell),
        material,
        [
            *(rf.Fixed(axis + "0", axis) for axis in "xyz"),
            rf.Preload([rf.Traction("x1", (traction, 0.0, 0.0))], increments=3),
        ],
        order=order,
        mass="consistent",
        probes={"corner": (1.0, 1.0, 1.0)},
    )
    reports = rf.simulate(scene, 1.0, 1.0)
    corner = next(reports).probes["corner"]
    reports.close()
    return 1 + corner


def _svk_energy(a, b, p):
    e, f = (a**2 - 1) / 2, (b**2 - 1) / 2
    return p["lmbda"] / 2 * (e + 2 * f) ** 2 + p["mu"] * (e**2 + 2 * f**2)


def _neo_hooke_energy(a, b, p):
    log_J = np.log(a * b * b)
    return p["mu"] / 2 * (a**2 + 2 * b**2 - 3 - 2 * log_J) + p["lmbda"] / 2 * log_J**2


def _mooney_rivlin_energy(a, b, p):
    J = a * b * b
    I1, I2 = a**2 + 2 * b**2, 2 * a**2 * b**2 + b**4
    isochoric = p["c10"] * (J ** (-2 / 3) * I1 - 3) + p["c01"] * (J ** (-4 / 3) * I2 - 3)
    return isochoric + p["kappa"] / 2 * (J - 1) ** 2


@pytest.mark.parametrize("traction", [-15.0, 25.0])
@pytest.mark.parametrize(
    ("material", "energy"),
    [
        (rf.StVenantKirchhoff(E=100.0, nu=0.3, rho=1.0), _svk_energy),
        (rf.NeoHooke(E=100.0, nu=0.45, rho=1.0), _neo_hooke_energy),
        (rf.MooneyRivlin(c10=15.0, c01=5.0, kappa=90.0, rho=1.0), _mooney_rivlin_energy),
    ],
)
def test_static_end_load_at_finite_strain(material, energy, traction):
    """Both stretches under a dead end traction: ∂W/∂a = T, ∂W/∂b = 0, at 15 to 30 % strain."""

    def gradient(x):
        step = 1e-20j  # complex step: exact to rounding
        p = material.parameters
        return [
            (energy(x[0] + step, x[1], p) / 1e-20).imag - traction,
            (energy(x[0], x[1] + step, p) / 1e-20).imag,
        ]

    a, b = root(gradient, [1 + traction / 100, 1.0], tol=1e-14).x
    assert np.abs(gradient([a, b])).max() <= NEWTON * abs(traction)
    found = _uniaxial_bar(material, traction)
    show(a=a, b=b, error=np.abs(found - [a, b, b]).max())
    assert np.abs(found - [a, b, b]).max() <= 100 * NEWTON


@pytest.mark.parametrize(
    ("cell", "order"), [("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]
)
def test_uniform_stress_is_exact_in_all_cells(cell, order):
    """A patch test: the same stretches whatever the cells."""
    material = rf.NeoHooke(E=100.0, nu=0.3, rho=1.0)
    reference = _uniaxial_bar(material, 20.0)
    assert np.abs(_uniaxial_bar(material, 20.0, cell, order) - reference).max() <= 100 * NEWTON


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_free_fall_is_exact(mass):
    """u = v t + ½ g t², also at the steps' ends, and no strain."""
    g, v = np.array([1.0, -2.0, -9.81]), np.array([3.0, 0.0, 1.0])
    scene = rf.Scene(
        rf.box((0, 0, 0), (2, 1, 1), (3, 2, 1)),
        rf.NeoHooke(E=1e5, nu=0.3, rho=1000.0),
        [rf.Gravity(tuple(g)), rf.InitialVelocity(linear=tuple(v))],
        mass=mass,
    )
    for r in rf.simulate(scene, 0.07, 3.0):
        u, u_exact = r.state.u.x.array.reshape(-1, 3), v * r.t + g * r.t**2 / 2
        # Rounding of each step's increment adds up.
        assert np.abs(u - u_exact).max() <= 10 * (r.step + 1) * NEWTON * 45
        assert np.abs(r.state.v.x.array.reshape(-1, 3) - v - g * r.t).max() <= 1e3 * NEWTON * 30
        assert r.strain <= NEWTON * (r.kinetic + 1.0)


def test_body_force_is_gravity_by_volume():
    """A body force ρ g moves a body as gravity g does; on one half, it is half of it."""
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)).with_cells("half", lambda x: x[0] <= 1)
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=5.0)

    def momentum(load):
        *_, last = rf.simulate(rf.Scene(domain, material, [load]), 0.1, 1.0)
        return last.linear_momentum

    for load, share in (
        (rf.BodyForce((0.0, 0.0, -10.0)), 1.0),
        (rf.Gravity((0.0, 0.0, -2.0)), 1.0),
        (rf.BodyForce((0.0, 0.0, -10.0), where="half"), 0.5),
        (rf.Gravity((0.0, 0.0, -2.0), where="half"), 0.5),
    ):
        assert momentum(load) == pytest.approx([0, 0, -20.0 * share], abs=20 * 100 * NEWTON)


def oscillator(T, t, a, finer=8):
    """The largest displacement of the exact oscillator, a being linear between its instants."""
    omega = 2 * np.pi / T
    fine = np.linspace(t[0], t[-1], (t.size - 1) * finer + 1)
    system = [-1.0], [1.0, 2 * RATIO * omega, omega**2]
    return np.abs(lsim(system, np.interp(fine, t, a), fine)[1]).max()


@pytest.mark.parametrize(
    ("T", "dt", "until", "way"),
    [(0.5, 0.01, 3, by_gravity), (2.0, 0.02, 11.6, by_support)],
)
def test_el_centro(T, dt, until, way):
    """The reference within 1 %, the exact oscillator of this record within what Δt errs by."""
    most, _ = shaken(T, dt, until, way)
    assert most / INCH == pytest.approx(DEFORMATION[T], rel=0.01)
    assert most == pytest.approx(oscillator(T, *el_centro()), rel=3e-3)
