"""Bad contacts, Δt by its error, rotations, symmetries, damping, fields and stresses are refused.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from math import nan

import numpy as np
import pytest
import refusals
from mpi4py import MPI

import rigidfx as rf
from rigidfx.effects.contacts.obstacles import Approach, Obstacle
from rigidfx.flexible.stress import CauchyStress

COMM = MPI.COMM_WORLD
SOFT = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
BELOW = rf.Plane((0, 0, -1), (0, 0, 1))


@cache
def _box():
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    domain = domain.with_cells("a", lambda x: x[0] < 1.1).with_cells("b", lambda x: x[0] > 0.9)
    return domain.with_facets("skin", lambda x: x[0] > -1)


def _scene(*effects, material=SOFT, **options):
    return rf.Scene(_box(), material, effects, **options)


def _run(*effects, dt=0.1, criterion=None, **options):
    for _ in rf.simulate(_scene(*effects, **options), dt, 0.2, rigidify=criterion):
        pass


def _overlapping():
    """Two cells, of which one, with all of the skin, is in the other; given on one rank."""
    cube = np.argwhere(np.ones((2, 2, 2)))[:, ::-1]
    points, cells = np.vstack([cube, cube + 0.2]), np.arange(16).reshape(2, 8)
    mine = slice(None) if COMM.rank == 0 else slice(0)
    return rf.from_arrays(points[mine], cells[mine]).with_facets(
        "skin", lambda x: (x < 1 + 1e-9).all(axis=0)
    )


def _contact(where="z0", **options):
    return rf.Contact(where, **{"against": BELOW} | options)


def _moving(path):
    return _contact(against=rf.Plane((0, 0, -1), (0, 0, 1), path=path))


def _control(tol=0.05, **options):
    return rf.StepControl(tol, **{"largest": 0.1} | options)


def _turned(**options):
    return rf.PrescribedRotation("x0", **{"axis": (1, 0, 0), "angle": lambda t: t} | options)


def _later(value):
    """A function that is zero at first."""
    return lambda *arguments: value if arguments[-1] > 0.08 else 0.0


def _fails_later(*arguments):
    """Zero at first, then it fails on the last rank."""
    if arguments[-1] > 0.08 and COMM.rank == COMM.size - 1:
        raise KeyError("no file")
    return 0.0


def _of_vectors(function):
    return lambda *arguments: np.zeros(3) + function(*arguments)


class Kinked:
    """A path at rest with breakpoints of any kind."""

    def __init__(self, breakpoints):
        self.breakpoints = breakpoints

    def __call__(self, t):
        return (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Told(Obstacle):
    """An obstacle of a user's own, whose gap is what a function tells."""

    told: Callable = None

    def gap(self, y):
        return self.told(y)

    def approach(self, y0, y1):
        return Approach(y0 * np.nan, None, y1)


def _told(function):
    return _scene(_contact(against=Told(function)))


@cache
def _report():
    """The last report of a run."""
    return list(rf.simulate(_scene(), 0.1, 0.1))[-1]


@cache
def _stress():
    return CauchyStress(_scene())


def _other_mesh():
    return CauchyStress(rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), SOFT))


