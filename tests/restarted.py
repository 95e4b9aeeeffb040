"""Scenes that are cut, and what is compared of their runs.

As a script: leave a checkpoint after a step of a run, or go on from one, and report what was seen.
"""

import sys
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from bench.waking_scenes import SOFT, scene, stalk_and_block
from common import boxes
from joints import PIN, bars
from mpi4py import MPI
from parallel import report

import rigidfx as rf

bar = partial(scene, stalk_and_block((16, 1, 1)))
HELD, DRAG = rf.Fixed("x0"), rf.MassDamping(1.0)
SINE = rf.Traction("x1", (0, 0, 40.0), time=lambda t: np.sin(2 * np.pi * t / 3) * min(1, t / 3))
BLOW = rf.Traction("y1", (0, 300.0, 0), time=lambda t: max(0.0, 1 - ((t - 2.6) / 0.2) ** 2))
HIT = rf.Traction("y1", (0, 2500.0, 0), time=lambda t: max(0.0, 1 - ((t - 1.6) / 0.2) ** 2))
FLOOR = rf.Contact("z0", against=rf.Plane((0, 0, -0.2), (0, 0, 1)), friction=0.3, creep=1e-3)
LOW = rf.Contact("z0", against=rf.Plane((0, 0, -1e-3), (0, 0, 1)), stiffness=1e4)
QUIET = rf.StrainRate(0.003, 0.4)
CALM = rf.StiffnessDamping(ratio=0.3, frequency=20.0)


def block(*effects):
    thrown = rf.Gravity((0.3, 0, -9.81)), rf.InitialVelocity((1.0, 0, 0)), FLOOR
    box = rf.box((0, 0, 0), (1, 1, 1), (2, 2, 2))
    return rf.Scene(box, SOFT, [*thrown, *effects], probes={"tip": (1, 1, 1)})


def pair(*effects, along=0.5, since=0.0):
    """A block that slides on another one, which it meets node by triangle."""
    domain = boxes(
        ((0, 0, 0), (1, 1, 0.5), (3, 3, 1)), ((0.1, 0.2, 0.52), (0.7, 0.8, 1.1), (2, 2, 1))
    )
    domain = domain.with_facets("lower", lambda x: np.isclose(x[2], 0.5))
    domain = domain.with_facets("upper", lambda x: np.isclose(x[2], 0.52))
    domain = domain.with_facets("base", lambda x: np.isclose(x[2], 0))
    sides = ("upper", "lower"), ("lower", "upper")
    meet = (rf.Contact(a, against=b, since=since) for a, b in sides)
    held = rf.Fixed("base"), rf.Gravity((along, 0, -9.81))
    return rf.Scene(domain, SOFT, [*held, *meet, *effects], probes={"tip": (0.7, 0.8, 1.1)})


def joined(**more):
    """Two bars that tumble, with a motor, a spring and a cable."""
    sides = rf.MeanFace("a"), rf.MeanFace("b")
    pin = rf.Revolute(*sides, PIN, (0, 0, 1), name="pin")
    motor = rf.Motor("pin", speed=lambda t: 2.0 + np.sin(9 * t), until=0.4)
    spring = rf.JointSpring("pin", stiffness=3.0, damping=0.1)
    probes = {"tip": (2.02, 0.2, 0.2)}
    cable = rf.SpringDamper("A", "B", 20.0, pulls_only=True)
    return bars(pin, motor, spring, cable, joined=False, probes=probes, **more)


SWAYED = rf.PrescribedMotion(
    "x0", displacement=lambda t: (0, 0.1 * np.sin(3 * (t - 1.2)), 0), since=1.2
)
SCENES = {
    "damped": (partial(bar, HELD, SINE, DRAG, rf.NumericalDamping(0.05)), 0.05, 1.0, {}),
    "windows": (
        partial(
            bar,
            *(rf.Fixed("x0", until=1.0), SWAYED, rf.Spring("x1", 1e3, damping=3.0)),
            rf.Gravity((0, 0, -1.0), until=0.7),
        ),
        *(0.05, 1.8, {}),
    ),
    "follower": (partial(bar, HELD, rf.Pressure("z1", 30.0), element="enhanced"), 0.05, 1.2, {}),
    "falls": (block, 0.01, 0.4, {}),
    "rigid falls": (partial(block, rf.Rigid(None)), 0.01, 0.6, {}),
    "pair": (pair, 0.01, 0.5, {}),
    "pair rests": (
        partial(pair, CALM, along=0, since=0.02),
        *(2**-7, 0.3, {"rigidify": rf.StrainRate(1.0, 0.03, wake="all")}),
    ),
    "joined": (joined, 0.02, 0.8, {}),
    "named": (partial(bar, HELD, rf.Rigid("block"), SINE), 0.05, 1.0, {}),
    "control": (partial(bar, HELD, SINE, BLOW), rf.StepControl(0.02, largest=0.05), 3.0, {}),
    "all wake": (
        partial(bar, HELD, SINE, BLOW, DRAG),
        *(0.04, 3.0, {"rigidify": rf.StrainRate(0.003, 0.4, wake="all")}),
    ),
    "grows": (partial(bar, HELD, SINE, HIT, DRAG), 0.04, 3.2, {"rigidify": QUIET}),
    "pressed": (partial(bar, HELD, SINE, BLOW, LOW, DRAG), 0.04, 3.2, {"rigidify": QUIET}),
    "budget": (
        partial(bar, HELD, SINE, BLOW, DRAG),
        *(0.05, 3.2, {"accuracy": rf.Accuracy(0.1, min_cells=2)}),
    ),
}


def row(r):
    spent = 0.0 if r.ledger is None else r.ledger.time.spent
    counts = r.step, r.iterations, r.tangents, r.unknowns, len(r.events), len(r.bodies), r.cuts
    energies = r.kinetic, r.strain, r.stored, r.contact, sum(r.dissipated.values()), spent
    return [*counts, r.t, *energies, *r.probes["tip"], *r.linear_momentum]


def seen(name, folder, last, every):
    """Rows of a run up to a step, or of what is left of it if there is a checkpoint."""
    make, dt, t_end, more = SCENES[name]
    checkpoint = rf.Checkpoint(folder, steps=every)
    if (folder / "checkpoint-000001.rfx").exists():
        run = rf.resume(folder, make())
    else:
        run = rf.simulate(make(), dt, t_end, checkpoint=checkpoint, **more)
    rows = []
    for told in run:
        rows.append(row(told))
        if told.step > last:
            break
    run.close()
    return rows


if __name__ == "__main__":
    _, name, folder, last, every = sys.argv
    warnings.simplefilter("ignore")
    found = seen(name, Path(folder), int(last), int(every))
    if MPI.COMM_WORLD.rank == 0:
        report(found)
