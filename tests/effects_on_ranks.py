"""Histories of scenes with every effect, for as many ranks as there are."""

import sys
from unittest.mock import patch

import numpy as np
from balances import follow
from parallel import report
from test_effects import EFFECTS, SPIN, bar

import rigidfx as rf
from rigidfx.coupling import dealt_rows

rows = []
least = -1.0 if "dealt" in sys.argv else np.inf  # of a rank's cells, for them to be dealt


class AllCells(dealt_rows.DealtCells):
    """Copies of all cells, as if the others had become rigid later on."""

    def __init__(self, space, cells):
        super().__init__(space, np.arange(space.mesh.topology.index_map(3).size_local))


copies = AllCells if "all" in sys.argv else dealt_rows.DealtCells
with patch.multiple(dealt_rows, LOPSIDED=-1.0, FEW=least, DealtCells=copies):
    for parts in ([], [rf.Rigid("middle")], [rf.Rigid("end")]):
        # A body may not be held in part.
        effects = [e for e in EFFECTS.values() if not isinstance(e, rf.effects.Support)]
        scene = bar(*effects, SPIN, *parts, mass=sys.argv[1])
        books, reports = follow(scene, 0.1, 1.0)
        assert books.worst <= 1e-11, books
        for r in reports:
            rows.append(
                [
                    r.kinetic,
                    r.strain,
                    r.springs,
                    *r.linear_momentum,
                    *r.angular_momentum,
                    r.work_of_loads,
                    sum(r.dissipated.values()),
                ]
            )
report(rows)
