"""What all demos share: how one starts, what goes beside its run, and how it ends.

Importing it makes rigidfx and the meshes of this checkout importable.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rigidfx.command.main import conclude, write_json
from rigidfx.command.options import nonnegative, number, positive, say
from rigidfx.command.pair import KeptRun, Pair, curve, energy_jump, events_of, freezes_of

from .finish import draw, write
from .start import ROOT, Parser, chosen, comm

__all__ = [
    "ROOT", "KeptRun", "Pair", "Parser", "chosen", "comm", "conclude", "curve", "draw",
    "energy_jump", "events_of", "freezes_of", "nonnegative", "number", "positive", "say", "write",
    "write_json",
]  # fmt: skip
