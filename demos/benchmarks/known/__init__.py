"""Problems that others publish: cases of the benchmark `known_problems.py`."""

from . import slender, motions, machines, nafems, contacts  # noqa: I001 (the order of the table)
from .row import PROBLEMS, Found, Problem
