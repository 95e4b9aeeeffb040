"""Slender structures: a soft cantilever, beams under pressure and oblique load, a hanging strip.

* *Soft cantilever* of the Newton and MuJoCo projects: 0.9 m, 70 × 55 mm and 0.12 kg, with 0.2 kg at
  its tip, under 9.81 m/s². Reference is the rod that neither stretches nor shears.
* *Prestressed beam*: a hinged bar under a load P has (f/f₀)² = 1 - P/P_E up to Euler's load P_E.
* *Hanging chain*: a strip 3000 times as long as thick hangs between two points at 0.8 of its
  length; the sag is that of the catenary.
* *Princeton beam*: a cantilever under a load that is oblique to its section.

Its numbers are those of ANSYS that L. Obrezkov and others give (Nonlinear Dynamics 109 (2022) 31)
and Exudyn's test of its beam quotes, of beams and of solids (4 × 12 × 500 cells). Components are
relative to √(y² + z²) of their row.

The beams have the bound of 1 %. Of the solids' table the displacements along the stiff edge have
it, and those across it at 0°. The others are 0.7 to 3.1 % too small there, and no kind of cell
gives them: the plane case of 90° has the elastica, 146.27 mm at 8.896 N, beside which the table has
143.85 mm, CalculiX's cells of incompatible modes on 4 × 12 × 500 cells 145.96 mm, ours of second
order 145.81 mm, and first-order ones of that mesh, which lock, 139.99 mm, ours and CalculiX's. The
rows contradict each other, too: a rod of theory has them at loads of 99.5 % at 15° and of 97.7 to
98.2 % from 30° on, in directions that are up to 0.7° less and 0.5° more.

As a reduced part the beam bends too far for its shapes, of which a run warns.
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from bench.mode_answers import hinged_bar
from bench.static_answers import tip_of_rod
from codes import Case, calculix_static, calculix_there, nearest
from common import ROOT, block_of, comm, say
from scipy.optimize import brentq

import rigidfx as rf

from .row import Found, problem

G = 9.81  # m/s²


@problem("soft cantilever", "Newton and MuJoCo projects; elastica")
def soft_cantilever(short: bool) -> Iterator[list[Found]]:
    """Deflection of the tip for two moduli."""
    long, wide, high, own, tip = 0.9, 0.07, 0.055, 0.12, 0.2
    for modulus in (8e6, 16e6):
        domain = rf.box((0, 0, 0), (long, wide, high), (12 if short else 24, 2, 2))
        rubber = rf.StVenantKirchhoff(E=modulus, nu=0.3, rho=own / (long * wide * high))
        load = rf.Traction("x1", (0, 0, -tip * G / (wide * high)))
        given = [rf.Fixed("x0"), rf.Gravity((0, 0, -G)), load]
        probes = {"tip": (long, wide / 2, high / 2)}
        scene = rf.Scene(domain, rubber, given, order=2, mass="consistent", probes=probes)
        *_, report = rf.static(scene, 4, verbose=False)
        exact = tip_of_rod(long, modulus * wide * high**3 / 12, tip * G, own * G)
        title = f"deflection at {modulus / 1e6:g} MPa [m]"
        moved = float(-report.probes["tip"][2])
        yield [Found(title, exact, moved, 0.02, unknowns=report.unknowns)]


@problem("prestressed beam", "L. Euler")
def prestressed(short: bool) -> Iterator[list[Found]]:
    """Squares of frequencies over that without a load."""
    for share in (0.5, 0.98) if short else (0.25, 0.5, 0.75, 0.9, 0.98):
        euler = np.pi**2 * 1e9 * 0.01**4 / 12  # N
        found, _ = hinged_bar(-share * euler, 20 if short else 60)
        free, _ = hinged_bar(0.0, 20 if short else 60)
        title = f"(f/f₀)² at {share} of Euler's load"
        yield [Found(title, 1 - share, (found / free) ** 2, 0.005, 1.0)]


@problem("hanging chain", "Catenary")
def chain(short: bool) -> Iterator[list[Found]]:
    """Sag of the middle over the span."""
    thick, span = 3e-4, 0.8  # of the length
    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - 1, 0.1, 10.0)
    sag = a * (np.cosh(span / (2 * a)) - 1)
    half = brentq(lambda b: np.sin(b) / b - span, 0.1, 3.0)  # of the arc at the start
    radius = 0.5 / half

    def place(x: np.ndarray) -> np.ndarray:
        angle, r = 2 * half * (x[0] - 0.5), radius + thick * (0.5 - x[2])
        return np.stack([r * np.sin(angle), 0.01 * x[1], -r * np.cos(angle)])

    strip = block_of((16 if short else 100, 1, 2), place)
    low = radius * np.cos(half)
    for name, sign in (("left", -1), ("right", 1)):
        end = sign * radius * np.sin(half), -low
        strip = strip.with_edges(
            name, lambda x, end=end: np.hypot(x[0] - end[0], x[2] - end[1]) < 1e-9
        )
    soft = rf.StVenantKirchhoff(E=1e8, nu=0.0, rho=1000.0)
    given = [rf.Fixed("left"), rf.Fixed("right"), rf.Gravity((0, 0, -G))]
    scene = rf.Scene(strip, soft, given, order=2, probes={"middle": (0, 0.005, -radius)})
    *_, report = rf.static(scene, 5 if short else 10, verbose=False)
    found = radius - low - float(report.probes["middle"][2])
    yield [Found("sag over length", float(sag), found, 0.005, unknowns=report.unknowns)]


# The Princeton beam -------------------------------------------------------------------------------

LENGTH, WIDE, THIN = 0.508, 12.3777e-3, 3.2024e-3  # m
ALUMINIUM = rf.StVenantKirchhoff(E=71.7e9, nu=0.31, rho=2700.0)
STEP = 15  # degrees from the stiff edge, between loads
# By load [N]: displacements along the stiff edge and across it [mm].
BEAMS = {
    8.896: (
        (10.714, 10.613, 10.112, 8.837, 6.605, 3.539, 0.0),
        (0.0, 42.082, 79.395, 108.988, 129.888, 142.194, 146.246),
    ),
    13.345: (
        (16.064, 16.458, 16.659, 15.186, 11.578, 6.249, 0.0),
        (0.0, 64.358, 117.736, 156.467, 181.862, 196.097, 200.678),
    ),
}
SOLIDS = {
    8.896: (
        (10.698, 10.572, 9.938, 8.687, 6.500, 3.482, 0.0),
        (0.0, 41.012, 76.967, 105.976, 127.251, 139.595, 143.849),
    ),
    13.345: (
        (16.037, 16.370, 16.404, 14.851, 11.272, 6.062, 0.0),
        (0.0, 62.707, 113.752, 153.554, 179.979, 192.972, 197.669),
    ),
}
BOUND = 0.01
CELLS, COARSE = (60, 4, 2), (30, 2, 1)  # of second order, along the edges
LINEAR, OF_ANSYS = (125, 6, 2), (500, 12, 4)  # of first order
WORST, PLANE = 2, 6  # angles: 30° is farthest from the table of solids, at 90° the beam stays plane
# CalculiX's kind of a cell, and the largest difference to it: the same cells, and similar ones.
PEERS = {"standard": ("C3D8", 1e-6), "enhanced": ("C3D8I", 2e-4)}
DRAG, REST, DT = 130.0, 0.24, 0.02  # 1/s, about critical; s
BEND = rf.Table((0.0, 0.05), (0.0, 1.0))  # s: the load grows and stays


def pulled(load: float, degrees: float) -> np.ndarray:
    """Traction at the tip [Pa], shape (3,)."""
    angle = np.radians(degrees)
    return load / (WIDE * THIN) * np.array([0.0, np.cos(angle), np.sin(angle)])


def beam(
    load: float,
    degrees: float,
    cells: tuple[int, int, int],
    *effects: rf.effects.Effect,
    **how: Any,
) -> rf.Scene:
    """The beam under a load at its tip [N]."""
    y, z = WIDE / 2, THIN / 2
    domain = rf.box((0, -y, -z), (LENGTH, y, z), cells)
    force, time = tuple(pulled(load, degrees)), BEND if effects else None
    given = [rf.Fixed("x0"), rf.Traction("x1", force, time=time), *effects]
    return rf.Scene(domain, ALUMINIUM, given, probes={"tip": (LENGTH, 0, 0)}, **how)


def rows(u: np.ndarray, load: float, k: int, how: str, **more: Any) -> list[Found]:
    """Both components [mm] beside those of ANSYS."""
    out = []
    for name, table in (("beams", BEAMS), ("solids", SOLIDS)):
        published = [component[k] for component in table[load]]
        scale = float(np.hypot(*published))
        for axis, theirs, own in zip("yz", published, u[1:], strict=True):
            bounded = name == "beams" or axis == "y" or k == 0
            title = f"{axis} at {load} N, {STEP * k}°, {how}, beside ANSYS {name} [mm]"
            found = Found(title, theirs, float(1e3 * own), BOUND if bounded else None, scale)
            out.append(replace(found, **more))
    return out


def static(load: float, k: int, cells: tuple[int, int, int], **how: Any) -> rf.Report:
    """The last report of load steps."""
    *_, report = rf.static(beam(load, STEP * k, cells, **how), 4, verbose=False)
    return report


@problem("Princeton beam", "L. Obrezkov et al., Nonlinear Dynamics 109 (2022) 31")
def princeton(short: bool) -> Iterator[list[Found]]:
    """Statics at all angles, and steps to rest."""
    for load in list(BEAMS)[1:] if short else BEAMS:
        for k in (WORST,) if short else range(7):
            report = static(load, k, COARSE if short else CELLS, order=2)
            yield rows(report.probes["tip"], load, k, "statics", unknowns=report.unknowns)
    yield reduced()
    if not short:
        scene = beam(13.345, 45, COARSE, rf.MassDamping(DRAG), order=2)
        *_, report = rf.simulate(scene, DT, REST, progress=False)
        yield rows(report.probes["tip"], 13.345, 3, "steps to rest", unknowns=report.unknowns)


@problem("its first-order cells", "L. Obrezkov et al., Nonlinear Dynamics 109 (2022) 31; CalculiX")
def first_order(short: bool) -> Iterator[list[Found]]:
    """Cells of first order beside the tables, and beside CalculiX's where it is installed."""
    if short:
        return
    command = calculix_there() if comm.size == 1 else None
    if command is None:
        say("CalculiX is missing, or there are several ranks; see peers.py")
    for load, k in ((8.896, WORST), (8.896, PLANE)):
        report = static(load, k, OF_ANSYS, order=1)
        how = "standard cells, 500 × 12 × 4"
        yield rows(report.probes["tip"], load, k, how, allowed=None, unknowns=report.unknowns)
        report = static(load, k, LINEAR, order=1, element="enhanced")
        yield rows(report.probes["tip"], load, k, "enhanced cells", unknowns=report.unknowns)
        for element in PEERS if command else ():
            yield beside_calculix(command, load, k, element)


