"""The file with the messages of a run."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

__all__ = ["LogFile"]


class LogFile(logging.FileHandler):
    """A file with times, whose errors are told when it is closed, not on standard error each time.

    Messages come behind its content, which may be left out later.
    """

    def __init__(self, path: Path) -> None:
        """Open it.

        Args:
            path: The file.

        Raises:
            OSError: If it cannot be written.
        """
        super().__init__(path, mode="a", encoding="utf-8")
        self.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        self._path, self._former = path, path.stat().st_size

    def begin(self) -> None:
        """Leave out what was there when it was opened.

        Raises:
            OSError: If it cannot be written.
        """
        self.flush()
        own = self._path.read_bytes()[self._former :]
        self._path.write_bytes(own)
        self._former = 0

    def handleError(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)
