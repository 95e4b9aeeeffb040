"""Motions: a pendulum, bars that spin freely or are spun up, and an earthquake.

* *Pendulum*: a bar of steel, 0.1 × 0.1 × 1 m, on a hinge in the middle of its bottom, let go at 45°
  above the horizontal (SimScale's validation case of a pinned bar; CalculiX's forum, thread 1826:
  7.08845 m/s at 0.626 s). A rigid bar has exactly this speed at a corner of its top.
* *Turning bar*: a bar is thrown into a spin about its middle without stretch, so that it vibrates
  about the stretch ρ ω² a³/(3 E) of its halves a; waves repeat after 2 L/c, over which is averaged.
* *Spin-up beam* (J. C. Simo and L. Vu-Quoc, ASME J. Appl. Mech. 53 (1986) 855): 10 m long,
  EA 2.8e7 N, EI 1.4e4 N m², ρA 1.2 kg/m: a square solid of 77.5 mm. It is brought to 6 rad/s in
  15 s, by a support, or by a motor on its face: a mean one, with both orders of sides, or a rigid
  one. The tip lags by 0.576 m, and afterwards the beam is stretched by
  ρA ω² L³/(3 EA) = 5.14e-4 m, and swings by 5 mm at most. A step of φ stretches it by φ²/6 more.
* *El Centro*: the largest displacement of an oscillator of 1 s with 2 % of damping by the record of
  1940, north-south (A. K. Chopra, Dynamics of Structures, figure 6.4.1: 5.97 in).
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from common import ROOT
from scipy.interpolate import make_interp_spline

import rigidfx as rf

from .row import Found, problem

Array = npt.NDArray[np.float64]
G = 9.81  # m/s²
STEEL = rf.StVenantKirchhoff(E=2.05e11, nu=0.3, rho=7870.0)
INCH, G_OF_RECORD = 0.0254, 386.4 * 0.0254  # m; m/s², as in the reference
RATIO = 0.02  # of damping
# Largest displacements by the El Centro record, by period.
DEFORMATION = {0.5: 2.67, 1.0: 5.97, 2.0: 7.47}  # s: in
RECORD = ROOT / "tests" / "data" / "el_centro_1940_ns.txt"


@problem("pendulum", "SimScale, pinned bar; CalculiX's forum, thread 1826")
def pendulum(short: bool) -> Iterator[list[Found]]:
    """The largest speed of a corner, and its time: flexible, reduced, found and named rigid."""
    dt = 0.02 if short else 0.002
    slope = np.array([[1.0, 0.0, -1.0], [0.0, np.sqrt(2), 0.0], [1.0, 0.0, 1.0]]) / np.sqrt(2)
    domain = rf.box((-0.05, -0.05, 0), (0.05, 0.05, 1), (1, 1, 6)).with_cells(
        "bar", lambda x: x[2] > -1
    )
    domain.mesh.geometry.x[:] = domain.mesh.geometry.x @ slope
    corner = np.array([0.05, 0.05, 1.0]) @ slope
    named = {"rigid": [rf.Rigid("bar")], "reduced": [rf.Reduced("bar")]}
    for kind in ("flexible", "reduced", "found", "rigid"):
        side = "bar" if kind == "rigid" else rf.MeanFace("z0")
        hinge = rf.Revolute("ground", side, (0, 0, 0), (0, 1, 0), name="hinge")
        given = [hinge, rf.Gravity((0, 0, -G)), *named.get(kind, [])]
        probes = {"corner": tuple(corner)}
        scene = rf.Scene(domain, STEEL, given, element="enhanced", mass="consistent", probes=probes)
        rigidify = rf.StrainRate(tol=1.0, window=5 * dt) if kind == "found" else None
        places = []
        for report in rf.simulate(scene, dt, 0.7, rigidify=rigidify, progress=False):
            places.append(report.probes["corner"])
        speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / dt
        k = int(np.argmax(speed))
        curve = np.polyfit([-dt, 0, dt], speed[k - 1 : k + 2], 2)
        after = -curve[1] / (2 * curve[0])
        most, at = np.polyval(curve, after), (k + 0.5) * dt + after
        yield [
            Found("largest speed [m/s]", 7.0885, float(most), 0.005, None, kind, report.unknowns),
            Found("its time [s]", 0.626, float(at), 0.005, None, kind, report.unknowns),
        ]


@problem("turning bar", "ρ ω² a³/(3 E)")
def turning_bar(short: bool) -> Iterator[list[Found]]:
    """The mean stretch of a bar that spins, flexible and reduced."""
    long, thick, rate = 1.0, 0.05, 100.0  # m, m, rad/s
    soft = rf.StVenantKirchhoff(E=1e9, nu=0.0, rho=1000.0)
    period = 2 * long / 1e3  # s, 2 L/c
    exact = soft.rho * rate**2 * long**3 / (12 * 1e9)
    domain = rf.box((0, 0, 0), (long, thick, thick), (20, 2, 2))
    ends = {"a": (0, thick / 2, thick / 2), "b": (long, thick / 2, thick / 2)}
    for kind in ("flexible", "reduced"):
        given = [rf.InitialVelocity(angular=(0, 0, rate)), *[rf.Reduced()] * (kind == "reduced")]
        scene = rf.Scene(domain, soft, given, element="enhanced", probes=ends)
        steps = 40 if short else 160
        stretch = []
        for report in rf.simulate(scene, period / steps, 2 * period, progress=False):
            apart = report.probes["b"] - report.probes["a"] + [long, 0, 0]
            stretch.append(float(np.linalg.norm(apart)) - long)
        mean = float(np.trapezoid(stretch) / (len(stretch) - 1))
        yield [Found("mean stretch [m]", exact, mean, 0.01, None, kind, report.unknowns)]


def el_centro() -> tuple[Array, Array]:
    """Times [s] and ground accelerations [m/s²]."""
    lines = RECORD.read_text(encoding="utf-8").splitlines()
    values = " ".join(line for line in lines if not line.startswith("#")).split()
    a = 1e-5 * G_OF_RECORD * np.array([0, *values], dtype=float)
    return 0.02 * np.arange(a.size), a


def storey(period: float, effects: list[rf.effects.Effect]) -> rf.Scene:
    """A storey without mass, whose walls shear, under a level roof of a tonne."""
    height, width, mass = 10.0, 10.0, 1000.0
    stiffness = mass * (2 * np.pi / period) ** 2  # N/m, = G A/h
    walls = rf.StVenantKirchhoff(E=2 * stiffness * height / width**2, nu=0.0, rho=1e-3)
    effects = [
        rf.PointMass("z1", mass),
        rf.Fixed("z1", components="yz"),
        rf.StiffnessDamping(RATIO, 1 / period),
        *effects,
    ]
    cell = rf.box((0, 0, 0), (width, width, height), (1, 1, 1))
    return rf.Scene(cell, walls, effects, probes={"roof": (5, 5, 10)})


def by_gravity(t: Array, a: Array) -> list[rf.effects.Effect]:
    """In the frame of the ground, where it is a load on all mass."""
    return [rf.Fixed("z0"), rf.Gravity((-1.0, 0.0, 0.0), time=rf.Table(t, a))]


def by_support(t: Array, a: Array) -> list[rf.effects.Effect]:
    """The record, integrated twice, moves the foot."""
    path = make_interp_spline(t, a, k=1).antiderivative(2)
    speed = path.derivative()
    return [
        rf.PrescribedMotion(
            "z0",
            displacement=lambda t: (float(path(t)), 0.0, 0.0),
            velocity=lambda t: (float(speed(t)), 0.0, 0.0),
        )
    ]


def shaken(period: float, dt: float, until: float, way: Callable[..., Any]) -> tuple[float, int]:
    """Largest displacement of a storey's roof against the ground [m], and unknowns."""
    t, a = el_centro()
    path = make_interp_spline(t, a, k=1).antiderivative(2)
    most = 0.0
    for report in rf.simulate(storey(period, way(t, a)), dt, until, progress=False):
        ground = float(path(report.t)) if way is by_support else 0.0
        most = max(most, abs(report.probes["roof"][0] - ground))
    return most, report.unknowns


