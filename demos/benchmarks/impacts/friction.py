"""A block that slides to rest, and one that creeps on a slope."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

import rigidfx as rf

from .blocks import FLOOR, block, drift


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
