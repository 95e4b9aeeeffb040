"""A tangent that is kept and turned along: the rules, and the same motions as by Newton's method.

Run as a script under mpirun, this file reports histories of motions with tangents that are kept.
"""

from __future__ import annotations

import numpy as np
import parallel
import pytest
from histories import EPS, column, drift, show
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.newton import aggregates, chord, factors
from rigidfx.step.newton.chord_test import ChordTest
from rigidfx.step.newton.frames import Frames
from rigidfx.step.newton.kept_tangent import KeptTangent
from rigidfx.step.newton.pause import LENGTH, MAX_FAILURES, Pause
from rigidfx.step.newton.refresh import Refresh
from rigidfx.step.newton.secants import Secants
from rigidfx.step.newton.stopping_test import MAX_ITERATIONS, ROUNDING

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
DT = 1.2e-4  # s; some 25 to a period of the bar's first bending motion
SPIN = rf.InitialVelocity(angular=(100.0, 400.0, 50.0))  # 0.05 rad per step
NEWTON = {"snes_lag_jacobian": 1}  # who says how tangents are used, is obeyed


# Rules -----------------------------------------------------------------------------------------


def test_first_step_needs_a_tangent():
    rule = Refresh(cost=10)
    rule.begin()
    assert rule.wanted([1.0], 1e-12)
    rule.renewed([1.0])
    assert not rule.wanted([1.0, 0.9], 1e-12)  # one iteration tells nothing


@pytest.mark.parametrize(
    ("history", "wanted"),
    [
        ([1e6, 1e4, 1e2], False),  # 12 decades at 2 each: less than a tangent and three more
        ([1e6, 1e6, 3e5], True),  # at half a decade, more
        ([1e6, 1e4, 6e3], True),  # it hardly falls
        ([1e6, 1e4, 2e4], True),
        ([1e6, 1e-5, 9e-6], False),  # nothing is left that would tell
    ],
)
def test_a_tangent_is_renewed_in_a_step_where_it_does_not_fit(history, wanted):
    rule = Refresh(cost=8)
    rule.renewed([1.0])
    rule.accepted(4)
    rule.begin()
    assert rule.wanted(history, target=1e-4) == wanted


def test_a_tangent_is_renewed_where_further_steps_would_raise_the_average():
    rule = Refresh(cost=10)
    rule.renewed([1.0])
    due = []
    for iterations in (4, 4, 5, 6, 7, 8):
        rule.begin()
        rule.accepted(iterations)
        due.append(rule.due)
    # (10 + 4 + 4 + 5 + 6 + 7)/5 is 7.2; a sixth step of 8 raises it.
    assert due == [False] * 5 + [True]


def level(rounding=1e-6, **options):
    stop = ChordTest(**options)
    stop.expect_rounding(rounding / (ROUNDING * EPS))
    return stop


def end(norms, stop, renewed=()):
    """Iterate at which a sequence of norms ends; -1 if it does not."""
    stop.restart()
    for k, norm in enumerate(norms):
        if stop(k, norm):
            return k
        if k in renewed:
            stop.renewed()
    return -1


def test_linear_convergence_goes_on_below_rounding():
    """What is left falls by a tenth each time, though it does not show."""
    falling = [1e2, 1e1, 1e0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5]
    assert end([*falling, 1e-6, 5e-7, 5e-7, 5e-7, 5e-7], level()) == 10
    assert end([*falling, 1e-6, 1e-7, 1e-8, 1e-9], level(1e-7)) == -1  # it still falls


def test_rounding_is_no_more_than_a_hundred_times_the_least_that_has_been_met():
    """Where it is estimated for what is stiff and does not move, say."""
    stop, slower = level(1e-5), [1e2, 1e-3, 5e-6, 1e-8, 1e-10, 1e-10]
    assert end(slower, level(1e-5)) == 2
    assert end([1e2, 1e-3, 1e-8, 1e-8], stop) == 3
    # From then on what is left is seen to fall more slowly than at first.
    assert end(slower, stop) == 5


