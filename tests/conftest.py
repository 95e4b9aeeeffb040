"""What every test gets: folders of meshes and demos on the path, PETSc objects freed after it.

Whole folders of tests are divided between two processes, by pytest-xdist where that is installed:
the suite takes a little more than half of its time. `-n 0` keeps them in one, and so do a single
file, --pdb, -s and mpirun, whose ranks are the processes then.
"""

import gc
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from mpi4py import MPI

WORKERS = 2  # more get in each other's way, as tests start ranks of their own
LAUNCHED = "OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"  # what mpirun tells its ranks
LONG = "parallel", "demo", "slow", "convergence"  # markers of tests that come first, in this order

# Ranks that wait for each other let others work meanwhile. Beside a busy process two ranks that did
# not took five times the processor time and six times as long.
os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
os.environ.setdefault("MPIR_CVAR_ENABLE_HEAVY_YIELD", "1")  # MPICH: to sleep, not to ask again
os.environ.setdefault("MPIR_CVAR_POLLS_BEFORE_YIELD", "1")

# Tests compile hundreds of forms, and run each on few cells: these flags take two thirds of the
# compiler's time that the default takes, and up to 1.5 times the kernels'. Unoptimised sums would
# take three times. `test_form_cache.py` compares them with the default's.
os.environ.setdefault(
    "RIGIDFX_KERNEL_FLAGS",
    "-O1 -g0 -march=native -ftree-loop-vectorize -fvect-cost-model=dynamic -ffp-contract=fast "
    "-fno-math-errno -fno-trapping-math -fassociative-math -fno-signed-zeros -freciprocal-math",
)

ROOT = Path(__file__).resolve().parent.parent
sys.path += [
    str(ROOT),
    str(ROOT / "meshes"),
    str(ROOT / "demos"),
    str(ROOT / "demos" / "benchmarks"),
]

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # DOLFINx warns about packages it could use and does not find
    import rigidfx.base.dolfinx_first  # noqa: F401

    # isort: split
    import dolfinx.jit

# Another process may be compiling a form that is needed here, on a busy machine.
dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (120, "")

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


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Divide whole folders of tests between processes; ranks of mpirun are refused."""
    if not config.pluginmanager.hasplugin("xdist") or "PYTEST_XDIST_WORKER" in os.environ:
        return  # a worker that started workers of its own would start them without end
    option = config.option
    if any(name in os.environ for name in LAUNCHED):
        if option.numprocesses:
            raise pytest.UsageError("pytest's -n and mpirun do not go together: leave one out")
        return
    folders = any(Path(argument.split("::")[0]).is_dir() for argument in config.args)
    watched = option.usepdb or option.capture == "no" or option.collectonly
    cores = len(os.sched_getaffinity(0))
    if option.numprocesses is None and folders and not watched and cores >= WORKERS:
        option.numprocesses = WORKERS
    # What shares a fixture goes to one process; xdist may have said "load" before.
    if option.numprocesses and option.dist in ("no", "load"):
        option.dist = "loadgroup"


def pytest_configure() -> None:
    """Give each process cores of its own, also for the ranks that it starts.

    Ranks on one core hand it to each other where they wait. Spread over cores beside other work
    they took 1.4 times the processor time, as one waits for another that has no core just then.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw").removeprefix("gw")
    if worker.isdecimal():
        count = int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        mine = sorted(os.sched_getaffinity(0))[int(worker) :: count]
        if mine:
            os.sched_setaffinity(0, mine)


@pytest.hookimpl(tryfirst=True)  # before xdist looks for groups
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long tests first, so that no process is left with one; fixtures of a module made once.

    One process alone starts ranks: five or six ranks at a time on two cores wait for each other
    most of theirs.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        config.option.loadgroup = True  # a worker knows the command line only
    of_ranks = {item.path for item in items if item.get_closest_marker("parallel")}
    for item in items if config.pluginmanager.hasplugin("xdist") else ():
        fixtures = item._fixtureinfo.name2fixturedefs.values()
        shared = any(definition.scope == "module" for (*_, definition) in fixtures)
        if item.get_closest_marker("parallel") or (shared and item.path in of_ranks):
            item.add_marker(pytest.mark.xdist_group("ranks"))
        elif shared:
            item.add_marker(pytest.mark.xdist_group(item.path.name))
    order = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: min((order.get(m.name, 9) for m in item.iter_markers()), default=9))


@hypothesis.given(hypothesis.strategies.none())
def _hypothesis_begins(_: None) -> None:
    """Run hypothesis once."""


def pytest_collection_finish() -> None:
    """Spare the collections after each test what imports have made: 0.1 s of each."""
    _hypothesis_begins()  # it looks for who holds its random numbers, and would see nobody then
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _free_petsc_objects() -> Iterator[None]:
    """Free PETSc objects at the same place on all ranks, not whenever Python collects them."""
    yield
    if MPI.COMM_WORLD.size > 1 or gc.get_count()[2]:  # a scene is some thousand objects
        gc.collect()
    MPI.COMM_WORLD.barrier()


@pytest.fixture
def hears() -> Iterator[None]:
    """A shell's job in the background ignores SIGINT, and so do the processes it starts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def petsc_options() -> Iterator[dict[str, object]]:
    """PETSc's options database under rigidfx's prefix; what a test puts in is taken out again."""
    from petsc4py import PETSc

    database = PETSc.Options("rigidfx_")
    before = set(database.getAll())
    yield database
    for name in set(database.getAll()) - before:
        database.delValue(name)
