"""Springs, dampers and cables between two points.

Run as a script under mpirun, this file reports a history of two boxes with a spring and a cable.
"""

import warnings
from dataclasses import replace

import numpy as np
import parallel
import pytest
from common import boxes
from histories import heard, imbalance
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, eigh
from test_beside_twin import Beside

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(rho=1000.0, E=1e6, nu=0.3)
NO_WARNINGS = pytest.mark.filterwarnings("ignore:Body")  # of few cells, whose lumped mass shows
G = 9.81  # m/s²
SIDE = 0.2  # m
MASS = 1000 * SIDE**3  # kg of each box
A, B = np.array([0.1, 0.1, 0.1]), np.array([1.1, 0.1, 0.1])  # centres [m]


def near(*points):
    """Marker of vertices at some points."""
    return lambda x: (np.abs(x.T[:, None] - np.array(points)) < 1e-9).all(axis=-1).any(axis=-1)


def two(*effects, **options):
    """Two boxes a metre apart, with sets at their ends."""
    first, second = ((0, 0, 0), (SIDE,) * 3), ((1, 0, 0), (1 + SIDE, SIDE, SIDE))
    domain = boxes((*first, (2, 2, 2)), (*second, (2, 2, 2)))
    domain = domain.with_cells("A", lambda x: x[0] < 0.5).with_cells("B", lambda x: x[0] > 0.5)
    domain = domain.with_facets("a", lambda x: np.isclose(x[0], SIDE))
    domain = domain.with_facets("b", lambda x: np.isclose(x[0], 1.0))
    domain = domain.with_vertices("corner", near((SIDE, SIDE, SIDE)))
    domain = domain.with_vertices("corners", near((1, 0, 0), (1 + SIDE, SIDE, 0)))
    return rf.Scene(domain, SOFT, effects, probes={"a": A, "b": B}, **options)


BOTH = rf.Rigid("A"), rf.Rigid("B")
APART = rf.InitialVelocity(
    function=lambda x: np.where(x[:1] > 0.5, np.array([[1.0], [0.0], [0.0]]), 0.0)
)
TUMBLE = rf.InitialVelocity(
    function=lambda x: (
        np.cross((0.7, 0.4, 1.5), x.T - 0.1).T
        + np.where(x[:1] > 0.5, np.array([[1.5], [-0.5], [0.5]]), 0.0)
    )
)
ENDS = {
    "nodes": (("corner", "corners"), {}),
    "mean faces": ((rf.MeanFace("a"), rf.MeanFace("b")), {"at_b": (1.0, 0.05, 0.15)}),
    "rigid faces": ((rf.RigidFace("a"), rf.RigidFace("b")), {"at_a": (0.3, 0.1, 0.1)}),
    "ground": (("ground", "corners"), {"at_a": (0.5, 0.5, 0.2)}),
}


def balances(scene, dt, t_end, **options):
    """Reports; changes of energy and of both momenta, relative; energy that dampers have taken."""
    reports = list(rf.simulate(scene, dt, t_end, **options))
    first = reports[0]
    taken = np.cumsum([sum(r.dissipated.values()) for r in reports])
    size = max(r.momentum_scale for r in reports)
    names = "linear_momentum", "angular_momentum"
    off = [
        max(np.abs(getattr(r, name) - getattr(first, name)).max() for r in reports) / size
        for name in names
    ]
    return reports, imbalance(reports), *off, taken


@NO_WARNINGS
def test_two_masses_swing_at_their_frequency():
    """√(2 k/m), in modes and in steps; the report has force, length and rate."""
    k = 500.0
    scene = two(*BOTH, APART, rf.SpringDamper("A", "B", k, name="s"))
    exact = np.sqrt(2 * k / MASS)
    assert rf.modes(scene, 1).squares[0] == pytest.approx(exact**2, rel=1e-9)
    reports, *off, _ = balances(scene, 2e-3, 0.4)
    assert max(off) <= 1e-13
    t = np.array([r.t for r in reports])
    moved = np.array([r.probes["b"][0] - r.probes["a"][0] for r in reports])
    assert moved == pytest.approx(np.sin(exact * t) / exact, abs=5e-4 / exact)
    assert reports[-1].springs == pytest.approx(0.5 * k * moved[-1] ** 2, rel=1e-9)
    told = [r.spring_dampers["s"] for r in reports[1:]]
    assert [own.length for own in told] == pytest.approx(1.0 + moved[1:], abs=1e-12)
    middle = 0.5 * (moved[1:] + moved[:-1])
    assert [own.force for own in told] == pytest.approx(k * middle, abs=1e-9 * k)
    assert [own.rate for own in told] == pytest.approx(np.diff(moved) / 2e-3, abs=1e-9)
    with pytest.raises(KeyError, match="has 's' from the first step on"):
        reports[0].spring_dampers["s"]


