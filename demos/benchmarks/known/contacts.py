"""Contacts: two bars that collide, and a belt on a drum.

* *Two bars*: a bar of length L and speed v hits another of the same section at rest. Both ends get
  the speed v/2, so that the force is ρ c A v/2. A wave runs to the free end of the first bar and is
  back after 2 L/c: this bar is at rest then, and the force ends. Its end is left when the wave is
  back in the other bar: after 2 L/c if that is as long, after 4 L/c if it is 2 L long. (Two bars
  that are 2 L long each press each other for 4 L/c.)
* *Capstan*: a belt lies on half of a drum and slips; its tensions are in the ratio exp(μ π).
"""

from collections.abc import Iterator

import numpy as np
from common import block_of
from impact import APART, SIDE, SPEED, two_bars

import rigidfx as rf

from .row import Found, problem

SLIP = 0.002  # m: the belt is stretched by 0.0006 m and then slips; 0.004 unwinds it by 0.9 %


@problem("two bars", "Plane waves in bars: ρ c A v/2; 2 L/c and 4 L/c")
def bars(short: bool) -> Iterator[list[Found]]:
    """Force, its duration, and when the ends part."""
    for struck in (2,) if short else (1, 2):
        yield blow(struck, 50 if short else 200)


def blow(struck: int, n: int) -> list[Found]:
    """A bar of a metre hits one of so many metres, of n cells a metre."""
    unit = rf.StVenantKirchhoff(E=1.0, nu=0.0, rho=1.0)  # c = 1 m/s
    scene = two_bars(n, unit, unit, struck)
    dt = 1 / n
    force, gap = [], []
    for report in rf.simulate(scene, dt, 2 * struck + 0.6, progress=False):
        touches = report.touches["blow"].force[0] if report.step else 0.0
        force.append(abs(float(touches)))
        gap.append(APART + float(report.probes["begin"][0] - report.probes["end"][0]))
    known = SIDE**2 * SPEED / 2
    pressed = np.flatnonzero(np.array(force) > known / 2)
    lasts = (pressed[-1] - pressed[0] + 1) * dt
    middle = slice(pressed[0] + int(0.2 / dt), pressed[0] + int(1.6 / dt))
    late = np.arange(len(gap) - int(0.3 / dt), len(gap))
    opening = np.polyfit(late * dt, np.array(gap)[late], 1)
    parts = float(-opening[1] / opening[0] - APART / SPEED)  # after the first touch
    allowed = 0.03 if n < 100 else 0.02  # of a time: two cells' transit
    title, more = f"on a bar of {struck} L", {"unknowns": report.unknowns}
    return [
        Found(f"force {title} [N]", known, float(np.mean(force[middle])), 0.01, **more),
        Found(f"its duration {title} [s]", 2.0, float(lasts), allowed, **more),
        Found(f"ends part {title} [s]", 2.0 * struck, parts, allowed, **more),
    ]


@problem("capstan", "J. A. Eytelwein, L. Euler: exp(μ π)")
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
    allowed = 0.02 if short else 0.01  # it falls with the length of a cell, squared
    yield [Found("ratio of tensions", float(np.exp(mu * np.pi)), ratio, allowed)]
