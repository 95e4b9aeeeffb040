"""What is in the way in the cache of compiled forms."""

from __future__ import annotations

import logging
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
import ufl
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base import form_cache
from rigidfx.flexible import kernels
from rigidfx.flexible.kernels import Kernel

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
