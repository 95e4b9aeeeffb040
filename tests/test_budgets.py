"""One per cent of a motion as what a user asks for.

Run as a script under mpirun, this file reports a history.
"""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import parallel
import pytest
from bench.waking_scenes import SOFT, STIFF, stalk_and_block
from bench.waking_scenes import scene as of_bar
from histories import heard, imbalance
from scipy.interpolate import CubicSpline

import rigidfx as rf
from rigidfx.plot.pictures import spent
from rigidfx.report.ledger import NOTHING, Entry

LARGEST = 0.2  # s

pytestmark = [
    pytest.mark.filterwarnings("ignore:Body 'part:rigidfx.RigidfxWarning"),
    pytest.mark.filterwarnings("ignore:Scene. first-order cells lock:rigidfx.RigidfxWarning"),
    pytest.mark.filterwarnings("ignore:Contact .* as nodes of the surface ring"),
]


def bar(*effects, cells=(8, 1, 1), **more):
    """A soft stalk, clamped, and a stiff block on it."""
    return of_bar(stalk_and_block(cells, 4.0), *effects, **more)


def pulled(t):
    return np.sin(2 * np.pi * t / 4.0) * min(1.0, t / 4.0)


def swaying(**more):
    pull = rf.Traction("x1", (0, 0, 200.0), time=pulled)
    return bar(rf.Fixed("x0"), pull, rf.MassDamping(1.0), **more)


def asked(budget, at="tip", **more):
    """Parts of few cells may become rigid, too, for the sake of small scenes."""
    return rf.Accuracy(budget, at, min_cells=2, **more)


def run(scene, accuracy, t_end, dt=LARGEST):
    return list(rf.simulate(scene, dt, t_end, accuracy=accuracy, progress=False))


@cache
def checked():
    """A run to five per cent beside its twin."""
    return run(swaying(), asked(0.05, check=True), 6.0)


# What is asked, and what comes of it ------------------------------------------------------------


def metal(*effects):
    """A cantilever of metal, 6 m long."""
    bar = rf.box((0, 0, 0), (6, 1, 1), (12, 2, 2))
    held, material = rf.Fixed("x0"), rf.StVenantKirchhoff(E=2e9, nu=0.3, rho=1000.0)
    return rf.Scene(bar, material, [held, *effects], probes={"tip": (6, 0.5, 0.5)})


def bent(x):
    return np.stack([0 * x[0], 0 * x[0], 0.002 * x[0] ** 2])


@pytest.mark.parametrize(
    "effects",
    [
        [rf.Gravity(lambda t: (0, 0, -200 * min(1.0, t / 0.1)))],  # it bends by 4 % of its length
        [rf.InitialDisplacement(bent), rf.KelvinVoigt(1e6)],  # stresses that no load balances
    ],
    ids=["bends far", "begins bent"],
)
def test_large_bends_keep_the_budget(effects):
    scene, asked_for = metal(*effects), asked(0.01)
    fine = rf.simulate(scene, rf.StepControl(0.002, "tip", largest=0.004), 0.5, progress=False)
    t, u = zip(*((r.t, r.probes["tip"]) for r in fine), strict=True)
    twin = CubicSpline(t, u)
    ours = run(scene, asked_for, 0.5, dt=0.004)
    apart = max(np.linalg.norm(r.probes["tip"] - twin(r.t)) for r in ours)
    assert apart < 0.01 * np.linalg.norm(u, axis=1).max()
    assert len(ours) < len(t)  # ringing after a release is not followed


def test_bodies_of_a_start_that_is_not_stable():
    criterion = rf.StrainRate(1e9, 0.004, patience=1)
    scene = metal(rf.InitialDisplacement(bent), rf.KelvinVoigt(1e6))
    reports = list(rf.simulate(scene, 0.002, 0.02, rigidify=criterion, progress=False))
    assert reports[-1].bodies
    assert imbalance(reports) < 1e-9


def test_what_is_asked_is_kept_and_something_freezes():
    """The block is rigid; what was measured is below the budget, and was estimated."""
    last = checked()[-1]
    ledger = last.ledger
    assert last.unknowns < checked()[0].unknowns
    assert 0 < ledger.measured.relative < 0.05
    estimate = ledger.time.relative + ledger.rigidity.relative
    assert 0.3 * ledger.measured.relative < estimate < 0.05
    assert ledger.time.part >= 0.025
    assert ledger.time.part + ledger.rigidity.part == pytest.approx(0.05)
    assert ledger.motion == ledger.rigidity.relative


