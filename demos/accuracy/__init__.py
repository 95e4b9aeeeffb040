"""Parts of `accuracy_vs_time.py`: structures, their runs, and a picture."""

from .picture import draw
from .runs import Run, measured
from .structure import Setting, Structure

__all__ = ["Run", "Setting", "Structure", "draw", "measured"]
