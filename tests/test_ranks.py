"""Ranks that wait for scripts: each script is told from the others, and what fails ends them."""

import parallel
import pytest
from mpi4py import MPI

pytestmark = [
    pytest.mark.parallel,
    pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself"),
]

TELL = """
import sys
import parallel
from mpi4py import MPI

found = MPI.COMM_WORLD.gather((__name__, sys.argv[1:], "left" in globals()))
left = True
if MPI.COMM_WORLD.rank == 0:
    parallel.report(found)
"""
FAIL = """
from mpi4py import MPI

if MPI.COMM_WORLD.rank:
    raise ValueError("of one rank")
MPI.COMM_WORLD.barrier()
"""


@pytest.fixture
def script(tmp_path):
    """Writes a script."""

    def write(text):
        (tmp_path / "script.py").write_text(text, encoding="utf-8")
        return tmp_path / "script.py"

    return write


def test_each_script_is_the_main_module_of_its_own(script):
    """With its arguments, and nothing of what the last one left; who reports nothing gives None."""
    for argument in ("one", "two"):
        found = parallel.run(script(TELL), 2, 60, argument)
        assert found == [["__main__", [argument], False]] * 2
    assert parallel.run(script("left = True"), 2, 60) is None


def test_a_script_that_fails_on_one_rank_fails(script):
    """At once, with what it said, and the next one is run."""
    with pytest.raises(AssertionError, match=r"(?s)script.py fails.*ValueError: of one rank"):
        parallel.run(script(FAIL), 2, 60)
    assert parallel.run(script(TELL), 2, 60) == [["__main__", [], False]] * 2
