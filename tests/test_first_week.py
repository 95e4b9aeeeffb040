"""Warnings of what goes another way than was meant: jolts, brief impacts, springs, facets."""

import re

import numpy as np
import pytest
from common import on_first_rank
from hardcases.first_week import drum
from histories import heard

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
BAR = rf.box((0, 0, 0), (1, 0.1, 0.1), (4, 1, 1))


def said(effects, dt, t_end, domain=BAR):
    """What a run warns of, but for cells that are coarse."""
    with heard() as found:
        for _ in rf.simulate(rf.Scene(domain, SOFT, effects), dt, t_end, progress=False):
            pass
    coarse = re.compile("lock in bending|error of its lumped masses")
    return [text for text in found if not coarse.search(text)]


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


def peaks_of_force(effects, dt, t_end, domain=BAR):
    """The largest force of a contact, and that of its mean over the time that cells resolve [N]."""
    reports = rf.simulate(rf.Scene(domain, SOFT, effects), dt, t_end, progress=False)
    touches = [touch for r in reports for touch in r.touches.values()]
    return max(t.pressing for t in touches), max(t.resolved for t in touches)


def facing_bars():
    """Two bars, of which the first one flies at the other."""
    x = np.array([[i, j, k] for i in (0.0, 0.25, 0.5) for j in (0.0, 0.1) for k in (0.0, 0.1)])
    cells = np.array([[0, 4, 2, 6, 1, 5, 3, 7], [4, 8, 6, 10, 5, 9, 7, 11]])
    points, cells = np.vstack([x, x + np.array([0.501, 0, 0])]), np.vstack([cells, cells + 12])
    bars = on_first_rank(points, cells).with_cells("first", lambda x: x[0] < 0.5005)
    bars = bars.with_facets("end", lambda x: np.abs(x[0] - 0.5) < 1e-9)
    return bars.with_facets("begin", lambda x: np.abs(x[0] - 0.501) < 1e-9)


@pytest.mark.parametrize("pair", [False, True])
@pytest.mark.filterwarnings("ignore:.* as nodes of the surface ring")
def test_a_contact_that_the_step_does_not_resolve(pair):
    """It is told with a Δt at which steps are not told of, and the peak is that at half of it."""
    if pair:
        contact, domain = rf.Contact("end", against="begin"), facing_bars()
        effects = [contact, rf.InitialVelocity(linear=(1.0, 0, 0), where="first")]
    else:
        contact, domain = rf.Contact("x0", against=rf.Plane((-1e-3, 0, 0), (1, 0, 0))), BAR
        effects = [contact, rf.InitialVelocity(linear=(-1.0, 0, 0))]
    (message,) = said(effects, 5e-3, 0.05, domain)
    assert f"Contact '{contact.title}' closed at t = " in message
    assert "and opened again within" in message
    dt = float(re.search(r"With Δt ≤ (\S+) s", message)[1])
    assert 1e-4 < dt < 3e-4  # a wave passes a cell in 0.7 ms
    control = rf.StepControl(0.01, largest=5e-3)
    for steps in (dt, control):
        assert not [text for text in said(effects, steps, 0.012, domain) if "within" in text]
    coarse, fine = (peaks_of_force(effects, dt / k, 8e-3, domain)[1] for k in (1, 2))
    assert coarse == pytest.approx(fine, rel=0.03)
    with pytest.warns(rf.RigidfxWarning, match="opened again within"):
        assert peaks_of_force(effects, 0.02, 0.1, domain)[1] < 0.5 * fine


@pytest.mark.parametrize(("dt", "steps"), [(5e-3, 1), (8e-4, 2), (1e-4, 13), (1e-4, 11)])
def test_a_blow_in_the_last_step_is_told(dt, steps):
    """Its length is not known yet: steps have to resolve the time of the contact itself."""
    contact = rf.Contact("x0", against=rf.Plane((-1e-3, 0, 0), (1, 0, 0)))
    found = said([contact, rf.InitialVelocity(linear=(-1.0, 0, 0))], dt, steps * dt)
    assert len(found) == (dt > 5e-4), found
    assert all(
        "and pressed until the run ended, within one step: Δt does not resolve" in text
        for text in found
    )


def test_a_load_that_grows_on_a_contact_is_no_blow():
    floor = rf.Contact("x0", against=rf.Plane((0, 0, 0), (1, 0, 0)))
    push = rf.NodalForce("x1", (-100.0, 0, 0), time=rf.Table((0, 1), (0, 1)))
    assert not said([floor, rf.KelvinVoigt(1e4), push], 0.1, 0.5)


@pytest.mark.parametrize(
    ("dt", "t_end", "stays", "words"),
    [
        (5e-3, 0.01, True, "and past its peak within 2 steps: Δt does not resolve"),
        (2e-4, 0.03, True, "and past its peak: the peak of its force, 2.76e+03 N, lasts for less"),
        (5e-3, 0.2, False, None),
    ],
)
def test_a_contact_that_is_closed_to_the_end(dt, t_end, stays, words):
    """It had no word, whatever its blow; a block that rests on its floor has no blow."""
    block = rf.box((0, 0, 1e-3), (0.1, 0.1, 0.101), (2, 2, 2))
    floor = rf.Plane((0, 0, 0 if stays else 1e-3), (0, 0, 1))
    effects = [rf.Contact("z0", against=floor), rf.KelvinVoigt(1e4), rf.Gravity()]
    if stays:
        thrown = rf.InitialVelocity(linear=(0, 0, -1.0))
        effects = [*effects[:2], rf.NodalForce("z1", (0, 0, -200.0)), thrown]
    material = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0)
    with heard("closed at") as found:
        *_, last = rf.simulate(
            rf.Scene(block, material, effects, element="enhanced"), dt, t_end, progress=False
        )
    assert last.touches["z0_plane"].pressing > 0
    assert len(found) == (words is not None), found
    assert all(words in text for text in found), found


