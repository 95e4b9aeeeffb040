"""Statics against exact and converged values: bending, pressure, contact, friction, snap-through.

* *elastica*: a cantilever under an end load of four times EI/L², whose tip moves by 0.67 L. The
  reference is the curve of an inextensible rod, found by integration.
* *pressure vessel*: a thick tube under follower pressure in plane strain; Lamé's solution.
* *Hertz*: a rigid sphere pressed into a block. The greatest pressure belongs to the force found.
* *friction*: a block on a plane pushed by twice what friction bears; a spring takes the rest.
* *snap-through*: a clamped shallow arch under a load at its crown. Load steps end with an error at
  the limit; the reference is the greatest reaction when the crown's displacement is prescribed.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from common import block_of
from mpi4py import MPI
from scipy.integrate import solve_bvp

import rigidfx as rf

FACTOR = 1.7  # of the limit load, that the load steps of the arch aim at

Case = Callable[[bool], tuple[float, float]]


def last_of(scene: rf.Scene, steps: Any) -> rf.Report:
    """The report of the last load step."""
    *_, report = rf.static(scene, steps)
    return report


def tip_of_rod(length: float, bending: float, tip: float, weight: float = 0.0) -> float:
    """Deflection of the tip of a level rod that neither stretches nor shears [m].

    Its bending stiffness is E I [N m²]; the tip and its own weight are forces [N].
    """
    P, W = (force * length**2 / bending for force in (tip, weight))

    def rod(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Angle, curvature, and place: θ'' = -(P + W (1 - s)) cos θ."""
        return np.stack([y[1], -(P + W * (1 - s)) * np.cos(y[0]), np.sin(y[0])])

    s = np.linspace(0, 1, 101)
    ends = lambda a, b: np.array([a[0], b[1], a[2]])  # noqa: E731
    start = np.stack([s, 1 - s, s**2])
    return float(length * solve_bvp(rod, ends, s, start, tol=1e-10, max_nodes=100_000).y[2, -1])


def elastica(short: bool) -> tuple[float, float]:
    """Deflection of the tip over the length."""
    force, thick = 4.0, 0.01
    bar = rf.box((0, 0, 0), (1, thick, thick), (20 if short else 50, 1, 1))
    rubber = rf.StVenantKirchhoff(E=12.0, nu=0.0, rho=1.0)
    load = rf.Traction("x1", (0.0, 0.0, force * thick**2))
    middle = (1.0, thick / 2, thick / 2)
    effects = [rf.Fixed("x0"), load]
    scene = rf.Scene(bar, rubber, effects, order=2, probes={"tip": middle})
    return float(last_of(scene, 10).probes["tip"][2]), tip_of_rod(1.0, 1.0, force)


def vessel(short: bool) -> tuple[float, float]:
    """Radial displacement of the inner face, over its radius."""
    a, b, E, nu, p = 1.0, 2.0, 1e9, 0.3, 1e5
    n = (3, 12, 1) if short else (8, 32, 1)

    def place(x: np.ndarray) -> np.ndarray:
        r, angle = a + (b - a) * x[0], 0.5 * np.pi * x[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.1 * x[2]])

    tube = block_of(n, place)
    holds = [rf.Fixed("y0", "y"), rf.Fixed("y1", "x"), rf.Fixed("z0", "z"), rf.Fixed("z1", "z")]
    material = rf.NeoHooke(E=E, nu=nu, rho=1000.0)
    effects = [*holds, rf.Pressure("x0", p)]
    scene = rf.Scene(tube, material, effects, order=2, probes={"inner": (a, 0, 0)})
    exact = p * a**2 * (1 + nu) / (E * (b**2 - a**2)) * ((1 - 2 * nu) * a + b**2 / a)
    return float(last_of(scene, 1).probes["inner"][0]), exact