def beside_calculix(command: str, load: float, k: int, element: str) -> list[Found]:
    """Both components beside those of CalculiX on the same mesh [mm]."""
    theirs, most = PEERS[element]
    scene = beam(load, STEP * k, LINEAR, order=1, element=element)
    *_, report = rf.static(scene, 4, verbose=False)
    tractions, factor = {"x1": pulled(load, STEP * k)}, rf.Table((0.0, 1.0), (0.0, 1.0))
    probe = nearest(scene, (LENGTH, 0.0, 0.0))
    case = Case("princeton", scene, tractions, factor, "x0", 0.25, 4, probe)
    known = calculix_static(case, command, ROOT / "out" / "calculix", theirs)[1:]
    title = f"at {load} N, {STEP * k}°, {element} cells, beside CalculiX's {theirs} [mm]"
    scale = float(1e3 * np.linalg.norm(known))
    return [
        Found(f"{axis} {title}", float(1e3 * a), float(1e3 * b), most, scale)
        for axis, a, b in zip("yz", known, report.probes["tip"][1:], strict=True)
    ]


def reduced() -> list[Found]:
    """As a reduced part, which bends too far for its shapes: a warning has its error."""
    scene = beam(13.345, 45, COARSE, rf.MassDamping(DRAG), rf.Reduced(), order=2)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        *_, report = rf.simulate(scene, DT, REST, progress=False)
    assert comm.rank > 0 or any("too far for its shapes" in str(one.message) for one in heard)
    found = rows(report.probes["tip"], 13.345, 3, "steps to rest", kind="reduced", allowed=None)
    return [replace(one, unknowns=report.unknowns) for one in found[:2]]
