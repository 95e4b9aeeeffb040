"""Signals that end a run after the step that it is in: Ctrl-C, SIGTERM and SIGUSR1.

Of several runs that are open the newest is told: one whose loop was left by an error stays open
until Python frees it, and hears nothing any more.
"""

from __future__ import annotations

import os
import signal
import threading
from contextlib import suppress
from typing import Any, ClassVar

__all__ = ["Signals"]

ALL = signal.SIGINT, signal.SIGTERM, signal.SIGUSR1  # mpirun hands the last one on


class Signals:
    """Signals that a run hears.

    Attributes:
        heard: Number of a signal that has come and has ended nothing yet, else 0.
    """

    _open: ClassVar[list[Signals]] = []
    _former: ClassVar[dict[int, Any]] = {}  # handlers before the first of them

    def __init__(self, tells: bool) -> None:
        """Hear nothing yet.

        Args:
            tells: Whether this rank says what a signal does.
        """
        self._tells, self.heard = tells, 0

    def begin(self) -> None:
        """Hear signals that would end the process; in the main thread only."""
        if threading.current_thread() is not threading.main_thread():
            return
        self._open.append(self)
        for number in ALL:
            before = signal.getsignal(number)
            if before in (signal.SIG_DFL, signal.default_int_handler):
                self._former[number] = signal.signal(number, _hear)

    def end(self) -> None:
        """Hear them no more. One that has ended nothing is sent again, half a second later.

        While a generator is closed Python ignores all exceptions.
        """
        with suppress(ValueError):
            self._open.remove(self)
        while self._former and not self._open:
            number, handler = self._former.popitem()
            if signal.getsignal(number) is _hear:
                signal.signal(number, handler)
        if self.heard:
            threading.Timer(0.5, os.kill, (os.getpid(), self.heard)).start()

    def hear(self, number: int) -> None:
        """Have the run end after this step; at once if it was told before."""
        if self.heard:
            self.heard = 0
            raise KeyboardInterrupt
        self.heard = number
        if self._tells:
            with suppress(OSError):
                os.write(2, b"\nrigidfx: the run ends after this step; once more ends it at once\n")


def _hear(number: int, frame: Any) -> None:
    """Tell the newest run."""
    if Signals._open:
        Signals._open[-1].hear(number)
