"""Scenes with joints, and how far they are from keeping them."""

import numpy as np
from common import boxes
from histories import changes

import rigidfx as rf
from rigidfx.effects import Joint
from rigidfx.effects.joints.vectors import motion_at

SOFT = rf.StVenantKirchhoff(rho=1000.0, E=1e6, nu=0.3)
PIN = 1.01, 0.1, 0.1  # m, halfway between two bars


def bars(*effects, sides=None, ball=False, n=5, thrown=None, joined=True, **options):
    """Two bars along x, joined in the middle, that tumble and turn against each other."""
    domain = boxes(
        ((0, 0, 0), (1, 0.2, 0.2), (n, 2, 2)), ((1.02, 0, 0), (2.02, 0.2, 0.2), (n, 2, 2))
    )
    h, pin = 1 / n, np.array(PIN)
    domain = domain.with_cells("A", lambda x: x[0] < PIN[0])
    domain = domain.with_cells("B", lambda x: x[0] > PIN[0])
    domain = domain.with_facets("a", lambda x: (x[0] > 1 - h - 1e-6) & (x[0] < PIN[0]))
    domain = domain.with_facets("b", lambda x: (x[0] < 1.02 + h + 1e-6) & (x[0] > PIN[0]))
    of_b = np.array([0.4, 0.3, 2.0]) if ball else np.array([0.0, 0.0, 2.0])

    def turning(x):
        arms = x.T - pin
        omega = np.where(x[:1] > PIN[0], of_b[:, None], 0.0).T + np.array([0.3, -0.2, 1.5])
        return np.cross(omega, arms).T

    a, b = sides or (rf.MeanFace("a"), rf.MeanFace("b"))
    joint = rf.Spherical(a, b, PIN) if ball else rf.Revolute(a, b, PIN, (0, 0, 1))
    start = rf.InitialVelocity(function=thrown or turning)
    effects = [*([joint] if joined else []), start, *effects]
    return rf.Scene(domain, SOFT, effects, **options)


def apart(scene, state):
    """The largest g of rows of joints [m], and the largest ġ [m/s], on one rank."""
    state.rebuild()
    x, v = state.X + state.u.x.array.reshape(-1, 3), state.v.x.array.reshape(-1, 3)
    largest = [0.0, 0.0]
    for joint in scene.named(Joint):
        averages = joint.pieces.averages
        p, q = zip(*(motion_at(scene, average, x, v) for average in averages), strict=True)
        for row in joint.pieces.rows:
            g = sum(c * p[k][axis] for k, axis, c in row.linear)
            g += sum(c * p[k] @ p[j] for k, j, c in row.products)
            rate = sum(c * q[k][axis] for k, axis, c in row.linear)
            rate += sum(c * (p[k] @ q[j] + q[k] @ p[j]) for k, j, c in row.products)
            largest = np.maximum(largest, np.abs([float(g), float(rate)]))
    return largest


def follow(scene, dt, steps, **options):
    """Reports, the largest changes of H, L and J, relative, the largest g [m] and ġ [m/s]."""
    reports, held = [], np.zeros(2)
    for report in rf.simulate(scene, dt, steps * dt, **options):
        reports.append(report)
        held = np.maximum(held, apart(scene, report.state))
    return reports, *changes(reports), held
