"""What all benchmarks share: a bar, runs that take their steps in turn, a start and an end.

Importing it makes `common`, rigidfx and the meshes of this checkout importable.
"""

import sys
from pathlib import Path

if (demos := str(Path(__file__).resolve().parents[2])) not in sys.path:
    sys.path.insert(0, demos)

from common import Parser, chosen, conclude, write

from .shared import (
    DT,
    MATERIAL,
    PUSH,
    Turns,
    bar,
    by_another_python,
    cells_of_bar,
    run_parts,
    timed,
    without_mpi,
)  # fmt: skip

__all__ = [
    "DT", "MATERIAL", "PUSH", "Parser", "Turns", "bar", "by_another_python", "cells_of_bar",
    "chosen", "conclude", "run_parts", "timed", "without_mpi", "write",
]  # fmt: skip