def test_the_measured_error_is_that_of_a_run_all_flexible():
    """The twin that runs beside against one of constant steps."""
    twin = list(rf.simulate(swaying(), 0.01, 6.0, progress=False))
    t, z = (np.array([f(r) for r in twin]) for f in (lambda r: r.t, lambda r: r.probes["tip"][2]))
    errors = [abs(r.probes["tip"][2] - np.interp(r.t, t, z)) for r in checked()]
    assert checked()[-1].ledger.measured.spent == pytest.approx(max(errors), rel=0.2)


def test_a_length_that_is_given_counts_in_what_flies_far():
    """It moves by five metres, and bends by nine millimetres."""

    def rises(t):
        return np.sin(np.pi * t / 4) ** 2

    box = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
    thrown = rf.InitialVelocity(linear=(5.0, 0, 0))
    pulls = (rf.Traction(name, (0, 0, 1e4), time=rises) for name in ("x0", "x1"))
    scene = rf.Scene(box, STIFF, [thrown, *pulls], probes={"tip": (8, 0.5, 0.5)})
    twin, found = (
        np.array([(r.t, *r.probes["tip"]) for r in reports])
        for reports in (
            rf.simulate(scene, 0.01, 1.0, progress=False),
            run(scene, asked(0.05, of=2e-3), 1.0),
        )
    )
    exact = CubicSpline(twin[:, 0], twin[:, 1:])(found[:, 0])
    assert np.linalg.norm(found[:, 1:] - exact, axis=1).max() < 0.05 * 2e-3


def test_energy_is_what_loads_have_done():
    """Whatever froze and woke."""
    assert imbalance(checked()) < 1e-9


def test_the_tables_and_pictures_have_it(tmp_path):
    scene = swaying()
    with rf.Recorder(scene, tmp_path) as recorder:
        for report in rf.simulate(scene, LARGEST, 1.0, accuracy=asked(0.1)):
            recorder.write(report)
    h = rf.read_history(tmp_path / "history.csv")
    allowed = h["rigidity_allowed"][-1] + h["time_allowed"][-1]
    assert allowed == pytest.approx(0.1 * h["displacement"][-1])
    assert h["rigidity_allowed"][1] == 0.0  # while nothing is rigid, Δt has all of it
    assert h["rigidity_error"][-1] == report.ledger.rigidity.spent
    assert np.isnan(h["measured_error"]).all()
    energy = h["deformation"][-1]
    assert h["damping_allowed"][-1] == pytest.approx(2 * 0.1 * energy)
    assert 0 < h["energy_allowed"][-1] < 0.1 * energy
    assert h["frozen"][-1] < h["energy_allowed"][-1]
    assert h["rejected"][-1] == report.ledger.rejected
    assert h["periods"][-1] == report.ledger.periods
    assert "Rigid parts, % of the largest displacement" in spent(h)


def test_what_is_at_rest_for_a_while():
    """Nothing is relative to nothing: no step is short and nothing is rigid before the push."""
    push = rf.Traction("x1", (0, 0, 100.0), since=2.0, until=2.5)
    reports = run(bar(rf.Fixed("x0"), push), asked(0.05), 4.0)
    before = [r for r in reports if 0 < r.t <= 2.0]
    assert len(before) <= 30
    assert all(r.ledger.rigidity.spent == 0 for r in before)
    assert all(np.isfinite(r.energy) for r in reports)
    still = run(bar(rf.Fixed("x0")), asked(0.01, None), 1.0)
    assert still[-1].ledger.rigidity.spent == still[-1].ledger.time.spent == 0


@pytest.mark.parametrize(("time", "rigid", "said"), [(0.024, 0.0255, False), (0.025, 0.026, True)])
def test_the_word_is_about_the_whole_budget(time, rigid, said):
    """A share may be exceeded where the other is not used up."""

    def entry(spent, allowed):
        return Entry(spent, 1.0, allowed, "m")

    last = checked()[-1]
    spent = {"time": entry(time, 0.025), "rigidity": entry(rigid, 0.025)}
    ledger = replace(last.ledger, **spent, measured=NOTHING)
    one = iter([replace(last, ledger=ledger)])

    def reports():
        yield from one

    with heard("budget of") as words:
        list(rf.Accuracy(0.05, "tip").followed(reports(), swaying(), None, run))
    assert ["together 0.051" in word for word in words] == [True] * said


@pytest.mark.filterwarnings("ignore:StepControl:rigidfx.RigidfxWarning")
def test_a_budget_that_is_not_met_is_said():
    """Steps as long as they have to be here err by more."""
    sharp = asked(1e-3, smallest=LARGEST)
    with pytest.warns(rf.RigidfxWarning, match=r"budget of 0\.001 was not met: time integration"):
        ledger = run(swaying(), sharp, 3.0)[-1].ledger
    assert ledger.time.relative > 0.5e-3


