"""Run a script on several ranks and read what rank 0 found."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

RESULT = "RIGIDFX_TEST_RESULT"  # names the file; standard output mixes what the ranks print
on_1_to_3_ranks = pytest.mark.parametrize(
    "ranks", [1, *(pytest.param(n, marks=pytest.mark.parallel) for n in (2, 3))]
)
ROOT = Path(__file__).resolve().parent.parent


def report(data: Any) -> None:
    """Leave data where `run` finds it; to be called once, by one rank of the script."""
    Path(os.environ[RESULT]).write_text(json.dumps(data), encoding="utf-8")


def run(script: str | Path, ranks: int, timeout: float, *arguments: str) -> Any:
    """What a script reported; None if nothing.

    Args:
        script: Python file.
        ranks: Number of MPI ranks.
        timeout: Seconds after which the run counts as hanging.
        arguments: Arguments of the script.

    Raises:
        AssertionError: If the script fails or hangs.
    """
    # `-m mpi4py` aborts all ranks where one fails. This process may itself be a rank of MPI, of
    # which mpirun must know nothing.
    command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, "-m", "mpi4py"]
    mine = ("OMPI_COMM", "OMPI_UNIVERSE", "OMPI_APP", "OMPI_NUM", "OMPI_FIRST", "OMPI_FILE",
            "PMIX_", "PMI_", "PRTE_", "HYDRA_")  # fmt: skip
    kept = {k: v for k, v in os.environ.items() if not k.startswith(mine)}
    folders = [ROOT, *(ROOT / name for name in ("meshes", "tests", "demos"))]
    path = [os.environ.get("PYTHONPATH", ""), *map(str, folders)]
    kept["PYTHONPATH"] = os.pathsep.join(p for p in path if p)
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder, "result.json")
        kept[RESULT] = str(result)
        with subprocess.Popen(
            [*command, str(script), *arguments],
            env=kept,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            try:
                out, err = process.communicate(timeout=timeout)
            except subprocess.TimeoutExpired:
                process.terminate()  # mpirun ends its ranks
                out, err = process.communicate()
                raise AssertionError(f"hangs after {timeout} s\n{out}\n{err}") from None
        assert process.returncode == 0, f"{out}\n{err}"
        return json.loads(result.read_text(encoding="utf-8")) if result.exists() else None
