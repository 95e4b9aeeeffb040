"""PETSc's options: where they come from, which are honoured, which refused: docs/solver.md.

An option under the prefix `rigidfx_` is taken from the command line behind `--petsc`, else from
PETSC_OPTIONS, else from `simulate(…, petsc_options=…)`. Options known to be ignored, or to end in
an error of PETSc's own, are refused by name. Of others from Python a run warns if none of PETSc's
objects has looked them up once it has solved. petsc4py 3.22 does not pass these marks on, so
PETSc's library, which it has loaded, is asked.
"""

import ctypes
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import shown
from rigidfx.base.warning import warn
from rigidfx.linear.linear_solver import PREFIX, default_options

Monitor = Callable[[int, float], None]

FAMILIES = ("snes_", "ksp_", "pc_", "mat_", "sub_", "mg_")
OWN_TEST = "Newton stops by a test of its own: take snes_rtol (1e-12) and snes_max_it (25)"
ASSEMBLED = "the tangent is an assembled matrix"
REFUSED = {
    "snes_atol": OWN_TEST,
    "snes_stol": OWN_TEST,
    "snes_divergence_tolerance": OWN_TEST,
    "snes_max_funcs": OWN_TEST,
    "snes_convergence_test": OWN_TEST,
    "snes_mf": ASSEMBLED,
    "snes_mf_operator": ASSEMBLED,
    "snes_fd": ASSEMBLED,
    "snes_fd_color": ASSEMBLED,
}
NEWTON = "newtonls"
TOLERANCES = ("_rtol", "_atol")
LATE = ("mat_mumps_", "pc_factor_")  # asked for by LU, to which a later step may have to turn


def asked(names: Iterable[str]) -> set[str]:
    """Those names, with their prefix, that have been looked up; all where PETSc cannot tell."""
    used, every, marked = _options_used(), set(names), set()
    if used is None:
        return every
    for name in every:
        answer = ctypes.c_int(0)  # room for an enumeration, and for the one byte of newer PETSc's
        failed = used(None, name.encode(), ctypes.byref(answer))
        if failed or answer.value:
            marked.add(name)
    return marked


@cache
def _options_used() -> Any:
    """PETSc's function that tells; None if there is none."""
    try:
        return ctypes.CDLL(PETSc.__file__).PetscOptionsUsed
    except (AttributeError, OSError):
        return None


