"""What `accuracy_vs_time.py` is made of: settings, runs, their errors, a table and a picture."""

from .picture import draw
from .plans import plan
from .runs import known, run
from .setting import Setting
from .structure import Points, Structure
from .study import Study, written_as_csv

__all__ = [
    "Points", "Setting", "Structure", "Study", "draw", "known", "plan", "run",
    "written_as_csv",
]  # fmt: skip
