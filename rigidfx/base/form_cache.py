"""Compiled forms in FFCx's cache, which processes share: one compiles, others wait, none for ever.

FFCx takes a source file without a result for another process's work in progress. So who may be
compiling holds a shared lock, which the system takes back when a process ends: a source is left
over if nobody holds it. A damaged result cannot be loaded and is removed. A process looks for a
large form once, and small ones have a folder, as FFCx reads the names of all files for each form.
Variables of expressions are numbered from zero here; UFL's running numbers would compile an
expression for each scene.
"""

import fcntl
import logging
import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import ufl
from cffi import VerificationError
from dolfinx import fem, jit
from mpi4py import MPI
from ufl.classes import Label
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from rigidfx.base.c_library import raise_uncompiled
from rigidfx.base.errors import on_rank_0
from rigidfx.base.files import lock
from rigidfx.base.log import LOGGER, announce

LOCK = "rigidfx.lock"  # beside the compiled forms

# Options for small forms, in a folder of their own; who holds the lock is waited for longer.
SMALL = {"timeout": 10, "cache_dir": str(Path(jit.get_options()["cache_dir"], "small"))}

# Processor time of compilers for the forms of a scene of St.Venant–Kirchhoff with a pressure and
# numerical damping, over the order of cells, on an EPYC of 2024 [s].
SECONDS = 2
SLOWER = 5  # times as long as that: a slow or busy processor, another material, enhanced strains

SPENT: list[float] = []  # times of this process in compilations [s]

# Forms this process has compiled, by signature and options; a UFL form in them would keep its mesh.
FOUND: dict[tuple[str, str], fem.forms.CompiledForm] = {}
TOLD_AFTER = 3  # seconds of waiting

ANNOUNCED: set[str] = set()  # what this process has said that it compiles


class CacheLog(logging.Filter):
    """Listens to FFCx's log, tells on standard error of long waits, keeps the source it found."""

    def __init__(self, shown: int, what: str) -> None:
        """Begin with nothing heard; records from the level `shown` on go on."""
        super().__init__()
        self.source: Path | None = None
        self._shown, self._what, self._waits = shown, what, 0
        self._began: float | None = None  # when a compilation began

    def filter(self, record: logging.LogRecord) -> bool:
        """Hear a record; whether it goes on."""
        text = record.getMessage()
        if found := re.search(r"Cached C file already exists: (\S.*\.c)$", text):
            self.source = Path(found[1])
        if text.startswith("Compiler stage 1:"):
            self._began = time.perf_counter()
            if self._what and self._what not in ANNOUNCED:
                ANNOUNCED.add(self._what)
                announce(f"compiling {self._what}")
        if text.startswith("JIT C compiler finished") and self._began is not None:
            took = time.perf_counter() - self._began
            LOGGER.info("compiled in %.1f s", took)
        if text.startswith("Waiting for") and self.source is not None:
            self._waits += 1
            if self._waits == TOLD_AFTER + 1:
                LOGGER.warning(
                    "rigidfx waits for another process to compile a form. Where none does so any "
                    "more (one may have been stopped), remove '%s'.",
                    self.source,
                )
        return record.levelno >= self._shown


@contextmanager
def listening(what: str = "") -> Iterator[CacheLog]:
    """Around a compilation of forms in words, whose option verbosity must be logging.INFO."""
    logger, root = logging.getLogger("ffcx"), logging.getLogger()
    handlers = root.handlers.copy()  # FFCx takes them away, for good where the compiler fails
    log, level = CacheLog(logger.getEffectiveLevel(), what), logger.level
    logger.addFilter(log)
    try:
        yield log
    finally:
        logger.setLevel(level)
        logger.removeFilter(log)
        root.handlers = handlers


def compile_form(comm: MPI.Intracomm, form: ufl.Form, options: dict[str, Any]) -> Any:
    """Compile a form, or wait for another process that does; rank 0 compiles. Collective.

    This function and those below raise the errors of `raise_uncompiled`, and an `OutputError` if a
    file that is in the way cannot be removed.
    """
    key = form.signature(), repr(sorted(jit.get_options(options).items()))
    if not comm.allreduce(key in FOUND, op=MPI.LAND):
        compiled = _past_the_cache(
            comm, options, lambda **how: fem.compile_form(comm, form, **how), _announced(form)
        )
        FOUND[key] = replace(compiled, ufl_form=None)
    return replace(FOUND[key], ufl_form=form)


def form_on(comm: MPI.Intracomm, form: ufl.Form) -> fem.Form:
    """A small form for one use, bound to the cells or facets of its measures. Collective."""
    return _past_the_cache(comm, SMALL, lambda **how: fem.form(form, **how))


