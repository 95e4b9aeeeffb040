"""Scenes and machines whose runs with bodies are held against their flexible twins."""

import warnings
from functools import partial

import numpy as np
import pytest
from bench import waking_scenes
from bench.waking_scenes import SOFT, stalk_and_block
from common import boxes
from four_bars import MOTOR, driven, four_bars

import rigidfx as rf

DT = 0.04  # s
BOX = stalk_and_block((16, 1, 1)).with_facets("end", lambda x: x[0] >= 7 - 1e-9)


def shaken(t):
    return 0.0, 0.0, 0.02 * np.sin(2 * np.pi * t) * min(1.0, t / 2) ** 3


def swinging(t):
    return np.sin(2 * np.pi * t / 3.0) * min(1.0, t / 3)


BASE = rf.PrescribedMotion("x0", displacement=shaken)
FACE = {"where": rf.MeanFace("end"), "at": (8.5, 0.5, 0.5)}  # a point beside it
HELD, PUSHED = rf.Fixed("x0"), rf.Traction("x1", (0, 0, 100.0), time=swinging)
SLOW = rf.MassDamping(0.5)


def scene(*effects, domain=BOX, **options):
    return waking_scenes.scene(domain, *effects, **options)


def lifted():
    """A bar hinged along an edge, whose far edge is guided along z as it turns to 69°."""

    def guided(t):
        s = min(1.0, t / 3)
        return 0.0, 0.0, 8 * np.sin(1.2 * s**3 * (10 - 15 * s + 6 * s * s))

    edges = BOX.with_vertices("near", lambda x: (x[0] < 1e-9) & (x[2] < 1e-9))
    edges = edges.with_vertices("far", lambda x: (x[0] > 8 - 1e-9) & (x[2] < 1e-9))
    push = rf.Traction("x1", (60.0, 0, 0), time=lambda t: np.sin(2 * np.pi * t / 1.5))
    far = rf.PrescribedMotion("far", "z", displacement=guided)
    return scene(rf.Fixed("near"), far, SLOW, push, domain=edges)


def turning(speed, *effects):
    """An arm that a support turns."""
    axis = {"axis": (0, 0, 1), "through": (0, 0.5, 0.5)}
    base = rf.PrescribedRotation("x0", **axis, angle=lambda t: speed * t * min(1.0, t / 4))
    return scene(base, *effects)


def between_springs():
    springs = [rf.Spring("x1", tuple(k)) for k in ((4e3, 0, 0), (0, 40.0, 0), (0, 0, 4e3))]
    return turning(0.3, *springs, PUSHED, SLOW)


def named(name, **given):
    """A part that is rigid always, beside one that freezes."""
    low, high = {"head": (6.0, 8.0), "foot": (0.0, 1.0)}[name]
    box = BOX.with_cells(name, lambda p: (p[0] >= low - 1e-9) & (p[0] <= high + 1e-9))
    held = rf.Fixed("x0") if name == "head" else rf.Fixed(name)
    return scene(held, PUSHED, SLOW, rf.Rigid(name, **given), domain=box)


def struck():
    """A bar in which a wave runs to and fro."""

    def blow(t):
        return float(0.4 < t < 0.6) * np.sin(np.pi * (t - 0.4) / 0.2) ** 2

    push = rf.Traction("x1", (-3000.0, 0, 0), time=blow)
    return scene(HELD, push, rf.MassDamping(0.1), block=SOFT)


def hung():
    """A bar that its weight bends by twenty times what moves."""

    def still(t):
        return 0.0, 0.0, 0.002 * np.sin(2 * np.pi * t) * min(1.0, t / 2) ** 3

    weight = rf.Gravity((0, 0, -0.05))
    return scene(rf.PrescribedMotion("x0", displacement=still), weight, rf.Preload([weight]), SLOW)


def stretched():
    load = rf.Gravity((5.0, 0, 0))
    return scene(BASE, load, rf.Preload([load]), SLOW)


def at_a_face():
    spring = rf.Spring(**FACE, stiffness=(3e2, 3e2, 4e3), damping=50.0)
    return scene(HELD, PUSHED, SLOW, rf.PointMass(**FACE, mass=500.0), spring)


