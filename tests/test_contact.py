"""Contact with obstacles: exact energy and momenta, waves, rebounds, friction, waking, refusals.

Run as a script under mpirun, this file reports histories of scenes with contacts.
"""

from itertools import pairwise

import numpy as np
import parallel
import pytest
from histories import imbalance
from impact import FLOOR, SOFT, bar_against_wall, block, bounces, crept, slid
from mpi4py import MPI

import rigidfx as rf

# Bounces in long steps, and a floor that comes back under a skin: balances hold through both.
pytestmark = [
    pytest.mark.filterwarnings("ignore:Contact .* closed at .* and (opened again|past its peak)"),
    pytest.mark.filterwarnings("ignore:.* acts with a jolt"),
]

BALL = rf.Sphere((0.2, 0.1, -0.5), 0.5)
OBSTACLES = {
    "plane": FLOOR,
    "tilted": rf.Plane((0, 0, 0), (0.1, 0.2, 3)),
    "sphere": BALL,
    "in a sphere": rf.Sphere((0.2, 0.1, 0.12), 0.26, inside=True),
    "cylinder": rf.Cylinder((0.2, 0.1, -0.5), 0.5, axis=(0, 1, 0)),
    "in a tube": rf.Cylinder((0.2, 0.1, 0.2), 0.3, axis=(2, 1, 0), inside=True),
    "shaken": rf.Plane((0, 0, 0), (0, 0, 1), path=lambda t: (0.2 * t, 0, 0.01 * np.sin(30 * t))),
}
PARTS = {"flexible": [], "mixed": [rf.Rigid("part")], "rigid": [rf.Rigid()]}
NO_WARNINGS = pytest.mark.filterwarnings("ignore:Body")  # of few cells, whose lumped mass shows


THROWN = rf.InitialVelocity(linear=(0.3, 0, -1.0), angular=(1, 2, 0.5))


def books(scene, dt, t_end, **options):
    """Reports of a run, and how far energy and momenta are from balance, relative."""
    reports = list(rf.simulate(scene, dt, t_end, **options))
    linear, angular = 0.0, 0.0
    size = max(r.momentum_scale for r in reports)
    for before, r in pairwise(reports):
        force = sum(touch.force for touch in r.touches.values())
        moment = sum(touch.moment for touch in r.touches.values())
        gained = r.linear_momentum - before.linear_momentum - r.dt * force
        turned = r.angular_momentum - before.angular_momentum - r.dt * moment
        linear = max(linear, float(np.abs(gained).max()) / size)
        angular = max(angular, float(np.abs(turned).max()) / size)
    return reports, imbalance(reports), max(linear, angular)


# Energy and momenta ----------------------------------------------------------------------------


@NO_WARNINGS
@pytest.mark.parametrize(
    ("name", "parts", "mu"),
    [
        *((name, "mixed", 0.4) for name in OBSTACLES),
        *(("plane", parts, 0.0) for parts in PARTS),
        *(("in a tube", parts, 0.4) for parts in ("flexible", "rigid")),
    ],
)
def test_energy_and_momenta_balance(name, parts, mu):
    """Of blocks that fly against all obstacles; forces and moments are those that are reported."""
    contact = rf.Contact("skin", against=OBSTACLES[name], friction=mu, creep=1e-3)
    scene = block(contact, THROWN, *PARTS[parts])
    reports, energy, momenta = books(scene, 2e-3, 0.12)
    assert max(t.nodes for r in reports for t in r.touches.values()) > 0
    assert energy <= 1e-12
    assert momenta <= 1e-12
    assert all(r.dissipated.get("Contact", 0.0) >= 0 for r in reports)
    lost = sum(r.dissipated.get("Contact", 0.0) for r in reports)
    assert (lost > 1e-3 * reports[0].energy) == (mu > 0)


@NO_WARNINGS
@pytest.mark.parametrize(
    ("cell", "order", "mass", "material"),
    [
        ("hexahedron", 2, "lumped", SOFT),
        ("tetrahedron", 1, "lumped", SOFT),
        ("tetrahedron", 2, "consistent", SOFT),
        ("hexahedron", 1, "consistent", rf.NeoHooke(rho=1000.0, E=1e6, nu=0.3)),
    ],
)
def test_any_cell_and_mass(cell, order, mass, material):
    """A part of the block is rigid; weights of all nodes make up the area."""
    contact, cells = rf.Contact("skin", against=FLOOR), (2, 1, 1) if order == 2 else (4, 2, 2)
    options = {"cell": cell, "order": order, "mass": mass, "material": material, "cells": cells}
    scene = block(contact, THROWN, PARTS["mixed"][0], **options)
    reports, energy, momenta = books(scene, 2e-3, 0.1)
    assert max(t.nodes for r in reports for t in r.touches.values()) > 0
    assert energy <= 1e-11
    assert momenta <= 1e-11
    nodes = contact.at_nodes(scene, scene.space.tabulate_dof_coordinates(), 0.0)[0]
    assert nodes.size > 0


