"""Problems that others publish: cases of the benchmark `known_problems.py`."""

from .princeton import PRINCETON
from .row import Found, Problem
from .spin_up import SPIN_UP

__all__ = ["PROBLEMS", "Found", "Problem"]

PROBLEMS: dict[str, Problem] = {
    "Princeton beam": PRINCETON,
    "spin-up beam": SPIN_UP,
}
