# # What accuracy costs in time
#
# Four structures are run again and again, in three ways: all flexible with shorter and shorter
# steps; with parts that are reduced by name, and the same steps; and by asking for an accuracy,
# which chooses Δt and bodies. How far off is each run, and how long does it take?
#
#     python3 demos/accuracy_vs_time.py
#     python3 demos/accuracy_vs_time.py --only body
#
# A finished run is a file in out/accuracy_vs_time/runs, and is not repeated while its scene and its
# setting stay; delete these files after changes of rigidfx itself. The demo leaves
# `accuracy_vs_time.png` and, with all numbers, `accuracy_vs_time.csv` and `summary.json`.

# +
from dataclasses import asdict
from itertools import pairwise

import numpy as np
from accuracy import Setting, Structure, draw, measured
from common import Parser, chosen, conclude, machines, say, write, write_json

import rigidfx as rf

parser = Parser(__file__, "What accuracy costs in time.", "few runs, short")
parser.add_only("structures")
options = parser.read()
# -

# ## Four structures
#
# The arm of a robot (20 073 unknowns) is moved aside in 40 ms, stops, and its head swings on a thin
# leaf. A device (25 320) falls half a metre on its corner. A slider-crank (21 468) is brought to
# 100 rad/s. The paper's block with a cantilever (1722) is thrown into a turn. Damping is a
# viscosity, which does not depend on Δt.


# +
def arm(*parts: rf.Reduced) -> rf.Scene:
    """A machine part of aluminium on a moved axis."""
    damping = rf.StiffnessDamping(0.01, frequency=30.0)
    way = lambda t: (0.0, 0.05 * machines.travel(t / 0.04), 0.0)  # noqa: E731
    return machines.arm_moved(0.02 if options.short else 0.009, way, damping, *parts)


def drop(*parts: rf.Reduced) -> rf.Scene:
    """A device of a shell, two boards and a block, above a floor."""
    body = machines.device_above_floor(0.02 if options.short else 0.0033)
    highest = body.mesh.geometry.x[np.argmax(body.mesh.geometry.x[:, 2])]
    return machines.device_dropped(body, *parts, probes={"top": tuple(highest)})


def body(*parts: rf.Reduced) -> rf.Scene:
    """The block with a cantilever, thrown into a turn."""
    return machines.block_thrown(rf.StiffnessDamping(0.025 * np.pi, frequency=1.0), *parts)


def crank(*parts: rf.Reduced) -> rf.Scene:
    """A crank, a rod and a block between joints, and a motor."""
    size = 0.05 if options.short else 0.019  # m
    joints = machines.crank_joints(lambda t: 100.0 * machines.ramp(t / 0.02))
    damping = rf.StiffnessDamping(0.02, frequency=500.0)
    return machines.crank_scene(size, [*joints, damping, *parts], {"block": machines.BLOCK})


# -

# ## Three ways
#
# Link and head of the arm are reduced and its leaf stays flexible; the device, and all parts of the
# slider-crank, are reduced; the block is reduced beside its flexible cantilever.
#
# From one point of a curve to the next Δt is halved; as the device falls it is ten times as long.
# Errors are against a run with a quarter of the shortest Δt, all flexible: the largest distance of
# a probe from its place there. They are parts of a length, which is the bend of arm and body, the
# way of the device's top after the touch, and the way of the slider-crank's block less that of
# rigid links. They contain nothing of the mesh, which is the same in all.


# +
def structure(name, scene, at, of, t_end, dt, reduced, quiet=0.0) -> Structure:
    """A structure with its ways; Δt is that of the middle points."""
    halved = (2.0, 1.0) if options.short else (2.0, 1.0, 0.5)
    budgets = (0.05,) if options.short else (0.05, 0.01)
    ways = {
        "all flexible": [Setting(k * dt) for k in halved],
        "parts reduced by name": [Setting(k * dt, reduced=True) for k in halved],
        "asked for": [Setting(4 * dt, budget=budget) for budget in budgets],
    }
    reference = Setting(halved[-1] * dt / (2 if options.short else 4))
    parts = tuple(map(rf.Reduced, reduced))
    return Structure(name, scene, at, of, t_end, quiet, reference, ways, parts)


short, touch = options.short, machines.TOUCH
parts = "crank", "rod", "block"
STRUCTURES = [
    structure("robot arm", arm, "tip", 0.018, 0.06 if short else 0.2, 5e-4, ("link", "head")),
    structure("drop test", drop, "top", 0.05, touch + 0.012, 1e-4, (None,), quiet=touch - 1e-3),
    structure("slider-crank", crank, "block", 6e-5, 0.01 if short else 0.04, 2e-4, parts),
    structure("free-flying body", body, "end", 1.7, 4.0 if short else 30.0, 0.05, ("block",)),
]
STRUCTURES = [s for s in STRUCTURES if s.name in chosen(options, [s.name for s in STRUCTURES])]
# -

# ## The runs

# +
# If nothing can be written, then now:
write_json(options.out / "plan.json", {s.name: asdict(s.reference) for s in STRUCTURES})
rows, panels = [], {}
for s in STRUCTURES:
    settings = [(way, setting) for way, along in s.ways.items() for setting in along]
    reference = measured(s, s.reference, options.out / "runs")
    found = []
    for way, setting in settings:
        run = measured(s, setting, options.out / "runs")
        error = run.error(reference, s.of)
        found.append(
            {"structure": s.name, "way": way, "dt": setting.dt}
            | {"asked": setting.budget, "steps": len(run.t) - 1, "cpu_s": run.cpu_s}
            | {"saved": run.saved, "error": error, "percent": 100 * error}
        )
        say(f"{s.name}: {way}, Δt {setting.dt:g} s: {100 * error:.3g} % in {run.cpu_s:.3g} s")
    rows += found
    panels[f"{s.name}: {reference.unknowns} unknowns"] = found

columns = list(rows[0])
lines = [columns, *([row[name] for name in columns] for row in rows)]
write(options.out / "accuracy_vs_time.csv", "".join(",".join(map(str, r)) + "\n" for r in lines))
draw(panels, options.out / "accuracy_vs_time.png")


def best(name: str, target: float) -> dict[str, float]:
    """Way → time of its fastest run within an error [s]."""
    good = [r for r in rows if r["structure"] == name and r["error"] <= target]
    ways = dict.fromkeys(r["way"] for r in good)
    return {way: min(r["cpu_s"] for r in good if r["way"] == way) for way in ways}


def asked(name: str) -> dict[float, float]:
    """Accuracy that was asked for → error."""
    return {r["asked"]: r["error"] for r in rows if r["structure"] == name and r["asked"]}


summary = {
    "one_per_cent": {s.name: best(s.name, 0.01) for s in STRUCTURES},
    "asked": {s.name: asked(s.name) for s in STRUCTURES},
    "runs": len(rows),
}
conclude(options.out, summary)
# -

# ## Assertions
#
# Budgets are kept, and shorter steps are nearer to the reference.

for s in STRUCTURES:
    of_it = [r for r in rows if r["structure"] == s.name]
    assert all(error <= budget for budget, error in asked(s.name).items()), s.name
    flexible = [r["error"] for r in of_it if r["way"] == "all flexible"]
    assert all(a > b for a, b in pairwise(flexible)), s.name
say("Budgets are kept.")