def test_slow_convergence_is_no_stall_unless_the_tangent_is_new():
    slow = [1e2, 1e-4, 1e-5, 9e-6]
    assert end(slow, level()) == -1
    stop = level()
    assert end(slow, stop, renewed=[2]) == 3
    # Where rounding has been met is remembered: the next step needs no new tangent for that.
    assert stop.target == pytest.approx(9e-6)
    assert end([1e2, 1e0, 1e-2, 1e-4, 9e-6, 9e-6], stop) == 5


def test_what_does_not_end_at_rounding_asks_for_a_tangent():
    """A tangent that has contracted next to nothing once would never be done; a new one is."""
    stop = level()
    slowly = [1e2, 9.9e1, 9.8e1]
    assert end(slowly, stop) == -1
    assert end([1e2, *[5e-7] * 4], stop) == -1
    assert not stop.stuck
    assert end([1e2, *[5e-7] * 5], stop) == -1
    assert stop.stuck
    assert end([1e2, *[5e-7] * 9], stop, renewed=[5]) > 0


def test_a_first_guess_may_be_nearer_than_the_first_iterate():
    stop = level()
    assert end([1e0, 1e1, 1e-3, 1e-7, 1e-8, 9e-9], stop) > 0


def test_reduction_ends_a_step_well_below_that_of_newton():
    assert end([1e7, 1e1, 1e-5, 1e-6], level(0.0)) == 3
    assert end([1.0] * 50, level(0.0)) == MAX_ITERATIONS


def test_what_fails_pauses_and_is_tried_again():
    """Not for good, as a contact that opens and closes goes by; once is enough the next time."""
    pause = Pause()
    for failures in (MAX_FAILURES, 1):
        for _ in range(failures):
            assert not pause.failed
            pause.failure()
        for _ in range(LENGTH):
            assert pause.failed
            pause.passed()
    pause.kept(0.3)
    pause.failure()
    assert not pause.failed
    assert pause.over


# Secants ---------------------------------------------------------------------------------------


def linear_system(size=40, unknown_to_it=3):
    """A matrix, and a kept one that lacks a stiffness of low rank."""
    random = np.random.default_rng(1)
    kept = np.diag(random.uniform(1.0, 100.0, size))
    stiff = random.normal(size=(size, unknown_to_it))
    return kept, kept + 0.5 * stiff @ stiff.T


def corrections(secants, kept, true, right):
    """Errors of the iterates of one step, relative."""
    secants.begin()
    exact, y = np.linalg.solve(true, right), np.zeros(len(right))
    errors = []
    for _ in range(12):
        z = np.linalg.solve(kept, right - true @ y)
        secants.mend(z, learning=True)
        y += z
        errors.append(np.linalg.norm(y - exact) / np.linalg.norm(exact))
    return errors


def test_secants_tell_what_a_kept_tangent_lacks():
    """Three pairs of one step tell three directions to the next, until there is a new tangent."""
    kept, true = linear_system()
    secants = Secants(MPI.COMM_SELF, len(kept))
    first, second = (corrections(secants, kept, true, b) for b in np.eye(len(kept))[:2])
    assert first[2] > 1e-2
    assert second[2] < 1e-12
    assert secants.known == 6
    z = np.full(len(kept), 1e200)
    for _ in range(2):  # what overflows mends nothing, and what is rounding teaches nothing
        secants.mend(z, learning=False)
    assert secants.known == 6
    secants.mend(z, learning=True)
    assert np.isfinite(z).all()
    secants.forget()
    assert corrections(secants, kept, true, np.eye(len(kept))[1])[2] > 1e-3


