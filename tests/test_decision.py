"""What is decided from an observed window, without a mesh."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.log import heard
from rigidfx.decide.bodies import PlannedBody, plan_bodies, qualify
from rigidfx.decide.clusters import Cluster
from rigidfx.decide.memory import CYCLES, EXCITED, longest_period
from rigidfx.report.account import Account, Pay

SELF = MPI.COMM_SELF


# Cells that qualify ----------------------------------------------------------------------------


def decide(worst, tol, observed=True):
    worst, tol = np.asarray(worst, float), np.asarray(tol, float)
    return qualify(worst, tol, np.broadcast_to(observed, worst.shape), SELF)


def test_cell_at_its_tolerance_qualifies():
    able, closeness = decide([1.0, 2.0, np.nextafter(2.0, 3.0)], [2.0, 2.0, 2.0])
    assert able.tolist() == [True, True, False]
    assert closeness == 0.0


def test_only_cells_observed_in_the_whole_window_count():
    able, closeness = decide([1.0, 0.0, 3.0], [2.0, 2.0, 2.0], [True, False, True])
    assert able.tolist() == [True, False, False]
    assert closeness == 0.5


def test_tolerance_zero_takes_what_is_at_rest():
    able, closeness = decide([0.0, 1e-300], [0.0, 0.0])
    assert able.tolist() == [True, False]
    assert closeness == np.inf  # nothing was compared


# Identity of bodies ----------------------------------------------------------------------------


def cluster(*cells):
    """A cluster of one rank; its nodes are of no concern here."""
    array = np.asarray(cells, dtype=np.int32)
    return Cluster(array, array, min(cells), len(cells))


def assign(clusters, before, always=None, next_number=5, owned=12):
    """Bodies after a change, by cells of clusters, of bodies before, and of sets rigid always."""
    origin = np.full(owned, -1)
    for number, cells in before.items():
        origin[list(cells)] = number
    sets = {name: np.asarray(cells, np.int32) for name, cells in (always or {}).items()}
    sizes = {number: len(cells) for number, cells in before.items()}
    return plan_bodies([cluster(*r) for r in clusters], origin, sizes, sets, next_number, SELF)


def facts(body: PlannedBody):
    return body.number, body.name, body.kept


def test_new_bodies_get_new_numbers():
    parts, free = assign([(0, 1), (4, 5)], {})
    assert [facts(p) for p in parts] == [(5, "part 5", False), (6, "part 6", False)]
    assert free == 7


@pytest.mark.parametrize("cells", [(4, 5, 6, 7), (4, 5)], ids=["grows", "shrinks"])
def test_body_that_grows_or_shrinks_keeps_its_number(cells):
    (part,), free = assign([cells], {2: (4, 5, 6)})
    assert facts(part) == (2, "part 2", False)
    assert free == 5


def test_divided_body_leaves_its_number_to_the_first_piece():
    parts, free = assign([(0, 1), (3, 4), (6,)], {2: (0, 1, 2, 3, 4, 5, 6)})
    assert [facts(p) for p in parts] == [
        (2, "part 2", False),
        (5, "part 5", False),
        (6, "part 6", False),
    ]
    assert [p.cells[0] for p in parts] == [0, 3, 6]
    assert free == 7


def test_piece_of_one_body_may_merge_with_another():
    """The first cluster takes the oldest number in it, the second what is left."""
    parts, free = assign([(0, 1, 2), (4, 5)], {3: (2, 4), 2: (0,), 4: (5,)})
    assert [facts(p) for p in parts] == [
        (2, "part 2", False),
        (3, "part 3", False),
    ]
    assert free == 5


def test_body_is_called_by_the_first_set_in_it_that_is_rigid_always():
    parts, _ = assign([(0, 1, 2), (6, 7)], {1: (2,), 2: (0,)}, {"foot": (2,), "head": (0,)})
    assert [(p.name, p.named) for p in parts] == [("foot", ("foot", "head")), ("part 5", ())]


# Longest period --------------------------------------------------------------------------------

HIGH, LOW = 0.5, 4.0  # periods [s]


def sine(t, period, amplitude=1.0, phase=0.3):
    return amplitude * np.sin(2 * np.pi * t / period + phase)


def period_of(signal, t_end=40.0, n=1600):
    """Longest period in a signal; a record of 10 periods of LOW, 80 of HIGH."""
    t = np.linspace(0.0, t_end, n)
    columns = signal(t)
    return longest_period(t, columns if columns.ndim == 2 else columns[:, None])


def near(period, t_end=40.0):
    """Within the spacing of the frequencies: the spectrum is padded to four times its length."""
    return pytest.approx(period, rel=period / (4 * t_end))


@pytest.mark.parametrize("amplitude", [2 * EXCITED, 1.0, 10.0])
def test_low_mode_that_is_excited_counts(amplitude):
    found = period_of(lambda t: sine(t, HIGH) + sine(t, LOW, amplitude))
    assert found == near(LOW)


@pytest.mark.parametrize("amplitude", [0.0, 0.4 * EXCITED])
def test_low_mode_that_is_not_excited_does_not_count(amplitude):
    found = period_of(lambda t: sine(t, HIGH) + sine(t, LOW, amplitude))
    assert found == near(HIGH)


@pytest.mark.parametrize("slope", [-0.02, 5.0])
def test_linear_trend_is_no_period(slope):
    assert period_of(lambda t: sine(t, LOW) + slope * t) == near(LOW)


@pytest.mark.parametrize(
    "slow",
    [lambda t: 1e-2 * t**2, lambda t: sine(t, 40.0, 3.0)],
    ids=["parabola", "less than three cycles"],
)
def test_what_is_slower_than_the_record_can_tell(slow):
    assert np.isnan(period_of(lambda t: sine(t, HIGH) + slow(t)))


@pytest.mark.parametrize("cycles", [CYCLES - 1.5, CYCLES + 1.5])
def test_period_is_believed_after_some_cycles(cycles):
    found = period_of(lambda t: sine(t, LOW), t_end=cycles * LOW)
    assert np.isnan(found) if cycles < CYCLES else found == near(LOW, cycles * LOW)


@pytest.mark.parametrize("level", [0.0, 3.0])
def test_rest_has_no_period(level):
    """Not even if rounding errors move it."""
    noise = np.random.default_rng(0).normal(size=1600)
    assert period_of(lambda t: 0 * t + level) == 0.0
    assert period_of(lambda t: level * (1 + 1e-15 * noise)) == 0.0


def test_uneven_steps():
    """Steps end on breakpoints, and may be cut: the record need not be even."""
    t = np.sort(np.r_[np.linspace(0, 40, 1600), np.random.default_rng(1).uniform(0, 40, 300)])
    assert longest_period(t, sine(t, LOW)[:, None]) == near(LOW)


def steps(*rows):
    """What is said after steps of (unknowns, bodies, wall time, events)."""
    pay = Pay()
    for step, (unknowns, bodies, wall, events) in enumerate(rows):
        pay.follow(report(step, bodies, wall, unknowns, events))
    return pay.told()


def report(step, bodies, wall, unknowns=None, events=0, named=0):
    """What is asked of one, with bodies found and parts named rigid."""
    found = [SimpleNamespace(name="part 2", cells=9, size=9, named=(), q=np.zeros(0))]
    parts = [SimpleNamespace(name="lug", cells=9, size=9, named=("lug",), q=np.zeros(0))]
    records = bodies * found + named * parts
    return SimpleNamespace(
        step=step,
        t=0.1 * step,
        dt=0.1,
        unknowns=(40 if bodies else 100) if unknowns is None else unknowns,
        bodies=records,
        rigid=SimpleNamespace(of=SimpleNamespace(records=records)),
        wall=wall,
        events=events * [None],
        iterations=1,
        cuts=0,
    )


def test_steps_with_bodies_are_compared_with_those_without():
    flexible, switch, rigid = (100, 0, 2.0, 0), (40, 1, 4.0, 1), (40, 1, 1.0, 0)
    said = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *19 * [rigid])
    assert said == (
        "rigid parts: 30% of unknowns × time; a step with them took 0.57 of one without; "
        "steps with a switch took 6% of the time"
    )
    dear = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *19 * [(40, 1, 3.0, 0)])
    assert "took 1.52 of one without, which does not pay" in dear
    assert steps((100, 0, 0.0, 0), *20 * [flexible]) == ""
    # Most steps are cheap; each tenth is dear, and switches cost what is saved.
    slow = [*9 * [(40, 1, 1.0, 0)], (40, 1, 12.0, 0)]
    dear = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *3 * slow)
    assert "took 1.08 of one without, which does not pay" in dear


def test_what_does_not_pay_is_told_in_pipes(capsys):
    """As a line on standard error, where a run is not silent; what pays is told to who asks."""
    for dear, verbose, told in ((True, None, 1), (True, False, 0), (False, None, 0)):
        account = Account(MPI.COMM_SELF, 1.0)
        with heard(MPI.COMM_SELF, verbose), account:
            for step in range(40):
                account.follow(
                    report(step, step > 20, 3.0 if dear and step > 20 else 2.0 - step / 40)
                )
        assert capsys.readouterr().err.count("which does not pay") == told


def test_a_run_says_it_at_its_end(caplog):
    box = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    scene = rf.Scene(box, rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0), [rf.Fixed("x0")])
    with caplog.at_level("INFO", "rigidfx"):
        list(rf.simulate(scene, 0.1, 2.0, rigidify=rf.StrainRate(1.0, 0.5), progress=False))
    assert any("rigid parts:" in record.message for record in caplog.records)
