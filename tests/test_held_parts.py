"""Parts named rigid that supports hold: what they take from the compliance is told, once.

Run as a script under mpirun, this file reports what a run warns of.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
import parallel
import pytest
from mpi4py import MPI
from test_contact_pairs import boxes

import rigidfx as rf
import rigidfx.shadow.recovery
from rigidfx.decide.memory.compliance import Compliance
from rigidfx.flexible.stress import CauchyStress
from rigidfx.shadow.linear_part import LinearPart
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.shadow import Shadow

COMM = MPI.COMM_WORLD
DT, T = 0.2, 60.0  # s, and s of the slow load
SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
STIFF = rf.StVenantKirchhoff(E=3e6, nu=0.3, rho=1000.0)
CLAMP = rf.Fixed("x0")
DRAG = rf.MassDamping(2.0)


def slowly(t):
    return np.sin(2 * np.pi * t / T)


def drift(t):
    return 1e-4 * t**2, 0.0, 0.0


WALL = rf.Contact("x0", against=rf.Plane((0, 0, 0), (1, 0, 0)), stiffness=3e5)


def floor(speed=0.0, **friction):
    """A floor below the bar that runs along it [m/s]."""
    below = rf.Plane((0, 0, 0), (0, 0, 1), path=lambda t: (speed * t, 0.0, 0.0))
    return rf.Contact("z0", against=below, stiffness=3e5, **friction)


FLOOR = floor()
PUSH = rf.Traction("x1", (0, 0, 50.0), time=slowly)


def bar(*effects, root=STIFF, cells=(8, 1, 1), **options):
    """A bar of 4 m × 1 m × 1 m; its first half, the root, is what supports hold."""
    box = rf.box((0, 0, 0), (4, 1, 1), cells, options.pop("cell", "hexahedron"))
    box = box.with_cells("root", lambda x: x[0] <= 2 + 1e-9)
    box = box.with_cells("rest", lambda x: x[0] >= 2 - 1e-9)
    probes = {"tip": (4, 0.5, 0.5)}
    return rf.Scene(box, {"root": root, "rest": SOFT}, effects, probes=probes, **options)


def ended(scene, t_end, rule=None, dt=DT):
    """Tips, what was said of the root, and the last report."""
    tips = []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", rf.RigidfxWarning)
        for report in rf.simulate(scene, dt, t_end, rigidify=rule, progress=False):
            tips += [report.probes["tip"]]
    said = [str(w.message) for w in said if "'root' that is named Rigid" in str(w.message)]
    return np.array(tips), said, report


def run(*given):
    """Tips, and what was said of the root."""
    return ended(*given)[:2]


RULE = rf.StrainRate(rf.Relative(0.02), 5 * DT, never=("rest",))
HELD = rf.Rigid("root")


def lacking(said):
    """Part of the compliance that a warning tells of."""
    return float(re.search(r"lacks some ([\d.]+)%", said).group(1)) / 100


@pytest.mark.parametrize(
    ("effects", "options"),
    [
        ((PUSH, CLAMP), {}),
        ((PUSH, CLAMP), {"mass": "consistent"}),
        ((PUSH, CLAMP), {"cell": "tetrahedron"}),
        ((PUSH, CLAMP, rf.Spring("x1", 100.0)), {}),
        ((rf.Gravity((0, 0, -0.1), time=slowly), CLAMP), {}),
        ((rf.Traction("x1", (900.0, 0, 0), time=slowly), CLAMP), {}),
        ((PUSH, rf.PrescribedMotion("x0", displacement=drift)), {}),
        ((rf.Traction("x1", (-900.0, 0, 0), time=slowly), WALL), {}),
    ],
    ids=["push", "consistent", "tetrahedra", "spring", "weight", "axial", "moved", "contact"],
)
def test_what_held_parts_take_and_carry_is_what_the_twin_shows(effects, options):
    """Under slow loads: of the compliance within a fifth, stresses within 5 % in the mean."""
    t_end, scene = T / 4, bar(*effects, DRAG, HELD, **options)
    own, said, last = ended(scene, t_end, RULE)
    flexible = bar(*effects, DRAG, **options)
    twin, silent, last_of_twin = ended(flexible, t_end)
    carried, recovered = rf.recovered_stress(last, CauchyStress(scene))
    exact, none = rf.recovered_stress(last_of_twin, CauchyStress(flexible))
    assert not none.any()
    assert np.array_equal(np.flatnonzero(recovered), scene.owned_cells("root", ""))
    sizes = np.linalg.norm([carried - exact, exact], axis=(2, 3))[:, recovered].sum(axis=1)
    assert sizes[0] < 0.05 * sizes[1]
    moves = any(isinstance(effect, rf.PrescribedMotion) for effect in effects)
    base = drift(t_end if moves else 0.0)
    ways = [np.linalg.norm(tips[-1] - tips[0] - base) for tips in (own, twin)]
    assert silent == []
    assert len(said) == 1
    assert "deflections may be off by as much" in said[0]
    assert lacking(said[0]) == pytest.approx(1 - ways[0] / ways[1], rel=0.2)


def beam(*effects):
    """A weak root of 1 m on 7 m of beam, between two clamps, pulled near the other one."""
    box = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
    box = box.with_cells("root", lambda x: x[0] <= 1 + 1e-9)
    box = box.with_cells("rest", lambda x: x[0] >= 1 - 1e-9)
    box = box.with_cells("load", lambda x: (x[0] >= 6 - 1e-9) & (x[0] <= 6.5 + 1e-9))
    pull = rf.BodyForce((300.0, 0, 0), "load", time=slowly)
    weak, ends = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=1000.0), [CLAMP, rf.Fixed("x1")]
    probes = {"tip": (6, 0.5, 0.5)}
    return rf.Scene(box, {"root": weak, "rest": SOFT}, [*ends, pull, *effects], probes=probes)


def lying(*effects):
    """A bar on a floor, pressed on it at its end."""
    return bar(CLAMP, FLOOR, PRESS, *effects, root=SOFT)


@pytest.mark.parametrize("make", [beam, lying])
def test_what_else_bears_the_loads_is_known(make):
    """Another support, far away, and a floor: by the shadow alone 82 and 11 % were told."""
    own, (said,) = run(make(DRAG, HELD), T / 4, RULE)
    twin, _ = run(make(DRAG), T / 4)
    ways = [np.linalg.norm(tips[-1]) for tips in (own, twin)]
    assert lacking(said) == pytest.approx(1 - ways[0] / ways[1], rel=0.15)


GRAVITY = rf.Gravity((0, 0, -0.5), time=slowly)
VISCOUS = rf.StiffnessDamping(ratio=0.2, frequency=0.5), rf.NumericalDamping(0.35)
PRESS = rf.Traction("x1", (0, 0, -50.0), time=slowly)


@pytest.mark.parametrize(
    ("effects", "name", "off"),
    [
        ((PUSH, CLAMP, rf.Spring("x1", 3000.0)), "root", 0.1),
        ((GRAVITY, CLAMP, rf.Fixed("x1", "z"), rf.Spring("x1", 300.0)), "root", 0.4),
        ((GRAVITY, CLAMP, FLOOR), "root", 1.0),
        ((PRESS, CLAMP, FLOOR), "rest", 0.3),
        ((GRAVITY, PRESS, CLAMP, floor(friction=0.3, creep=1e-3)), "root", 1.0),
        ((GRAVITY, PRESS, CLAMP, floor(0.01, friction=0.3, creep=1e-5)), "root", 1.0),
        ((GRAVITY, CLAMP, rf.Spring("x1", 3000.0), *VISCOUS), "root", 0.1),
        ((rf.Gravity((0, 0, -2.0), time=slowly), CLAMP), "root", 0.1),
        ((rf.Traction("x1", (2e5, 0, 0), time=slowly), CLAMP, rf.Spring("x1", 1e5)), "root", 0.1),
    ],
    ids=[
        *("spring", "second support", "floor", "free on a floor", "friction", "belt"),
        *("viscous", "bent far", "pulled far"),
    ],
)
def test_what_parts_carry_is_that_of_the_whole_structure(monkeypatch, effects, name, off):
    """Within 3 % of the twin's stress in the mean; by the shadow alone it is off by far more."""
    scene, flexible = bar(*effects, DRAG, rf.Rigid(name), root=SOFT), bar(*effects, DRAG, root=SOFT)
    rule = rf.StrainRate(rf.Relative(0.02), 5 * DT, never=("root", "rest"))
    last, last_of_twin = ended(scene, T / 4, rule)[2], ended(flexible, T / 4)[2]
    exact, _ = rf.recovered_stress(last_of_twin, CauchyStress(flexible))

    def error():
        carried, recovered = rf.recovered_stress(last, CauchyStress(scene))
        assert np.array_equal(np.flatnonzero(recovered), scene.owned_cells(name, ""))
        sizes = np.linalg.norm([carried - exact, exact], axis=(2, 3))[:, recovered].sum(axis=1)
        return sizes[0] / sizes[1]

    assert error() < 0.03
    monkeypatch.setattr(rigidfx.shadow.recovery, "small_enough", lambda stepper: False)
    assert error() > off


