"""What all demos share: how one starts, what goes beside its run, and how it ends.

Importing it makes rigidfx and the meshes of this checkout importable.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rigidfx.command.main import conclude, write_json
from rigidfx.command.options import nonnegative, number, positive, say
from rigidfx.command.pair import KeptRun, curve, energy_drift, energy_jump, events_of, freezes_of

from .balance import Balance
from .grids import arrays, block_of, boxes, hexahedra, on_first_rank, ring
from .start import ROOT, Parser, chosen, comm, draw, go, share_of, write
