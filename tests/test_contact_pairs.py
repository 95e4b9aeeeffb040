"""Contact of two surfaces that deform: energy, both momenta, waves, waking, ranks.

Run as a script under mpirun, this file reports histories of two blocks that meet.
"""

import numpy as np
import parallel
import pytest
from common import arrays, boxes, on_first_rank
from histories import changes
from impact import SOFT, collided
from mpi4py import MPI

import rigidfx as rf
from rigidfx.step.first_touch import FirstTouch

# Bounces in long steps: balances hold at any Δt.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Contact .* closed at .* and (opened again|past its peak)"
)

BOTH = rf.Contact("upper", against="lower"), rf.Contact("lower", against="upper")
PARTS = {
    "flexible": (),
    "one rigid": (rf.Rigid("high"),),
    "both rigid": (rf.Rigid("high"), rf.Rigid("low")),
    "mixed": (rf.Rigid("high"), rf.Rigid("left")),
    "reduced and rigid": (rf.Reduced("high"), rf.Rigid("low")),
}
NO_WARNINGS = pytest.mark.filterwarnings("ignore:Body")  # of few cells, whose lumped mass shows
TOO_MANY = pytest.mark.filterwarnings(
    "ignore:Reduced .* (more of its nodes press|it deforms too far)"
)


def _of_the_lower(x):
    """Its nodes are at multiples of 0.1 m along x, those of the other are not."""
    return np.abs((10 * x[0] + 0.5) % 1 - 0.5) < 1e-6


def blocks(*effects, gap=0.03, **options):
    """Two blocks, one thrown at the other, both turning."""
    low = (0, 0, 0), (0.4, 0.2, 0.2), (4, 2, 2)
    high = (0.07, 0.03, 0.2 + gap), (0.37, 0.19, 0.4 + gap), (3, 2, 2)
    between = 0.2 + 0.5 * gap
    domain = boxes(low, high)
    sets = {"low": _of_the_lower, "high": lambda x: ~_of_the_lower(x)}
    for name, marker in sets.items():
        domain = domain.with_cells(name, marker)
    domain = domain.with_cells("left", lambda x: _of_the_lower(x) & (x[0] <= 0.2 + 1e-9))
    domain = domain.with_facets("lower", sets["low"]).with_facets("upper", sets["high"])

    def thrown(x):
        falls = np.array([[0.1], [0.05], [-1.0]]) + np.array([0.1 - x[1], x[0] - 0.2, 0 * x[0]])
        turns = 0.5 * np.array([0 * x[0], x[2] - 0.1, 0.1 - x[1]])
        return np.where(x[2] > between, falls, turns)

    return rf.Scene(domain, SOFT, [rf.InitialVelocity(function=thrown), *effects], **options)


def drifts(scene, dt, steps, **options):
    """Reports, and the largest changes of H, L and J, relative."""
    reports = list(rf.simulate(scene, dt, steps * dt, **options))
    return reports, *changes(reports)


@NO_WARNINGS
@TOO_MANY
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("parts", PARTS)
def test_energy_and_both_momenta_are_kept(parts, mass):
    """Nodes of each against facets of the other, whatever is rigid."""
    reports, H, L, J = drifts(blocks(*BOTH, *PARTS[parts], mass=mass), 1e-3, 70)
    assert sum(any(t.nodes for t in r.touches.values()) for r in reports) >= 5
    assert H <= 1e-11
    assert max(L, J) <= 1e-12


@TOO_MANY
def test_reduced_parts_get_shapes_where_they_strike_each_other(monkeypatch):
    """They bounce off as flexible ones do; cells that are pressed too far leave them."""
    monkeypatch.setitem(globals(), "SOFT", rf.StVenantKirchhoff(rho=1000.0, E=1e8, nu=0.3))
    both = rf.Reduced("high"), rf.Reduced("low")
    flexible, (reduced, H, L, J) = (
        drifts(blocks(*BOTH, *p, gap=0.004), 2e-4, 60) for p in ((), both)
    )
    assert 12 < reduced[0].unknowns < reduced[-1].unknowns <= 160
    assert H <= 1e-12
    assert max(L, J) <= 1e-13
    impulse, expected = (
        sum(t.pressing for r in reports for t in r.touches.values())
        for reports in (reduced, flexible[0])
    )
    assert impulse == pytest.approx(expected, rel=0.05)