FAST = rf.Traction("x1", (0, 0, 50.0), time=lambda t: np.sin(2 * np.pi * t / 1.1) * min(1, t))
SPRING = rf.Spring("x1", (3e2, 3e2, 4e3), damping=50.0)
# Each with the end of the run [s], and the tolerance over the largest strain rate.
SCENES = {
    "viscosity": (partial(scene, HELD, PUSHED, rf.KelvinVoigt(3e4)), 6.0),
    "springs": (partial(scene, HELD, PUSHED, SPRING, SLOW), 6.0),
    "at a face": (at_a_face, 6.0),
    "numerical damping": (
        partial(scene, HELD, PUSHED, rf.NumericalDamping(0.1), rf.MassDamping(0.3)),
        6.0,
    ),
    "held by springs": (partial(scene, rf.Spring("x0", 3e5, damping=300.0), PUSHED, SLOW), 6.0),
    "a support begins": (
        partial(scene, BASE, rf.Fixed("x1", since=3.81), SLOW, mass="consistent"),
        4.8,
    ),
    "guided edges": (lifted, 4.5, 0.01, 0.02),
    "springs in space": (between_springs, 4.5),
    "rollers": (partial(scene, rf.Fixed("x0", "x"), rf.Fixed("x0", "z"), PUSHED, SLOW), 3.0),
    "a heavy head": (partial(named, "head", mass=1500.0), 6.0),
    "a rigid foot": (partial(named, "foot"), 6.0),
    "a wave": (struck, 0.7, 0.005, 0.01),
    "a turning arm": (partial(turning, 0.5, FAST, rf.MassDamping(0.3)), 8.0),
    "hung": (hung, 8.0),
    "stretched": (stretched, 6.0),
    "viscosity ends": (
        partial(scene, BASE, rf.KelvinVoigt(1e5, until=4.0), rf.MassDamping(0.2)),
        8.0,
    ),
}
# Where supports shake, and waves run, bodies withhold more.
SHAKEN = "a wave", "a support begins", "stretched", "viscosity ends", "hung"


class Beside:
    """A run beside its flexible twin.

    Attributes:
        off: Largest distance of the tip from the twin's, over the twin's largest displacement.
        held_off: That of the force at x0, over its largest.
        reduced: Mean part of the cells that are in bodies.
        freezes: Whether anything became a body.
    """

    def __init__(self, make, t_end, part=0.01, dt=DT, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rest = rf.StrainRate(0.0, 1e9, wake="none")
            twin = [
                (self._seen(report), float(report.strain_rate.max()))
                for report in rf.simulate(make(), dt, t_end, rigidify=rest, progress=False)
            ]
            rule = rf.StrainRate(part * max(rate for _, rate in twin), 20 * dt, **options)
            run = rf.simulate(make(), dt, t_end, rigidify=rule, progress=False)
            ours, inside, self.freezes = [], [], False
            for report in run:
                ours.append(self._seen(report))
                inside.append(np.mean(report.state.body_numbers() > 0))
                self.freezes |= any(event.kind == "freeze" for event in report.events)
        theirs = np.array([seen for seen, _ in twin])
        distance = np.linalg.norm(np.array(ours) - theirs, axis=2).max(axis=0)
        sizes = np.linalg.norm(theirs - theirs[:1], axis=2).max(axis=0)
        self.off, self.held_off = distance / np.maximum(sizes, 1e-300)
        self.reduced = float(np.mean(inside))

    @staticmethod
    def _seen(report):
        return report.probes["tip"], report.reactions.get("x0", np.zeros(3))


@pytest.mark.parametrize("name", SCENES)
def test_a_run_with_bodies_is_near_its_flexible_twin(name):
    """Whatever drives, holds or damps it."""
    run = Beside(*SCENES[name])
    assert run.freezes
    assert run.reduced > 0.15
    assert run.off <= (0.024 if name in SHAKEN else 5e-4)


FINE = 4e-3  # s
SPRUNG = partial(four_bars, MOTOR, rf.JointSpring("D", stiffness=30.0, damping=0.2))
LOSS = rf.NumericalDamping(0.1)


def chain():
    """Bars that turn, and are struck."""

    def blow(t):
        s = (t / FINE - 70) / 10
        return np.sin(np.pi * s) ** 2 if 0 < s < 1 else 0.0

    return SPRUNG(rf.Traction("coupler 1", (0, 3e5, 0), time=blow), LOSS)


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
    return scene(*effects, domain=box, probes={"tip": (8, 0.5, 0)})


LOCK = rf.Spring(rf.MeanFace("root"), (0, 0, 2e3)), rf.Motor("rail", rate=0.0, since=1.2)
MACHINES = {
    "a chain": (chain, 0.312, 0.01, FINE),
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
    assert run.reduced > 0.09
    assert run.off <= 5e-4
