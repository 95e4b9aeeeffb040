"""A recorded ground acceleration, as a load and as the motion of a support."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import lsim

import rigidfx as rf

INCH, G = 0.0254, 386.4 * 0.0254  # m; m/s², as in the reference
RATIO = 0.02
# Largest displacements of oscillators of period T by the El Centro record: A. K. Chopra, Dynamics
# of Structures, figure 6.4.1.
DEFORMATION = {0.5: 2.67, 1.0: 5.97, 2.0: 7.47}  # s: in
RECORD = Path(__file__).with_name("data") / "el_centro_1940_ns.txt"


def el_centro():
    """Times [s] and ground accelerations [m/s²]."""
    lines = RECORD.read_text().splitlines()
    values = " ".join(line for line in lines if not line.startswith("#")).split()
    a = 1e-5 * G * np.array([0, *values], dtype=float)
    return 0.02 * np.arange(a.size), a


def oscillator(T, t, a, finer=8):
    """The largest displacement of the exact oscillator, a being linear between its instants."""
    omega = 2 * np.pi / T
    fine = np.linspace(t[0], t[-1], (t.size - 1) * finer + 1)
    system = [-1.0], [1.0, 2 * RATIO * omega, omega**2]
    return np.abs(lsim(system, np.interp(fine, t, a), fine)[1]).max()


def storey(T, effects):
    """A storey without mass, whose walls shear, under a level roof of a tonne; its period is T."""
    height, width, mass = 10.0, 10.0, 1000.0
    stiffness = mass * (2 * np.pi / T) ** 2  # N/m, = G A/h
    walls = rf.StVenantKirchhoff(E=2 * stiffness * height / width**2, nu=0.0, rho=1e-3)
    effects = [
        rf.PointMass("z1", mass),
        rf.Fixed("z1", components="yz"),
        rf.StiffnessDamping(RATIO, 1 / T),
        *effects,
    ]
    cell = rf.box((0, 0, 0), (width, width, height), (1, 1, 1))
    return rf.Scene(cell, walls, effects, probes={"roof": (5, 5, 10)})


def by_gravity(t, a):
    """In the frame of the ground, where it is a load on all mass."""
    return [rf.Fixed("z0"), rf.Gravity((-1.0, 0.0, 0.0), time=rf.Table(t, a))]


def by_support(t, a):
    """The record, integrated twice, moves the foot."""
    path = make_interp_spline(t, a, k=1).antiderivative(2)
    speed = path.derivative()
    return [
        rf.PrescribedMotion(
            "z0",
            displacement=lambda t: (float(path(t)), 0.0, 0.0),
            velocity=lambda t: (float(speed(t)), 0.0, 0.0),
        )
    ]


@pytest.mark.parametrize("way", [by_gravity, by_support])
@pytest.mark.parametrize(
    ("T", "dt", "until"), [(0.5, 0.01, 3), (1.0, 0.01, 5.2), (2.0, 0.02, 11.6)]
)
def test_el_centro(T, dt, until, way):
    """The reference within 1 %, the exact oscillator of this record within what Δt errs by."""
    t, a = el_centro()
    scene = storey(T, way(t, a))
    path = make_interp_spline(t, a, k=1).antiderivative(2)
    most = 0.0
    for report in rf.simulate(scene, dt, until, progress=False):
        ground = float(path(report.t)) if way is by_support else 0.0
        most = max(most, abs(report.probes["roof"][0] - ground))
    assert most / INCH == pytest.approx(DEFORMATION[T], rel=0.01)
    assert most == pytest.approx(oscillator(T, t, a), rel=3e-3)