def compile_expression(
    comm: MPI.Intracomm, expression: Any, points: Any, options: dict[str, Any]
) -> fem.Expression:
    """Compile an expression at points of the reference cell, shape (points, 3). Collective."""
    named = map_expr_dag(_Numbered(), expression)
    return _past_the_cache(
        comm, options, lambda **how: fem.Expression(named, points, comm=comm, **how)
    )


def compile_values(
    comm: MPI.Intracomm, expression: Any, points: Any, options: dict[str, Any]
) -> tuple[Any, Any]:
    """FFCx's kernel of an expression, which kernels of ours call, and its module. Collective.

    Coefficients of the expression need no values. Points have the shape (points, 3).
    """
    named = map_expr_dag(_Numbered(), expression)
    return _past_the_cache(
        comm, options, lambda **how: jit.ffcx_jit(comm, (named, points), **how)[:2]
    )


class _Numbered(MultiFunction):
    """An expression with its variables numbered from zero."""

    expr = MultiFunction.reuse_if_untouched

    def __init__(self) -> None:
        super().__init__()
        self._labels: dict[Label, Label] = {}

    def label(self, own: Label) -> Label:
        """The label of a variable, which equal variables share."""
        return self._labels.setdefault(own, Label(len(self._labels)))


def _announced(form: ufl.Form) -> str:
    """The forms that are compiled for a scene, and about how long that takes."""
    elements = [w.ufl_element() for w in (*form.arguments(), *form.coefficients())]
    order = max((e.degree for e in elements), default=1)
    cell = form.ufl_domains()[0].ufl_coordinate_element().cell_type.name
    if "hedron" not in cell or order > 2:
        return ""
    kind = cell.replace("hedron", "hedra")
    least, most = SECONDS * order, SLOWER * SECONDS * order
    return (
        f"the forms of {kind} of order {order}, once for all scenes of this kind: about {least} to "
        f"{most} s"
    )


def _past_the_cache(
    comm: MPI.Intracomm, options: dict[str, Any], compiled: Callable[..., Any], what: str = ""
) -> Any:
    """The result of a compilation, repeated until nothing is in its way. Collective."""
    began = time.perf_counter()
    while True:
        heard = {"verbosity": logging.INFO}  # what `listening` is to hear
        with _may_compile(comm, options), listening(what) as log:
            try:
                return compiled(form_compiler_options=heard, jit_options=options)
            except (RuntimeError, OSError, ImportError, VerificationError) as error:
                found = [source for source in comm.allgather(log.source) if source is not None]
                if not found:
                    raise_uncompiled(comm, error, jit.get_options(options)["cache_dir"])
                    raise
                damaged = isinstance(error, ImportError)
            finally:
                SPENT.append(time.perf_counter() - began)
                began = time.perf_counter()
        damaged = comm.allreduce(damaged, op=MPI.LOR)
        _clear(comm, found[0], damaged)


@contextmanager
def _may_compile(comm: MPI.Intracomm, options: dict[str, Any]) -> Iterator[None]:
    """Hold the shared lock on rank 0."""
    if comm.rank:
        yield
        return
    folder = Path(jit.get_options(options)["cache_dir"])
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock(stack.enter_context((folder / LOCK).open("w")).fileno(), fcntl.LOCK_SH)
        except OSError:  # what is there may be read; what has to be written says what is wrong
            pass
        yield


def _clear(comm: MPI.Intracomm, source: Path, damaged: bool) -> None:
    """Wait for a form, or remove obstacles to it, or raise the remedy. Collective."""

    def clear() -> None:
        if not damaged:
            wait_or_clear(source)
        for file in list(source.parent.glob(f"{source.stem}.*")) if damaged else ():
            file.unlink(missing_ok=True)

    def remedy(error: Exception) -> str:
        said = getattr(error, "strerror", None) or error
        return (
            f"The compiled form '{source.with_suffix('')}.*' is damaged, or its compilation was "
            f"stopped, and it cannot be removed from here ({said}): remove these files."
        )

    on_rank_0(comm, clear, remedy)


def wait_or_clear(source: Path) -> None:
    """Wait until the form of a C file is compiled; if nobody compiles, remove the file."""
    said = False
    while source.exists() and not source.with_suffix(".c.cached").exists():
        with (source.parent / LOCK).open("w") as file, suppress(BlockingIOError):
            lock(file.fileno())
            source.unlink(missing_ok=True)
            return
        if not said:
            logging.getLogger(__name__).warning(
                "waiting for another process, which compiles %s", source
            )
            said = True
        time.sleep(0.5)
