"""Where the error motion decides, and what it wakes."""

from __future__ import annotations

import numpy as np
import pytest
from test_contact_pairs import boxes

import rigidfx as rf

DT = 0.02  # s
SOFT, STIFF = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
BOX = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
BOX = BOX.with_cells("stalk", lambda x: x[0] <= 2 + 1e-9)
BOX = BOX.with_cells("block", lambda x: x[0] >= 2 - 1e-9)
HELD, DRAG = rf.Fixed("x0"), rf.MassDamping(1.0)


def scene(*effects):
    materials = {"stalk": SOFT, "block": STIFF}
    return rf.Scene(BOX, materials, effects, probes={"tip": (8, 0.5, 0.5)})


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_blow_wakes_what_it_strains(mass):
    """Each rigid cell that the twin strains at twice κ tol is flexible one step later."""
    sine = rf.Traction("x1", (0, 0, 40.0), time=lambda t: np.sin(2 * np.pi * t / 3) * min(1, t / 3))
    blow = rf.Traction("y1", (0, 300.0, 0), time=lambda t: max(0.0, 1 - ((t - 4) / 0.2) ** 2))

    def run(rule):
        made = rf.Scene(
            BOX,
            {"stalk": SOFT, "block": STIFF},
            [HELD, sine, blow, DRAG],
            probes={"tip": (8, 0.5, 0.5)},
            mass=mass,
        )
        steps = rf.simulate(made, DT, 6.0, rigidify=rule, progress=False)
        return [
            (r.strain_rate.copy(), r.state.body_numbers() > 0, r.probes["tip"], r.events)
            for r in steps
            if r.step
        ]

    twin = run(rf.StrainRate(0.0, 1e9, wake="none"))
    rates = np.array([row[0] for row in twin])
    tol = 0.01 * rates.max()
    ours = run(rf.StrainRate(tol, 20 * DT))
    rigid = np.array([row[1] for row in ours])
    assert rigid[:190].mean() > 0.3
    assert any(event.woken.size for row in ours for event in row[3])
    crossed = rates[:-1] > 2 * 3 * tol
    assert not (crossed & rigid[:-1] & rigid[1:]).any()
    tips, told = (np.array([row[2] for row in rows]) for rows in (twin, ours))
    assert np.abs(told - tips).max() <= 0.8 * 3 * 0.01 * np.abs(tips).max()


def test_a_condition_is_asked_of_the_motion_that_is_shown():
    """A bar that is rigid but for its root bends in u + e alone: its step is solved again."""
    push, shown = rf.Traction("x1", (0, 0, 20.0), time=lambda t: min(1.0, t)), []

    def bent(report):
        moved = abs(report.probes["tip"][2])
        shown.append((report.t, moved, abs(report.error_motion["tip"][2])))
        return moved > 2e-4

    release = rf.Release(when=bent, repeat=True)
    rule = rf.StrainRate(0.1, 10 * DT, until=0.3, release=release)
    reports = list(rf.simulate(scene(HELD, push, DRAG), DT, 1.0, rigidify=rule, progress=False))
    freeze, event = (event for report in reports for event in report.events)
    assert (freeze.kind, event.reason) == ("freeze", "checked: a condition")
    t, moved, told = next(row for row in shown if row[1] > 2e-4)
    assert event.t == pytest.approx(t - DT)
    assert moved - told < 2e-4  # u alone


def test_a_contact_of_the_twin_opens_and_closes_by_the_error_motion():
    """A bar whose tip is pressed on a floor by a force that swells: u + e is the flexible twin."""
    box = BOX.with_facets("sole", lambda x: (x[2] < 1e-9) & (x[0] > 6.9))
    floor = rf.Contact("sole", against=rf.Plane((0, 0, -1e-4), (0, 0, 1.0)), stiffness=2e4)
    push = rf.Traction("x1", (0, 0, -40.0), time=lambda t: np.sin(2 * np.pi * t / 2) * min(1, t))
    effects, tips, pressed = (HELD, floor, push, DRAG, rf.KelvinVoigt(2e4)), [], []
    rule = rf.StrainRate(0.0, 1e9, wake="none")
    for _ in range(2):
        made = rf.Scene(box, {"stalk": SOFT, "block": STIFF}, effects, probes={"tip": (8, 0.5, 0)})
        rows, touching, rigid, peak, none = [], [], [], 0.0, np.zeros(3)
        for report in rf.simulate(made, DT, 5.0, rigidify=rule, progress=False):
            rows.append((report.probes["tip"], report.error_motion["tip"]))
            touch = next(iter(report.touches.values()))
            touching.append(touch.nodes)
            pressed.append((touch.force[2], report.error_touches.get(touch.name, none)[2]))
            rigid.append((report.state.body_numbers() > 0).mean())
            peak = max(peak, float(report.strain_rate.max()))
        rule = rf.StrainRate(0.01 * peak, 20 * DT)
        tips.append(np.array(rows))
    twin, ours = tips[0][:, 0], tips[1][:, 0]
    off = np.abs(ours - tips[1][:, 1] - twin).max()
    assert np.count_nonzero(np.diff(np.array(touching) > 0)) >= 2
    assert np.mean(rigid) > 0.2
    assert off > 1e-3 * np.abs(twin).max()
    assert np.abs(ours - twin).max() <= 0.1 * off
    of_twin, (of_u, of_e) = np.array(pressed[: len(twin)])[:, 0], np.array(pressed[len(twin) :]).T
    assert np.abs(of_u + of_e - of_twin).max() <= 0.01 * np.abs(of_u - of_twin).max()


def test_a_blow_wakes_nothing_in_another_part():
    """Beside a bar that is struck, one that e strains between tol and κ tol stays rigid."""
    two = boxes(((0, 0, 0), (2, 1, 1), (4, 2, 2)), ((0, 5, 0), (6, 6, 1), (12, 2, 2)))
    two = two.with_facets("roots", lambda x: x[0] < 1e-9)
    two = two.with_facets("struck", lambda x: (x[0] > 2 - 1e-9) & (x[1] < 3))
    two = two.with_facets("pushed", lambda x: x[0] > 6 - 1e-9)
    two = two.with_cells("slow", lambda x: x[1] > 3)

    def blow(t):
        return np.sin(np.pi * (t - 6.0) / 0.2) ** 2 if 6.0 < t < 6.2 else 0.0

    effects = [
        rf.Fixed("roots"),
        rf.MassDamping(3.0),
        rf.StiffnessDamping(ratio=0.05, frequency=2.0),
        rf.Traction("struck", (0, 0, 3e4), time=blow),
        rf.Traction("pushed", (0, 0, 600.0), time=lambda t: np.sin(np.pi * t / 2) * min(t / 4, 1)),
    ]
    scene = rf.Scene(two, rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0), effects)
    slow = scene.domain.find("slow", (3,), "test").entities
    woken = []
    for report in rf.simulate(scene, 0.02, 6.5, rigidify=rf.StrainRate(1e-3, 0.8), progress=False):
        woken += [event.woken for event in report.events if event.kind == "release"]
    assert len(woken) == 1
    assert not np.isin(slow, woken[0]).any()
