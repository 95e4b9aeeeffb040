"""Tension stiffens a mast that is pulled before it is pushed aside, and bends shorten a strip."""

from itertools import pairwise

import numpy as np
import pytest
from elements import PARTS, bent, scene_of

import rigidfx as rf

STEEL = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7850.0)
PULL = 3e4  # N, as much as the load under which it would buckle
T1, T_END = 0.15, 0.3  # s


def rising(begin, end):
    return lambda t: 0.5 * (1 - np.cos(np.pi * min(max((t - begin) / (end - begin), 0), 1)))


def mast(*effects):
    domain = rf.box((-0.025, -0.025, 0), (0.025, 0.025, 3), (1, 1, 12))
    pull = rf.Traction("z1", (0, 0, PULL), total=True, time=rising(0, T1))
    push = rf.Traction("z1", (20, 0, 0), total=True, time=rising(T1, T_END), since=T1)
    damping = rf.StiffnessDamping(ratio=0.008, frequency=5.0)
    effects = [rf.Fixed("z0"), pull, push, damping, *effects]
    return rf.Scene(domain, STEEL, effects, element="enhanced", probes={"top": (0, 0, 3)})


def tops(scene, dt=2e-3, **how):
    """Times, places of the top and the last report."""
    reports = [(r.t, r.probes["top"], r) for r in rf.simulate(scene, dt, T_END, **how)]
    t, u, last = zip(*reports, strict=True)
    return np.array(t), np.array(u), last[-1]


@pytest.fixture(scope="module")
def twin():
    return tops(mast(), progress=False)[:2]


def off(t, u, twin):
    at = [np.interp(t, twin[0], twin[1][:, k]) for k in range(3)]
    return np.linalg.norm(u - np.array(at).T, axis=1).max() / np.linalg.norm(twin[1], axis=1).max()


def test_what_is_asked_is_kept(twin):
    """About the start it would bend by 5.5 % of the largest displacement too far."""
    asked = rf.Accuracy(0.01, "top", min_cells=3)
    t, u, last = tops(mast(), 0.02, accuracy=asked, progress=False)
    assert off(t, u, twin) < 2e-3
    assert last.ledger.motion < 0.01
    assert len(last.bodies) == 1


def test_a_named_part_bends_as_its_twin(twin):
    """Without the tension it would bend by 94 % of the largest displacement too far."""
    t, u, _ = tops(mast(rf.Reduced()), progress=False)
    assert off(t, u, twin) < 1e-3


def test_a_part_that_vibrates_is_pulled():
    """A pull has little energy beside a bend: it erred by 172 % of the displacement."""
    rubber = rf.NeoHooke(E=2.1e11, nu=0.3, rho=7850.0)
    domain = rf.box((-0.025, -0.025, 0), (0.025, 0.025, 3), (1, 1, 12))
    pluck = rf.Traction("z1", (40, 0, 0), total=True, time=rising(0, 0.02), until=0.05)
    pull = rf.Traction("z1", (0, 0, PULL), total=True, time=rising(0.05, 0.1), since=0.05)

    def ways(*parts):
        effects = [rf.Fixed("z0"), pluck, pull, *parts]
        probes = {"top": (0, 0, 3)}
        scene = rf.Scene(domain, rubber, effects, element="enhanced", probes=probes)
        return np.array([r.probes["top"][0] for r in rf.simulate(scene, 2e-3, 0.4)])

    twin = ways()
    assert np.abs(ways(rf.Reduced()) - twin).max() < 0.02 * np.abs(twin).max()


STRIP = rf.box((0, 0, 0), (1.0, 0.05, 0.01), (20, 1, 1))


def strip(*effects):
    probes = {"tip": (1.0, 0, 0)}
    return rf.Scene(STRIP, STEEL, [rf.Fixed("x0"), *effects], element="enhanced", probes=probes)