def test_small_strains_wear_no_tangent_out():
    """Where all iterates but the first are rounding, one of these would be taken for a secant."""
    sheet = rf.box((0, 0, 0), (1, 1, 0.02), (8, 8, 1), cell="hexahedron")
    push = rf.Traction("x1", (0, 0, 1.0), until=0.03)
    effects = [rf.Fixed("x0"), push]
    scene = rf.Scene(sheet, STEEL, effects, element="enhanced")
    reports = list(rf.simulate(scene, 3e-3, 0.18, progress=False))
    assert sum(report.tangents for report in reports) <= 6
    assert all("kept" in report.solver for report in reports[1:])


# Frames ----------------------------------------------------------------------------------------


def _frames(scene, held=None):
    mask = np.zeros(3 * scene.owned_nodes, dtype=bool)
    if held is not None:
        mask[held] = True
    owned = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    layout = dof_layout(scene, {0: owned}, Bodies.of_each([]).of, mask)
    return layout, Prolongation(layout, scene.comm)


def _turned(layout, R):
    X = layout.rows.X
    return (X @ R.T + [3.0, -2.0, 5.0] - X).reshape(-1)


@pytest.mark.parametrize("angle", [0.0, 0.3, 3.1])
def test_a_rotation_is_found_whatever_is_strained_and_moved(angle):
    scene = rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 2, 1)), STEEL)
    layout, prolongation = _frames(scene)
    frames = Frames(prolongation, scene.parts)
    R = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8])).as_matrix()
    assert frames.rotations(_turned(layout, R))[0] == pytest.approx(R, abs=1e-14)
    stretched = R @ np.diag([1.3, 0.9, 1.1])
    assert frames.rotations(_turned(layout, stretched))[0] == pytest.approx(R, abs=1e-14)


def test_unknowns_turn_as_vectors_and_single_components_do_not():
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), STEEL)
    Q = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()[None]
    for held in (None, [4, 9]):
        _, prolongation = _frames(scene, held)
        y = np.random.default_rng(1).standard_normal(prolongation.size)
        turned = y.copy()
        Frames(prolongation, scene.parts).turn(turned, Q)
        if held is None:
            assert turned == pytest.approx((y.reshape(-1, 3) @ Q[0].T).reshape(-1), abs=1e-15)
            continue
        assert turned[:3] == pytest.approx(Q[0] @ y[:3], abs=1e-15)
        assert np.array_equal(turned[3:5], y[3:5])  # of node 1, whose second component is held
        assert turned[5:8] == pytest.approx(Q[0] @ y[5:8], abs=1e-15)
        assert np.array_equal(turned[8:10], y[8:10])


def test_what_has_no_direction_is_not_turned():
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), STEEL)
    held = np.arange(24)[np.r_[3:24]]  # all but one node
    layout, prolongation = _frames(scene, held)
    frames = Frames(prolongation, scene.parts)
    collapsed = -layout.rows.X.copy()  # all nodes on a line
    collapsed[:, 0] = 0.0
    assert np.array_equal(frames.rotations(collapsed.reshape(-1))[0], np.eye(3))


# Motions ---------------------------------------------------------------------------------------


def _bar(*effects, **options):
    bar = rf.box((0, 0, 0), (1, 0.2, 0.2), (8, 2, 2))
    for name, low, high in (("end", 0.8, 1.1), ("middle", 0.3, 0.6)):
        bar = bar.with_cells(name, lambda x, a=low, b=high: (a < x[0]) & (x[0] < b))
    return rf.Scene(bar, STEEL, effects, probes={"tip": (1, 0.1, 0.1)}, **options)


def _shaken(t):
    return (0.0, 0.0, 1e-3 * np.sin(2e3 * t))


