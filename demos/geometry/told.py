"""Errors of rigidfx as messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from common import Parser

import rigidfx as rf


@contextmanager
def told(parser: Parser) -> Iterator[None]:
    """Stop all ranks over an error of rigidfx, which all have: a message instead of a traceback."""
    try:
        yield
    except rf.SceneError as error:  # of what is asked for
        parser.error(str(error))
    except rf.RigidfxError as error:  # of the run
        parser.exit(1, f"{parser.prog}: {type(error).__name__}: {error}\n")