def test_numerical_damping_that_takes_too_much_is_told_what_would_do():
    """A bar that swings to and fro; with ξ as advised nothing is said of it."""
    box, push = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1)), rf.Traction("x1", (0, 0, 30.0), until=1.0)

    def said(xi):
        effects = [rf.Fixed("x0"), push, rf.NumericalDamping(xi)]
        scene = rf.Scene(box, SOFT, effects, probes={"tip": (8, 0.5, 0.5)})
        with heard("numerical damping takes") as found:
            run(scene, rf.Accuracy(0.05, "tip"), 20.0)
        return " ".join(found)

    advised = re.search(r"xi = (\S+) in place of 0\.5 would do", said(0.5))
    assert 0.005 < float(advised[1]) < 0.1
    assert not said(float(advised[1]))


def test_estimates_hold_near_a_resonance():
    """A bar that swings once in eleven seconds is pulled each eleven; against its finer twin."""
    pull = rf.Traction("x1", (0, 0, 20.0), time=lambda t: np.sin(2 * np.pi * t / 11))
    scene = bar(rf.Fixed("x0"), pull, rf.MassDamping(0.1))
    ledger = run(scene, asked(0.01, check=True), 18.0)[-1].ledger
    assert ledger.sure == "estimate"
    assert 0 < ledger.rigidity.relative < 0.005  # half of the budget, and its bend drifts
    assert ledger.measured.relative < 0.01


def falling():
    """A stiff bar above a plane."""
    box = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
    floor = rf.Contact("z0", against=rf.Plane((0, 0, -0.05), (0, 0, 1)))
    return rf.Scene(box, STIFF, [rf.Gravity((0, 0, -1.0)), floor], probes={"tip": (8, 0.5, 0.5)})


def test_nothing_is_sure_from_a_contact_on(tmp_path):
    """Estimated to err by less than a per cent, such a bar was off by 15 and more."""
    scene = falling()

    def recorded():
        with rf.Recorder(scene, tmp_path) as recorder:
            for report in rf.simulate(scene, LARGEST, 0.4, accuracy=asked(0.05)):
                recorder.write(report)
        return report

    with pytest.warns(rf.RigidfxWarning, match=r"budget of 0\.05 was kept is unknown"):
        report = recorded()
    h = rf.read_history(tmp_path / "history.csv")
    touch = int(np.argmax(h["contact"] > 0))
    assert h["t"][touch] == pytest.approx(np.sqrt(0.1), rel=0.05)
    assert (h["unsure"][:touch] == 0).all()
    assert (h["unsure"][touch:] == 2).all()
    assert report.ledger.struck
    assert report.ledger.sure == "unknown"
    assert "time integration (unknown)" in str(report.ledger)
    alone = list(rf.simulate(scene, rf.StepControl(0.05, "tip", largest=0.2), 0.4, progress=False))
    assert [r.ledger.sure for r in alone[:2]] == ["estimate"] * 2
    assert alone[-1].ledger.sure == "unknown"


def test_what_flies_rigid_keeps_its_budget_as_it_strikes():
    """A tilted block lands on an edge, turns and strikes the floor with the next one."""

    def tilted(x):
        moved = np.array([[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]])
        return moved @ x - x + np.array([[0.0], [0.05], [0.05]])

    def fall(dt, **more):
        scene = rf.Scene(
            rf.box((0, 0, 0), (0.4, 0.2, 0.2), (6, 4, 4)),
            rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0),
            [
                rf.StiffnessDamping(ratio=0.05, frequency=20.0),
                rf.InitialDisplacement(tilted),
                rf.Gravity((0, 0, -9.81)),
                rf.Contact("z0", against=rf.Plane((0, 0, 0), (0, 0, 1)), title="floor"),
            ],
            probes={"end": (0.4, 0.2, 0.2)},
        )
        return list(rf.simulate(scene, dt, 0.16, progress=False, **more))

    exact = fall(1e-3)[-1].probes["end"]
    with pytest.warns(rf.RigidfxWarning, match="as a contact has closed"):
        reports = fall(5e-3, accuracy=rf.Accuracy(0.02, "end", min_cells=20))
    assert any(r.touches["floor"].nodes > 0 and len(r.bodies) for r in reports)
    way = max(np.linalg.norm(r.probes["end"]) for r in reports)
    assert np.linalg.norm(reports[-1].probes["end"] - exact) < 0.02 * way


def test_what_is_too_small_to_be_worth_it_stays_flexible():
    """Nothing watches it then, and time integration has all of the budget."""
    last = run(swaying(), rf.Accuracy(0.05, "tip"), 1.0)[-1]
    assert not last.finds_bodies
    assert last.ledger.rigidity.spent == 0
    assert last.ledger.time.part == pytest.approx(0.05)