@pytest.mark.filterwarnings("ignore:StrainRate. forces would:rigidfx.RigidfxWarning")
def test_what_a_part_on_another_surface_carries():
    """A bar that comes to lie on another one, both clamped; they close by what each gives way."""
    gap = 1e-3
    both = ((0, 0, 0), (4, 1, 1), (8, 1, 1)), ((0, 0.1, 1 + gap), (4.2, 0.9, 2 + gap), (8, 1, 1))
    domain = boxes(*both).with_cells("root", lambda x: (x[2] > 1 + gap / 2) & (x[0] < 2.2))
    domain = domain.with_cells("rest", lambda x: (x[2] < 1 + gap / 2) | (x[0] > 2.0))
    for name, z in {"lower": 1.0, "upper": 1 + gap}.items():
        domain = domain.with_facets(name, lambda x, z=z: abs(x[2] - z) < 1e-9)
    for name, at in {"left": 0.0, "end": 4.2}.items():
        domain = domain.with_facets(name, lambda x, at=at: abs(x[0] - at) < 1e-9)
    meets = rf.Contact("upper", against="lower", stiffness=3e5)
    press = rf.Traction("end", (0, 0, -50.0), time=slowly)
    effects = GRAVITY, press, rf.Fixed("left"), meets, DRAG
    scene, flexible = (rf.Scene(domain, SOFT, [*effects, *held]) for held in ([HELD], []))
    (*_, last) = rf.simulate(scene, DT, T / 4, rigidify=RULE, progress=False)
    (*_, twin) = rf.simulate(flexible, DT, T / 4, progress=False)
    assert twin.touches["upper_lower"].nodes > last.touches["upper_lower"].nodes == 0
    carried, recovered = rf.recovered_stress(last, CauchyStress(scene))
    exact, _ = rf.recovered_stress(twin, CauchyStress(flexible))
    sizes = np.linalg.norm([carried - exact, exact], axis=(2, 3))[:, recovered].sum(axis=1)
    assert recovered.any()
    assert sizes[0] < 0.01 * sizes[1]