PUSH = rf.Traction("x1", (0.0, 0.0, 2e7), until=6 * DT)
MOTIONS = {
    "clamped": lambda: _bar(rf.Fixed("x0"), PUSH),
    "turning": lambda: _bar(SPIN, PUSH),
    "consistent": lambda: _bar(SPIN, PUSH, mass="consistent"),
    "held in part": lambda: _bar(rf.Fixed("x0", components="x"), PUSH),
    "springs": lambda: _bar(rf.Spring("x0", stiffness=1e7), rf.NumericalDamping(0.02), PUSH, SPIN),
    "pressure": lambda: _bar(rf.Pressure("z0", 1e7, until=10 * DT), SPIN),
    "moved": lambda: _bar(rf.PrescribedMotion("x0", displacement=_shaken)),
    "rigid end": lambda: _bar(rf.Rigid("end"), SPIN, rf.Traction("x0", (0, 0, 2e7), until=6 * DT)),
    "rigid middle": lambda: _bar(rf.Rigid("middle"), SPIN, PUSH, mass="consistent"),
}
STEPS = 30


def follow(name, options, dt=DT):
    return list(rf.simulate(MOTIONS[name](), dt, STEPS * DT, petsc_options=options))


def keep(patch):
    """Have tangents kept however small a scene is."""
    patch.setattr(chord, "SMALLEST", 0)
    patch.setattr(chord, "SMALLEST_OF_RANKS", 0)
    patch.setattr(chord, "STIFF_FROM", 0.0)


def by_two_levels(patch):
    """Have incomplete factors and a coarse grid solve with them, too."""
    keep(patch)
    patch.setattr(chord, "FACTORS_UP_TO", 0)
    patch.setattr(chord, "SLENDER_UP_TO", 0)
    patch.setattr(aggregates, "NODES", 8)


@pytest.fixture
def _keeping(monkeypatch):
    keep(monkeypatch)


@pytest.mark.usefixtures("_keeping")
@pytest.mark.parametrize("name", MOTIONS)
def test_the_motion_is_that_of_newtons_method(name):
    kept, newton = follow(name, {}), follow(name, NEWTON)
    assert newton[-1].tangents == newton[-1].iterations
    assert all(r.solver.startswith("kept") for r in kept[1:])
    tangents = sum(r.tangents for r in kept)
    tips = [np.array([r.probes["tip"] for r in run]) for run in (kept, newton)]
    apart = np.abs(tips[0] - tips[1]).max() / np.abs(tips[1]).max()
    H = [column(run, "energy")[12:] for run in (kept, newton)]
    J = [column(run, "angular_momentum")[12:] for run in (kept, newton)]
    show(tangents=tangents, apart=apart, H=drift(H[0]), J=drift(J[0]))
    assert tangents <= STEPS / 2
    assert apart <= 1e-11
    for mine, other in ((H[0], H[1]), (J[0], J[1])):
        assert drift(mine) <= 2 * drift(other) + 2e-14


@pytest.mark.usefixtures("_keeping")
def test_a_change_of_the_time_step_is_followed(monkeypatch):
    """Where tangents are dear; those of so small a bar are renewed every few steps anyhow."""
    monkeypatch.setattr(factors, "prices", lambda *_: (10.0, 15.0))
    changed = {0.0: DT, 8 * DT: 1.05 * DT, (8 + 8 * 1.05) * DT: 2 * DT}
    kept, newton = (follow("clamped", options, changed) for options in ({}, NEWTON))
    assert column(kept, "t") == pytest.approx(column(newton, "t"), rel=1e-12)
    assert kept[-1].probes["tip"] == pytest.approx(newton[-1].probes["tip"], rel=1e-10)
    by_dt = [[r.tangents for r in kept[1:] if r.dt == pytest.approx(f * DT)] for f in (1, 1.05, 2)]
    assert by_dt[1][0] == 0  # near enough
    assert by_dt[2][0] >= 1


