"""A rigid block that falls flat again and again."""

from __future__ import annotations

import numpy as np

import rigidfx as rf

from .blocks import FLOOR, block


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
