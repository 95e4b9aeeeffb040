"""Warnings of what goes another way than was meant: jolts, brief impacts, springs, facets."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
BAR = rf.box((0, 0, 0), (1, 0.1, 0.1), (4, 1, 1))


def said(effects, dt, t_end, domain=BAR):
    """What a run warns of, but for cells that are coarse."""
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        for _ in rf.simulate(rf.Scene(domain, SOFT, effects), dt, t_end, progress=False):
            pass
    coarse = re.compile("lock in bending|error of its lumped masses")
    return [str(w.message) for w in shown if not coarse.search(str(w.message))]


def turning(speed):
    return rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=speed)


def test_a_rotation_at_full_speed_under_a_body_at_rest():
    """It is told, not where the body spins with it, nor where the speed grows from zero."""
    sudden = turning(lambda t: 5 * t)
    (message,) = said([sudden], 1e-3, 4e-3)
    assert "At t = 0 s 'x0' acts with a jolt: an impact brings" in message
    assert "100% of the energy" in message
    spun = rf.InitialVelocity(angular=(0, 0, 5), centre=(0, 0, 0))
    assert not said([sudden, spun], 1e-3, 4e-3)
    for smooth in (lambda t: 50 * t**2, lambda t: 5e4 * t**3, lambda t: 1 - np.cos(9 * t)):
        assert not said([turning(smooth)], 1e-3, 4e-3)


def test_a_support_that_stops_a_body():
    flying = rf.InitialVelocity(linear=(1.0, 0, 0))
    (message,) = said([flying, rf.Fixed("x0", since=2e-3)], 1e-3, 4e-3)
    assert "At t = 0.002 s 'x0' acts with a jolt: an impact takes" in message


def test_a_contact_that_the_step_does_not_resolve():
    """It is told with a Δt that resolves it, at which nothing is said."""
    floor = rf.Contact("x0", against=rf.Plane((-1e-3, 0, 0), (1, 0, 0)))
    effects = [floor, rf.InitialVelocity(linear=(-1.0, 0, 0))]
    (message,) = said(effects, 5e-3, 0.05)
    assert "Contact 'x0_plane' closed at t = 0.001 s and opened again within" in message
    dt = 5e-3
    for _ in range(4):
        found = said(effects, dt, 0.02)
        if not found:
            break
        dt = float(re.search(r"With Δt ≤ (\S+) s", found[0])[1])
    assert not found
    assert 1e-4 < dt < 2e-3  # a wave passes the bar and comes back in 6 ms
    assert not said(effects, rf.StepControl(0.01, largest=5e-3), 0.02)


@pytest.mark.parametrize("rigid", [[], [rf.Rigid()]])
def test_springs_on_faces_that_turn(rigid):
    """End faces hold a shaft back; nodes on its axis let it turn."""
    shaft = rf.box((-0.05, -0.05, 0), (0.05, 0.05, 0.5), (2, 2, 2))
    for name, z in (("low", 0.0), ("high", 0.5)):
        shaft = shaft.with_vertices(
            name, lambda x, z=z: np.hypot(np.hypot(x[0], x[1]), x[2] - z) < 1e-9
        )
    spin = [rf.InitialVelocity(angular=(0, 0, 50.0)), *rigid]
    (message,) = said([rf.Spring("z0", 1e4), rf.Spring("z1", 1e4), *spin], 2e-3, 0.04, shaft)
    assert re.search(r"Spring on 'z0': at t = \S+ s its nodes have turned by", message)
    assert not said([rf.Spring("low", 1e4), rf.Spring("high", 1e4), *spin], 2e-3, 0.04, shaft)


def drum(n):
    """A ring of n flat facets, of radius 1 m."""
    phi = 2 * np.pi * np.arange(n) / n
    rings = [(r, z) for z in (0.0, 0.5) for r in (0.6, 1.0)]
    points = np.concatenate(
        [np.c_[r * np.cos(phi), r * np.sin(phi), np.full(n, z)] for r, z in rings]
    )
    k, after = np.arange(n), (np.arange(n) + 1) % n
    square = np.stack([k, k + n, after, after + n], axis=1)
    cells = np.concatenate([square, square + 2 * n], axis=1)
    if MPI.COMM_WORLD.rank > 0:
        points, cells = points[:0], cells[:0]
    ring = rf.from_arrays(points, cells)
    return ring.with_facets("skin", lambda x: np.hypot(x[0], x[1]) > 0.9)


def on_a_floor(domain, friction=0.3):
    """What a scene warns of whose skin meets a floor."""
    creep = 1e-3 if friction else None
    floor = rf.Plane((0, -1.1, 0), (0, 1, 0))
    contact = rf.Contact("skin", against=floor, friction=friction, creep=creep)
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        rf.Scene(domain, SOFT, [contact])
    return [str(w.message) for w in shown if "lock in bending" not in str(w.message)]


@pytest.mark.parametrize(("n", "half"), [(8, "22.5"), (24, "7.5"), (48, "3.75"), (96, "")])
def test_a_drum_of_flat_facets(n, half):
    """A polygon stands still below 180°/n; fine ones, and blocks, are not spoken of."""
    found = on_a_floor(drum(n))
    assert len(found) == bool(half)
    assert all(f"some n = {n} in a turn" in m and f"180°/n = {half}°" in m for m in found)
    assert not on_a_floor(drum(n), friction=0.0)


def test_a_block_is_not_round():
    assert not on_a_floor(BAR.with_facets("skin", lambda x: x[0] < 9))
