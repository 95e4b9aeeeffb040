"""Every hard case, short: stable within the bounds it states, or known not to be, with the reason.

The cases are those of `demos/hard_cases.py`, see `demos/hardcases/`.
"""

import parallel
import pytest
from hardcases import CASES, carry_out, follow
from hardcases import failure as failures
from hardcases.stiffness import check, compare
from mpi4py import MPI

import rigidfx as rf

alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Scene. its mass is")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_hard_case(case):
    assert case.bound
    for result in carry_out(case, short=True):
        print(f"{result.way}: energy {result.energy_drift:.1e}, Newton {result.newton_worst}")
        assert result.stable != result.known, f"{result.way}: {result.verdict}"


@alone
def test_condition_does_not_depend_on_the_stiffness_of_a_body():
    check(compare(short=True))


@alone
@pytest.mark.parallel
@pytest.mark.slow
def test_hard_cases_on_several_ranks():  # the demo runs others on two, see test_demos
    """Ranks without cells, or with frozen ones: the same on all, and no rank waits for ever."""
    problems = parallel.run(__file__, 3, 600)
    assert problems == []


@pytest.mark.parametrize(
    "runs",
    [
        failures.inversion,
        failures.step_that_cannot_converge,
        failures.load_beyond_all_bounds,
        failures.load_that_is_nan_on_one_rank,
    ],
)
def test_what_was_written_before_a_failure_is_whole(tmp_path, runs):
    """A row for each step and fields that VTK reads, the last ones among them."""
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    (run, *_) = runs(True)
    history = follow(run, folder)
    assert isinstance(history.error, run.fails)
    written = rf.read_history(folder / "history.csv")
    assert written["t"].tolist() == pytest.approx(history.t)
    if MPI.COMM_WORLD.rank == 0:
        import pyvista

        reader = pyvista.get_reader(folder / "fields.pvd")
        assert len(reader.time_values) == len(history.t)
        for t in reader.time_values:
            reader.set_active_time_value(t)
            assert reader.read()[0].n_points > 0


if __name__ == "__main__":
    found = [
        f"{case.name}, {result.way}: {result.verdict}"
        for case in CASES
        if case.group == "parallel"
        for result in carry_out(case, short=True)
        if not result.stable
    ]
    parallel.report(found)