@NO_WARNINGS
@TOO_MANY
def test_a_reduced_part_may_touch_itself():
    """Its prongs are parts of one body, but deform; thrown faster they leave its range (ν > 1)."""
    contact = rf.Contact("slot", against="slot")
    reports, H, L, J = drifts(fork(contact, rf.Reduced(), speed=6), 1e-3, 20)
    assert any(r.touches["slot_slot"].nodes for r in reports)
    assert H <= 1e-11
    assert max(L, J) <= 2e-12


def test_equal_bars_exchange_their_velocities():
    """In plane waves: each has the other's speed after 2 L/c, lateral motion blocked."""
    found = collided(60, 1.0)
    assert found["speed_error"] <= 0.03
    assert max(found["energy_drift"], found["linear_momentum_drift"]) <= 1e-11


def fork(*effects, speed=12):
    """The prongs of a fork, thrown at each other; at its root the sets have nodes in common.

    It is sheared, so that no node meets an edge: rounding would choose the facet, and the motion.
    """
    points, cells = arrays(((0, 0, 0), (0.5, 0.1, 0.3), (5, 1, 6)))
    middle = points[cells].mean(axis=1)
    cells = cells[(middle[:, 0] < 0.1) | (np.abs(middle[:, 2] - 0.15) > 0.05)]
    used, cells = np.unique(cells, return_inverse=True)
    x, y, z = points[used].T
    x = x * (1 + 0.13 * z)
    sheared = np.c_[x, y + 0.17 * x * z, z]
    domain = on_first_rank(sheared, cells.reshape(-1, 8))

    def within(x):
        return (x[0] > 0.1 - 1e-6) & (np.abs(x[2] - 0.15) < 0.05 + 1e-6)

    domain = domain.with_facets("upper", lambda x: within(x) & (x[2] > 0.2 - 1e-6))
    domain = domain.with_facets("lower", lambda x: within(x) & (x[2] < 0.2 - 1e-6))
    domain = domain.with_facets("slot", within)

    def closing(x):
        return np.stack([0 * x[0], 0.5 * x[0], speed * x[0] * np.sign(0.15 - x[2])])

    return rf.Scene(domain, SOFT, [*effects, rf.InitialVelocity(function=closing)])


@NO_WARNINGS
def test_parts_of_one_surface_meet_named_or_not(monkeypatch):
    """The slot against itself is its upper side against its lower one, and the other way round."""
    monkeypatch.setattr(FirstTouch, "before", lambda self, target: target)  # of one, or of two
    named, H, L, J = drifts(fork(*BOTH), 1e-3, 30)
    itself = drifts(fork(rf.Contact("slot", against="slot")), 1e-3, 30)
    assert max(sum(t.nodes for t in r.touches.values()) for r in named) >= 2
    assert max(H, itself[1]) <= 1e-11
    assert max(L, J, *itself[2:]) <= 1e-12
    energies = [[(r.kinetic, r.strain, r.contact) for r in of] for of in (named, itself[0])]
    np.testing.assert_allclose(*energies, atol=1e-12 * named[0].energy)
    pressing = [sum(t.pressing for t in r.touches.values()) for r in named[1:]]
    both = [r.touches["slot_slot"] for r in itself[0][1:]]
    np.testing.assert_allclose([t.pressing for t in both], pressing, atol=1e-9 * max(pressing))
    assert not any(touch.force.any() or touch.moment.any() for touch in both)


def curved(kind, *effects, n=24):
    """A strip bent to a C, all of it one surface: its ends, or its backs, fly at each other."""
    points, cells = arrays(((0.15, 0.0, 0.34), (2 * np.pi - 0.15, 0.1, 0.4), (n, 1, 1)))
    angle, y, r = points.T
    bent = np.c_[r * np.cos(angle), y, r * np.sin(angle)]
    domain = on_first_rank(bent, cells)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    domain = domain.with_cells("upper", lambda x: x[2] > 0.2)

    def thrown(x):
        ends = -3 * np.maximum(x[0], 0) * np.sign(x[2]), -20 * x[2]
        return np.stack([0 * x[0] + 0.3, 0.2 * x[2], ends[kind == "backs"]])

    skin = rf.Contact("skin", against="skin")
    return rf.Scene(domain, SOFT, [skin, rf.InitialVelocity(function=thrown), *effects])


