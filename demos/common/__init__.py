"""What all demos share: how one starts, what goes beside its run, and how it ends.

Importing it makes rigidfx and the meshes of this checkout importable.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from .finish import conclude, write, write_json
from .numbers import nonnegative, number, positive
from .pair import Pair
from .reports import curve, energy_jump, events_of, freezes_of
from .start import ROOT, Parser, chosen, comm, say

__all__ = [
    "ROOT", "Pair", "Parser", "chosen", "comm", "conclude", "curve", "energy_jump",
    "events_of", "freezes_of", "nonnegative", "number", "positive", "say", "write",
    "write_json",
]  # fmt: skip
