"""FFCx names the forms that it compiles, and files that it waits for or cannot load."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigidfx.base.log import LOGGER, announce

__all__ = ["CacheLog", "listening"]

TOLD_AFTER = 3  # seconds of waiting

ANNOUNCED: set[str] = set()  # what this process has said that it compiles


class CacheLog(logging.Filter):
    """Listens to FFCx's log, and tells on standard error of long waits.

    Attributes:
        source: The source file that was found in the cache, if one was.
    """

    def __init__(self, shown: int, what: str) -> None:
        """Begin with nothing heard.

        Args:
            shown: Level from which on records go where they would go otherwise.
            what: The form, and the seconds of its compilation; said once by each process.
        """
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
    """Around a compilation, whose option verbosity must be logging.INFO.

    Args:
        what: The form, and the seconds of its compilation.
    """
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