def loads(bend, pull, bent=None, pulled=None):
    """Forces at the tip [N], by functions of time."""
    both = zip(((0, 0, bend), (pull, 0, 0)), (bent, pulled), strict=True)
    return [rf.Traction("x1", force, total=True, time=time) for force, time in both]


@pytest.mark.parametrize(
    ("pull", "pulled"), [(-200.0, None), (4e3, None), (-300.0, rf.Table((0, 0.5, 1), (0, 0, 1)))]
)
def test_equilibria_have_tension(pull, pulled):
    """Without it displacements erred by 9 to 179 %; stresses of Φq for Φe were 65-fold."""
    forces, ways = loads(10, pull, rf.Table((0, 0.5, 1), (0, 1, 1)), pulled), ([], [rf.Reduced()])
    twin, own = ([*rf.static(strip(*forces, *w), 4)][-1] for w in ways)
    size = np.abs(twin.probes["tip"]).max()
    assert np.abs(own.probes["tip"] - twin.probes["tip"]).max() < 2e-3 * size
    a, b = (report.stresses["tip"].von_mises for report in (own, twin))
    assert a == pytest.approx(b, rel=0.01)


def test_warnings_tell_how_much_further_shapes_fail():
    with pytest.warns(rf.RigidfxWarning, match="deforms too far") as caught:
        *_, last = rf.static(strip(*loads(400, 0), rf.Reduced()), 8)
    told = [float(str(w.message).split("ν = ")[1].split("%")[0]) / 100 for w in caught]
    assert len(told) > 1
    assert all(now > 8 * before for before, now in pairwise(told))
    assert last.nu["all cells"] < 8.1 * told[-1]


def test_tension_of_second_order_cells_varies_in_them():
    """By one point a cell, the strip bent by 1.6 % of its displacement too far."""
    domain = rf.box((0, 0, 0), (1.0, 0.05, 0.01), (8, 1, 1), "tetrahedron")
    how = {"order": 2, "mass": "consistent", "probes": {"tip": (1.0, 0, 0)}}
    effects = [rf.Fixed("x0"), *loads(10, 300.0)]
    twin, own = (
        [*rf.static(rf.Scene(domain, STEEL, [*effects, *w], **how), 2)][-1]
        for w in ([], [rf.Reduced()])
    )
    size = np.abs(twin.probes["tip"]).max()
    assert np.abs(own.probes["tip"] - twin.probes["tip"]).max() < 3e-3 * size


@pytest.mark.parametrize("element", PARTS)
def test_tension_is_that_of_the_element(element):
    """Without its enhanced or assumed strains, a bent strip erred by 0.4 and 10.7 %."""
    domain = bent((8, 1, 1)).with_facets("root", lambda x: x[0] < 1e-9)
    domain = domain.with_facets("end", lambda x: np.arctan2(x[0], x[2]) > 1.2 - 1e-9)
    effects = [rf.Fixed("root"), rf.Traction("end", (1e6, 0, 0), total=True)]
    how = {"material": STEEL, "probes": {"tip": (1.1 * np.sin(1.2), 0, 1.1 * np.cos(1.2))}}
    twin, own = (
        [*rf.static(scene_of(element, domain, *effects, *w, **how), 2)][-1].probes["tip"]
        for w in ([], [rf.Reduced()])
    )
    assert np.abs(own - twin).max() < 1e-3 * np.abs(twin).max()


@pytest.mark.parametrize("pull", [5.0, 400.0])
def test_results_have_how_a_bend_shortens_before_and_after_a_pull(pull):
    """They lacked 0.23 %, where shapes follow the pull; two runs from here lacked it for good."""
    effects = [*loads(10, pull, rising(0, 0.3), rising(0.3, 0.6)), rf.MassDamping(60.0)]
    x = [
        np.array([r.probes["tip"] for r in rf.simulate(strip(*effects, *parts), 5e-3, 0.6)])
        for parts in ([], [rf.Reduced()])
    ]
    assert np.abs(x[1] - x[0])[:, 0].max() < 2e-4 * np.abs(x[0]).max()


