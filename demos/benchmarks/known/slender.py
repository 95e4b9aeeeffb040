"""Slender structures beside rods: a soft cantilever, a beam under pressure, and a hanging strip.

* *Soft cantilever* of the Newton and MuJoCo projects: 0.9 m, 70 × 55 mm and 0.12 kg, with 0.2 kg at
  its tip, under 9.81 m/s². Reference is the rod that neither stretches nor shears.
* *Prestressed beam*: a hinged bar under a load P has (f/f₀)² = 1 - P/P_E up to Euler's load P_E.
* *Hanging chain*: a strip 3000 times as long as thick hangs between two points at 0.8 of its
  length; the sag is that of the catenary.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from bench.graded import block_of
from bench.mode_answers import hinged_bar
from bench.static_answers import tip_of_rod
from scipy.optimize import brentq

import rigidfx as rf

from .row import Found, Problem

__all__ = ["CHAIN", "PRESTRESSED", "SOFT_CANTILEVER"]

G = 9.81  # m/s²


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


def prestressed(short: bool) -> Iterator[list[Found]]:
    """Squares of frequencies over that without a load."""
    for share in (0.5, 0.98) if short else (0.25, 0.5, 0.75, 0.9, 0.98):
        euler = np.pi**2 * 1e9 * 0.01**4 / 12  # N
        found, _ = hinged_bar(-share * euler, 20 if short else 60)
        free, _ = hinged_bar(0.0, 20 if short else 60)
        title = f"(f/f₀)² at {share} of Euler's load"
        yield [Found(title, 1 - share, (found / free) ** 2, 0.005, 1.0)]


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


SOFT_CANTILEVER = Problem("Newton and MuJoCo projects; elastica", soft_cantilever)
PRESTRESSED = Problem("L. Euler", prestressed)
CHAIN = Problem("Catenary", chain)
