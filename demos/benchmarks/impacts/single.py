"""A block that bounces, one that slides and creeps, and Hertz's contact."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from bench.graded import block_of

import rigidfx as rf

from .blocks import FLOOR, block, drift


def bounces(short: bool) -> dict[str, float]:
    """A rigid block falls flat again and again: error of the height it regains, relative."""
    g, height, wanted = 10.0, 0.05, 20 if short else 100
    contact = rf.Contact("skin", against=FLOOR)
    # So large an inertia that rounding does not make it rock.
    heavy = rf.Rigid("all", mass=16.0, inertia=1e9 * np.eye(3))
    scene = block(contact, rf.Gravity((0, 0, -g)), heavy, above=height)
    mass, found, worst, rises = 0.4 * 0.2 * 0.2 * 1000.0, 0, 0.0, False
    for r in rf.simulate(scene, 2e-3, 1e3):
        v = r.linear_momentum[2] / mass
        if rises and v <= 0:
            found += 1
            top = r.rigid.r[0, 2] - 0.1 + v * v / (2 * g)  # at the instant between two steps
            worst = max(worst, abs(top / height - 1))
        rises = v > 0
        if found == wanted:
            break
    return {"bounces": found, "height_error": worst}


def friction(short: bool) -> dict[str, float]:
    """Way of a block that slides to rest, and creep of one on a slope."""
    mu, g, v, k, creep = 0.3, 10.0, 0.5, 1e8, 1e-4
    contact = rf.Contact("z0", against=FLOOR, stiffness=k, friction=mu, creep=creep)
    effects = [contact, rf.Rigid(), rf.InitialVelocity(linear=(v, 0, 0)), rf.Gravity((0, 0, -g))]
    slides = list(rf.simulate(block(*effects, above=-200.0 * g / k), 1e-3, 0.3))
    way = slides[-1].rigid.r[0, 0] - 0.2
    slope = 0.25
    down = g * np.array([np.sin(np.arctan(slope)), 0, -np.cos(np.arctan(slope))])
    # Softer, as a gap of 2e-5 m from coordinates of 0.1 m is known to 1e-12 only. Friction at its
    # base tips it: without a drag it rocks for ever, and the bound is for a steady N.
    k = 1e7
    contact = rf.Contact("z0", against=FLOOR, stiffness=k, friction=mu, creep=creep)
    effects = [contact, rf.Rigid(), rf.Gravity(tuple(down)), rf.MassDamping(100.0)]
    creeps = list(rf.simulate(block(*effects, above=200.0 * down[2] / k), 1e-3, 0.3))
    fastest = creep * slope / np.sqrt(mu**2 - slope**2)
    begin, end = creeps[200], creeps[-1]  # velocities at the ends of steps swing about the mean
    speed = (end.rigid.r - begin.rigid.r)[0, 0] / (end.t - begin.t)
    gains = [b.energy - a.energy - b.work_of_loads for a, b in pairwise(slides)]
    return {
        "way_error": abs(way / (v * v / (2 * mu * g)) - 1),
        "creep_by_theory": speed / fastest,
        "largest_gain_of_energy": max(gains) / slides[0].energy,
        "energy_drift": max(drift(slides), drift(creeps)),
    }


def hertz(short: bool) -> dict[str, float]:
    """A rigid sphere slowly pressed into a quarter of a block: force and approach."""
    R, nu, E, depth, rho = 1.0, 0.3, 1e6, 4e-4, 1000.0
    a = float(np.sqrt(R * depth))
    n, growth, first = (12, 1.45, a / 4) if short else (16, 1.33, a / 7)
    lines = np.r_[0.0, np.cumsum(first * growth ** np.arange(n))]

    def place(x: np.ndarray) -> np.ndarray:
        """Cells grow away from the origin, below z = 0."""
        grown = np.interp([x[0], x[1], 1 - x[2]], np.linspace(0, 1, n + 1), lines)
        return grown * np.array([[1.0], [1.0], [-1.0]])

    domain = block_of((n, n, n), place)
    fall, calm = 0.2, 0.1  # s, slow against L/c = 0.03 s
    ball = rf.Sphere((0, 0, R), R, path=lambda t: (0, 0, -depth * min(t / fall, 1.0)))
    contact = rf.Contact("z1", against=ball, title="ball")
    held = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("z0")]
    effects = [contact, *held, rf.MassDamping(200.0)]
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=E, nu=nu, rho=rho), effects)
    *_, last = rf.simulate(scene, 0.01, fall + calm)
    known = 4 / 3 * E / (1 - nu**2) * np.sqrt(R) * depth**1.5
    force = -4 * last.touches["ball"].force[2]
    return {"force_error": abs(force / known - 1), "penetration_by_approach":
            last.touches["ball"].penetration / depth}  # fmt: skip