def test_what_begins_from_a_bent_part_is_not_stretched_by_its_bend():
    """Bent by its thickness it had 24.6 Hz for 8.4, and swung back by half as much."""
    effects = *loads(20, 0, rising(0, 0.3))[:1], rf.MassDamping(20.0)
    found, back = [], []
    for parts in ([], [rf.Reduced()]):
        *_, bent = rf.simulate(strip(*effects, *parts), 5e-3, 0.4)
        found.append(rf.modes(strip(*effects, *parts), 2, about=bent).frequencies)
        free = rf.simulate(strip(*parts), 2e-3, 0.04, start=bent)
        back.append(np.array([r.probes["tip"][2] for r in free]))
    assert found[1] == pytest.approx(found[0], rel=2e-3)
    assert np.abs(back[1] - back[0]).max() < 0.02 * np.abs(back[0]).max()


@pytest.mark.parametrize("accuracy", [None, rf.Accuracy(0.01, "middle", min_cells=2)])
def test_joints_that_hold_both_ends_pull_a_part_as_it_bends(accuracy):
    """Before, there was no tension without Γ, nor Γ without tension: errors were 60 %."""
    bar, gravity = rf.box((0, 0, 0), (0.8, 0.04, 0.02), (12, 2, 2)), rf.Gravity((0, 0, -200.0))
    plastic = rf.StVenantKirchhoff(E=2e10, nu=0.3, rho=2000.0)
    ends = [
        rf.Revolute("ground", rf.MeanFace(face), (x, 0.02, 0.01), (0, 1, 0), name=face)
        for face, x in (("x0", 0.0), ("x1", 0.8))
    ]
    known = {"element": "enhanced", "probes": {"middle": (0.4, 0.02, 0.02)}}
    twin = rf.Scene(bar, plastic, [*ends, gravity], **known)
    own = twin if accuracy else rf.Scene(bar, plastic, [*ends, gravity, rf.Reduced()], **known)
    how = {"accuracy": accuracy, "progress": False}
    found = list(rf.simulate(own, 1e-3, 0.03, **how))
    t = np.array([report.t for report in found])
    steps = dict(zip(t, np.diff(t), strict=False))
    each = found, list(rf.simulate(twin, steps, t[-1], progress=False))
    a, b = (np.array([report.probes["middle"] for report in of]) for of in each)
    assert found[-1].unknowns < 0.2 * each[1][-1].unknowns
    assert np.abs(a - b).max() < 0.01 * np.abs(b).max()


def test_cells_that_wake_in_tension_swing_on():
    """They have 0.2 % less energy than shapes: velocities had got it, and erred by 2 %."""
    rubber = rf.MooneyRivlin(c10=2.5e8, c01=5e7, kappa=1.7e9, rho=2000.0)
    loads = [rf.Traction("x1", (6e6, 0, 0), time=rising(0, 0.1))]
    loads += [rf.Traction("x1", (0, 0, 1e4), time=rising(0, 0.05))]
    effects = [rf.Fixed("x0"), *loads]
    domain, probes = rf.box((0, 0, 0), (1.0, 0.05, 0.02), (8, 1, 1)), {"tip": (1.0, 0, 0)}
    scene = rf.Scene(domain, rubber, effects, element="enhanced", probes=probes)
    asked, paths, events = {"accuracy": rf.Accuracy(0.01, "tip", min_cells=2)}, [], []
    for dt, how in ((5e-3, asked), (5e-4, {})):
        reports = list(rf.simulate(scene, dt, 0.065, progress=False, **how))
        paths.append(
            [np.array([r.t for r in reports]), np.array([r.probes["tip"] for r in reports])]
        )
        events += [event.kind for report in reports for event in report.events]
    assert events == ["freeze", "release"]
    assert off(*paths[0], paths[1]) < 0.01
