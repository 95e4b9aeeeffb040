"""The cache of compiled forms, and coefficients that a bound form reads."""

import logging
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base import form_cache
from rigidfx.base.form_cache import LOCK, wait_or_clear
from rigidfx.flexible import kernels
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import FLAGS, Kernel, jit_options

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="one cache, one process")

OPTIONS = kernels.jit_options
MIDDLE = np.full((1, 3), 0.5)  # of a cell of reference


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache of its own, in which 2 s are waited for others."""
    options = kernels.jit_options() | {
        "cache_dir": str(tmp_path / "forms"),
        "timeout": 3,
        "cffi_extra_compile_args": ["-O0"],
    }
    monkeypatch.setattr(kernels, "jit_options", lambda: options)
    monkeypatch.setattr(form_cache, "TOLD_AFTER", 1)
    return tmp_path / "forms"


def compile_form(afresh=True):
    """As a new process would, or as one that has compiled it before."""
    if afresh:
        form_cache.FOUND.clear()
    mesh = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)).mesh
    return Kernel(ufl.Constant(mesh) * ufl.dx(domain=mesh, subdomain_id=0), [], mesh)


def the_file(cache, suffix):
    (file,) = cache.glob(f"*{suffix}")
    return file


def test_a_stopped_compilation_is_told_and_cleared(cache, caplog):
    """Only its source is there, for whose result FFCx waits."""
    compile_form()
    source = the_file(cache, ".c")
    for file in cache.iterdir():
        if file != source:
            file.unlink()
    with caplog.at_level(logging.WARNING):
        compile_form()
    (told,) = (line for line in caplog.messages if not line.startswith("compiling"))
    assert "waits for another process" in told
    assert f"remove '{source}'" in told
    assert the_file(cache, ".c.cached").exists()


def test_an_expression_is_found_by_a_later_scene(cache):
    """Though UFL has counted its variables on."""

    def compiled():
        mesh = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)).mesh
        x = ufl.variable(ufl.SpatialCoordinate(mesh))
        values = ufl.diff(ufl.dot(x, x), x)
        form_cache.compile_expression(mesh.comm, values, MIDDLE, kernels.jit_options())
        return {file.name for file in cache.iterdir()}

    assert compiled() == compiled()


@pytest.mark.parametrize("damage", ["emptied", "cut", "gone"])
def test_a_damaged_result_is_made_anew(cache, tmp_path, monkeypatch, caplog, damage):
    """In another folder: a library that this process has loaded would not be read again."""
    compile_form()
    other = shutil.copytree(cache, tmp_path / "other")
    library = the_file(other, ".so")
    size = library.stat().st_size
    if damage == "gone":
        library.unlink()
    else:
        library.write_bytes(library.read_bytes()[: 200 if damage == "cut" else 0])
    options = kernels.jit_options() | {"cache_dir": str(other)}
    monkeypatch.setattr(kernels, "jit_options", lambda: options)
    with caplog.at_level(logging.WARNING):
        compile_form()
    assert all(line.startswith("compiling") for line in caplog.messages)
    assert the_file(other, ".so").stat().st_size == size


def test_what_cannot_be_removed_is_told(cache, monkeypatch):
    def refuse(self, missing_ok=False):
        raise PermissionError(13, "Permission denied", str(self))

    compile_form()
    library = the_file(cache, ".so")
    library.unlink()
    monkeypatch.setattr("pathlib.Path.unlink", refuse)
    with pytest.raises(rf.OutputError, match=r"libffcx_forms_\w+\.\*' is damaged.*remove these"):
        compile_form()


@pytest.fixture
def small(tmp_path, monkeypatch):
    """The same for forms that are not bound anew."""
    folder = tmp_path / "small"
    options = {"cache_dir": str(folder), "timeout": 2, "cffi_extra_compile_args": ["-O0"]}
    monkeypatch.setattr(form_cache, "SMALL", options)
    return folder


def make_scene():
    return rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), rf.StVenantKirchhoff(E=1.0, nu=0.3, rho=2.0)
    )


def test_the_forms_of_a_scene_are_cleared_too(small, monkeypatch):
    """Of masses: a stopped compilation, and a library that is gone."""
    mass = make_scene().nodal_mass.sum()
    sources = list(small.glob("*.c"))
    assert sources
    for file in small.iterdir():
        if file not in sources:
            file.unlink()
    assert make_scene().nodal_mass.sum() == mass
    for library in small.glob("*.so"):
        library.unlink()
    assert make_scene().nodal_mass.sum() == mass
    assert len(list(small.glob("*.so"))) == len(sources)


def test_all_forms_go_by_the_cache():
    """Whoever calls DOLFINx's own functions waits in vain for what was stopped."""
    package = Path(rf.__file__).parent
    direct = ("fem.form(", "fem.compile_form(", "fem.Expression(")
    found = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if any(call in path.read_text(encoding="utf-8") for call in direct)
    }
    assert found == {"base/form_cache.py"}


@pytest.mark.parametrize("flags", ["-fno-such-thing", "-O2 'left open"])
def test_wrong_flags_are_named(cache, monkeypatch, flags):
    monkeypatch.setattr(kernels, "jit_options", lambda: OPTIONS() | {"cache_dir": str(cache)})
    monkeypatch.setenv(kernels.FLAGS, flags)
    with pytest.raises(rf.SceneError, match=kernels.FLAGS) as error:
        compile_form()
    assert flags in str(error.value)


@pytest.mark.parametrize("reason", ["File exists", "File too large"])
def test_a_cache_that_cannot_be_written_to_is_named(cache, reason):
    """Such as a full disk, or a home that may only be read: a bare OSError of another package."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    if reason == "File exists":
        cache.touch()
    else:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(rf.OutputError, match=f"'{cache}' .{reason}.*XDG_CACHE_HOME"):
            compile_form()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    if reason == "File too large":
        compile_form()  # nothing that is half written is in the way


@pytest.mark.parametrize("flags", ["", "-O0"])
def test_a_compiler_that_is_not_installed_is_named(cache, monkeypatch, flags):
    """And none of the flags that it might have been given."""
    monkeypatch.setenv("RIGIDFX_KERNEL_FLAGS", flags)
    monkeypatch.setenv("PATH", str(cache))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(rf.CompilerError, match=r"cannot be run .*gcc, libc6-dev.* variable CC"):
        compile_form()


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
