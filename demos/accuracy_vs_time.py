# # What accuracy costs in time
#
# Four structures are run again and again, in three ways: all flexible with shorter and shorter
# steps; with parts that are reduced by name, and the same steps; and by asking for an accuracy,
# which chooses Δt and bodies. How far off is each run, and how long does it take?
#
#     python3 demos/accuracy_vs_time.py
#     python3 demos/accuracy_vs_time.py --only body
#
# It leaves in out/accuracy_vs_time `accuracy_vs_time.png` and, with all numbers,
# `accuracy_vs_time.csv` and `summary.json`.

# +
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from common import Parser, chosen, comm, conclude, machines, say, write, write_json
from matplotlib.ticker import LogLocator
from scipy.interpolate import CubicSpline

import rigidfx as rf
from rigidfx.plot import figure_of, on_first_rank, save
from rigidfx.plot.curves import DPI

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
@dataclass(frozen=True)
class Setting:
    """The choices of a run."""

    dt: float  # Δt, or the longest one with a budget [s]
    budget: float = 0.0  # of `Accuracy`, which chooses Δt and bodies; neither is chosen if 0
    reduced: bool = False  # whether the structure's parts are reduced


@dataclass(frozen=True)
class Structure:
    """A structure, and its runs."""

    name: str  # its name
    scene: Callable[..., rf.Scene]  # makes the problem, of parts that are reduced
    at: str  # the probe that is compared
    of: float  # length that errors are parts of [m]
    t_end: float  # end of its runs [s]
    dt: float  # that of the middle points [s]
    parts: tuple[rf.Reduced, ...]  # the parts that may be reduced
    quiet: float = 0.0  # time up to which Δt is ten times as long [s]

    @property
    def reference(self) -> Setting:
        """The setting that errors are against."""
        return Setting(HALVED[-1] * self.dt / (2 if options.short else 4))

    @property
    def ways(self) -> dict[str, list[Setting]]:
        """Name of a curve → the settings along it, the fastest first."""
        return {
            "all flexible": [Setting(k * self.dt) for k in HALVED],
            "parts reduced by name": [Setting(k * self.dt, reduced=True) for k in HALVED],
            "asked for": [Setting(4 * self.dt, budget=budget) for budget in BUDGETS],
        }


HALVED = (2.0, 1.0) if options.short else (2.0, 1.0, 0.5)
BUDGETS = (0.05,) if options.short else (0.05, 0.01)
short, touch = options.short, machines.TOUCH
named = lambda *names: tuple(map(rf.Reduced, names))  # noqa: E731
all_three = named("crank", "rod", "block")
STRUCTURES = [
    Structure("robot arm", arm, "tip", 0.018, 0.06 if short else 0.2, 5e-4, named("link", "head")),
    Structure("drop test", drop, "top", 0.05, touch + 0.012, 1e-4, named(None), quiet=touch - 1e-3),
    Structure("slider-crank", crank, "block", 6e-5, 0.01 if short else 0.04, 2e-4, all_three),
    Structure("free-flying body", body, "tip", 1.7, 4.0 if short else 30.0, 0.05, named("block")),
]
STRUCTURES = [s for s in STRUCTURES if s.name in chosen(options, [s.name for s in STRUCTURES])]
# -

# ## The runs
#
# Forms are compiled before the time of a run is measured.


# +
@dataclass(frozen=True)
class Run:
    """A run in numbers."""

    t: list[float]  # ends of its steps [s]
    path: list[list[float]]  # places of the probe then, a list of three each [m]
    cpu_s: float  # time of the processor, set-up included [s]
    unknowns: int  # at the start
    saved: float  # unknowns that were saved, as a part of unknowns × time

    def error(self, reference: "Run", of: float) -> float:
        """Largest distance of the probe from that of a reference, as a part of a length."""
        exact = CubicSpline(reference.t, reference.path)(self.t)
        return float(np.linalg.norm(self.path - exact, axis=1).max() / of)


def measured(structure: Structure, setting: Setting) -> Run:
    """A run of a structure. Collective."""
    parts, rule = structure.parts if setting.reduced else (), {}
    dt: float | dict[float, float] = setting.dt
    if setting.budget:
        rule["accuracy"] = rf.Accuracy(setting.budget, structure.at, of=structure.of)
    elif structure.quiet:
        dt = {0.0: 10 * setting.dt, structure.quiet: setting.dt}
    given = dt, structure.t_end
    next(rf.simulate(structure.scene(*parts), *given, **rule))  # compiles forms, which stay
    began = time.process_time()
    scene = structure.scene(*parts)
    reports = rf.simulate(scene, *given, **rule)
    first = next(reports)
    t, path, saved = [first.t], [_place(scene, first, structure.at)], 0.0
    for report in reports:
        t.append(report.t)
        path.append(_place(scene, report, structure.at))
        saved += report.dt * (1 - report.unknowns / first.unknowns)
    cpu = time.process_time() - began
    # All ranks take over the time of rank 0.
    return comm.bcast(Run(t, path, cpu, first.unknowns, saved / structure.t_end))


def _place(scene: rf.Scene, report: rf.Report, at: str) -> list[float]:
    return list(map(float, scene.probes[at] + report.probes[at]))


# If nothing can be written, then now:
write_json(options.out / "plan.json", {s.name: asdict(s.reference) for s in STRUCTURES})
rows, panels = [], {}
for s in STRUCTURES:
    settings = [(way, setting) for way, along in s.ways.items() for setting in along]
    reference = measured(s, s.reference)
    found = []
    for way, setting in settings:
        run = measured(s, setting)
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
# -

# ## The picture


# +
COLOURS = {
    "all flexible": "0.45",
    "asked for": "#0072b2",
    "parts reduced by name": "#009e73",
}


def draw(panels: Mapping[str, Sequence[Mapping[str, Any]]], path: Path) -> None:
    """Draw curves of rows with `way`, `cpu_s`, `error` and `asked`, by titles of panels.

    Collective.
    """

    def picture() -> None:
        title = "Error against computing time: down and to the left is better"
        figure, axes = figure_of(-(-len(panels) // 2), min(len(panels), 2), (9.2, 8.4), title)
        figure.set_dpi(DPI)
        for ax, (name, rows) in zip(axes.flat, panels.items(), strict=False):
            _panel(ax, name, rows)
        for ax in axes[:, 0]:
            ax.set_ylabel("error of the probe (%)")
        axes[0, 0].legend(frameon=False, loc="upper center")
        save(figure, path)

    on_first_rank(comm, picture, path.stem)


def _panel(ax: Any, name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    ax.set(title=name, xlabel="time of one core (s)", xscale="log", yscale="log")
    for way, colour in COLOURS.items():
        if not (along := [row for row in rows if row["way"] == way]):
            continue
        x, y = ([row[key] for row in along] for key in ("cpu_s", "percent"))
        ax.plot(x, y, marker="o", color=colour, linewidth=2.5, label=way)
        for k, row in enumerate(row for row in along if row["asked"]):
            text, place = f"{100 * row['asked']:g} % asked", (row["cpu_s"], row["percent"])
            beside = 7, 8 - 12 * (k % 2)  # in turn above and below
            ax.annotate(text, place, beside, textcoords="offset points", color=colour)
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.margins(0.25)


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
