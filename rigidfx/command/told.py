"""Errors of rigidfx as messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rigidfx.base.errors import RigidfxError, SceneError
from rigidfx.command.parser import RankParser

__all__ = ["told"]


@contextmanager
def told(parser: RankParser) -> Iterator[None]:
    """Stop all ranks over an error of rigidfx, which all have: a message instead of a traceback."""
    try:
        yield
    except SceneError as error:  # of what is asked for
        parser.error(str(error))
    except RigidfxError as error:  # of the run
        parser.exit(1, f"{parser.prog}: {type(error).__name__}: {error}\n")
