"""A run that goes on from a checkpoint is the run that left it."""

from __future__ import annotations

import shutil
from functools import partial

import numpy as np
import pytest
from memory import differences

import rigidfx as rf
import rigidfx.error.equations

SOFT, STIFF = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
BOX = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
BOX = BOX.with_cells("stalk", lambda x: x[0] <= 2 + 1e-9)
BOX = BOX.with_cells("block", lambda x: x[0] >= 2 - 1e-9)
HELD, DRAG = rf.Fixed("x0"), rf.MassDamping(1.0)
SINE = rf.Traction("x1", (0, 0, 40.0), time=lambda t: np.sin(2 * np.pi * t / 3) * min(1, t / 3))
BLOW = rf.Traction("y1", (0, 300.0, 0), time=lambda t: max(0.0, 1 - ((t - 2.6) / 0.2) ** 2))
FLOOR = rf.Contact("z0", against=rf.Plane((0, 0, -0.2), (0, 0, 1)), friction=0.3, creep=1e-3)
QUIET = rf.StrainRate(0.003, 0.4)


def bar(*effects, **more):
    materials = {"stalk": SOFT, "block": STIFF}
    return rf.Scene(BOX, materials, effects, probes={"tip": (8, 0.5, 0.5)}, **more)


def block(*effects):
    thrown = rf.Gravity((0.3, 0, -9.81)), rf.InitialVelocity((1.0, 0, 0)), FLOOR
    box = rf.box((0, 0, 0), (1, 1, 1), (2, 2, 2))
    return rf.Scene(box, SOFT, [*thrown, *effects], probes={"tip": (1, 1, 1)})


SWAYED = rf.PrescribedMotion(
    "x0", displacement=lambda t: (0, 0.1 * np.sin(3 * (t - 1.2)), 0), since=1.2
)
SCENES = {
    "damped": (partial(bar, HELD, SINE, DRAG, rf.NumericalDamping(0.05)), 0.05, 1.0, {}),
    "windows": (
        partial(
            bar,
            *(rf.Fixed("x0", until=1.0), SWAYED, rf.Spring("x1", 1e3, damping=3.0)),
            rf.Gravity((0, 0, -1.0), until=0.7),
        ),
        *(0.05, 1.8, {}),
    ),
    "follower": (partial(bar, HELD, rf.Pressure("z1", 30.0), element="enhanced"), 0.05, 1.2, {}),
    "falls": (block, 0.01, 0.4, {}),
    "rigid falls": (partial(block, rf.Rigid(None)), 0.01, 0.6, {}),
    "named": (partial(bar, HELD, rf.Rigid("block"), SINE), 0.05, 1.0, {}),
    "control": (partial(bar, HELD, SINE, BLOW), rf.StepControl(0.02, largest=0.05), 3.0, {}),
    "all wake": (
        partial(bar, HELD, SINE, BLOW, DRAG),
        *(0.02, 3.0, {"rigidify": rf.StrainRate(0.003, 0.4, wake="all")}),
    ),
    "error": (partial(bar, HELD, SINE, BLOW, DRAG), 0.02, 3.2, {"rigidify": QUIET}),
    "modes": (partial(bar, HELD, SINE, BLOW, DRAG), 0.02, 3.2, {"rigidify": QUIET}),
}


def row(r):
    spent = 0.0 if r.ledger is None else r.ledger.time.spent
    counts = r.step, r.iterations, r.tangents, r.unknowns, len(r.events), len(r.bodies), r.cuts
    energies = r.kinetic, r.strain, r.stored, r.contact, sum(r.dissipated.values()), spent
    return [*counts, r.t, *energies, *r.probes["tip"], *r.linear_momentum]


def parts(run):
    made = run.gi_frame.f_locals
    return [made["run"], made["looks"]]


@pytest.mark.filterwarnings("ignore::rigidfx.base.errors.RigidfxWarning")
@pytest.mark.parametrize("name", SCENES)
def test_a_run_goes_on_bit_by_bit(name, tmp_path, monkeypatch):
    """All that its objects know after the next step, and its reports to the end."""
    if name == "modes":
        monkeypatch.setattr(rigidfx.error.equations, "LARGEST", 100)
    make, dt, t_end, more = SCENES[name]
    steps = 15 if "falls" in name or (isinstance(dt, float) and dt == 0.05) else 70
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
