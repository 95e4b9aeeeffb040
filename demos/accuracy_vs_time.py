# # What accuracy costs in time
#
# Three structures are run again and again, in four ways: all flexible with shorter and shorter
# steps; with rigid parts by hand, where the tolerance falls with Δt; by asking for an accuracy,
# which chooses both; and with parts that are reduced by name. How far off is each run, and how long
# does it take?
#
#     python3 demos/accuracy_vs_time.py
#     python3 demos/accuracy_vs_time.py --only frame
#
# A finished run is a file in out/accuracy_vs_time/runs, and is not repeated while its scene and its
# setting stay; delete these files after changes of rigidfx itself. The demo leaves
# `accuracy_vs_time.png` and, with all numbers, `accuracy_vs_time.csv` and `summary.json`.

# +
from dataclasses import asdict
from functools import partial
from itertools import pairwise

import numpy as np
from accuracy import Setting, Structure, draw, measured
from common import Parser, chosen, conclude, say, write, write_json

import rigidfx as rf
from meshes.block_with_cantilever import block_with_cantilever
from meshes.robot_arm import HEIGHT, TIP, robot_arm
from meshes.spatial_frame import spatial_frame

parser = Parser(__file__, "What accuracy costs in time.", "few runs, short")
parser.add_only("structures")
options = parser.read()
# -

# ## Three structures
#
# The arm of a robot (20 073 unknowns) is moved aside in 40 ms, stops, and its head swings on a thin
# leaf. The paper's two examples are a block with a cantilever that is thrown into a turn, and a
# frame under a shock. Damping is a viscosity, which does not depend on Δt.


# +
def arm(*parts: rf.Reduced) -> rf.Scene:
    """A machine part of aluminium on a moved axis."""
    size = 0.02 if options.short else 0.009  # m

    def way(t: float) -> tuple[float, float, float]:
        """Displacement of the axis [m]."""
        s = np.clip(t / 0.04, 0.0, 1.0)
        return 0.0, 0.05 * (s - np.sin(2 * np.pi * s) / (2 * np.pi)), 0.0

    return rf.Scene(
        robot_arm(size, max(0.012, 0.6 * size)),
        rf.StVenantKirchhoff(E=7e10, nu=0.33, rho=2700.0),  # Pa, 1, kg/m³
        [
            rf.PrescribedMotion("bore", displacement=way),
            rf.StiffnessDamping(0.01, frequency=30.0),
            *parts,
        ],
        order=2,
        mass="consistent",
        probes={"tip": (TIP, 0.0, HEIGHT / 2)},
    )


def body(*parts: rf.Reduced) -> rf.Scene:
    """The block with a cantilever, thrown into a turn."""
    domain = block_with_cantilever()
    domain = domain.with_facets("block", lambda x: (x[0] < 9.01) & (np.abs(x[2] - 3.0) > 2.99))
    domain = domain.with_facets("end", lambda x: (x[0] > 14.99) & (x[2] > 3.99))
    return rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=5e5, nu=0.3, rho=100.0),
        [
            rf.Traction("block", (0.0, 0.0, -1e4), total=True, until=2.0),  # N
            rf.Traction("end", (0.0, 0.0, 1e4), total=True, until=2.0),
            rf.StiffnessDamping(0.025 * np.pi, frequency=1.0),
            *parts,
        ],
        probes={"end": (23.0, 2.7, 3.0)},
    )


def frame() -> rf.Scene:
    """The plate on four columns, under a shock."""
    return rf.Scene(
        spatial_frame(coarse=3) if options.short else spatial_frame(),
        rf.StVenantKirchhoff(E=7e10, nu=0.2, rho=2700.0),
        [
            rf.Fixed("feet"),
            rf.Fixed("symmetry", "y"),
            rf.Traction("side", (4250.0, 0.0, 0.0), until=0.05),  # Pa
            rf.StiffnessDamping(0.00125 * np.pi, frequency=1.0),
        ],
        probes={"a": (6.0, 3.0, 4.5)},
    )


# -

# ## Four ways
#
# Link and head of the arm are reduced and its leaf stays flexible. The block is reduced beside its
# flexible cantilever. The frame strains everywhere: nothing of it is reduced by name.
#
# From one point of a curve to the next Δt is halved, and so is the tolerance of rigid parts. Errors
# are against a run with an eighth of the shortest Δt, all flexible: the largest distance of a probe
# from its place there. They are parts of the bending (arm and body) or of the largest displacement
# (frame), and contain nothing of the mesh, which is the same in all.


# +
def structure(
    name, scene, at, of, t_end, dt, tol, window, min_cells=20, knobs=not options.short, reduced=()
) -> Structure:
    """A structure with its ways; Δt and the tolerance are those of the middle points."""
    halved = (2.0, 1.0) if options.short else (2.0, 1.0, 0.5)
    budgets = (0.05,) if options.short else (0.05, 0.01, 0.002)
    ways = {
        "all flexible": [Setting(k * dt) for k in halved],
        "rigid parts by hand": [Setting(k * dt, k * tol, window) for k in halved],
        "asked for": [Setting(4 * dt, budget=budget) for budget in budgets],
    }
    if reduced:
        ways["parts reduced by name"] = [Setting(k * dt, reduced=True) for k in halved]
    by_hand = partial(Setting, dt, tol)
    turned = {
        "window / 2": by_hand(window / 2),
        "window × 2": by_hand(2 * window),
        "Newton to 1e-3": by_hand(window, newton=1e-3),
        "the paper's releases": by_hand(window, wake="all"),
    }
    reference = Setting(halved[-1] * dt / 8)
    parts = tuple(rf.Reduced(part) for part in reduced)
    others = turned if knobs else {}
    return Structure(name, scene, at, of, t_end, min_cells, reference, ways, others, parts)


short = options.short
STRUCTURES = [
    structure(
        "robot arm",
        arm,
        "tip",
        0.018,
        0.06 if short else 0.2,
        5e-4,
        0.01,
        0.04,
        knobs=False,
        reduced=("link", "head"),
    ),
    structure(
        "free-flying body",
        body,
        "end",
        1.7,
        6.0 if short else 30.0,
        0.05,
        2e-3,
        5.0,
        reduced=("block",),
    ),
    structure("frame", frame, "a", 6e-4, 0.3 if short else 1.25, 0.01, 5e-5, 0.25, min_cells=1),
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
    settings += list(s.knobs.items())
    reference = measured(s, s.reference, options.out / "runs")
    found = []
    for way, setting in settings:
        run = measured(s, setting, options.out / "runs")
        error = run.error(reference, s.of)
        found.append(
            {"structure": s.name, "way": way, "dt": setting.dt, "tol": setting.tol}
            | {"asked": setting.budget, "steps": len(run.t) - 1, "cpu_s": run.cpu_s}
            | {"rigid": run.rigid, "error": error, "percent": 100 * error}
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
