"""Ctrl-C, and whatever else is raised in functions that PETSc calls."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

import rigidfx as rf
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.stopping_test import StoppingTest

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
