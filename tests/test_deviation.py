"""How far a run is off its flexible twin: told by a linear equation, measured by the twin."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rigidfx as rf
from rigidfx.decide.criteria import rate_rule
from rigidfx.decide.reasons import ASTRAY
from rigidfx.shadow import deviation
from rigidfx.shadow.deviation import Deviation
from rigidfx.shadow.linear_motion import LinearMotion

DT = 0.02  # s
SOFT, STIFF = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
BOX = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
BOX = BOX.with_cells("stalk", lambda x: x[0] <= 2 + 1e-9)
BOX = BOX.with_cells("block", lambda x: x[0] >= 2 - 1e-9)


def shaken(t):
    return 0.0, 0.0, 0.02 * np.sin(2 * np.pi * t) * min(1.0, t / 2) ** 3


def swinging(t):
    return np.sin(2 * np.pi * t / 3.0) * min(1.0, t / 3)


BASE = rf.PrescribedMotion("x0", displacement=shaken)
HELD, PUSHED = rf.Fixed("x0"), rf.Traction("x1", (0, 0, 100.0), time=swinging)


def scene(*effects, **options):
    materials = {"stalk": SOFT, "block": STIFF}
    return rf.Scene(BOX, materials, effects, probes={"tip": (8, 0.5, 0.5)}, **options)


@pytest.fixture
def followed(monkeypatch):
    """All that follow a run."""
    every, begin = [], Deviation.__init__

    def made(self, *arguments):
        begin(self, *arguments)
        every.append(self)

    monkeypatch.setattr(Deviation, "__init__", made)
    return every


def compared(make, followed, t_end, part=0.01, **options):
    """Largest distance of the tip from that of its twin, what was told, and events."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tips, rates = [], []
        rest = rf.StrainRate(0.0, 1e9, wake="none")
        for report in rf.simulate(make(), DT, t_end, rigidify=rest, progress=False):
            tips.append(report.probes["tip"])
            rates.append(float(report.strain_rate.max()))
        rule = rf.StrainRate(part * max(rates), 20 * DT, **options)
        told, off, events = [], [], []
        run = rf.simulate(make(), DT, t_end, rigidify=rule, progress=False)
        for tip, report in zip(tips, run, strict=True):
            off.append(np.linalg.norm(tip - report.probes["tip"]))
            told.append(followed[-1].largest)
            events += report.events
    size = max(np.linalg.norm(tip - tips[0]) for tip in tips)
    return np.array(off) / size, told, size, events


@pytest.mark.parametrize("longest", [1, 4])
@pytest.mark.parametrize(
    ("effects", "options"),
    [
        ((BASE, rf.MassDamping(1.0)), {}),
        ((BASE, rf.MassDamping(1.0)), {"mass": "consistent"}),
        ((HELD, PUSHED, rf.KelvinVoigt(3e4)), {}),
        ((HELD, PUSHED, rf.Spring("x1", (3e2, 3e2, 4e3), damping=50.0), rf.MassDamping(0.5)), {}),
        ((HELD, PUSHED, rf.NumericalDamping(0.1), rf.MassDamping(0.3)), {}),
    ],
    ids=["drag", "consistent", "viscosity", "springs", "numerical damping"],
)
def test_a_run_knows_how_far_it_is_off(effects, options, longest, followed, monkeypatch):
    """Bodies that grow, wake, are let down and freeze anew included."""
    monkeypatch.setattr(deviation, "LONGEST", longest)
    off, told, size, events = compared(lambda: scene(*effects, **options), followed, 8.0)
    assert any(event.kind == "freeze" for event in events)
    told = np.array(told) / size
    assert off.max() > 0.002
    assert told.max() == pytest.approx(off.max(), rel=0.2)
    # Other nodes may be off by more at times, not by less; a step of four looks back.
    assert (off - told).max() <= (0.2 if longest == 1 else 0.6) * off.max()


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_base_that_shakes_between_two_modes_keeps_the_bound(mass, followed):
    """It was 2.4 times that off, as resonance amplified what bodies bend by."""
    off, _, _, events = compared(
        lambda: scene(BASE, rf.MassDamping(1.0), mass=mass), followed, 10.0, part=0.01
    )
    assert off.max() <= 0.8 * 3 * 0.01
    assert any(event.kind == "freeze" for event in events)


