"""Warnings that reach the user: on rank 0, with the line of the user's that led to them.

A run's log.txt has them, too.

FFCx, when it is imported, hands all of Python's warnings over to `logging`, which drops them where
nobody has given it a handler: no script and no notebook would ever show one.
"""

import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import dolfinx  # noqa: F401 - imports FFCx, whose doing is undone below
from mpi4py import MPI

from rigidfx.base.errors import RigidfxWarning
from rigidfx.base.log import keep

PACKAGE = str(Path(__file__).resolve().parent.parent)

_wordings: list[Callable[[str], str]] = []  # under way


@contextmanager
def worded(wording: Callable[[str], str]) -> Iterator[None]:
    """Reword warnings in log.txt meanwhile; Python's filters see them as they are."""
    _wordings.append(wording)
    try:
        yield
    finally:
        _wordings.remove(wording)


def warn(comm: MPI.Intracomm, message: str) -> None:
    """Warn on rank 0, as from the first line outside this package that led here; all ranks call."""
    if comm.rank != 0:
        return
    text = message
    for wording in _wordings:
        text = wording(text)
    keep(f"warning: {text}")
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, RigidfxWarning, stacklevel=level)


def _show() -> None:
    """Show warnings in place of `logging`, unless it has a handler that uses them."""
    loggers = logging.getLogger("py.warnings"), logging.getLogger()
    handlers = [handler for logger in loggers for handler in logger.handlers]
    if all(isinstance(handler, logging.NullHandler) for handler in handlers):
        logging.captureWarnings(False)


_show()
