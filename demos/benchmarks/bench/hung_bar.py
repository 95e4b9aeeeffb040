"""A bar of 1 m that swings on a pin in its own hole, let go from the horizontal."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.special import ellipk

import rigidfx as rf

__all__ = ["exact_period", "hung_bar", "swing"]

LENGTH, WIDE, THICK, RADIUS = 1.0, 0.04, 0.02, 0.01  # m
STEEL = rf.StVenantKirchhoff(rho=7800.0, E=2.1e11, nu=0.3)
G = 9.81  # m/s²
UNIFORM = 4 * ellipk(0.5) * np.sqrt(2 * LENGTH / (3 * G))  # s, of a thin bar on its end


def _bar(size: float, gmsh: Any) -> None:
    """A bar along x with a round end and a hole along z, both about the origin."""
    occ, model = gmsh.model.occ, gmsh.model
    bar = [(3, occ.addBox(0, -WIDE / 2, 0, LENGTH, WIDE, THICK))]
    whole, _ = occ.fuse(bar, [(3, occ.addCylinder(0, 0, 0, 0, 0, THICK, WIDE / 2))])
    drilled, _ = occ.cut(whole, [(3, occ.addCylinder(0, 0, 0, 0, 0, THICK, RADIUS))])
    occ.synchronize()
    model.addPhysicalGroup(3, [volume for _, volume in drilled], name="bar")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)
    model.mesh.generate(3)


def hung_bar(size: float, *effects: rf.Effect, joined: bool = True) -> rf.Scene:
    """The bar; its pin finds place and axis in the hole.

    Args:
        size: Length of its cells [m].
        effects: More of them.
        joined: Whether it is on its pin.
    """
    domain = rf.from_gmsh(partial(_bar, size))
    domain = domain.with_facets("hole", lambda x: np.hypot(x[0], x[1]) < 1.01 * RADIUS)
    pin = [rf.Revolute("ground", rf.MeanFace("hole"), name="pin")] if joined else []
    return rf.Scene(domain, STEEL, [*pin, rf.Gravity((0, -G, 0)), *effects])


def exact_period(size: float) -> float:
    """Period of a physical pendulum of the mesh's own mass and inertia, from 90° [s]."""
    body = hung_bar(size, rf.Rigid("bar"), joined=False)
    first, *_ = rf.simulate(body, 1e-3, 1e-3)
    data = next(iter(first.rigid)).data
    away = float(np.hypot(*data.origin[:2]))
    about = data.inertia[2, 2] + data.mass * away**2
    return float(4 * ellipk(0.5) * np.sqrt(about / (data.mass * G * away)))


def swing(size: float, dt: float) -> tuple[float, float, float, float, int]:
    """Period [s], drift of energy [J], constraint [m], seconds a step and unknowns.

    The period is the time between two passes of the vertical in the same direction.
    """
    t, angle, drift, gap, wall = [], [], 0.0, 0.0, 0.0
    for report in rf.simulate(hung_bar(size), dt, 1.3 * UNIFORM):
        if report.step == 0:
            expected = report.energy
            continue
        expected += report.work_of_loads
        drift = max(drift, abs(report.energy - expected))
        gap = max(gap, report.joints["pin"].gap)
        wall += report.wall
        t.append(report.t)
        angle.append(abs(report.joints["pin"].angle) - np.pi / 2)
    passed = [k for k in range(2, len(t) - 2) if angle[k - 1] < 0 <= angle[k]]
    at = []
    for k in (passed[0], passed[1]):
        near = slice(k - 2, k + 2)
        time_of = np.polyfit(angle[near], np.array(t[near]) - t[k], 3)
        at.append(t[k] + time_of[-1])
    return at[1] - at[0], drift, gap, wall / len(t), report.unknowns