def test_corners_of_second_order_triangles_are_stopped():
    """They have no area by their shape functions: the corner would go in first."""
    contact = rf.Contact("skin", against=rf.Plane((0, 0, 0), (1, 1, 1)))
    options = {"cell": "tetrahedron", "order": 2, "mass": "consistent", "cells": (2, 1, 1)}
    scene = block(contact, rf.InitialVelocity(linear=(-1, -1, -1)), above=1e-3, **options)
    reports = list(rf.simulate(scene, 1e-3, 0.01))
    assert max(r.touches[contact.title].nodes for r in reports[1:5]) == 1
    assert max(r.touches[contact.title].penetration for r in reports[1:]) < 5e-3


def test_a_rigid_block_regains_its_height():
    """It falls flat, by steps in which it goes deep, or not, as they come."""
    assert bounces(11, 5e-3)["height_error"] <= 2e-11


# Waves -----------------------------------------------------------------------------------------


def test_a_bar_rebounds_as_plane_waves_do():
    """Force ρ c v S for 2 L/c, lateral motion blocked, and all of its speed comes back."""
    found = bar_against_wall(100, 1)
    assert found["energy_drift"] <= 1e-12
    assert max(found["force_error"], found["rebound_error"]) <= 0.03
    assert found["duration_error"] <= 0.05


# Friction --------------------------------------------------------------------------------------


def test_a_block_slides_as_far_as_coulomb_says():
    """v²/(2 μ g), resting on the floor from the start at the depth of its weight."""
    with pytest.warns(rf.RigidfxWarning, match="at the start it is 2e-05 m inside the Plane"):
        found = slid(2e-3)
    assert found["way_error"] <= 0.01
    assert found["energy_drift"] <= 1e-12
    assert found["lost_by_kinetic"] == pytest.approx(1, rel=1e-2)


def test_a_block_on_a_slope_creeps_no_faster_than_told():
    """ε tan φ/√(μ² - tan² φ) below the angle of friction."""
    with pytest.warns(rf.RigidfxWarning, match="at the start"):
        assert crept()["creep_by_theory"] == pytest.approx(1, rel=1e-2)


# Waking ----------------------------------------------------------------------------------------


@NO_WARNINGS
@pytest.mark.parametrize("wake", ["all", "local"])
def test_what_is_struck_is_flexible_in_that_very_step(wake):
    """A block flies as one body, is struck, rebounds and flies as a body again."""
    contact = rf.Contact("skin", against=FLOOR)
    scene = block(contact, rf.InitialVelocity(linear=(0, 0, -1.0)), above=0.0605)
    rule = rf.StrainRate(1e-2, 0.01, wake=wake, patience=1.0)
    reports, energy, _ = books(scene, 1e-3, 0.1, rigidify=rule)
    touching = [r for r in reports if r.step and r.touches[contact.title].energy > 0]
    before = [r for r in reports if r.t < touching[0].t]
    # One body; where forces wake it, with modes that follow the blow.
    assert before[-1].unknowns == (6 if wake == "all" else 26)
    assert before[-1].t == pytest.approx(0.0605, abs=1e-9)  # a step ends where it touches
    assert wake == "local" or any(e.kind == "release" for e in touching[0].events)
    assert energy <= 1e-12


@NO_WARNINGS
@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
def test_what_rests_does_not_chatter():
    """After a fall it rocks on the floor, damped: it freezes once and stays so."""
    contact = rf.Contact("z0", against=FLOOR)
    damped = rf.MassDamping(20.0), rf.KelvinVoigt(2e3)
    scene = block(contact, *damped, rf.Gravity((0, 0, -10.0)), above=0.01)
    rule = rf.StrainRate(2e-2, 0.05)
    reports, energy, _ = books(scene, 5e-3, 1.5, rigidify=rule)
    events = [e for r in reports for e in r.events if r.t > 0.2]
    assert reports[-1].unknowns < 0.5 * reports[0].unknowns
    assert reports[-1].touches[contact.title].nodes > 0
    assert len(events) <= 6
    assert energy <= 1e-11