@pytest.mark.filterwarnings("ignore:StrainRate. forces would:rigidfx.RigidfxWarning")
@pytest.mark.parametrize("bears", [rf.Spring("x1", 3000.0), FLOOR], ids=["spring", "floor"])
def test_what_is_asked_for_often_is_what_is_asked_for_once(monkeypatch, bears):
    """Equations and factors of the whole serve all asks; contacts open and close on the way."""
    effects = rf.Gravity((0, 0, -0.5), time=lambda t: np.sin(2 * np.pi * t / 7)), CLAMP, bears
    rule = rf.StrainRate(rf.Relative(0.02), 5 * DT, never=("root", "rest"))
    made, own = [], rigidfx.shadow.recovery.Whole

    def counted(*given):
        made.append(own(*given))
        return made[-1]

    monkeypatch.setattr(rigidfx.shadow.recovery, "Whole", counted)
    found = []
    for often in (True, False):
        scene = bar(*effects, DRAG, HELD, root=SOFT)
        stress, made[:] = CauchyStress(scene), []
        for report in rf.simulate(scene, DT, 6.0, rigidify=rule, progress=False):
            if report.step and (often or report.t > 6.0 - DT / 2):
                carried, recovered = rf.recovered_stress(report, stress)
        assert len(made) == 1
        found.append(carried[recovered])
    assert found[0] == pytest.approx(found[1], abs=1e-4 * np.abs(found[1]).max())