def test_bodies_are_released_before_a_run_is_too_far_off(followed, monkeypatch):
    monkeypatch.setattr(rate_rule, "OFF", 0.15)
    off, _, _, events = compared(lambda: scene(BASE, rf.MassDamping(1.0)), followed, 10.0)
    assert ASTRAY in {event.reason for event in events}
    assert off.max() <= 0.8 * 3 * 0.01


@pytest.mark.parametrize(
    "more",
    [(rf.Contact("z0", against=rf.Plane((0, 0, -9.0), (0, 0, 1.0))),), (rf.Rigid("block"),), ()],
    ids=str,
)
def test_what_is_not_followed(more, followed):
    """Contacts, parts named rigid, and what nothing holds: what bodies bend by tells there."""
    effects = [*([HELD] if more else []), PUSHED, rf.MassDamping(1.0), *more]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        *_, last = rf.simulate(
            scene(*effects), DT, 2.0, rigidify=rf.StrainRate(1e-5, 20 * DT), progress=False
        )
    assert last.t == pytest.approx(2.0)
    assert all(one.largest is None for one in followed)


def test_a_structure_that_turns_has_its_equations_anew(followed, monkeypatch):
    """Of an arm that a support turns by 1.2 rad, beside a motion of its tip that is withheld."""
    made = []

    class Counted(LinearMotion):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append(self)

    monkeypatch.setattr(deviation, "LinearMotion", Counted)
    turn = rf.PrescribedRotation(
        "x0", axis=(0, 0, 1), through=(0, 0.5, 0.5), angle=lambda t: 0.15 * t * min(1.0, t / 4)
    )
    off, told, size, events = compared(
        lambda: scene(turn, PUSHED, rf.MassDamping(1.0)), followed, 8.0
    )
    assert any(event.kind == "freeze" for event in events)
    assert len(made) > 3
    assert max(told) / size == pytest.approx(off.max(), rel=0.3)


def test_what_hangs_bent_under_a_preload_keeps_the_bound(followed):
    """Its sag, twenty times what moves, is no motion that bodies may take a part of."""

    def still(t):
        return 0.0, 0.0, 0.002 * np.sin(2 * np.pi * t) * min(1.0, t / 2) ** 3

    weight = rf.Gravity((0, 0, -0.05))
    hung = rf.PrescribedMotion("x0", displacement=still), weight, rf.Preload([weight])
    off, _, _, events = compared(lambda: scene(*hung, rf.MassDamping(0.5)), followed, 12.0)
    sag = next(iter(rf.simulate(scene(*hung), DT, DT, progress=False))).probes["tip"]
    assert np.linalg.norm(sag) > 5 * (2 * 0.002)
    assert any(event.kind == "freeze" for event in events)
    assert off.max() <= 0.8 * 3 * 0.01


def test_an_error_turns_with_the_structure(followed):
    """In an arm that turns on and on what bends it would stretch it, and grew without bound."""
    turn = rf.PrescribedRotation(
        "x0", axis=(0, 0, 1), through=(0, 0.5, 0.5), angle=lambda t: 0.5 * t * min(1.0, t / 4)
    )
    push = rf.Traction("x1", (0, 0, 50.0), time=lambda t: np.sin(2 * np.pi * t / 1.1) * min(1, t))
    off, told, size, _ = compared(lambda: scene(turn, push, rf.MassDamping(0.3)), followed, 16.0)
    assert off.max() <= 0.8 * 3 * 0.01
    assert max(told[-200:]) <= 0.1 * size


def test_viscosity_that_ends_is_one_no_more(followed, monkeypatch):
    made = []

    class Seen(LinearMotion):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append(self._viscosity is not None)

    monkeypatch.setattr(deviation, "LinearMotion", Seen)
    viscous = rf.KelvinVoigt(1e5, until=4.0), rf.MassDamping(0.2)
    off, told, size, _ = compared(lambda: scene(BASE, *viscous), followed, 12.0)
    assert made == [True, False]
    assert max(told) / size == pytest.approx(off.max(), rel=0.25)
