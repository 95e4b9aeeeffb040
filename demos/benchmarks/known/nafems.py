"""Problems of NAFEMS.

* *FV52*: modes of a simply supported solid plate of 10 × 10 × 1 m on 4 × 4 cells. Its rim is held
  on a line, about which finer solids become ever softer; the numbers are those of 20-node cells
  that NAFEMS gives beside its target of plate theory (45.897, 109.44, 167.89 Hz).
* *5T*: a simply supported beam of 10 × 2 × 2 m under a sudden load of 1 MN/m (NAFEMS R0016).
* *LE10*: a thick elliptic plate under pressure; stress at the end of the inner ellipse.
* *3DNLG-5*: a bend of 45° and radius 100 under loads across (NAFEMS R0024); the numbers are those
  of Abaqus' B32, which three elements of it share to 1.3 %.
"""

from collections.abc import Iterator

import numpy as np
from common import block_of

import rigidfx as rf

from .row import Found, problem

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=8000.0)


@problem("NAFEMS FV52", "NAFEMS FV52, The Standard NAFEMS Benchmarks (1990)")
def plate(short: bool) -> Iterator[list[Found]]:
    """The first modes that bend, of which two are equal [Hz]."""

    def rim(x: np.ndarray) -> np.ndarray:
        return (x[2] < 1e-9) & (np.abs(x[:2] - 5).max(axis=0) > 5 - 1e-9)

    square = rf.box((0, 0, 0), (10, 10, 1), (4, 4, 1)).with_edges("rim", rim)
    scene = rf.Scene(square, STEEL, [rf.Fixed("rim", "z")], order=2, mass="consistent")
    found = rf.modes(scene, 4).frequencies
    known = {1: 44.8, 2: 110.5, 4: 169.1}
    yield [Found(f"frequency {k} [Hz]", f, float(found[k - 1]), 0.02) for k, f in known.items()]


@problem("NAFEMS 5T", "NAFEMS 5T, Selected Benchmarks for Forced Vibration, R0016")
def deep_beam(short: bool) -> Iterator[list[Found]]:
    """The first peak of the middle, its time, and its static deflection."""
    alpha, beta, force = 5.36, 7.46e-5, 2.5e5  # 1/s, s, N/m³

    def beam(*damping: rf.effects.Effect) -> rf.Scene:
        domain = rf.box((0, -1, -1), (10, 1, 1), (10 if short else 20, 2, 2))
        domain = domain.with_edges("axis", lambda x: (np.abs(x[2]) < 1e-9) & (x[0] < 1e-9))
        holds = [rf.Fixed("x0", "z"), rf.Fixed("x1", "z"), rf.Fixed("axis", "xy")]
        given = [*holds, rf.BodyForce((0.0, 0.0, -force)), *damping]
        probes = {"middle": (5, 0, 0)}
        return rf.Scene(domain, STEEL, given, order=2, mass="consistent", probes=probes)

    damping = rf.MassDamping(alpha), rf.StiffnessDamping(beta * np.pi, 1.0)
    t, w = [], []
    for report in rf.simulate(beam(*damping), 3e-4 if short else 1e-4, 0.0135, progress=False):
        t.append(report.t)
        w.append(-report.probes["middle"][2])
    k = int(np.argmax(w))
    curve = np.polyfit(np.array(t[k - 1 : k + 2]) - t[k], w[k - 1 : k + 2], 2)
    after = -curve[1] / (2 * curve[0])
    yield [
        Found("peak [mm]", 1.043, float(1e3 * np.polyval(curve, after)), 0.01),
        Found("time of the peak [ms]", 11.7, float(1e3 * (t[k] + after)), 0.01),
    ]
    *_, report = rf.static(beam(), 1, verbose=False)
    yield [Found("static deflection [mm]", 0.538, float(-1e3 * report.probes["middle"][2]), 0.01)]


@problem("NAFEMS LE10", "NAFEMS LE10, The Standard NAFEMS Benchmarks (1990)")
def thick_plate(short: bool) -> Iterator[list[Found]]:
    """Stress across the inner ellipse, at its end on the loaded side [MPa]."""
    n = (8, 12, 4) if short else (12, 18, 6)

    def place(x: np.ndarray) -> np.ndarray:
        out, angle = x[0], np.pi / 2 * x[1]
        half = 2 + 1.25 * out, 1 + 1.75 * out
        return np.stack([half[0] * np.cos(angle), half[1] * np.sin(angle), 0.6 * x[2]])

    def line(x: np.ndarray) -> np.ndarray:
        outside = (x[0] / 3.25) ** 2 + (x[1] / 2.75) ** 2 > 0.96
        return (np.abs(x[2] - 0.3) < 1e-9) & outside

    quarter = block_of(n, place).with_edges("line", line)
    holds = [rf.Fixed("y0", "y"), rf.Fixed("y1", "x"), rf.Fixed("x1", "xy"), rf.Fixed("line", "z")]
    metal = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7800.0)
    given = [*holds, rf.Pressure("z1", 1e6)]
    scene = rf.Scene(quarter, metal, given, order=2, probes={"D": (2, 0, 0.6)})
    *_, report = rf.static(scene, 1, verbose=False)
    stress = float(report.stresses["D"].stress[1, 1]) / 1e6
    yield [Found("stress at D [MPa]", -5.38, stress, 0.02)]


@problem("NAFEMS 3DNLG-5", "NAFEMS 3DNLG-5, R0024; Abaqus' B32")
def bend(short: bool) -> Iterator[list[Found]]:
    """The tip of the bend under two loads."""
    radius = 100.0

    def place(x: np.ndarray) -> np.ndarray:
        angle, r = np.pi / 4 * x[0], radius + 0.5 - x[1]
        return np.stack([r * np.sin(angle), radius - r * np.cos(angle), x[2] - 0.5])

    known = {600.0: (-13.73, -23.81, 53.60), 3000.0: (-25.06, -47.70, 68.46)}
    end = radius * np.array([np.sin(np.pi / 4), 1 - np.cos(np.pi / 4), 0.0])
    for load, published in list(known.items())[: 1 if short else 2]:
        arc = block_of((16 if short else 32, 2, 2), place)
        rubber = rf.StVenantKirchhoff(E=1e7, nu=0.0, rho=1.0)
        given = [rf.Fixed("x0"), rf.Traction("x1", (0.0, 0.0, load))]
        scene = rf.Scene(arc, rubber, given, order=2, probes={"tip": tuple(end)})
        *_, report = rf.static(scene, 6 if load < 1e3 else 16, verbose=False)
        ux, uy, uz = report.probes["tip"]
        size = float(np.linalg.norm(published))
        yield [
            Found(f"{axis} at {load:g}", a, float(b), 0.01, size, unknowns=report.unknowns)
            for axis, a, b in zip("xyz", published, (uy, ux, uz), strict=True)
        ]