@dataclass(frozen=True)
class SolverOptions:
    """A user's options for the solver of a run."""

    # PETSc's options by name, without a prefix; None or "" for those without a value
    options: Mapping[str, Any] = field(default_factory=dict)
    # Called with the number of each Newton iterate and ‖R‖ [N] there, on every rank
    monitor: Monitor | None = None
    _unasked: set[str] = field(default_factory=set, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the record, and the options from elsewhere, or raise a `SceneError`."""
        if not isinstance(self.options, Mapping):
            raise SceneError(
                "simulate: petsc_options must be a dict of PETSc's options without a prefix, such "
                f"as {{'ksp_type': 'gmres'}}, got {shown(self.options)}."
            )
        if self.monitor is not None and not callable(self.monitor):
            raise SceneError(
                "simulate: monitor must be a function of the number of an iterate and its "
                f"residual, got {shown(self.monitor)}."
            )
        values = {name: _text(name, value) for name, value in self.options.items()}
        object.__setattr__(self, "options", MappingProxyType(values))
        self._unasked.update(name for name in values if not name.startswith(LATE))
        _check(PETSc.Options(PREFIX).getAll() | values)

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Around all code that makes solvers and solves in this run; not around a user's code.

        It is a `SceneError` if PETSc cannot solve with the user's options.
        """
        token = _monitor.set(self.monitor)
        try:
            with default_options(PREFIX, **self.options):
                try:
                    yield
                except PETSc.Error as error:
                    raise _named(error) from None
                finally:  # the marks go with the options
                    found = asked(PREFIX + name for name in self._unasked)
                    self._unasked.difference_update(name.removeprefix(PREFIX) for name in found)
        finally:
            _monitor.reset(token)

    def warn_of_unasked(self, comm: MPI.Intracomm) -> None:
        """Warn, once, of options that nobody has asked for; after linear systems were solved."""
        if not self._unasked:
            return
        names = ", ".join(f"'{name}'" for name in sorted(self._unasked))
        self._unasked.clear()
        warn(
            comm,
            f"simulate: petsc_options: no solver at work has asked for {names}, which therefore "
            "had no effect: misspelt, or an option of another solver, or of none (PETSc's "
            "manual pages of SNES, KSP and PC say which there are).",
        )


_monitor: ContextVar[Monitor | None] = ContextVar("monitor", default=None)


def monitor_solves(snes: PETSc.SNES) -> None:
    """Show the iterates of a solver to the monitor of the run at work."""
    if _monitor.get() is None:
        return

    def show(snes: PETSc.SNES, iteration: int, norm: float) -> None:
        monitor = _monitor.get()
        if monitor is None:
            return
        own: Exception | None = None
        try:
            monitor(iteration, norm)
        except Exception as error:  # whatever a user's function may raise
            own = error
        problem = f"simulate: monitor failed with {type(own).__name__}: {own}" if own else None
        try:
            agree(snes.comm.tompi4py(), problem)
        except SceneError as told:
            raise (own or told) from None

    snes.setMonitor(show)


def _named(error: PETSc.Error) -> Exception:
    """The error to raise for an error of PETSc's own: the user's options, where there are any."""
    given = PETSc.Options(PREFIX).getAll()
    if not given:
        return error
    named = " ".join(f"-{PREFIX}{name} {value}".strip() for name, value in sorted(given.items()))
    # Without the numbers of lines of PETSc's own that follow its error code.
    lines = [line.split("] ", 1)[-1] for line in str(error).splitlines()[1:]]
    text = " ".join(line.strip() for line in lines if ") at ./" not in line)
    return SceneError(f"PETSc cannot solve with the options {named}: {text or error}")


def take_arguments(arguments: list[str]) -> None:
    """Give PETSc the options behind `--petsc`, and take them off a script's command line."""
    if "--petsc" not in arguments:
        return
    begin = arguments.index("--petsc")
    options = PETSc.Options()
    options.insertString(" ".join(arguments[begin + 1 :]))
    del arguments[begin:]
    if options.hasName("log_view"):  # too late for PETSc to see it by itself
        PETSc.Log.begin()


def _text(name: Any, value: Any) -> str:
    """A value as PETSc reads it."""
    is_one = isinstance(name, str) and name.startswith(FAMILIES) and name.split() == [name]
    if not is_one or "\0" in name:  # where C's texts end
        raise SceneError(
            f"simulate: petsc_options: {shown(name)} is no option of the solver; names begin with "
            f"{', '.join(FAMILIES)}, without a prefix or '-'."
        )
    if value is None:
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (str, int, float, np.number)):
        with suppress(ValueError):  # of a whole number of 5000 digits
            if "\0" not in (text := str(value)):
                return text
    raise SceneError(
        f"simulate: petsc_options: {name} must be a text or a number, got {shown(value)}."
    )


def _check(options: Mapping[str, str]) -> None:
    for name, value in options.items():
        reason = REFUSED.get(name, "")
        if name == "snes_type" and value != NEWTON:
            reason = f"the solver has to be Newton's method ({NEWTON})"
        if name.endswith(TOLERANCES):
            with suppress(ValueError):  # PETSc itself refuses other texts
                reason = "a tolerance is a number above zero" if float(value) <= 0 else reason
        if reason:
            raise SceneError(f"The option -{PREFIX}{name} {value} cannot be honoured: {reason}.")


take_arguments(sys.argv)
