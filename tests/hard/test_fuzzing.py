"""Random scenes: a clear error before the first step, or a run that keeps its balances.

A few of them, as each has forms of its own to compile; `demos/hard_cases.py --all` tries hundreds.
Run as a script under mpirun, this file tries the drafts of a JSON file.
"""

import json
import sys
import warnings
from collections import Counter
from pathlib import Path
from unittest.mock import patch

import numpy as np
import parallel
import pytest
from hardcases.drafts import BALANCED, ERROR, drafts, outcome, try_scenes
from hypothesis import given, settings
from mpi4py import MPI

import rigidfx as rf
from rigidfx.coupling import dealt_rows

STILL = {
    **{"cell": "hexahedron", "two materials": True, "nu": 0.0, "xi": 0.0, "damping": 0.0},
    **{"mass": "lumped", "element": "standard", "speed": 0.0, "loads": [], "supports": []},
    **{"linear": (0.0, 0.0, 0.0), "angular": (0.0, 0.0, 0.0), "contacts": []},
    **{"criterion": None, "control": None, "accuracy": None},
}
PLANE = {"kind": "plane", "where": "x0", "away": 0.0, "friction": 0.0, "window": None}
LOADS = [
    {"kind": "Traction", "where": "x0", "time": "constant", "window": (5.820562040326433, 10.5)}
    | {"value": (0.30711099095652883, 0.0, 0.0)},
    {"kind": "Traction", "where": "x0", "time": "ramp", "window": None, "value": (0.0, 0.0, 0.0)},
]
# Drafts that have failed once.
FAILED = {
    "no energy and no momentum": STILL
    | {"cells": (2, 1, 1), "edges": (0.0, 0.0, 0.0), "E": (2.0, 0.0), "rho": (0.0, 2.0)}
    | {"dt": 1.0, "steps": 4, "rigid": ["middle"], "contacts": [PLANE]},
    "a tolerance of 0/0": STILL
    | {"cells": (5, 1, 1), "edges": (0.50996827248677, 0.0, 0.0), "E": (2.0, 1.4202775978660451)}
    | {"rho": (0.0, -1.661018681077869), "dt": 0.0, "steps": 11, "rigid": ["left"]}
    | {"loads": LOADS, "accuracy": 0.3},
}

EXAMPLES = 8
ON_RANKS = 4

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself"),
    pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning"),
]


def test_random_scenes():
    """On one rank; a failing scene is shown as small as hypothesis can make it."""
    seen = try_scenes(EXAMPLES)
    assert seen[BALANCED] >= 0.3 * EXAMPLES  # else the scenes try nothing
    assert seen[ERROR] > 0  # nor do they all run


@pytest.mark.parametrize("draft", FAILED.values(), ids=FAILED)
def test_scenes_that_have_failed(draft):
    """They do not again."""
    assert outcome(draft) in (ERROR, BALANCED)


@pytest.mark.parallel
def test_random_scenes_on_several_ranks(tmp_path):
    """No rank waits for ever, and what becomes of a scene does not depend on the ranks.

    Nor on whether flexible cells are dealt out among them, as in every other scene.
    """
    collected = []

    @settings(max_examples=ON_RANKS)
    @given(drafts)
    def collect(draft):
        collected.append(draft)

    collect()
    file = tmp_path / "drafts.json"
    file.write_text(json.dumps(collected))
    found = parallel.run(__file__, 2, 60 + 20 * len(collected), str(file))
    print(dict(Counter(found)))
    assert len(found) == len(collected)
    alone = [outcome(draft) for draft in collected]
    pairs = list(zip(found, alone, collected, strict=True))
    assert not [pair for pair in pairs if pair[0] not in (ERROR, BALANCED)]
    assert not [pair for pair in pairs if pair[0] != pair[1]]


if __name__ == "__main__":
    warnings.simplefilter("ignore", rf.RigidfxWarning)
    results = []
    for k, draft in enumerate(json.loads(Path(sys.argv[1]).read_text())):
        few = 0.5 if k % 2 else np.inf  # every other scene has its cells dealt
        with patch.multiple(dealt_rows, LOPSIDED=-1.0, FEW=few):
            results.append(outcome(draft))
    every = MPI.COMM_WORLD.gather(results)
    if MPI.COMM_WORLD.rank == 0:
        same = all(other == results for other in every)
        parallel.report(results if same else ["ranks differ"])
