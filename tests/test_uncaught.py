"""What ends a run: a script that fails on one rank or on all, Ctrl-C, errors in PETSc's calls."""

import os
import signal
import subprocess
import sys

import pytest
from parallel import launch

import rigidfx as rf
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.stopping_test import StoppingTest

NAMES = """
held = rf.Fixed("x0" if sound else 3)
rf.Scene(bar, soft, [held])
"""
LOOP = """
scene = rf.Scene(bar, soft, [rf.Fixed("x0"), rf.Gravity()])
for turn in range(3):  # those that are given up leave nothing that others wait for
    for report in rf.simulate(scene, 0.1, 1.0, progress=False):
        if report.step == turn:
            break
with rf.Recorder(scene, folder, every=99) as recorder:
    for report in rf.simulate(scene, 0.1, 1.0, progress=False):
        recorder.write(report)
        if report.step == 3 and not sound:
            raise KeyError("mine")
"""
OWN = "import test_refused_own as own; own._contact(in_approach=own.Fault(2))"
SCRIPT = """
from mpi4py import MPI
import rigidfx as rf
from rigidfx.base import uncaught

uncaught.PATIENCE, sound, folder = {patience}, MPI.COMM_WORLD.rank in {sound}, "{folder}"
bar = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
soft = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=1000.0)
"""


def _run(code, folder, sound, patience):
    command, environment = launch(2)
    script = SCRIPT.format(patience=patience, sound=sound, folder=folder) + code
    return subprocess.run(
        [*command, "-c", script],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("code", "failing", "told"),
    [
        (NAMES, 0, "SceneError: Fixed: where must be the name of a set, got 3."),
        (LOOP, 1, "KeyError: 'mine'"),
    ],
    ids=["names", "loop"],
)
def test_failing_on_one_rank_ends_all(tmp_path, code, failing, told):
    ended = _run(code, tmp_path, [1 - failing], 0.2)
    assert ended.returncode
    assert told in ended.stderr
    assert f"rigidfx: rank {failing} of 2 has failed without the others" in ended.stderr


@pytest.mark.parallel
def test_a_function_that_fails_in_a_step_ends_all(tmp_path):
    """The last rank alone fails, between sums in which the others wait for it."""
    ended = _run(OWN, tmp_path, [], 0.2)
    assert ended.returncode
    assert "approach of the Floor failed with" in ended.stderr
    assert "rigidfx: rank 1 of 2 has failed without the others" in ended.stderr


@pytest.mark.parallel
def test_failing_on_all_ranks_aborts_none(tmp_path):
    ended = _run(LOOP, tmp_path, [], 60.0)
    assert ended.returncode
    assert ended.stderr.count("KeyError: 'mine'") == 2
    assert "without the others" not in ended.stderr
    assert "ABORT" not in ended.stderr
    assert len((tmp_path / "history.csv").read_text().splitlines()) == 5  # names, 4 steps


RUN = """
import os, signal, sys
import rigidfx as rf
from rigidfx.step.equations.equations import Equations

signal.signal(signal.SIGINT, signal.default_int_handler)
material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=1.0)
pulled = [rf.Fixed("x0"), rf.Traction("x1", (1.0, 0.0, 2.0))]
scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), material, pulled)
residual, calls = Equations.residual, []

def interrupted(self, y, r):
    calls.append(1)
    if len(calls) == 5:
        os.kill(os.getpid(), signal.SIGINT)
    residual(self, y, r)

Equations.residual = interrupted
for report in rf.simulate(scene, 0.1, 100.0):
    pass
"""


def steps():
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=1.0)
    pulled = [rf.Fixed("x0"), rf.Traction("x1", (1.0, 0.0, 2.0))]
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), material, pulled)
    return rf.simulate(scene, 0.1, 1.0)


@pytest.mark.parametrize(
    ("owner", "name"),
    [(Equations, "residual"), (Equations, "tangent"), (StoppingTest, "__call__")],
)
@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError, ZeroDivisionError])
def test_what_a_callback_raises_is_raised(monkeypatch, owner, name, error):
    def fails(*arguments):
        raise error("heard in a callback")

    run = steps()
    next(run)
    monkeypatch.setattr(owner, name, fails)
    with pytest.raises(error, match="heard in a callback"):
        next(run)


@pytest.mark.usefixtures("hears")
def test_a_signal_during_a_solve_is_a_keyboard_interrupt(monkeypatch):
    residual = Equations.residual

    def interrupted(self, y, r):
        os.kill(os.getpid(), signal.SIGINT)
        residual(self, y, r)

    run = steps()
    next(run)
    monkeypatch.setattr(Equations, "residual", interrupted)
    with pytest.raises(KeyboardInterrupt):
        next(run)


def test_a_process_that_is_interrupted_ends_by_the_signal():
    """A shell shows that as 130."""
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, timeout=120)
    assert done.returncode == -signal.SIGINT
    assert "KeyboardInterrupt" in done.stderr
    assert "PETSc.Error" not in done.stderr.replace("petsc4py.PETSc.PetscPythonErrorHandler", "")