def test_what_rigidity_does_not_spend_goes_to_time():
    """All of it as long as nothing is rigid, at least half of what is left as something is."""
    for r in checked():
        time, rigidity = r.ledger.time.part, r.ledger.rigidity.part
        assert time + rigidity == pytest.approx(0.05)
        if not len(r.rigid):
            assert rigidity <= r.ledger.rigidity.relative + 1e-12
        assert time >= 0.025 - 1e-12


@pytest.mark.filterwarnings("ignore:StepControl:rigidfx.RigidfxWarning")
def test_of_what_flies_rigidity_withholds_a_part_of_its_deflection():
    """Which is next to nothing of its way; against the flexible twin with the same steps."""

    def swell(t):
        return np.sin(np.pi * t / 3) ** 2 if t < 3 else 0.0

    def spun():
        pull = rf.Traction("y0", (60.0, 0, 0), time=swell, until=3.0)
        push = rf.Traction("y1", (-60.0, 0, 0), time=swell, until=3.0)
        return bar(pull, push, rf.KelvinVoigt(2e4))

    twin = list(rf.simulate(spun(), 0.1, 6.0, progress=False))
    reports = run(spun(), asked(0.05, smallest=0.1), 6.0, dt=0.1)
    assert reports[-1].unknowns < reports[0].unknowns
    apart = [a.probes["tip"] - b.probes["tip"] for a, b in zip(reports, twin, strict=True)]
    measured = np.linalg.norm(apart, axis=1).max()
    spent = max(r.ledger.rigidity.spent for r in reports)
    assert 0.3 * measured < spent < 5 * measured
    assert spent < 1e-3 * 0.05 * reports[-1].ledger.rigidity.scale


def arms():
    """Two arms that stand out from a narrow foot; one is pushed and let go."""
    box = rf.box((0, 0, 0), (16, 1, 1), (32, 1, 1))
    box = box.with_facets("foot", lambda x: (abs(x[0] - 8) < 0.6) & (x[2] < 1e-9))
    box = box.with_facets("end", lambda x: (x[0] > 14.9) & (x[2] > 1 - 1e-9))
    push = rf.Traction("end", (0, 0, -200.0), until=1.0)
    effects = [rf.Fixed("foot"), push, rf.StiffnessDamping(ratio=0.003, frequency=0.1)]
    return rf.Scene(box, SOFT, effects, probes={"pushed": (16, 0.5, 0.5), "other": (0, 0.5, 0.5)})


def test_vibration_that_goes_from_part_to_part_is_not_frozen():
    """The other arm is almost at rest at first, and swings as far as the pushed one in the end."""
    ends = "pushed", "other"

    def motion(reports):
        rows = [(r.t, *(r.probes[name][2] for name in ends)) for r in reports]
        return np.array(rows).T

    reports = run(arms(), asked(0.05, ends), 20.0, dt=0.4)
    assert min(r.unknowns for r in reports) < reports[0].unknowns
    t, *found = motion(reports)
    fine, *exact = motion(rf.simulate(arms(), 0.08, 20.0, progress=False))
    size = max(np.abs(way).max() for way in exact)
    early = np.abs(exact[1][fine < 5.0]).max()
    assert np.abs(exact[1]).max() > 2 * early
    for ours, way in zip(found, exact, strict=True):
        assert np.abs(ours - np.interp(t, fine, way)).max() < 0.05 * size


def test_named_sets_stay_flexible():
    reports = run(swaying(), asked(0.05, never=("block", "stalk")), 2.0)
    assert all(r.unknowns == reports[0].unknowns for r in reports)


# Ranks ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def on_one_rank():
    return parallel.run(__file__, 1, 120)


@pytest.mark.parallel
def test_ranks_decide_alike(on_one_rank):
    """As one rank does, which keeps tangents where several do not."""
    some = parallel.run(__file__, 3, 120)
    assert some[:2] == on_one_rank[:2]
    assert some[2:-1] == pytest.approx(on_one_rank[2:-1], rel=1e-6, abs=1e-12)
    assert some[-1] == pytest.approx(on_one_rank[-1], rel=1e-4)  # an estimate


if __name__ == "__main__":
    reports = run(swaying(cells=(16, 2, 2)), asked(0.05), 8.0)
    last, times = reports[-1], [event.t for report in reports for event in report.events]
    assert times, "nothing was decided"
    row = [last.step, last.unknowns, *times, *last.probes["tip"], last.ledger.rigidity.spent]
    parallel.report([float(x) for x in row])