def watched(scene, t_end=T / 4, budget=0.05):
    """What is said of a part in a run by a budget, and the ends of its steps."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", rf.RigidfxWarning)
        reports = rf.simulate(scene, 4 * DT, t_end, accuracy=rf.Accuracy(budget), progress=False)
        times = [report.t for report in reports]
    return [str(w.message) for w in said if "that is named Rigid" in str(w.message)], times


def test_a_run_that_an_error_has_ended_may_be_asked_what_held_parts_carry():
    """Of what was solved last its equations know nothing any more: nothing is recovered."""

    def failing(t):
        if t > 4.2:
            raise RuntimeError("boom")
        return slowly(t)

    scene = bar(rf.Traction("x1", (0, 0, 50.0), time=failing), CLAMP, DRAG, HELD)
    with pytest.raises(rf.SceneError, match="boom"):
        for report in rf.simulate(scene, DT, T, rigidify=RULE, progress=False):  # noqa: B007
            pass
    assert not rf.recovered_stress(report, CauchyStress(scene))[1].any()


@pytest.mark.parametrize("name", ["root", "rest"])
def test_a_budget_tells_of_named_parts_where_nothing_else_is_rigid(monkeypatch, name):
    """Be they held or free; their budget is their own, and steps are those without a watch."""
    named = bar(PUSH, CLAMP, DRAG, rf.Rigid(name), root=SOFT)
    (said,), times = watched(named)
    ways = [
        run(bar(PUSH, CLAMP, DRAG, *of, root=SOFT), T / 4)[0][-1, 2]
        for of in ([], [rf.Rigid(name)])
    ]
    assert lacking(said) == pytest.approx(1 - ways[1] / ways[0], rel=0.2)
    assert said.startswith("Accuracy: ")
    monkeypatch.setattr(rf.Accuracy, "watching", lambda self, scene: None)
    assert watched(named) == ([], times)


def test_a_budget_is_silent_of_parts_that_hardly_give_way():
    hard = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1000.0)
    assert watched(bar(PUSH, CLAMP, DRAG, HELD, root=hard))[0] == []


def test_a_vibration_has_no_bound():
    """Under a sine at the first frequency of what is held, were it flexible."""
    f = 0.1615 / 16 * np.sqrt(1e3)
    sine = rf.Traction("x1", (0, 0, 5.0), time=lambda t: np.sin(2 * np.pi * f * t))
    _, (said,) = run(bar(CLAMP, sine, HELD, root=SOFT), 4.0, RULE)
    assert lacking(said) > 0.5
    assert "nothing bounds what the motion is off by" in said


def test_where_nothing_is_withheld_nothing_is_said():
    """All moves as one; or the part is so stiff that it hardly strains; or nothing moves."""
    v = (0.1, 0.2, 0.0)
    moved = rf.PrescribedMotion("x0", displacement=lambda t: np.multiply(v, t))
    rule = rf.StrainRate(1e-6, 5 * DT, never=("rest",))
    assert run(bar(moved, rf.InitialVelocity(linear=v), HELD), 4.0, rule)[1] == []
    hard = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1000.0)
    assert run(bar(PUSH, CLAMP, DRAG, HELD, root=hard), 4.0, RULE)[1] == []
    assert run(bar(CLAMP, HELD), 4.0, rule)[1] == []


def test_a_part_is_watched_from_when_a_support_holds_it():
    """And as it is turned, in its own frame."""
    held = rf.Fixed("x0", since=2.0)
    _, (said,) = run(bar(PUSH, held, DRAG, HELD), T / 4, RULE)
    assert 0 < lacking(said) < 1

    turns = rf.Resultant("root", torque=(1.0, 0, 0), until=1.0)
    _, (said,) = run(bar(PUSH, held, DRAG, HELD, turns), T / 4, RULE)
    assert 0 < lacking(said) < 1

    def angle(t):
        return 0.15 * np.sin(2 * np.pi * t / T) ** 2

    turned = rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=angle)
    push = rf.Traction("x1", (0, 0, 500.0), time=slowly)
    drag = rf.MassDamping(0.1)  # of the turn it is little beside the push
    _, (said,) = run(bar(push, turned, drag, HELD), T / 4, RULE)
    _, (still,) = run(bar(push, CLAMP, drag, HELD), T / 4, RULE)
    assert lacking(said) == pytest.approx(lacking(still), rel=0.05)


def test_what_holds_in_some_directions_holds_margins(monkeypatch):
    """On rollers: none of the body's own nodes is held where these do."""
    found, held = [], Margin.held

    def seen(self):
        found.append((self, held(self)))
        return found[-1][1]

    monkeypatch.setattr(Margin, "held", seen)
    rollers = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("z0", "z")]
    box = rf.box((0, 0, 0), (4, 2, 2), (8, 4, 4))
    box = box.with_cells("inner", lambda x: x.min(axis=0) >= 0.5 - 1e-9)
    scene = rf.Scene(box, SOFT, [*rollers, rf.Rigid("inner")])
    list(rf.simulate(scene, DT, DT, rigidify=rf.StrainRate(1e-6, 1.0), progress=False))
    ((margin, rows),) = found
    assert margin.supported.tolist() == (margin.rows.X < 1e-9).tolist()
    assert np.array_equal(np.sort(rows), np.flatnonzero(margin.supported))


def test_shadows_of_held_parts_cost_nothing_where_there_are_none(monkeypatch):
    made, begin = [], Shadow.__init__

    def counted(self, *given):
        made.append(self)
        begin(self, *given)

    monkeypatch.setattr(Shadow, "__init__", counted)
    beside = rf.Fixed("x1")
    for effects, shadows in (
        ((PUSH, CLAMP), 0),
        ((PUSH, HELD, beside), 1),
        ((PUSH, HELD, CLAMP), 2),
    ):
        made.clear()
        run(bar(*effects), DT, RULE)
        assert len(made) == shadows