def test_a_first_touch_is_a_breakpoint_of_what_chooses_the_steps():
    """Long steps in flight, one that ends at the touch, then one of a sixteenth."""
    contact = rf.Contact("skin", against=FLOOR)
    scene = block(contact, rf.InitialVelocity(linear=(0, 0, -1.0)), above=0.0605)
    control = rf.StepControl(1e-2, largest=4e-3)
    reports = list(rf.simulate(scene, control, 0.064))
    touch = next(k for k, r in enumerate(reports) if r.t > 0.0605 - 1e-9)
    assert reports[touch].t == pytest.approx(0.0605, abs=1e-9)
    longest = max(r.dt for r in reports[1:touch])
    assert longest > 2e-3
    assert reports[touch + 1].dt <= longest / 15
    assert reports[touch].cuts == 0


# Windows, tables, absence ----------------------------------------------------------------------


@NO_WARNINGS
@pytest.mark.parametrize("parts", PARTS)
def test_energy_of_a_contact_that_ends_is_told(parts):
    """The floor vanishes under a block that presses on it, and comes back under its skin."""
    ends = rf.Contact("skin", against=FLOOR, until=0.03, title="first")
    begins = rf.Contact("skin", against=FLOOR, since=0.035, until=0.05, title="second")
    reports, energy, _ = books(block(ends, begins, THROWN, *PARTS[parts]), 1e-3, 0.06)
    told = [r.impact for r in reports if r.impact]
    assert {impact.supports for impact in told} >= {("first",)}
    assert energy <= 1e-11


def test_histories_and_fields_tell_of_contacts(tmp_path):
    """A column for everything, gap and pressure at nodes of the skin."""
    contact = rf.Contact("skin", against=FLOOR, title="floor")
    scene = block(contact, THROWN)
    with rf.Recorder(scene, tmp_path, every=1) as recorder:
        reports = []
        for r in rf.simulate(scene, 2e-3, 0.05):
            recorder.write(r)
            reports.append(r)
    h = rf.read_history(recorder.history)
    touches = [r.touches["floor"] for r in reports[1:]]
    np.testing.assert_array_equal(h["contact"], [r.contact for r in reports])
    for name in ("pressing", "energy", "dissipated", "penetration", "nodes"):
        expected = [getattr(touch, name) for touch in touches]
        np.testing.assert_array_equal(h[f"contact_floor_{name}"][1:], expected)
    np.testing.assert_array_equal(h["contact_floor_force_z"][1:], [t.force[2] for t in touches])
    np.testing.assert_allclose(h["contact_floor_energy"], h["contact"], atol=1e-15)
    assert h["contact"].max() > 0


def test_a_preload_may_press():
    """A beam that sags into the floor rests there: the run begins in balance, and stays in it."""
    sags = rf.Fixed("x0"), rf.Preload([rf.Gravity()]), rf.Gravity()
    scene = block(rf.Contact("skin", against=FLOOR, title="floor"), *sags, above=1e-4)
    first, *_, last = rf.simulate(scene, 1e-3, 1e-2)
    assert first.contact > 0
    assert last.kinetic < 1e-18
    reaction = first.reactions["x0"][2] + last.touches["floor"].force[2]
    weight = 9.81 * scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())
    np.testing.assert_allclose(reaction, weight, rtol=1e-8)


# Several ranks ---------------------------------------------------------------------------------


def histories():
    """Numbers of runs with contacts of all kinds of parts."""
    rows = []
    for parts in PARTS.values():
        contact = rf.Contact("skin", against=BALL, friction=0.3, creep=1e-3)
        reports, *_ = books(block(contact, THROWN, *parts), 2e-3, 0.08)
        for r in reports[1:]:
            touch = r.touches[contact.title]
            rows.append([r.kinetic, r.strain, r.contact, *r.linear_momentum, *r.angular_momentum,
                         *touch.force, *touch.moment, touch.penetration, touch.nodes])  # fmt: skip
    return rows


@NO_WARNINGS
@pytest.mark.parallel
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")
def test_the_same_on_several_ranks():  # two surfaces are tried on three
    parallel.check_the_same(__file__, 2, histories())


if __name__ == "__main__":
    parallel.report(histories())