@NO_WARNINGS
@pytest.mark.parametrize("ends", ENDS)
def test_energy_and_momenta_are_kept(ends):
    """While cells become rigid and flexible, too, and a cable goes slack."""
    sides, places = ENDS[ends]
    springs = (
        rf.SpringDamper(*sides, 300.0, damping=4.0, length=1.2, **places, name="s"),
        rf.SpringDamper(*sides, 900.0, length=0.97, pulls_only=True, **places, name="c"),
    )
    criterion = rf.StrainRate(1e9, 0.1, patience=1, wake="none", release=rf.Release(at=(0.3,)))
    reports, H, L, J, taken = balances(two(TUMBLE, *springs), 0.01, 0.5, rigidify=criterion)
    assert [e.kind for r in reports for e in r.events] == ["freeze", "release", "freeze"]
    assert H <= 1e-12
    assert taken[-1] > 1e-3
    assert np.diff(taken).min() >= 0
    if ends != "ground":
        assert max(L, J) <= 1e-13
    pulls = np.array([r.spring_dampers["c"].force for r in reports[1:]])
    assert pulls.min() == 0.0
    assert pulls.max() > 1.0


@NO_WARNINGS
@pytest.mark.filterwarnings("ignore:c went taut")  # with a damper's force that falls at once
@pytest.mark.parametrize("damping", [0.0, 3000.0])
def test_a_cable_pulls_only(damping):
    """A box that is thrown up falls into its cable, which it meets at a known speed."""
    speed, k = 2.0, 2e4
    thrown = rf.InitialVelocity(linear=(0, 0, speed), where="B")
    cable = rf.SpringDamper(
        *("ground", "B", k), damping=damping, pulls_only=True, at_a=(1.1, 0.1, 0.6), name="c"
    )
    scene = two(rf.Rigid("B"), rf.Fixed("A"), thrown, cable, rf.Gravity((0, 0, -G)))
    reports = list(rf.simulate(scene, 2e-3, 0.6))
    t = np.array([r.t for r in reports])
    told = [r.spring_dampers["c"] for r in reports[1:]]
    slack = t[1:] < 2 * speed / G
    assert max(own.force for own, at in zip(told, slack, strict=True) if at) == 0.0
    assert min(own.force for own in told) >= 0.0

    def rates(_, y):
        longer = abs(y[0] - 0.5) - 0.5
        pull = max(k * longer - damping * y[1], 0.0) if longer > 0 else 0.0
        return y[1], pull / MASS - G

    exact = solve_ivp(rates, (0, 0.6), (0.0, speed), t_eval=t, rtol=1e-9, max_step=1e-3).y[0]
    assert [r.probes["b"][2] for r in reports] == pytest.approx(exact, abs=2e-3)
    assert imbalance(reports) <= 1e-12


def caught(dt, t_end=0.1, slack=0.005, damping=0.0):
    """Largest tension of a cable that catches a box thrown at 2 m/s, and warnings."""
    cable = rf.SpringDamper(
        *("ground", "B", 5e4), at_a=B - (1, 0, 0), length=1 + slack, pulls_only=True, name="c"
    )
    cable = replace(cable, damping=damping)
    thrown = rf.InitialVelocity(linear=(2.0, 0, 0), where="B")
    scene = two(rf.Rigid("B"), rf.Fixed("A"), thrown, cable)
    with heard("taut") as found:
        reports = list(rf.simulate(scene, dt, t_end, progress=False))
    forces = [report.spring_dampers["c"].force for report in reports[1:]]
    return max(forces), found


@NO_WARNINGS
@pytest.mark.parametrize(("t_end", "slack"), [(0.1, 0.005), (0.04, 0.005), (0.1, 0.0)])
def test_a_cable_that_steps_do_not_resolve_is_told(t_end, slack):
    """Half a period is π √(m/k) = 40 ms; the run may end before it is over."""
    exact = 2 * np.sqrt(5e4 * MASS)
    peak, (message,) = caught(0.02, t_end, slack)
    assert peak < 0.9 * exact
    assert "c went taut at t = 0 s" in message
    assert "With Δt ≤ 0.0039 s" in message
    peak, told = caught(0.0039, slack=slack)
    assert peak == pytest.approx(exact, rel=0.03)
    assert told == []


