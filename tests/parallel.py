"""Run a script on several ranks and read what rank 0 found.

Ranks that have run a script wait for the next one: to import what they need took them longer than
most scripts. Each script is the main module of its own, and finds its ranks by MPI.COMM_WORLD as if
mpirun had started it. Ranks of which one fails end all together, and the next script has new ones.

Run as a script under mpirun, this file is what the ranks do.
"""

import atexit
import gc
import json
import os
import runpy
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

RESULT = "RIGIDFX_TEST_RESULT"  # names the file; standard output mixes what the ranks print
SHARE = 0.1  # of a time of waiting that may pass until the end of it is seen
NAPS = 0.002, 0.1  # s, shortest and longest time between two looks
on_1_and_3_ranks = pytest.mark.parametrize(
    "ranks", [1, pytest.param(3, marks=pytest.mark.parallel)]
)
ROOT = Path(__file__).resolve().parent.parent


def report(data: Any) -> None:
    """Leave rank 0's data where `run` finds it; to be called once by each rank of the script."""
    if MPI.COMM_WORLD.rank == 0:
        Path(os.environ[RESULT]).write_text(json.dumps(data), encoding="utf-8")


def run(script: str | Path, ranks: int, timeout: float, *arguments: str) -> Any:
    """What a script reported on so many ranks; None if nothing.

    It fails or hangs by an `AssertionError`.
    """
    if ranks not in _waiting:
        _waiting[ranks] = Ranks(ranks)
    try:
        return _waiting[ranks].run(str(script), timeout, *arguments)
    except BaseException:  # a keyboard's, too: nobody knows what the ranks are at
        _waiting.pop(ranks).end()
        raise


def check_the_same(script: str | Path, ranks: int, alone: Any, *arguments: str) -> None:
    """Assert that a script reports the rows of one rank, to 1e-9 of each column's largest."""
    one, several = np.array(alone), np.array(run(script, ranks, 300, *arguments))
    assert (np.abs(several - one).max(axis=0) <= 1e-9 * np.abs(one).max(axis=0)).all()


def launch(ranks: int) -> tuple[list[str], dict[str, str]]:
    """Command that starts Python on several ranks, and the environment to start it in.

    mpirun is that of this Python's MPI, Open MPI or MPICH: in a virtual environment it lies beside
    python. This process may itself be a rank of MPI, of which mpirun must know nothing.
    """
    mine = ("OMPI_COMM", "OMPI_UNIVERSE", "OMPI_APP", "OMPI_NUM", "OMPI_FIRST", "OMPI_FILE",
            "PMIX_", "PMI_", "PRTE_", "HYDRA_", "HYDI_", "MPI_LOCAL")  # fmt: skip
    kept = {k: v for k, v in os.environ.items() if not k.startswith(mine)}
    folders = [ROOT, *(ROOT / name for name in ("meshes", "tests", "demos", "demos/benchmarks"))]
    path = [os.environ.get("PYTHONPATH", ""), *map(str, folders)]
    kept["PYTHONPATH"] = os.pathsep.join(p for p in path if p)
    beside = Path(sys.executable).with_name("mpirun")
    mpirun = str(beside) if beside.exists() else "mpirun"
    # MPICH's takes more ranks than cores by itself, and does not know this option.
    extra = ["--oversubscribe"] if "Open MPI" in MPI.Get_library_version() else []
    return [mpirun, *extra, "-n", str(ranks), sys.executable], kept


class Ranks:
    """Ranks that run scripts, one after the other."""

    def __init__(self, ranks: int) -> None:
        """Start them."""
        command, kept = launch(ranks)
        self._temporary = tempfile.TemporaryDirectory()
        self._folder = Path(self._temporary.name)
        self._jobs = 0
        with (self._folder / "told").open("w", encoding="utf-8") as told:
            self._process = subprocess.Popen(
                [*command, __file__, str(self._folder), str(os.getpid())],
                env=kept,
                stdin=subprocess.DEVNULL,
                stdout=told,
                stderr=subprocess.STDOUT,
            )

    def run(self, script: str, timeout: float, *arguments: str) -> Any:
        """What a script reported; None if nothing. It fails or hangs by an `AssertionError`."""
        told, before = self._folder / "told", (self._folder / "told").stat().st_size
        self._jobs += 1
        job, done, result = (self._folder / f"{self._jobs}.{k}" for k in ("job", "done", "result"))
        asked = {"argv": [script, *arguments], "result": str(result)}
        _written_at_once(job, json.dumps(asked))
        began = time.monotonic()
        while not done.exists():
            problem = f"hangs after {timeout} s" if time.monotonic() > began + timeout else ""
            if self._process.poll() is not None:
                problem = f"fails with {self._process.returncode}"
            if problem:
                raise AssertionError(f"{script} {problem}\n{told.read_text()[before:]}")
            _nap(began)
        return json.loads(result.read_text(encoding="utf-8")) if result.exists() else None

    def end(self) -> None:
        """Have mpirun end the ranks."""
        self._process.terminate()
        self._process.wait()
        self._temporary.cleanup()


_waiting: dict[int, Ranks] = {}


@atexit.register
def _end_all() -> None:
    for ranks in _waiting.values():
        ranks.end()


def _written_at_once(path: Path, text: str) -> None:
    """So that nobody reads half of it."""
    path.with_suffix(".part").write_text(text, encoding="utf-8")
    path.with_suffix(".part").rename(path)


def _awaited(job: Path, starter: int) -> bool:
    """Wait for a job without asking other ranks, all of a core's time; False if none will be."""
    began = time.monotonic()
    while not job.exists():
        try:
            os.kill(starter, 0)  # asks only
        except ProcessLookupError:
            return False
        _nap(began)
    return True


def _nap(began: float) -> None:
    """Sleep the longer, the longer one has waited for what the other side leaves in the folder."""
    shortest, longest = NAPS
    time.sleep(min(max(shortest, SHARE * (time.monotonic() - began)), longest))


def _run_scripts(folder: Path, starter: int) -> None:
    """Run what is left in a folder, until nobody will leave anything any more. Collective."""
    import rigidfx.base.dolfinx_first  # noqa: F401 - scripts may import DOLFINx before rigidfx

    comm, environment, path = MPI.COMM_WORLD, dict(os.environ), list(sys.path)
    number = 1
    while _awaited(folder / f"{number}.job", starter):
        job = json.loads((folder / f"{number}.job").read_text(encoding="utf-8"))
        script = job["argv"][0]
        sys.argv[:], sys.path[:] = job["argv"], [str(Path(script).parent), *path]
        os.environ[RESULT] = job["result"]
        try:
            with warnings.catch_warnings():
                runpy.run_path(script, run_name="__main__")
        except BaseException:  # others may wait for this rank until the test's time is over
            traceback.print_exc()
            sys.stderr.flush()
            comm.Abort(1)
        os.environ.clear()
        os.environ.update(environment)
        gc.collect()  # PETSc's objects at the same place on all ranks
        gc.freeze()  # what is left is modules, which later collections need not look through
        comm.barrier()
        if comm.rank == 0:
            _written_at_once(folder / f"{number}.done", "")
        number += 1


if __name__ == "__main__":
    _run_scripts(Path(sys.argv[1]), int(sys.argv[2]))