@pytest.mark.usefixtures("_keeping")
def test_what_fails_is_left_to_newtons_method(monkeypatch):
    """No step is cut that Newton's method can take."""

    def useless(self, pc, r, z):
        r.copy(z)

    monkeypatch.setattr(KeptTangent, "apply", useless)
    reports = follow("turning", {})
    assert not any(r.solver.startswith("kept") for r in reports)
    assert max(r.cuts for r in reports) == 0
    newton = follow("turning", NEWTON)
    assert reports[-1].probes["tip"] == pytest.approx(newton[-1].probes["tip"], rel=1e-10)


@pytest.mark.parametrize("options", [{"ksp_type": "preonly", "pc_type": "lu"}, NEWTON])
@pytest.mark.usefixtures("_keeping")
def test_who_chooses_a_solver_is_obeyed(options):
    reports = follow("clamped", options)
    assert all(r.tangents == r.iterations for r in reports)


def test_a_needle_in_long_steps_keeps_no_tangent():
    """By kept factors it turned about its axis: 8e-4 of its energy were lost in 500 steps."""
    needle = rf.Scene(
        rf.box((0, 0, 0), (1, 1e-3, 1e-3), (12, 1, 1)),
        STEEL,
        [rf.InitialVelocity(angular=(5.0, 0.5, 1.0))],
        order=2,
    )
    reports = list(rf.simulate(needle, 0.02, 1.0))
    assert reports[-1].unknowns > chord.SMALLEST
    H, J = (column(reports, name) for name in ("energy", "angular_momentum"))
    show(H=drift(H), J=drift(J))
    assert max(drift(H), drift(J)) <= 1e-11


def test_small_systems_do_not_keep_tangents():
    """They would not gain by it: 96 unknowns."""
    bar = rf.box((0, 0, 0), (1, 0.1, 0.1), (8, 1, 1))
    scene = rf.Scene(bar, STEEL, [rf.Fixed("x0"), PUSH])
    reports = list(rf.simulate(scene, DT, 4 * DT))
    assert all(r.tangents == r.iterations for r in reports)


def test_systems_of_two_hundred_unknowns_keep_tangents_however_stiff():
    """Where the fastest wave passes 11 cells in Δt, and where it passes 110."""
    for dt in (DT, 10 * DT):
        *_, last = rf.simulate(MOTIONS["clamped"](), dt, 4 * dt)
        assert last.solver.startswith("kept")


def test_what_a_tangent_costs_is_told_by_its_factors(monkeypatch):
    """A block's fill more than a bar's of as many unknowns: 15 and 8 iterations were measured."""
    told, prices = [], factors.prices
    monkeypatch.setattr(factors, "prices", lambda *of: told.append(prices(*of)) or told[-1])
    for sides in ((60, 2, 2), (8, 7, 7)):
        box = rf.box((0, 0, 0), tuple(0.05 * n for n in sides), sides)
        scene = rf.Scene(box, STEEL, [rf.Fixed("x0"), PUSH])
        *_, last = rf.simulate(scene, 2e-3, 4e-3)
        assert last.solver.startswith("kept")
    (bar, bar_worth), (block, block_worth) = told[0], told[-1]
    assert 5 < bar < 12 < block < 22
    assert min(bar_worth, block_worth) > 12


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_several_ranks_move_as_one(ranks):
    one, several = histories(), parallel.run(__file__, ranks, 300)
    for name, found in several.items():
        assert np.abs(np.array(found) - one[name]).max() <= 1e-11 * np.abs(one[name]).max()


def histories():
    out = {}
    with pytest.MonkeyPatch.context() as patch:
        keep(patch)
        for name in ("turning", "rigid middle", "held in part"):
            out[name] = _history(name)
        by_two_levels(patch)
        for name in ("rigid middle", "held in part"):
            out[f"{name}, two levels"] = _history(name)
    return out


def _history(name):
    reports = follow(name, {})
    assert sum(r.tangents for r in reports) <= STEPS / 2
    return [[r.kinetic, r.strain, *r.angular_momentum] for r in reports]


if __name__ == "__main__":
    found = histories()
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(found)
