"""Options that all ranks read, of which rank 0 says the fault."""

from __future__ import annotations

import argparse
import re
import sys
from typing import Any, NoReturn

from mpi4py import MPI

__all__ = ["RankParser", "say"]


def say(text: str) -> None:
    """Print on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


class RankParser(argparse.ArgumentParser):
    """A parser for scripts that run on several ranks: rank 0 alone prints."""

    def __init__(self, *given: Any, **how: Any) -> None:
        """Make a parser for which -1e4 is a number, as -10000 is, and no option."""
        super().__init__(*given, **how)
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

    def error(self, message: str) -> NoReturn:
        """Stop with a message and status 2."""
        self.exit(2, f"{self.prog}: {message}\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)
