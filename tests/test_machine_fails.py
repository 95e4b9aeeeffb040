"""A compiler or a disk that fails on one rank is told on all, and none waits.

Run as a script under mpirun, this file goes through all cases on each rank.
"""

import os
import resource
import shutil
import tempfile
from contextlib import ExitStack, closing, contextmanager
from errno import ENOSPC
from pathlib import Path
from unittest.mock import patch

import pytest
import refusals
import ufl
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base import c_library, form_cache
from rigidfx.flexible import kernels
from rigidfx.output.run_files import CsvFile

COMM = MPI.COMM_WORLD


@contextmanager
def _folder():
    """An empty folder, the same on all ranks."""
    with tempfile.TemporaryDirectory() as mine:
        yield Path(COMM.bcast(mine))


def _form(compiler):
    """A form that is in no cache, by a compiler of that name."""
    with (
        _folder() as folder,
        patch.dict(os.environ, {"CC": compiler}),
        patch.object(kernels, "jit_options", lambda: {"cache_dir": str(folder)}),
        patch.dict(form_cache.FOUND, clear=True),
    ):
        mesh = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)).mesh
        kernels.Kernel(ufl.Constant(mesh) * ufl.dx(domain=mesh, subdomain_id=0), [], mesh)


def _library(compiler):
    """A library of ours, likewise."""
    with (
        _folder() as folder,
        patch.dict(os.environ, {"CC": compiler}),
        patch.object(c_library.jit, "get_options", lambda given: {"cache_dir": str(folder)}),
    ):
        c_library.c_library(COMM, "one", "int one = 1;", "extern int one;", ["-O0"])


def _recorder(by_hand):
    """A recorder whose table, on rank 0, cannot be closed."""
    close = CsvFile.close

    def fails(file):
        close(file)
        raise OSError(ENOSPC, "No space left on device", "history.csv")

    scene = _scene()
    with (
        _folder() as folder,
        closing(rf.simulate(scene, 0.1, 0.1)) as reports,
        patch.object(CsvFile, "close", fails),
    ):
        recorder = rf.Recorder(scene, folder, every=1)
        if by_hand:
            recorder.write(next(reports))
            recorder.close()
        else:
            with recorder:
                recorder.write(next(reports))


def _scene():
    box = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    return rf.Scene(box, rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0))


def _long_run(happens, recorded=True):
    """A run that leaves checkpoints, and what happens in its middle on rank 0."""
    scene = _scene()
    with _folder() as place, ExitStack() as left:
        run = place / "run"
        checkpoint = rf.Checkpoint(run, steps=2)
        steps = left.enter_context(closing(rf.simulate(scene, 0.1, 2.0, checkpoint=checkpoint)))
        if recorded:
            recorder = left.enter_context(rf.Recorder(scene, run, every=100, stress=False))
        kept = {}
        try:
            for report in steps:
                if recorded:
                    recorder.write(report)
                if report.step == 5 and COMM.rank == 0:
                    kept = {path: path.read_bytes() for path in run.glob("*.rfx")}
                    happens(run)
        except rf.OutputError:
            if run.exists():
                resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
                assert all(path.read_bytes() == data for path, data in kept.items())
                again = left.enter_context(closing(rf.resume(run, scene)))
                assert next(again).step == 5
            raise


def _no_space(run):
    """What a file may have at most is less than a checkpoint has."""
    largest = max(path.stat().st_size for path in run.glob("*.rfx"))
    resource.setrlimit(resource.RLIMIT_FSIZE, (3 * largest // 4, resource.RLIM_INFINITY))


def _read_only():
    """A folder in which nobody may make a file, root neither."""
    rf.simulate(_scene(), 0.1, 2.0, checkpoint=rf.Checkpoint("/proc/self"))


COMPILERS = {
    "no compiler": (lambda: _form("none"), "'none', which the environment variable CC names"),
    "a compiler that fails": (lambda: _form("false"), "has failed: "),
    "no compiler of a library": (lambda: _library("none"), "cannot be run"),
    "one that fails": (lambda: _library("false"), "has failed: "),
}
CASES = COMPILERS | {
    "a close by hand": (lambda: _recorder(True), "No space left on device"),
    "a close at the end": (lambda: _recorder(False), "No space left on device"),
    "a full disk": (lambda: _long_run(_no_space), "File too large). Earlier checkpoints are as"),
    "a folder that goes": (lambda: _long_run(shutil.rmtree), "removed since the run began"),
    "the folder of checkpoints": (lambda: _long_run(shutil.rmtree, False), "is gone since the run"),
    "a folder to read": (_read_only, "cannot write to the folder '/proc/self'"),
}


@pytest.mark.parallel
@pytest.mark.skipif(COMM.size > 1, reason="starts its ranks itself")
def test_is_told_on_two_ranks():
    for name, (kind, told) in refusals.found_on_two_ranks(__file__):
        assert kind == ("CompilerError" if name in COMPILERS else "OutputError"), (name, kind, told)
        assert CASES[name][1] in told, (name, told)


@pytest.mark.parametrize("name", CASES)
def test_is_told_on_one_rank(name):
    action, told = CASES[name]
    refusals.check(action, told, rf.CompilerError if name in COMPILERS else rf.OutputError)


if __name__ == "__main__":
    refusals.on_each_rank({name: action for name, (action, _) in CASES.items()})
