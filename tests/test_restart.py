"""A run that goes on from a checkpoint is the run that left it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import parallel
import pytest
from memory import differences
from restarted import SCENES, row, seen

import rigidfx as rf
import rigidfx.error.equations

NO_WARNINGS = pytest.mark.filterwarnings("ignore::rigidfx.base.errors.RigidfxWarning")


STEPS = dict.fromkeys(SCENES, 15) | dict.fromkeys(("control", "all wake", "error", "modes"), 70)


def parts(run):
    made = run.gi_frame.f_locals
    return [made["run"], made["looks"]]


@NO_WARNINGS
@pytest.mark.parametrize("name", SCENES)
def test_a_run_goes_on_bit_by_bit(name, tmp_path, monkeypatch):
    """All that its objects know after the next step, and its reports to the end."""
    if name == "modes":
        monkeypatch.setattr(rigidfx.error.equations, "LARGEST", 100)
    make, dt, t_end, more = SCENES[name]
    steps = STEPS[name]
    checkpoint = rf.Checkpoint(tmp_path / "whole", steps=steps)
    whole = rf.simulate(make(), dt, t_end, checkpoint=checkpoint, **more)
    rows = []
    for report in whole:
        rows.append(row(report))
        if report.step == steps + 1:
            shutil.copytree(tmp_path / "whole", tmp_path / "cut")
            again = rf.resume(tmp_path / "cut", make())
            rest = [row(next(again))]
            assert differences(parts(whole), parts(again)) == []
    rest += [row(report) for report in again]
    assert np.array_equal(rows[steps + 1 :], rest, equal_nan=True)
    if name in ("error", "modes", "all wake"):
        assert sum(r[4] for r in rows[: steps + 1]) > 0
        assert sum(r[4] for r in rest) > 0


@NO_WARNINGS
@pytest.mark.parallel
@pytest.mark.parametrize("name", ["error", "modes", "pair", "joined", "rigid falls"])
def test_other_ranks_go_on(name, tmp_path, monkeypatch):
    """One rank begins, three go on, two end: rows and switches are those of one rank."""
    if name == "modes":
        monkeypatch.setattr(rigidfx.error.equations, "LARGEST", 100)
    every, script = STEPS[name], Path(__file__).with_name("restarted.py")
    alone = np.array(seen(name, tmp_path / "alone", 10**6, every))
    (tmp_path / "cut").mkdir()
    rows = []
    for ranks, last in ((1, every), (3, 2 * every), (2, 10**6)):
        asked = name, str(tmp_path / "cut"), str(last), str(every)
        found = parallel.run(script, ranks, 300, *asked)
        rows += found if last > 10**5 else found[:-1]
    several = np.array(rows, dtype=float)
    assert (several[:, [0, 3, 4, 5]] == alone[:, [0, 3, 4, 5]]).all()
    for group in (slice(7, 8), slice(8, 14), slice(14, 17), slice(17, 20)):
        ours, whole = (np.nan_to_num(rows[:, group]) for rows in (several, alone))
        assert np.abs(ours - whole).max() <= 1e-9 * np.abs(whole).max()