@problem("El Centro", "A. K. Chopra, Dynamics of Structures, figure 6.4.1")
def earthquake(short: bool) -> Iterator[list[Found]]:
    """The largest displacement of the roof against the ground."""
    for way in (by_gravity, by_support):
        most, unknowns = shaken(1.0, 0.02 if short else 0.01, 5.2, way)
        title = f"largest displacement, {way.__name__.replace('_', ' ')} [in]"
        yield [Found(title, DEFORMATION[1.0], most / INCH, 0.01, unknowns=unknowns)]


# A beam that is spun up ---------------------------------------------------------------------------

LENGTH, SIDE = 10.0, 0.0775  # m
PLASTIC = rf.StVenantKirchhoff(E=4.67e9, nu=0.0, rho=200.0)
RATE, UP = 6.0, 15.0  # rad/s, s
LAG, STRETCH, SWING = 0.576, 5.14e-4, 0.005  # m
END, DT = 17.0, 0.025  # s
SHORT_END, SHORT_DT = 7.0, 0.07  # s: the largest lag is at 6.8 s
WAYS = "support", "motor, mean face", "motor, mean face second side", "motor, rigid face"


def angle(t: float) -> float:
    """Angle of the hub [rad]."""
    if t >= UP:
        return RATE * t - 45.0
    return RATE / UP * (t**2 / 2 + (UP / (2 * np.pi)) ** 2 * (np.cos(2 * np.pi * t / UP) - 1))