def hertz(short: bool) -> tuple[float, float]:
    """Greatest pressure under a sphere, over that of Hertz for the same force."""
    R, E, nu, deep = 10.0, 1e6, 0.3, 1e-3
    n = 10 if short else 18

    def place(x: np.ndarray) -> np.ndarray:
        """A quarter of a block; cells grow away from the contact at the origin."""
        grown = (np.exp(3.2 * np.stack([x[0], x[1], 1 - x[2]])) - 1) / (np.exp(3.2) - 1)
        return grown * np.array([[1.0], [1.0], [-1.0]])

    quarter = block_of((n, n, n), place)
    soft = rf.StVenantKirchhoff(E=E, nu=nu, rho=1000.0)
    path = lambda t: (0.0, 0.0, -deep * t)  # noqa: E731
    ball = rf.Sphere((0.0, 0.0, R), R, path=path)
    contact = rf.Contact("z1", against=ball, stiffness=1e9, title="ball")
    holds = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("z0")]
    scene = rf.Scene(quarter, soft, [*holds, contact])
    report = last_of(scene, 4)
    force = 4 * abs(report.touches["ball"].force[2])
    state = report.state
    x = state.X + state.u.x.array.reshape(-1, 3)
    _, _, pressure = contact.at_nodes(scene, x, report.t)
    found = scene.comm.allreduce(float(pressure.max(initial=0.0)), op=MPI.MAX)
    exact = (6 * force * (E / (1 - nu**2)) ** 2 / (np.pi**3 * R**2)) ** (1 / 3)
    return found / exact, 1.0


def friction(short: bool) -> tuple[float, float]:
    """How far a block slides that is pushed by twice what friction bears [m]."""
    mu, k, weight = 0.4, 1e3, 100.0
    n = 2 if short else 5
    block = rf.box((0, 0, 0), (1, 1, 0.5), (n, n, n))
    stiff = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0)
    floor = rf.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    effects = [
        rf.Contact("z0", against=floor, friction=mu, creep=1e-6),
        rf.Traction("z1", (0.0, 0.0, -weight), time=rf.Table((0, 0.5), (0, 1))),
        rf.BodyForce((2 * mu * weight / 0.5, 0.0, 0.0), time=rf.Table((0.5, 1), (0, 1))),
        rf.Spring("z1", (k, k, 0.0)),
    ]
    scene = rf.Scene(block, stiff, effects, probes={"top": (0.5, 0.5, 0.5)})
    pushed = last_of(scene, 10)
    return float(pushed.probes["top"][0]), mu * weight / k


def snap_through(short: bool) -> tuple[float, float]:
    """Limit load of an arch, over the force unit."""
    rise, thick = 0.05, 0.01
    n, led_steps = (8, 20) if short else (40, 40)

    def place(x: np.ndarray) -> np.ndarray:
        return np.stack([x[0], 0.01 * x[1], 4 * rise * x[0] * (1 - x[0]) + thick * (x[2] - 0.5)])

    arch = block_of((n, 1, 1), place)
    top = np.array([[0.5], [rise + thick / 2]])
    arch = arch.with_edges("crown", lambda x: np.abs(x[::2] - top).max(axis=0) < 1e-9)
    material = rf.StVenantKirchhoff(E=1e6, nu=0.0, rho=1.0)
    clamped = [rf.Fixed("x0"), rf.Fixed("x1")]
    push = rf.PrescribedMotion("crown", "z", displacement=lambda t: (0.0, 0.0, -rise * t))
    led = rf.Scene(arch, material, [*clamped, push], order=2)
    greatest = max(-float(r.reactions["crown"][2]) for r in rf.static(led, led_steps) if r.step)
    load = rf.NodalForce("crown", (0.0, 0.0, -FACTOR * greatest))
    loaded = rf.Scene(arch, material, [*clamped, load], order=2)
    reached, ended = 0.0, "the path goes on"
    try:
        for report in rf.static(loaded, 8 if short else 20):
            reached = FACTOR * greatest * report.t
    except rf.StepError as error:
        ended = str(error)
    assert "limit load, where" in ended, ended
    return reached, greatest


CASES: dict[str, tuple[Case, float]] = {  # and the relative error that is allowed
    "elastica": (elastica, 0.005),
    "pressure vessel": (vessel, 0.003),
    "Hertz": (hertz, 0.03),
    "friction": (friction, 0.005),
    "snap-through": (snap_through, 0.005),
}
