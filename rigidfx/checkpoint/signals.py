"""Signals that end a run after the step that it is in: Ctrl-C, SIGTERM and SIGUSR1.

Of several runs that are open the one that ends a step next does so. One whose loop was left by an
error stays open until Python frees it, and ends no step any more.
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
    """Signals that a run hears, as long as it is open."""

    _open: ClassVar[list[Signals]] = []
    _former: ClassVar[dict[int, Any]] = {}  # handlers before the first of them
    _heard: ClassVar[int | None] = None  # a signal that has come and has ended nothing yet
    _tells: ClassVar[bool] = True  # whether this process says what a signal does

    @property
    def heard(self) -> int:
        """Number of a signal that is to end a run, else 0."""
        return Signals._heard or 0

    def served(self) -> None:
        """Take note that it ends this run."""
        Signals._heard = None

    def begin(self, tells: bool) -> None:
        """Hear signals that would end the process; in the main thread only.

        Args:
            tells: Whether this rank says what a signal does.
        """
        if threading.current_thread() is not threading.main_thread():
            return
        Signals._tells = tells
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
        if self._open:
            return
        while self._former:
            number, handler = self._former.popitem()
            if signal.getsignal(number) is _hear:
                signal.signal(number, handler)
        if heard := self.heard:
            self.served()
            threading.Timer(0.5, os.kill, (os.getpid(), heard)).start()


def _hear(number: int, frame: Any) -> None:
    """Have a run end after its step; at once if it was told before."""
    if Signals._heard:
        Signals._heard = None
        raise KeyboardInterrupt
    Signals._heard = number
    if Signals._tells:
        with suppress(OSError):
            os.write(2, b"\nrigidfx: the run ends after this step; once more ends it at once\n")
