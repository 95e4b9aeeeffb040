"""A bound form reads the coefficients it was written with."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base import form_cache
from rigidfx.base.form_cache import LOCK, wait_or_clear
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import FLAGS, Kernel, jit_options


@pytest.mark.parametrize("scheme", [rf.EnergyMomentum(), rf.Midpoint(), rf.Trapezoidal()])
def test_tangent_is_the_derivative_of_the_residual(scheme):
    """The trapezoidal rule's tangent has lost u₀: it must not read u₀ where it means u₁."""
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), material, scheme=scheme)
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0)
    bound = forces.bind(forces.cells())
    rng = np.random.default_rng(1)
    x0, x1, direction = rng.normal(scale=0.1, size=(3, u0.x.array.size))

    def residual(x):
        forces.u1.x.array[:] = x
        return fem.assemble_vector(bound.residual).array.copy()

    u0.x.array[:] = x0
    h = 1e-5
    quotient = (residual(x1 + h * direction) - residual(x1 - h * direction)) / (2 * h)
    residual(x1)
    K = fem.assemble_matrix(bound.interior).to_scipy()
    # The residual is cubic in u₁: the error of the quotient is of the order h².
    np.testing.assert_allclose(K @ direction, quotient, atol=1e-8 * np.abs(quotient).max())


def test_flags_are_the_users(monkeypatch):
    """Each set has compiled forms of its own; so has each processor that "native" stands for."""
    mesh = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)).mesh
    volume = fem.Constant(mesh, 3.0) * ufl.dx(1)
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    compiled = {}
    for flags in ("-O2", "-O1 -DNAME='a b'", ""):
        monkeypatch.setenv(FLAGS, flags)
        kernel = Kernel(volume, [], mesh)
        compiled[flags] = kernel.library
        found = mesh.comm.allreduce(fem.assemble_scalar(kernel.bind({1: cells})))
        assert found == pytest.approx(3.0)
    assert len(set(compiled.values())) == 3
    monkeypatch.setenv(FLAGS, "-O1 -DNAME='a b'")
    assert jit_options()["cffi_extra_compile_args"] == ["-O1", "-DNAME=a b"]
    for flags in ("", "-O2 -mcpu=native"):
        monkeypatch.setenv(FLAGS, flags)
        assert "-DRIGIDFX_PROCESSOR_" in jit_options()["cffi_extra_compile_args"][-1]


@pytest.mark.parametrize(
    ("cell", "material", "element"),
    [
        ("hexahedron", rf.StVenantKirchhoff, "standard"),
        ("hexahedron", rf.NeoHooke, "enhanced"),
        ("tetrahedron", rf.NeoHooke, "standard"),
    ],
)
def test_default_flags_give_the_numbers_of_those_of_tests(monkeypatch, cell, material, element):
    """Users have the default's: sums in another order, and nothing else."""
    domain = rf.box((0, 0, 0), (2, 1, 1), (2, 2, 1), cell)
    effects = [rf.NumericalDamping(0.1), rf.Pressure("x1", 0.2)]
    found = []
    for flags in (os.environ[FLAGS], ""):
        monkeypatch.setenv(FLAGS, flags)
        form_cache.FOUND.clear()
        scene = rf.Scene(domain, material(rho=1.0, E=10.0, nu=0.3), effects, element=element)
        reports = list(rf.simulate(scene, 0.1, 0.3, progress=False))
        found.append([*reports[-1].linear_momentum, reports[-1].kinetic, reports[-1].strain])
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-12)


HOLD = """
import fcntl, pathlib, sys, time
lock, ready = sys.argv[1:]
with open(lock, "w") as file:
    fcntl.flock(file, fcntl.LOCK_SH)
    print("held", flush=True)
    time.sleep(1.5)
    if ready:
        pathlib.Path(ready).touch()
        time.sleep(60)
"""


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="waits on one rank")
@pytest.mark.parametrize("compiles", [True, False])
def test_form_that_another_process_compiles_is_waited_for(tmp_path, caplog, compiles):
    """Until it is there, or the process has ended without it."""
    source = tmp_path / "form.c"
    source.touch()
    ready = str(tmp_path / "form.c.cached") if compiles else ""
    command = [sys.executable, "-c", HOLD, str(tmp_path / LOCK), ready]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        start = time.monotonic()
        wait_or_clear(source)
        waited = time.monotonic() - start
        process.kill()
    assert 1.0 < waited < 30.0
    assert source.exists() == compiles
    assert "waiting for another process" in caplog.text
