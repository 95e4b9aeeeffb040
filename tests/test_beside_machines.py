"""Machines whose runs with bodies are held against their flexible twins."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from common import boxes
from four_bars import MOTOR, driven, four_bars
from test_beside_twin import BOX, HELD, SOFT, STIFF, Beside

import rigidfx as rf

FINE = 4e-3  # s
SPRUNG = partial(four_bars, MOTOR, rf.JointSpring("D", stiffness=30.0, damping=0.2))
LOSS = rf.NumericalDamping(0.1)


def chain(**options):
    """Bars that turn, and are struck."""

    def blow(t):
        s = (t / FINE - 70) / 10
        return np.sin(np.pi * s) ** 2 if 0 < s < 1 else 0.0

    return SPRUNG(rf.Traction("coupler 1", (0, 3e5, 0), time=blow), LOSS, **options)


def locked():
    """A drive that ends in a lock, which strikes the bars."""
    lock, drive = rf.Motor("A", speed=0.0, since=0.3), rf.Motor("A", speed=driven, until=0.3)
    return four_bars(drive, lock, LOSS)


def rail(*effects):
    """A bar on a rail, pushed along it at its tip."""
    box = boxes(((0, 0, 0), (4, 1, 1), (8, 1, 1))).with_facets("root", lambda x: x[0] < 1 + 1e-9)
    box = box.with_facets("tip", lambda x: x[0] > 4 - 1e-9)
    box = box.with_cells("a", lambda x: x[0] <= 2 + 1e-9).with_cells(
        "b", lambda x: x[0] >= 2 - 1e-9
    )
    soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
    slide = rf.Prismatic("ground", rf.MeanFace("root"), (0.5, 0.5, 0.5), (0, 0, 1), name="rail")
    push = rf.Traction("tip", (0, 0, 100.0), time=lambda t: np.sin(2 * np.pi * t))
    probes, every = {"tip": (4, 0.5, 0.5)}, (slide, push, rf.MassDamping(0.5), *effects)
    return rf.Scene(box, {"a": soft, "b": stiff}, every, probes=probes)


def gate():
    """Two bars that swing up against each other, and a weight in springs at their mean end."""
    mesh = boxes(
        ((0, 0, 0), (3, 0.4, 0.4), (6, 1, 1)),
        ((4, 0, 0), (7, 0.4, 0.4), (6, 1, 1)),
        ((3.3, -2.5, 0), (3.7, -0.5, 0.4), (1, 3, 1)),
    )
    mesh = mesh.with_cells("weight", lambda x: x[1] <= -0.5 + 1e-9)
    mesh = mesh.with_facets("hook", lambda x: abs(x[1] + 0.5) < 1e-9)
    mesh = mesh.with_facets("ends", lambda x: (abs(abs(x[0] - 3.5) - 0.5) < 1e-9) & (x[1] > -1e-9))
    for name, root in (("root A", 0), ("root B", 7)):
        mesh = mesh.with_facets(name, lambda x, at=root: abs(x[0] - at) < 1e-9)

    def angle(t):
        return 0.6 * np.sin(np.pi * t / 1.5) ** 2 * min(t / 1.5, 1) ** 2

    effects = [
        rf.Revolute("ground", rf.MeanFace("root A"), (0, 0.2, 0.2), (0, 0, 1), name="A"),
        rf.Revolute("ground", rf.MeanFace("root B"), (7, 0.2, 0.2), (0, 0, 1), name="B"),
        rf.Motor("A", angle=lambda t: -angle(t)),
        rf.Motor("B", angle=angle),
        rf.Spherical(rf.MeanFace("ends"), rf.MeanFace("hook"), (3.5, -0.25, 0.2)),
        rf.Spring("weight", (1e5, 2e4, 1e5), (1e3, 2e2, 1e3)),
    ]
    steel = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
    return rf.Scene(mesh, steel, effects, probes={"tip": (3.5, -2.5, 0.2)})


def pressed():
    """A bar whose tip is pressed on a floor by a force that swells."""
    box = BOX.with_facets("sole", lambda x: (x[2] < 1e-9) & (x[0] > 6.9))
    floor = rf.Contact("sole", against=rf.Plane((0, 0, -1e-4), (0, 0, 1.0)), stiffness=2e4)
    push = rf.Traction("x1", (0, 0, -40.0), time=lambda t: np.sin(2 * np.pi * t / 2) * min(1, t))
    effects = HELD, floor, push, rf.MassDamping(0.5), rf.KelvinVoigt(2e4)
    return rf.Scene(box, {"stalk": SOFT, "block": STIFF}, effects, probes={"tip": (8, 0.5, 0)})


LOCK = rf.Spring(rf.MeanFace("root"), (0, 0, 2e3)), rf.Motor("rail", rate=0.0, since=1.2)
MACHINES = {
    "a chain": (chain, 0.312, 0.01, FINE),
    "a chain of rigid faces": (partial(chain, face=rf.RigidFace), 0.312, 0.01, FINE),
    "a lock": (locked, 0.4, 0.01, FINE),
    "a rail": (partial(rail, rf.JointSpring("rail", stiffness=2e3, damping=50.0)), 2.0),
    "a rail that locks": (partial(rail, *LOCK), 2.0),
    "a gate": (gate, 1.0, 0.2, 0.01),
    "pressed on a floor": (pressed, 5.0),
}


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_with_bodies_is_near_its_flexible_twin(name):
    """Whatever joints hold, drive or stop."""
    run = Beside(*MACHINES[name])
    assert run.freezes
    assert run.reduced > 0.1
    assert run.off <= 5e-4