# name: (what is done, part of the message)
CASES = {
    "contact with a class": (lambda: _contact(against=rf.Plane), "against must be a Plane"),
    "contact with itself": (lambda: _scene(_contact(against="z0")), "is flat, so it does not meet"),
    "contact of a skin that some ranks have nothing of": (
        lambda: rf.Scene(_overlapping(), SOFT, [_contact("skin", against="skin")]),
        "Contact on 'skin': the mesh overlaps itself at (",
    ),
    "contact with cells": (lambda: _scene(_contact(against="a")), "there are no facets named 'a'"),
    "friction of a pair": (
        lambda: _contact(against="z1", friction=0.1, creep=1),
        "friction is for obstacles, not for 'z1' yet",
    ),
    "title of two lines": (
        lambda: _contact(title="a\nb"),
        r"Contact on 'z0': title must be a text that can be printed, got 'a\nb'",
    ),
    "title twice": (
        lambda: _scene(_contact(), _contact()),
        "two contacts are called 'z0_plane'; give one a title of its own",
    ),
    "contact in a preload": (
        lambda: rf.Preload([_contact()]),
        "Preload: loads must be one or more dead loads",
    ),
    "contact that begins deep inside": (
        lambda: _run(_contact(), rf.InitialDisplacement(lambda x: (0.0, 0.0, -1.9))),
        "Contact on 'z0': at the start it is 0.9 m inside the Plane",
    ),
    "normal without length": (lambda: rf.Plane((0, 0, 0), (0, 0, 0)), "must have a direction"),
    "inside one": (lambda: rf.Sphere((0, 0, 0), 1, inside=1), "inside must be True or False"),
    "path of place": (lambda: _scene(_moving(lambda x, t: x)), "its function of time failed"),
    "path that ceases": (
        lambda: _run(_moving(_of_vectors(_later(nan)))),
        "s three finite components are expected, got [nan nan nan]. Check its path of the Plane",
    ),
    "path that fails on the last rank": (
        lambda: _run(_moving(_of_vectors(_fails_later))),
        "Contact on 'z0': its path of the Plane failed at t = ",
    ),
    "obstacle without a shape": (
        lambda: _scene(_contact(against=Obstacle())),
        "Contact on 'z0': its gap of the Obstacle failed with NotImplementedError",
    ),
    "gap that fails": (
        lambda: _told(lambda y: y[:, 3]),
        "Contact on 'z0': its gap of the Told failed with IndexError",
    ),
    "gap that is none": (
        lambda: _told(lambda y: np.full(len(y) or 1, nan)),
        "Contact on 'z0': gap of the Told must give finite numbers of shape (",
    ),
    "approach that is none": (
        lambda: _told(lambda y: 1 + y[:, 2]),
        "Contact on 'z0': approach of the Told must give finite numbers of shape (",
    ),
    "kinks that are no list": (
        lambda: _moving(Kinked(3)),
        "the attribute breakpoints of the path of against must be a list of instants, got 3",
    ),
    "error above all": (lambda: _control(2.0), "tol must be"),
    "smallest step above": (lambda: _control(smallest=1.0), "needs smallest ≤ largest"),
    "error of rounding": (lambda: _control(1e-320), "tol must be 1e-12 or more"),
    "error at a place": (lambda: _control(at=[(0, 0, 0)]), "at must be names of probes"),
    "error at an unknown probe": (
        lambda: _run(dt=_control(at="tip"), probes={"top": (1, 0.5, 0.5)}),
        "StepControl: at names the probe 'tip'; the scene has ['top']",
    ),
    "control as an effect": (lambda: _scene(_control()), "is not an effect"),
    "part of nothing": (lambda: rf.Relative(0), "Relative: part must be"),
    "part for a set": (
        lambda: rf.StrainRate(1.0, 1.0, tolerances={"a": rf.Relative(0.1)}),
        "the tolerance of 'a' must be a finite number, got Relative(part=0.1)",
    ),
    "element in capitals": (lambda: _scene(element="Enhanced"), "element must be"),
    "axis without length": (lambda: _turned(axis=(0, 0, 0)), "axis must have a direction"),
    "angle of a number": (lambda: _turned(angle=3.0), "angle must be a function of t, got 3.0"),
    "angle that fails on the last rank": (
        lambda: _run(_turned(angle=_fails_later)),
        "PrescribedRotation on 'x0': its path failed near t = ",
    ),
    "speed of another angle": (
        lambda: _scene(_turned(speed=lambda t: 7.0)),
        "its velocity is [7. 0. 0.] rad/s, and its path moves by [1. 0. 0.] rad/s. Give",
    ),
    "turned two ways": (
        lambda: _run(_turned(), _turned(angle=lambda t: 2 * t)),
        "prescribe different motions of the same nodes",
    ),
    "symmetry of a box": (lambda: _scene(rf.Symmetry("skin")), "must lie in one plane"),
    "velocity across a mirror": (
        lambda: _scene(rf.Symmetry("x0"), rf.InitialVelocity(linear=(1, 0, 0))),
        "InitialVelocity contradicts Symmetry on 'x0' (components 'x')",
    ),
    "displacement of a vector": (lambda: rf.InitialDisplacement((1, 0, 0)), "must be a function"),
    "displacement transposed": (
        lambda: _scene(rf.InitialDisplacement(lambda x: 0.01 * x.T)),
        "InitialDisplacement: function must map (3, n) to (3, n)",
    ),
    "displacement that fails on the last rank": (
        lambda: _scene(rf.InitialDisplacement(lambda x: x * _fails_later(1.0))),
        "it failed with KeyError: 'no file'",
    ),
    "displacement beside a rigid part": (
        lambda: _scene(rf.Rigid("a"), rf.InitialDisplacement(lambda x: 0 * x)),
        "an InitialDisplacement goes neither with a Preload",
    ),
    "field of one component": (
        lambda: _run(rf.Traction("x1", lambda x, t: x[0])),
        "three finite components for each of",
    ),
    "field that fails on the last rank": (
        lambda: _run(rf.BodyForce(lambda x, t: x * _fails_later(t))),
        "BodyForce on 'all cells': its function failed at t = 0.15 s with KeyError: 'no file'",
    ),
    "field of gravity": (lambda: _scene(rf.Gravity(lambda x, t: x)), "value must be a function"),
    "velocity of time, path of place": (
        lambda: rf.PrescribedMotion(
            "x0", displacement=lambda x, t: 0 * x, velocity=lambda t: (0, 0, 0)
        ),
        "displacement and velocity must be functions of the same arguments",
    ),
    "stresses of nothing": (lambda: CauchyStress(None), "CauchyStress: scene must be a Scene"),
    "stresses recovered at no report": (
        lambda: rf.recovered_stress(None, _stress()),
        "recovered_stress: report must be a Report, got NoneType",
    ),
    "stresses recovered on another mesh": (
        lambda: rf.recovered_stress(_report(), _other_mesh()),
        "recovered_stress: stress is that of a scene on another mesh",
    ),
    "integration points of one": (
        lambda: rf.Recorder(_scene(), "nowhere", integration_points=1),
        "integration_points must be True or False, got 1",
    ),
}

