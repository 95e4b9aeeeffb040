"""Linkages of flexible bars between mean faces: four bars in the plane, and Bricard's in space."""

from itertools import pairwise

import numpy as np
from common import boxes

import rigidfx as rf

METAL = rf.StVenantKirchhoff(rho=2700.0, E=2e10, nu=0.3)
Z = 0.0, 0.0, 1.0
# Crank, rocker and coupler: corners [m] and cells.
BARS = {
    "crank": ((-0.03, 0.03, -0.03), (0.03, 0.37, 0.03), (1, 2, 1)),
    "rocker": ((0.97, -0.46, -0.03), (1.03, 0.36, 0.03), (1, 4, 1)),
    "coupler": ((0.07, 0.37, -0.03), (0.93, 0.43, 0.03), (4, 1, 1)),
}
PLACES = (0, 0, 0), (0, 0.4, 0), (1, 0.4, 0), (1, -0.5, 0)
# The same with a long coupler.
SLENDER = {
    "crank": ((0, 0, 0), (0.1, 0.4, 0.1), (1, 4, 1)),
    "rocker": ((2.14, -0.3, 0), (2.24, 0.4, 0.1), (1, 7, 1)),
    "coupler": ((0.12, 0.3, 0), (2.12, 0.4, 0.1), (12, 1, 1)),
}
OF_SLENDER = (0.05, 0.05, 0.05), (0.11, 0.35, 0.05), (2.13, 0.35, 0.05), (2.19, -0.25, 0.05)


def with_ends(bars):
    """Bars with facets of the sides of both end cells, `"name 1"` at the lower end, `"name 2"`."""
    domain = boxes(*bars.values())
    for name, (low, high, cells) in bars.items():
        axis, ends = int(np.argmax(cells)), (np.array(low) - 1e-9, np.array(high) + 1e-9)
        h = (high[axis] - low[axis]) / max(cells) + 1e-9

        def of(x, ends=ends):
            return ((x >= ends[0][:, None]) & (x <= ends[1][:, None])).all(axis=0)

        def first(x, of=of, axis=axis, least=ends[0][axis] + h):
            return of(x) & (x[axis] <= least)

        def last(x, of=of, axis=axis, most=ends[1][axis] - h):
            return of(x) & (x[axis] >= most)

        domain = domain.with_facets(f"{name} 1", first).with_facets(f"{name} 2", last)
    return domain


def four_bars(*effects, face=rf.MeanFace, bars=BARS, places=PLACES, metal=METAL, **options):
    """The crank turns right round; a motor drives it where one is given."""
    domain, (A, B, C, D) = with_ends(bars), places
    joints = [
        rf.Revolute("ground", face("crank 1"), A, Z, name="A"),
        rf.Revolute(face("crank 2"), face("coupler 1"), B, Z, name="B"),
        rf.Revolute(face("coupler 2"), face("rocker 2"), C, Z, name="C"),
        rf.Revolute("ground", face("rocker 1"), D, Z, name="D"),
    ]
    low, high = (np.array(end) for end in bars["coupler"][:2])
    probes = {"tip": (0.5 * (low[0] + high[0]), *high[1:])}
    effects = [*joints, *effects]
    return rf.Scene(domain, metal, effects, element="enhanced", probes=probes, **options)


def driven(t):
    """A crank's speed that is there after 0.2 s [rad/s]."""
    s = min(t / 0.2, 1.0)
    return -12.0 * s * s * (3 - 2 * s)


MOTOR = rf.Motor("A", speed=driven)


def bricard(*effects):
    """Five bars along the edges of a cube, IFToMM's benchmark A04, which fall by their weight."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)])
    bars, sides = {}, ["ground"]
    for i, pair in enumerate(pairwise(corners)):
        along = int(np.argmax(np.abs(pair[1] - pair[0])))
        apart = np.where(np.arange(3) == along, -0.05, 0.02)
        bars[f"bar {i}"] = (np.min(pair, axis=0) - apart, np.max(pair, axis=0) + apart,
                            tuple(np.where(np.arange(3) == along, 4, 1)))  # fmt: skip
        ends = (1, 2) if pair[1][along] > pair[0][along] else (2, 1)
        sides += [rf.MeanFace(f"bar {i} {end}") for end in ends]
    sides += ["ground"]
    axes = np.eye(3)[[1, 2, 0, 1, 2, 0]]
    pins = [
        rf.Revolute(sides[2 * i], sides[2 * i + 1], corners[i], axes[i], name=f"pin {i}")
        for i in range(6)
    ]
    metal, tip = rf.StVenantKirchhoff(rho=2700.0, E=2e10, nu=0.3), {"tip": (1, -1, 0.94)}
    given = [*pins, rf.Gravity((0, 0, -9.81)), *effects]
    return rf.Scene(with_ends(bars), metal, given, element="enhanced", probes=tip)