@NO_WARNINGS
def test_a_cable_that_is_tense_at_the_start_has_no_blow():
    assert caught(0.02, slack=-0.2)[1] == []


FEET = [(1.1 + 0.7 * np.cos(a), 0.7 * np.sin(a), z) for a in range(4) for z in (-0.5, 0.9)]
HEADS = [(1 + SIDE * i, SIDE * j, SIDE * k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]


@NO_WARNINGS
def test_a_truss_has_its_stiffness_and_its_modes():
    """Eight bars under prestress hold a box, in statics and in modes."""
    k, stretch = 1e5, 1.002

    def bar(foot, head, n):
        length = np.linalg.norm(np.subtract(head, foot)) / stretch
        return rf.SpringDamper(
            *("ground", "B", k), length=length, at_a=foot, at_b=head, name=f"bar {n}"
        )

    bars = [bar(foot, head, n) for n, (foot, head) in enumerate(zip(FEET, HEADS, strict=True))]
    scene = two(rf.Fixed("A"), rf.Rigid("B"), rf.Gravity((0, 30.0, -G)), *bars)
    *_, rest = rf.static(scene, 1)
    found = rf.modes(scene, 6, about=rest)
    (body,) = rest.bodies
    centre, turned, inertia = body.centre, body.orientation, next(iter(rest.rigid)).data.inertia
    stiffness, force = np.zeros((6, 6)), np.zeros(6)
    for spring, foot, head in zip(bars, FEET, HEADS, strict=True):
        arm = turned @ (np.array(head) - B)
        r = centre + arm - foot
        L, n = np.linalg.norm(r), r / np.linalg.norm(r)
        N = k * (L - spring.length)
        row = np.r_[n, np.cross(arm, n)]
        hat = np.cross(np.eye(3), arm)
        moves = np.hstack([np.eye(3), hat.T])
        stiffness += k * np.outer(row, row) + N / L * moves.T @ (np.eye(3) - np.outer(n, n)) @ moves
        bend = np.outer(arm, n)
        stiffness[3:, 3:] += N * (0.5 * (bend + bend.T) - arm @ n * np.eye(3))
        force += N * row
    assert force == pytest.approx(MASS * np.array([0, 30.0, -G, 0, 0, 0]), abs=1e-7)
    assert rest.spring_dampers["bar 0"].force == pytest.approx(
        k * (rest.spring_dampers["bar 0"].length - bars[0].length), rel=1e-9
    )
    masses = block_diag(MASS * np.eye(3), turned @ inertia @ turned.T)
    assert found.squares == pytest.approx(eigh(stiffness, masses)[0], rel=1e-6)


def bridge(*effects, **options):
    """Two soft bars beside each other, held at one end, that rods across connect."""
    first, second = ((0, 0, 0), (4, 1, 1)), ((0, 2, 0), (4, 3, 1))
    domain = boxes((*first, (8, 1, 1)), (*second, (8, 1, 1)))
    domain = domain.with_facets("root", lambda x: np.isclose(x[0], 0))
    domain = domain.with_facets("tip", lambda x: np.isclose(x[0], 4) & (x[1] < 1.5))
    domain = domain.with_vertices("low", near((4, 1, 1))).with_vertices("high", near((4, 2, 1)))
    domain = domain.with_vertices("mid", near((2, 1, 0)))
    rods = [
        rf.SpringDamper("low", "high", 2e4, damping=50.0, name="rod"),
        rf.SpringDamper("mid", "high", 3e4, name="diagonal"),
        rf.SpringDamper("ground", "high", 1e4, at_a=(6, 5, 0), name="stay"),
    ]
    push = rf.Traction("tip", (0, 100.0, 100.0), time=lambda t: np.sin(2 * np.pi * t))
    every = rf.Fixed("root"), rf.MassDamping(0.5), push, *rods, *effects
    return rf.Scene(domain, SOFT, every, probes={"tip": (4, 2.5, 0.5)}, **options)


def test_bodies_bend_by_the_springs_between_them():
    """To a hundredth of what tolerances of a tenth of the rates allow."""
    run = Beside(bridge, 1.5, 0.1, 0.02)
    assert run.reduced > 0.2
    assert run.off <= 2.4e-3


@NO_WARNINGS
def test_a_string_swings_by_its_tension():
    """Across its springs a mass has the stiffness 2 N/L alone; in second order, by single nodes."""
    k, tension, half = 1e4, 30.0, 0.5
    length = half - tension / k
    domain = rf.box((-0.1,) * 3, (0.1,) * 3, (2, 2, 2)).with_cells("mass", lambda x: x[0] > -1)
    domain = domain.with_vertices("middle", near((0, 0, 0)))
    springs = [
        rf.SpringDamper("ground", "middle", k, length=length, at_a=(x, 0, 0)) for x in (-half, half)
    ]
    springs = [replace(own, name=f"{n}") for n, own in enumerate(springs)]
    found = rf.modes(rf.Scene(domain, SOFT, [rf.Rigid("mass"), *springs], order=2), 3)
    assert found.squares[0] == pytest.approx(2 * tension / half / MASS, rel=1e-9)
    assert found.squares[1] == pytest.approx(found.squares[0], rel=1e-9)
    assert found.squares[2] == pytest.approx(2 * k / MASS, rel=1e-9)


def test_history_and_description_have_the_springs(tmp_path, capsys):
    """Columns of force, length and rate."""
    scene = two(*BOTH, APART, rf.SpringDamper("A", "B", 500.0, damping=3.0, name="s"))
    scene.describe()
    line = "SpringDamper     'A' - 'B'   name s, stiffness 500, damping 3"
    assert line in capsys.readouterr().out
    with rf.Recorder(scene, tmp_path / "run") as recorder:
        for report in rf.simulate(scene, 0.01, 0.1):
            recorder.write(report)
    columns = rf.read_history(recorder.history)
    told = report.spring_dampers["s"]
    for name in ("force", "length", "rate"):
        assert columns[f"spring_s_{name}"][-1] == getattr(told, name)
        assert np.isnan(columns[f"spring_s_{name}"][0])


def history():
    """Two boxes, of which one is rigid, with a spring between nodes and a cable between faces."""
    springs = (
        rf.SpringDamper("corner", "corners", 300.0, damping=4.0, length=0.8, name="s"),
        rf.SpringDamper(rf.RigidFace("a"), "B", 900.0, at_b=(1.3, 0, 0), pulls_only=True, name="c"),
    )
    rows = []
    for r in rf.simulate(two(rf.Rigid("B"), TUMBLE, *springs), 0.01, 0.3):
        told = [(own.force, own.length) for own in r.spring_dampers.values()]
        named = np.ravel(told or np.zeros((2, 2)))
        rows.append([r.energy, r.springs, *named, *r.probes["a"], *r.angular_momentum])
    return rows


@NO_WARNINGS
@pytest.mark.parallel
def test_ranks_find_the_same():
    """Both ends may be on different ranks."""
    parallel.check_the_same(__file__, 3, history())


@pytest.mark.parametrize("slack", [0.0, 0.005])
def test_a_box_hangs_on_four_cables_without_joints(slack):
    """Statics find its place from taut and slack cables, by the springs' own elasticity."""
    box = rf.box((0, 0, 0), (0.1, 0.1, 0.1), (1, 1, 1)).with_cells("box", lambda x: x[0] > -1)
    metal, k, long = rf.StVenantKirchhoff(rho=2000.0, E=1e9, nu=0.3), 2000.0, 1.0
    corners = [(x, y) for x in (0, 0.1) for y in (0, 0.1)]
    cables = [
        rf.SpringDamper(
            "ground", "box", k, length=long + slack, pulls_only=True, name=f"cable {n}",
            at_a=(*at, 0.1 + long), at_b=(*at, 0.1),
        )
        for n, at in enumerate(corners)
    ]  # fmt: skip
    effects = [rf.Rigid("box"), *cables, rf.Gravity((0, 0, -9.81))]
    *_, hung = rf.static(rf.Scene(box, metal, effects, probes={"mid": (0, 0, 0)}), 1, verbose=False)
    exact = -(slack + 2.0 * 9.81 / (4 * k))
    assert hung.probes["mid"] == pytest.approx((0, 0, exact), abs=1e-9)


def test_a_spring_of_a_held_face_has_its_force():
    """No unknown is left for it."""
    bar = rf.box((0, 0, 0), (1, 0.1, 0.1), (2, 1, 1))
    spring = rf.SpringDamper("ground", rf.MeanFace("x0"), 1e3, at_a=(-1, 0.05, 0.05), length=0.5)
    metal = rf.StVenantKirchhoff(rho=2000.0, E=1e9, nu=0.3)
    for run in (
        lambda scene: rf.static(scene, 1, verbose=False),
        lambda scene: rf.simulate(scene, 1e-3, 1e-3),
    ):
        *_, last = run(rf.Scene(bar, metal, [rf.Fixed("x0"), spring]))
        (found,) = last.spring_dampers.values()
        assert found.force == pytest.approx(500.0)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    parallel.report(history())
