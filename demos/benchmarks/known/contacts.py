"""Contacts: two bars that collide, and a belt on a drum.

* *Two bars*: a bar of speed v hits an equal one at rest. Plane waves give the force ρ c A v/2, and
  bars of the length L part after 2 L/c.
* *Capstan*: a belt lies on half of a drum and slips; its tensions are in the ratio exp(μ π).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from bench.graded import block_of
from impacts.bars import two_bars

import rigidfx as rf

from .row import Found, Problem

__all__ = ["BARS", "CAPSTAN"]

SLIP = 0.004  # m: the belt is stretched by 0.0006 m and then slips; much more would unwind it


def bars(short: bool) -> Iterator[list[Found]]:
    """Force and duration of the contact."""
    n, apart, side, v = 100 if short else 200, 2e-4, 0.01, 2e-3
    unit = rf.StVenantKirchhoff(E=1.0, nu=0.0, rho=1.0)  # c = 1 m/s

    def thrown(x: np.ndarray) -> np.ndarray:
        return np.where(x[0] > 1 + apart / 2, 0.0, v) * np.array([[1.0], [0.0], [0.0]])

    held = rf.Fixed("first", "yz"), rf.Fixed("second", "yz")
    contact = rf.Contact("end", against="begin", title="blow")
    given = [contact, *held, rf.InitialVelocity(function=thrown)]
    scene = rf.Scene(two_bars(n, apart), unit, given)
    dt = 1 / n
    reports = list(rf.simulate(scene, dt, 2.6, progress=False))[1:]
    force = np.array([abs(report.touches["blow"].force[0]) for report in reports])
    pressed = np.flatnonzero(force > 0)
    lasted = (pressed[-1] - pressed[0] + 1) * dt
    middle = pressed[0] + int(0.2 / dt), pressed[0] + int(1.6 / dt)
    unknowns = reports[-1].unknowns
    known = side**2 * v / 2
    yield [
        Found("force [N]", known, float(force[slice(*middle)].mean()), 0.01, unknowns=unknowns),
        Found("duration [s]", 2.0, float(lasted), 0.03, unknowns=unknowns),
    ]


def capstan(short: bool) -> Iterator[list[Found]]:
    """Ratio of the tensions of a belt that is pulled over half a drum."""
    radius, thick, wide, mu, pull = 1.0, 0.01, 0.1, 0.3, 100.0
    n = 48 if short else 96

    def place(x: np.ndarray) -> np.ndarray:
        angle, r = np.pi * x[0], radius + thick * x[2]
        return np.stack([r * np.cos(angle), wide * x[1], r * np.sin(angle)])

    belt = block_of((n, 1, 1), place)
    rubber = rf.StVenantKirchhoff(E=1e9, nu=0.0, rho=1000.0)
    drum = rf.Cylinder((0, 0, 0), radius, axis=(0, 1, 0))
    grip = rf.Contact("z0", against=drum, friction=mu, creep=1e-5, title="drum")
    load = rf.Traction("x0", (0, 0, -pull / (wide * thick)), time=rf.Table((0, 0.3), (0, 1)))
    way = rf.Table((0.0, 0.3, 1.0), (0.0, 0.0, SLIP))
    lead = rf.PrescribedMotion("x1", "z", displacement=lambda t: (0.0, 0.0, -float(way(t))))
    scene = rf.Scene(belt, rubber, [grip, load, lead, rf.Fixed("y0", "y"), rf.Fixed("y1", "y")])
    *_, report = rf.static(scene, 10, verbose=False)
    ratio = float(abs(report.reactions["x1"][2])) / pull
    allowed = 0.03 if short else 0.01  # it falls with the length of a cell, squared
    yield [Found("ratio of tensions", float(np.exp(mu * np.pi)), ratio, allowed)]


BARS = Problem("Plane waves in bars: ρ c A v/2, 2 L/c", bars)
CAPSTAN = Problem("J. A. Eytelwein, L. Euler: exp(μ π)", capstan)