def speed(t: float) -> float:
    """Its derivative [rad/s]."""
    return RATE * min(t, UP) / UP - RATE / (2 * np.pi) * float(np.sin(2 * np.pi * min(t, UP) / UP))


def driven(way: str) -> list[rf.effects.Effect]:
    """A way to turn the beam."""
    axis = 0.0, 0.0, 1.0
    if way == "support":
        return [rf.PrescribedRotation("x0", axis=axis, angle=angle, speed=speed)]
    face = rf.RigidFace("x0") if "rigid" in way else rf.MeanFace("x0")
    sides = (face, "ground") if "second" not in way else ("ground", face)
    sign = 1.0 if sides[0] == "ground" else -1.0
    hinge = rf.Revolute(*sides, (0, 0, 0), axis, name="hub")
    return [hinge, rf.Motor("hub", angle=lambda t: sign * angle(t))]


def spun(way: str, short: bool) -> list[Found]:
    """Largest lag of the tip, and in full runs the mean stretch afterwards."""
    y = SIDE / 2
    domain = rf.box((0, -y, -y), (LENGTH, y, y), (10 if short else 20, 1, 1))
    probes = {"tip": (LENGTH, 0, 0), "hub": (0, 0, 0)}
    scene = rf.Scene(domain, PLASTIC, driven(way), order=2, probes=probes)
    dt, end = (SHORT_DT, SHORT_END) if short else (DT, END)
    lags, stretches = [], []
    for report in rf.simulate(scene, dt, end, progress=False):
        turned = angle(report.t)
        along = np.array([np.cos(turned), np.sin(turned), 0.0])
        tip = report.probes["tip"] + [LENGTH, 0, 0] - report.probes["hub"]
        lags.append(float(tip[0] * along[1] - tip[1] * along[0]))
        if report.t > UP:
            assert abs(lags[-1]) <= SWING, way
            stretches.append(tip @ along - LENGTH)
    rows = [Found(f"lag of the tip, {way} [m]", LAG, max(lags), 0.01, unknowns=report.unknowns)]
    if not short:
        stretch = float(np.mean(stretches))
        title = f"stretch, {way} [m]"
        rows.append(Found(title, STRETCH, stretch, 0.01, unknowns=report.unknowns))
    return rows


@problem("spin-up beam", "J. C. Simo, L. Vu-Quoc, J. Appl. Mech. 53 (1986) 855")
def spin_up(short: bool) -> Iterator[list[Found]]:
    """All ways, one after the other."""
    for way in WAYS[2:3] if short else WAYS:
        yield spun(way, short)