@NO_WARNINGS
@pytest.mark.parametrize(
    ("kind", "parts"), [("ends", ()), ("backs", ()), ("backs", (rf.Rigid("upper"),))]
)
def test_a_curved_surface_meets_itself(kind, parts):
    """Where it closes, nowhere before, and never through its own thickness."""
    reports, H, L, J = drifts(curved(kind, *parts), 1e-3, 100 if kind == "ends" else 40)
    touches = [r.touches["skin_skin"] for r in reports[1:]]
    first = next(k for k, touch in enumerate(touches) if touch.nodes)
    assert first >= (55 if kind == "ends" else 8)
    assert sum(touch.nodes > 0 for touch in touches) >= 5
    assert max(touch.penetration for touch in touches) < 0.01
    assert H <= 1e-11
    assert max(L, J) <= 1e-12


@NO_WARNINGS
def test_a_surface_that_meets_itself_wakes():
    """Its ends fly at each other as parts of bodies, and are flexible where they meet."""
    rule = rf.StrainRate(0.3, 0.008, wake="all", patience=1.0)
    reports, H, L, J = drifts(curved("ends"), 1e-3, 75, rigidify=rule)
    first = next(r for r in reports if r.step and r.touches["skin_skin"].nodes)
    before = reports[first.step - 1]
    assert before.unknowns < first.unknowns == reports[0].unknowns
    assert any("contact 'skin_skin' changes" in e.reason for e in first.events + before.events)
    assert H <= 1e-11
    assert max(L, J) <= 1e-12


@NO_WARNINGS
def test_what_is_pressed_within_one_body_keeps_its_energy():
    """A fork freezes as a whole while its prongs press on each other."""
    # Within some steps of the first touch: what rattles on depends on the last digits.
    freezes = rf.StrainRate(1e9, 0.0145, wake="none", release=rf.Release(at=0.05))
    reports, H, L, J = drifts(fork(*BOTH), 1e-3, 60, rigidify=freezes)
    frozen = [r for r in reports if r.unknowns == 6]
    assert H <= 1e-11
    assert max(L, J) <= 1e-12
    for r in reports[1:]:
        told = sum(touch.energy for touch in r.touches.values())
        assert told == pytest.approx(r.contact, abs=1e-14 * reports[0].energy)
    assert frozen[-1].contact > 0


@NO_WARNINGS
def test_a_thin_plate_does_not_meet_its_other_side():
    """However it bends: its thickness is a tenth of its cells."""
    plate = rf.box((0, 0, 0), (1, 0.5, 0.01), (10, 5, 1))
    plate = plate.with_facets("skin", lambda x: np.full(x.shape[1], True))

    def thrown(x):
        return np.stack([0 * x[0], 0 * x[0], 4 * np.cos(2 * np.pi * x[0]) + 3 * x[0] * x[1]])

    effects = rf.Contact("skin", against="skin"), rf.InitialVelocity(function=thrown)
    reports, *_ = drifts(rf.Scene(plate, SOFT, effects), 2e-3, 30)
    assert max(r.strain for r in reports) > 0.3 * reports[0].kinetic
    assert all(r.contact == 0.0 for r in reports)


@NO_WARNINGS
def test_a_plate_that_stands_on_its_edge_is_met():
    """By another of the same surface; the normal at its rim is no good if areas weigh it."""
    lying = (0, 0, 0), (0.4, 0.4, 0.01), (4, 4, 1)
    plates = boxes(lying, ((0.23, 0.07, 0.02), (0.24, 0.27, 0.22), (1, 2, 2)))
    plates = plates.with_facets("skin", lambda x: np.full(x.shape[1], True))

    def falling(x):
        return np.where(x[2] > 0.015, -2.0, 0.0) * np.array([[0.0], [0.0], [1.0]])

    skin = rf.Contact("skin", against="skin")
    scene = rf.Scene(plates, SOFT, [skin, rf.InitialVelocity(function=falling)])
    reports, H, L, J = drifts(scene, 1e-3, 20)
    assert max(r.touches["skin_skin"].nodes for r in reports[1:]) >= 6  # three along each side
    assert max(r.touches["skin_skin"].penetration for r in reports[1:]) < 1e-3
    assert H <= 1e-11
    assert max(L, J) <= 1e-12


