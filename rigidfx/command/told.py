"""Errors and warnings of rigidfx as messages of the command."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from rigidfx.base.errors import RigidfxError, RigidfxWarning, SceneError
from rigidfx.base.warning import worded
from rigidfx.command.parser import RankParser
from rigidfx.command.words import in_options

__all__ = ["told"]


@contextmanager
def told(parser: RankParser) -> Iterator[None]:
    """Stop all ranks over an error of rigidfx, which all have: a message instead of a traceback.

    Warnings are lines, without the place in a script that Python shows. Both name options.
    """
    try:
        with worded(in_options), _in_lines():
            yield
    except SceneError as error:  # of what is asked for
        parser.error(in_options(str(error)))
    except RigidfxError as error:  # of the run
        parser.exit(1, f"{parser.prog}: {type(error).__name__}: {in_options(str(error))}\n")


@contextmanager
def _in_lines() -> Iterator[None]:
    """Show warnings of rigidfx as lines, above a bar of progress."""
    before = warnings.showwarning

    def show(message: Any, category: type[Warning], *place: Any, **how: Any) -> None:
        if issubclass(category, RigidfxWarning):
            tqdm.write(f"rigidfx: warning: {in_options(str(message))}", file=sys.stderr)
        else:
            before(message, category, *place, **how)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = before
