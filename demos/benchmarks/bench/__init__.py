"""What all benchmarks share: a bar, runs that take their steps in turn, a start and an end.

Importing it makes `common`, rigidfx and the meshes of this checkout importable.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from common import Parser, chosen, conclude, write

from .bar import DT, MATERIAL, PUSH, bar, cells_of_bar
from .parts import run_parts
from .processes import without_mpi
from .turns import Turns, in_turn, timed

__all__ = [
    "DT", "MATERIAL", "PUSH", "Parser", "Turns", "bar", "cells_of_bar", "chosen", "conclude",
    "in_turn", "run_parts", "timed", "without_mpi", "write",
]  # fmt: skip
