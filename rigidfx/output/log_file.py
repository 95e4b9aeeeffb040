"""The file with the messages of a run."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

__all__ = ["log_file"]


class _LogFile(logging.FileHandler):
    """A file whose errors are told when it is closed, and not on standard error each time."""

    def handleError(self, record: logging.LogRecord) -> None:
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)


def log_file(path: Path, *, anew: bool) -> logging.Handler:
    """A handler that writes a file, with times; anew, or behind its content."""
    handler = _LogFile(path, mode="w" if anew else "a", encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    return handler