@NO_WARNINGS
def test_what_is_struck_is_flexible_in_that_very_step():
    """Both blocks fly as bodies, and meet."""
    rule = rf.StrainRate(3e-2, 0.008, wake="all", patience=1.0)
    reports, H, L, J = drifts(blocks(*BOTH), 1e-3, 60, rigidify=rule)
    forces = [np.linalg.norm(r.touches[BOTH[0].title].force) if r.step else 0.0 for r in reports]
    first = int(np.argmax(np.array(forces) > 0))  # by the rounding of a gap of zero, perhaps
    struck = int(np.argmax(np.array(forces) > 1e-6 * max(forces)))
    assert reports[first - 1].unknowns == 12
    assert reports[struck].unknowns > 12
    assert H <= 1e-11
    assert max(L, J) <= 1e-12


def test_what_overlaps_at_the_start_is_told():
    with pytest.raises(rf.SceneError, match=r"at the start it is 0\.02 m inside 'lower' at"):
        blocks(BOTH[0], gap=-0.02)


@pytest.mark.filterwarnings("ignore:Scene. the part")  # touches another
@pytest.mark.parametrize(("low", "count"), [((0.23, 0.07, 0.15), (3, 2, 2)), ((0.1, 0, 0.1), 2)])
def test_a_mesh_that_overlaps_itself_is_refused(low, count):
    """Whether nodes coincide or not; what touches is taken."""
    high, count = tuple(a + 0.2 for a in low), (2, 2, 2) if count == 2 else count
    one = (0, 0, 0), (0.4, 0.2, 0.2), (4, 2, 2)
    skin = rf.Contact("skin", against="skin")

    def scene(up):
        both = boxes(one, ((*low[:2], low[2] + up), (*high[:2], high[2] + up), count))
        return rf.Scene(both.with_facets("skin", lambda x: x[0] > -1), SOFT, [skin])

    with pytest.raises(rf.SceneError, match=r"the mesh overlaps itself at \(0\.\d*, .* m, and"):
        scene(0.0)
    scene(0.2 - low[2])


@pytest.mark.filterwarnings("ignore:Scene. the part")
def test_cells_with_warped_faces_are_no_larger_than_they_are():
    """The hull of the lower one goes far into the upper one."""
    points, cells = arrays(((0, 0, 0), (1, 1, 1), (1, 1, 1)), ((0, 0, 1.01), (1, 1, 2), (1, 1, 1)))
    points[:, 2] -= 0.3 * points[:, 0] * points[:, 1]
    both = rf.from_arrays(points, cells).with_facets("skin", lambda x: x[0] > -1)
    rf.Scene(both, SOFT, [rf.Contact("skin", against="skin")])


def histories():
    """Numbers of two blocks that meet, one pair switched, and of a strip with itself."""
    rows = []
    switched = {"rigidify": rf.StrainRate(3e-2, 0.008, wake="all", patience=1.0)}
    runs = [
        (blocks(*BOTH), switched),
        (blocks(*BOTH, *PARTS["mixed"]), {}),
        (curved("backs", rf.Rigid("upper")), {}),
    ]
    for scene, options in runs:
        for r in drifts(scene, 1e-3, 30, **options)[0][1:]:
            touch = next(iter(r.touches.values()))
            rows.append([r.unknowns, r.kinetic, r.strain, r.contact, *r.angular_momentum,
                         *touch.force, *touch.moment, touch.pressing, touch.penetration,
                         touch.nodes])  # fmt: skip
    return rows


@NO_WARNINGS
@pytest.mark.parallel
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")
def test_the_same_on_several_ranks():  # obstacles are tried on two
    parallel.check_the_same(__file__, 3, histories())


if __name__ == "__main__":
    parallel.report(histories())