def test_what_has_been_told_is_looked_at_no_more(monkeypatch):
    looks, look = [], Shadow.look

    def counted(self, t, *given):
        looks.append(t)
        return look(self, t, *given)

    monkeypatch.setattr(Shadow, "look", counted)
    blow = rf.Traction("x1", (0, 0, 50.0), time=lambda t: float(t < 2.0))
    _, said = run(bar(blow, CLAMP, rf.MassDamping(20.0), HELD), 16.0, RULE)
    assert len(said) == 1
    assert looks.count(0.0) == 2  # of bodies, and of what is held
    assert looks.count(max(looks)) == 1


def test_what_held_parts_carry_is_asked_of_the_last_step(monkeypatch):
    """Whenever that is, and only then: once all has been told, where other cells have become
    rigid or flexible at the end of the step, and when the run has ended."""
    solved, at_rest = [], LinearPart.at_rest

    def counted(self, force):
        before, found = self._rest[1], at_rest(self, force)
        solved.extend([1] if found is not before else [])
        return found

    monkeypatch.setattr(LinearPart, "at_rest", counted)
    push = rf.Traction("x1", (0, 0, 50.0), time=lambda t: min(t, 1.0))
    scene = bar(push, CLAMP, rf.MassDamping(20.0), HELD)
    stress, root = CauchyStress(scene), scene.owned_cells("root", "")
    release, tolerances = rf.Release(at=[8.0]), {"root": 1e-6}
    rule = rf.StrainRate(1.0, 5 * DT, tolerances=tolerances, release=release)
    kinds, sizes = [], []

    def carried(report):
        found, recovered = rf.recovered_stress(report, stress)
        assert recovered[root].all()
        return np.linalg.norm(found[root], axis=(1, 2)).mean()

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", rf.RigidfxWarning)
        for report in rf.simulate(scene, DT, 12.0, rigidify=rule, progress=False):
            if report.t > 6.0:
                assert len([w for w in said if "'root'" in str(w.message)]) == 1
                kinds += [event.kind for event in report.events]
                sizes += [carried(report)] if report.events or report.t > 11.9 else []
    assert kinds[:2] == ["release", "freeze"]
    assert sizes == pytest.approx([sizes[0]] * len(sizes), rel=0.02)
    assert carried(report) == sizes[-1]
    solved.clear()
    _, _, report = ended(scene, 6.0, rule)
    looked = len(solved)
    assert carried(report) == pytest.approx(sizes[0], rel=0.02)
    assert len(solved) == looked + 1


def test_what_is_told_is_what_the_energies_say():
    """Half of the compliance; it is told once the motion has not grown for as long as before."""
    compliance = Compliance()
    for t in range(1, 6):
        compliance.look({"root": min(t, 3.0)})
        compliance.add(0.01 * t, min(t, 3.0), float(t))
        assert not compliance.settled
    compliance.look({"root": 2.0})
    compliance.add(0.0, 1.0, 6.0)
    assert compliance.settled
    assert compliance.taken("root") == pytest.approx(0.5)
    assert compliance.taken("other") == 0
    assert not compliance.vibrates("root")
    compliance.add(0.4, 1.0, 7.0)
    assert compliance.vibrates("root")
    assert not compliance.vibrates("other")


def on_ranks():
    """What is said of a held part on these ranks, and the stress in it."""
    # At rest its nodes just touch the floor: rounding may not decide what that bears.
    every, sums = ended(bar(PUSH, CLAMP, DRAG, HELD, FLOOR), 8 * DT, RULE)[1], []
    for beside in ((), (rf.Spring("x1", 3000.0),)):
        scene = bar(PUSH, CLAMP, DRAG, HELD, *beside)
        _, said, report = ended(scene, 8 * DT, RULE)
        found, recovered = rf.recovered_stress(report, CauchyStress(scene))
        sums += [COMM.allreduce(found[recovered].sum(axis=0)).tolist()]
        every = every + said
    return every, sums


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_say_the_same(ranks):
    said, carried = parallel.run(__file__, ranks, 300)
    alone = on_ranks()
    assert len(said) == 3
    assert said == alone[0]
    assert np.array(carried) == pytest.approx(np.array(alone[1]), rel=1e-8, abs=1e-6)


if __name__ == "__main__":
    told = on_ranks()
    if COMM.rank == 0:
        parallel.report(told)