# What is not the same on all ranks, and what a message names.
APART = {
    "error": (lambda k: _run(dt=_control(0.05 * (1 + k))), "simulate: dt"),
    "a control or a number": (lambda k: _run(dt=_control() if k else 0.1), "simulate: dt"),
    "stiffness of a contact": (lambda k: _scene(_contact(stiffness=1.0 + k)), "Scene: effects"),
    "place of a plane": (
        lambda k: _scene(_contact(against=rf.Plane((0, 0, -1 - k), (0, 0, 1)))),
        "Scene: effects",
    ),
    "a contact or none": (lambda k: _scene(*[_contact()][:k]), "Scene: effects"),
    "axis": (lambda k: _scene(_turned(axis=(1, k, 0))), "Scene: effects"),
    "element": (lambda k: _scene(element="enhanced" if k else "standard"), "Scene: element"),
    "relative tolerance": (
        lambda k: _run(criterion=rf.StrainRate(rf.Relative(0.1 + 0.1 * k), 0.1)),
        "simulate: rigidify",
    ),
    "no cells but the same ones": (
        lambda k: rf.from_arrays(np.argwhere(np.ones((2, 2, 2)))[:, ::-1], [range(8)]),
        "from_arrays: ranks 0 and 1 give the same cells, so that each would be there twice",
    ),
    "integration points": (
        lambda k: rf.Recorder(_scene(), "nowhere", integration_points=bool(k)),
        "Recorder: integration_points",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_is_refused(name):
    refusals.check(*CASES[name])


@pytest.mark.parallel
def test_is_refused_on_two_ranks():
    """The same message on both, also of what differs, and no rank waits for the other."""
    apart = {f"{name} by rank": (None, message) for name, (_, message) in APART.items()}
    refusals.check_on_two_ranks(__file__, CASES | apart)


if __name__ == "__main__":
    actions = {name: action for name, (action, _) in CASES.items()}
    actions |= {f"{name} by rank": partial(f, COMM.rank) for name, (f, _) in APART.items()}
    refusals.on_each_rank(actions)
