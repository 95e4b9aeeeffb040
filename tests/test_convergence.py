"""Measured orders: in the time step, and in the cell size for smooth solutions."""

from itertools import pairwise

import numpy as np
import pytest
import ufl
from dolfinx import fem
from histories import show

import rigidfx as rf

pytestmark = pytest.mark.convergence

MATERIALS = {
    "StVenantKirchhoff": rf.StVenantKirchhoff(rho=1.0, E=100.0, nu=0.3),
    "NeoHooke": rf.NeoHooke(rho=1.0, E=100.0, nu=0.3),
}


def _orders(errors):
    return [float(np.log2(a / b)) for a, b in pairwise(errors)]


def _final_state(name, dt, *effects, scheme=None):
    """A bar of finite strain, bending and spinning, at t = 0.2 s."""

    def smooth(X):
        return np.stack([0.3 * np.cos(X[0]), 0.5 * np.cos(np.pi * X[0] / 4), 0.1 * X[1] * X[0]])

    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)),
        MATERIALS[name],
        [rf.InitialVelocity(angular=(0.0, 0.0, 0.3), function=smooth), *effects],
        scheme=scheme,
    )
    *_, last = rf.simulate(scene, dt, 0.2)
    return np.concatenate([last.state.u.x.array, last.state.v.x.array])


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize(("xi", "order"), [(None, 2), (0.0, 2), (0.2, 1)])
def test_order_in_time(name, xi, order):
    """2 without damping, 1 with ξ fixed, from differences of solutions at Δt, Δt/2, …"""
    damping = [] if xi is None else [rf.NumericalDamping(xi)]
    states = [_final_state(name, 0.01 / 2**k, *damping) for k in range(4)]
    first, last = _orders([np.linalg.norm(a - b) for a, b in pairwise(states)])
    show(first=first, last=last)
    # What is left of the next power of Δt halves (order 1) or quarters (order 2) each time.
    assert abs(last - order) <= 0.02
    assert abs(last - order) <= abs(first - order)


@pytest.mark.parametrize("scheme", [rf.Midpoint(), rf.Trapezoidal()])
def test_order_in_time_of_the_other_schemes(scheme):
    """They are of second order too."""
    states = [_final_state("NeoHooke", 0.01 / 2**k, scheme=scheme) for k in range(4)]
    last = _orders([np.linalg.norm(a - b) for a, b in pairwise(states)])[-1]
    show(last=last)
    assert abs(last - 2) <= 0.02


AMPLITUDE = 1e-6  # of the strain: what nonlinearity adds is as small, relative to the solution
STEPS = 8  # of a quarter period


def _standing_wave_error(n, mass, order, cell):
    """Relative L2 error in u after a quarter period of a pressure wave between sliding walls.

    u = grad cos(πx) cos(πy) cos(πz) sin(ωt) in the unit cube, with ω² = 3π² (λ + 2μ)/ρ. The time
    error is known and taken out: the scheme turns ω into 2/Δt arctan(ωΔt/2), with the velocity's
    amplitude as it is.
    """
    material = rf.StVenantKirchhoff(rho=2.0, E=5.0, nu=0.3)
    p = material.parameters
    omega = np.pi * np.sqrt(3 * (p["lmbda"] + 2 * p["mu"]) / material.rho)
    dt = np.pi / 2 / omega / STEPS

    def mode(X, sin=np.sin, cos=np.cos):
        s, c = [sin(np.pi * X[i]) for i in range(3)], [cos(np.pi * X[i]) for i in range(3)]
        return [s[0] * c[1] * c[2], c[0] * s[1] * c[2], c[0] * c[1] * s[2]]

    walls = [rf.Fixed(axis + side, axis) for axis in "xyz" for side in "01"]
    start = rf.InitialVelocity(function=lambda X: AMPLITUDE * omega * np.array(mode(X)))
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (n, n, n), cell),
        material,
        [*walls, start],
        order=order,
        mass=mass,
    )
    *_, last = rf.simulate(scene, dt, STEPS * dt)
    phase = 2 * np.arctan(omega * dt / 2) * STEPS
    x = ufl.SpatialCoordinate(scene.mesh)
    exact = float(AMPLITUDE * np.sin(phase)) * ufl.as_vector(mode(x, ufl.sin, ufl.cos))
    dx = ufl.dx(metadata={"quadrature_degree": 2 * order + 4})
    squares = [
        scene.sum(fem.assemble_scalar(fem.form(ufl.inner(w, w) * dx)))
        for w in (last.state.u - exact, exact)
    ]
    return float(np.sqrt(squares[0] / squares[1]))


@pytest.mark.parametrize(
    ("order", "cell", "mass", "sizes"),
    [
        (1, "hexahedron", "lumped", (6, 12)),
        (1, "hexahedron", "consistent", (6, 12)),
        (1, "tetrahedron", "lumped", (6, 12)),
        (1, "tetrahedron", "consistent", (6, 12)),
        (2, "hexahedron", "lumped", (3, 6)),
        (2, "hexahedron", "consistent", (3, 6)),
        (2, "tetrahedron", "consistent", (3, 6)),
    ],
)
def test_order_in_space(order, cell, mass, sizes):
    """Order + 1 in the displacement's L2 norm."""
    errors = [_standing_wave_error(n, mass, order, cell) for n in sizes]
    (measured,) = _orders(errors)
    show(order=measured, coarse=errors[0], fine=errors[1])
    # What is left of the next power of the cell size is below 1 % of the error by now.
    assert measured >= order + 1 - 0.1