@pytest.mark.parametrize(
    ("cell", "order", "mass", "n", "least"),
    [
        ("hexahedron", 1, "lumped", 6, 1.9),
        ("tetrahedron", 2, "consistent", 3, 1.1),
        ("hexahedron", 2, "lumped", 3, 1.4),
    ],
)
def test_a_flat_face_presses_with_the_force_of_the_body(cell, order, mass, n, least):
    """ρ c v A of a plane wave: its nodes ring on the contact, which is told, not their mean."""
    h, E, nu, rho, v = 0.005, 2.3e9, 0.35, 1050.0, 1.0
    c = np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / rho)
    block = rf.box((0, 0, 1e-6), (h, h, n * h + 1e-6), (1, 1, n), cell)
    block = block.with_cells("all", lambda x: x[0] > -1)
    floor = rf.Contact("z0", against=rf.Plane((0, 0, 0), (0, 0, 1)))
    effects = [floor, rf.Fixed("all", "xy"), rf.InitialVelocity(linear=(0, 0, -v))]
    plastic = rf.StVenantKirchhoff(E=E, nu=nu, rho=rho)
    peaks = []
    for crossings in (0.3, 0.1):  # of a layer of nodes, in a step
        scene = rf.Scene(block, plastic, effects, order=order, mass=mass)
        dt, t_end = crossings * h / order / c, (2 * n + 6) * h / c
        with heard("opened again") as found:
            reports = list(rf.simulate(scene, dt, t_end, progress=False))
        touches = [touch for r in reports for touch in r.touches.values()]
        peaks.append(max(touch.resolved for touch in touches) / (rho * c * v * h * h))
        peak = max(touch.pressing for touch in touches) / (rho * c * v * h * h)
    assert peaks == pytest.approx([1.0, 1.0], rel=0.05)
    assert peak > least
    (message,) = set(found)
    told = float(re.search(r"touch.resolved, (\S+) N", message)[1]) / (rho * c * v * h * h)
    assert told == pytest.approx(peaks[-1], rel=0.006)  # of three digits


def test_an_impact_of_a_rigid_body_that_the_step_does_not_resolve():
    """A body on a given stiffness is a mass on a spring: its own time is named at once."""
    floor = rf.Contact("x0", against=rf.Plane((-1e-3, 0, 0), (1, 0, 0)), stiffness=1e10)
    effects = [floor, rf.Rigid(), rf.InitialVelocity(linear=(-1.0, 0, 0))]
    (message,) = said(effects, 5e-3, 0.05)
    dt = float(re.search(r"With Δt ≤ (\S+) s", message)[1])
    assert not said(effects, dt, 0.01)
    exact = np.sqrt(10.0 * 1e10 * 0.01)  # v √(m k)
    assert peaks_of_force(effects, dt, 0.01) == pytest.approx((exact, exact), rel=0.035)


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


FLOOR = rf.Plane((0, -1.1, 0), (0, 1, 0))


def on_a_floor(domain, friction=0.3, floor=FLOOR, order=1):
    """What a scene warns of whose skin meets a floor."""
    creep = 1e-3 if friction else None
    contact = rf.Contact("skin", against=floor, friction=friction, creep=creep)
    with heard() as found:
        rf.Scene(domain, SOFT, [contact], order=order)
    return [text for text in found if "lock in bending" not in text]


@pytest.mark.parametrize(("n", "half"), [(8, "22.5"), (24, "7.5"), (48, "3.75"), (96, "")])
def test_a_drum_of_flat_facets(n, half):
    """A polygon stands still below 180°/n; fine ones, and blocks, are not spoken of."""
    found = on_a_floor(drum(n))
    assert len(found) == bool(half)
    assert all(f"some n = {n} in a turn" in m and f"180°/n = {half}°" in m for m in found)
    assert not on_a_floor(drum(n), friction=0.0)


@pytest.mark.parametrize(
    ("floor", "told"),
    [
        (rf.Sphere((0, -3, 0), 1.9), True),
        (rf.Cylinder((0, -3, 0), 1.9, axis=(0, 0, 1)), True),
        (rf.Cylinder((0, 0, 0), 3.0, axis=(0, 0, 1), inside=True), True),
        (rf.Cylinder((0, 0, 0), 1.05, axis=(0, 0, 1), inside=True), False),  # a bearing
    ],
)
@pytest.mark.parametrize("order", [1, 2])
def test_a_drum_on_what_is_round(floor, told, order):
    """Nodes halfway along flat facets make no more of them; a shaft in a bearing rolls on all."""
    found = on_a_floor(drum(24), floor=floor, order=order)
    assert len(found) == told
    assert all("180°/n = 7.5°" in message for message in found)


def test_a_block_is_not_round():
    assert not on_a_floor(BAR.with_facets("skin", lambda x: x[0] < 9))
