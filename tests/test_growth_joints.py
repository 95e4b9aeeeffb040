"""Bodies that were found and grow shapes, held by joints, beside flexible twins."""

from functools import partial

import numpy as np
import pytest
from four_bars import MOTOR, four_bars
from histories import tips
from joints import apart
from mpi4py import MPI
from parallel import check_the_same, report
from test_growth import HELD, bar
from test_reduced_joints import FAR, HINGE, bars

import rigidfx as rf

pytestmark = pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")

WINDOW = 10  # steps
LOSS = rf.NumericalDamping(0.1)


def pulse(t):
    return np.sin(np.pi * (t - 0.05) / 0.02) ** 2 if 0.05 < t < 0.07 else 0.0


def run(scene, dt, steps, tol=None):
    """Reports, the largest error of the energy, relative, and the largest gap of a joint [m]."""
    rule = None if tol is None else rf.StrainRate(tol, WINDOW * dt)
    reports, open_by = [], 0.0
    for found in rf.simulate(scene, dt, steps * dt, rigidify=rule):
        reports.append(found)
        if found.step % 5 == 0 and MPI.COMM_WORLD.size == 1:
            open_by = max(open_by, apart(scene, found.state)[0])
    energy = np.array([r.energy for r in reports])
    work = [r.work_of_loads + r.work_of_supports - sum(r.dissipated.values()) for r in reports]
    booked = np.cumsum([sum(event.energy_lost for event in r.events) for r in reports])
    off = np.abs(energy - energy[0] - np.cumsum(work) + booked).max()
    return reports, off / np.abs(energy).max(), open_by


def pushed(size):
    return rf.Traction("x1", (0, 0, size), time=pulse)


BLOW = rf.Traction("far", (0, 3e3, 1e3), time=pulse)
AT = {"at": (2.2, 0.3, 0.1), "time": pulse}
PUSH = rf.Resultant(FAR, (0, 200.0, 50.0), (10.0, 20.0, 0.0), **AT)
MACHINE = (
    rf.Motor("hinge", torque=lambda t: 40 * np.sin(20 * t) * (t > 0.05)),
    rf.JointSpring("hinge", stiffness=100.0, damping=1.0),
    rf.Stop("hinge", high=0.001, stiffness=1e4),
    rf.PointMass(FAR, 2.0, at=AT["at"]),
)
FREE = {"thrown": False}
CARRIED = rf.PointMass(rf.RigidFace("x1"), 1.0)
SCENES = {  # of a scene, its Δt [s], steps and tolerance [1/s]
    "struck": (partial(bars, HINGE, BLOW, LOSS, **FREE), 2e-3, 50, 8e-5),
    "resultant": (partial(bars, HINGE, PUSH, mass="consistent", **FREE), 2e-3, 50, 5e-5),
    "motor and stop": (partial(bars, HINGE, *MACHINE, **FREE), 2e-3, 60, 5e-5),
    "rigid faces": (partial(four_bars, MOTOR, LOSS, face=rf.RigidFace), 4e-3, 45, 4e-4),
    "carried face": (partial(bar, HELD, CARRIED, pushed(200.0)), 2e-3, 50, 3e-5),
}


@pytest.mark.parametrize("case", SCENES)
def test_they_move_as_their_flexible_twin(case):
    """The way to 0.05 %; energy 1e-11, joints closed to 1e-14 m; momenta where nothing holds."""
    build, dt, steps, tol = SCENES[case]
    (own, energy, open_by), (twin, _, _) = (run(build(), dt, steps, by) for by in (tol, None))
    assert energy < 1e-11
    assert open_by < 1e-14
    assert max(b.shapes for r in own for b in r.bodies) > 1
    ways = [tips(reports) - tips(reports)[0] for reports in (own, twin)]
    assert np.abs(ways[0] - ways[1]).max() < 5e-4 * np.abs(ways[1]).max()
    if case == "struck":
        after = [r for r in own if r.t > 0.075]
        for name in ("linear_momentum", "angular_momentum"):
            p = np.array([getattr(r, name) for r in after])
            assert np.abs(p - p[0]).max() < 1e-12 * np.abs(p).max()


def _found():
    """What is the same on any number of ranks."""
    build, dt, *_ = SCENES["struck"]
    return [[*r.probes["tip"], float(r.unknowns)] for r in run(build(), dt, 36, 4e-4)[0][::6]]


@pytest.mark.parallel
def test_it_is_the_same_on_two_ranks():
    check_the_same(__file__, 2, _found())


if __name__ == "__main__":
    report(_found())
