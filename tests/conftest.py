"""What every test gets: folders of meshes and demos on the path, PETSc objects freed after it."""

from __future__ import annotations

import gc
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from mpi4py import MPI

ROOT = Path(__file__).resolve().parent.parent
sys.path += [str(ROOT), str(ROOT / "meshes"), str(ROOT / "demos")]

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # DOLFINx warns about packages it could use and does not find
    import dolfinx  # noqa: F401

# A run compiles forms and integrates in time: neither deadlines nor a database of failures make
# sense, and every machine is to try the same examples.
hypothesis.settings.register_profile(
    "rigidfx",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=25,
    suppress_health_check=[
        hypothesis.HealthCheck.too_slow,
        hypothesis.HealthCheck.function_scoped_fixture,
    ],
)
hypothesis.settings.load_profile("rigidfx")


@pytest.fixture(autouse=True)
def _free_petsc_objects() -> Iterator[None]:
    """Free PETSc objects at the same place on all ranks, not whenever Python collects them."""
    yield
    gc.collect()
    MPI.COMM_WORLD.barrier()


@pytest.fixture
def petsc_options() -> Iterator[dict[str, object]]:
    """PETSc's options database under rigidfx's prefix; what a test puts in is taken out again."""
    from petsc4py import PETSc

    database = PETSc.Options("rigidfx_")
    before = set(database.getAll())
    yield database
    for name in set(database.getAll()) - before:
        database.delValue(name)
