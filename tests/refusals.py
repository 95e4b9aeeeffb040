"""Cases of what has to be refused, by name: one after the other, here and on two ranks.

A module of such cases hands them to `on_each_rank` where it is run as a script, and asks
`found_on_two_ranks` what became of them.
"""

import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping

import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf

Outcome = tuple[str, str]  # name of the error's class, message


def table(text: str) -> dict[str, str]:
    """Expressions and the words of their messages, one pair a line, apart by " :: "."""
    lines = [line for line in text.splitlines() if " :: " in line]
    cases = dict(line.split(" :: ", 1) for line in lines)
    assert len(cases) == len(lines), "an expression is there twice"
    return cases


def on_each_rank(actions: Mapping[str, Callable[[], object]]) -> None:
    """Go through all cases on every rank of this script, and report what each rank has raised."""
    comm, found = MPI.COMM_WORLD, {}
    warnings.simplefilter("ignore")
    for name, action in actions.items():
        print(f"rank {comm.rank}: {name}", file=sys.stderr, flush=True)
        try:
            action()
            found[name] = "accepted", ""
        except Exception as error:
            # Where an object lies in memory is a rank's own.
            found[name] = type(error).__name__, re.sub(r" at 0x[0-9a-f]+", "", str(error))
        comm.barrier()  # a rank that is still in the case would hang here
    everybody = comm.gather(found)
    parallel.report(everybody)


def write_bodies_of(scene: rf.Scene, path: object) -> None:
    """Write the bodies of a scene's first report, and free its run whatever becomes of that."""
    reports = rf.simulate(scene, 0.1, 0.1)
    try:
        rf.write_bodies(path, scene, next(reports))
    finally:
        reports.close()


def found_on_two_ranks(script: str) -> Iterator[tuple[str, Outcome]]:
    """What each case of a script has raised, the same on both ranks, or an `AssertionError`."""
    ranks = parallel.run(script, 2, timeout=600)
    assert len(ranks) == 2
    assert ranks[0].keys() == ranks[1].keys()
    for name in ranks[0]:
        first, second = (tuple(rank[name]) for rank in ranks)
        assert first == second, name
        yield name, first


def check(action, message, error=rf.SceneError):
    """Assert that an action is refused by an error whose message names what is wrong."""
    with pytest.raises(error) as caught:
        action()
    assert message in str(caught.value)


def check_on_two_ranks(script, cases):
    """Assert that a script's cases, messages by expressions, are refused on both ranks."""
    found = dict(found_on_two_ranks(script))
    assert found.keys() == cases.keys()
    for name, message in cases.items():
        assert found[name][0] in ("SceneError", "OutputError"), (name, found[name])
        assert message in found[name][1], (name, found[name])
