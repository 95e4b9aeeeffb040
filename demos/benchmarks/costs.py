"""Effects and output: the cost of each in a step, alone and together.

* *effects*: a bar flies and bends. Runs with one effect each, with all of them, and with all after
  their time windows have closed take their steps in turn. Effects that are absent or over cost
  nothing. `ratio_per_step` includes Newton iterations that an effect may add or save;
  `ratio_per_iteration` does not.
* *output*: a bar swings, flexible or nine tenths rigid. A run with a `Recorder` and one without
  take their steps in turn: the recorder's share of the run, and the times of a row of the history,
  and of the fields of one time with and without stresses.
* *machines*: rigid bars on hinges, one to nine, with motors and springs. A step of up to four bars
  is to take 6 ms at most on a quiet core, one of nine 12 ms.

    ./fenicsx python3 demos/benchmarks/costs.py --unknowns 27000
"""

from argparse import Namespace
from contextlib import closing
from functools import partial
from itertools import islice
from math import inf
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from bench import DT, MATERIAL, PUSH, Parser, Turns, bar, cells_of_bar, run_parts, timed
from bench.mechanism_scenes import four_bars, hinged, with_motor

import rigidfx as rf

FAR = rf.Plane((0.0, 0.0, -100.0), (0.0, 0.0, 1.0))
WARM = 3  # steps before the timing; windows that close do so after the first
WRITES = 6  # of each kind of record
RECORDS = {
    "row": {"every": 10**9},
    "fields": {"every": 1, "stress": False},
    "fields_and_stress": {"every": 1},
}


def each_effect(until: float) -> dict[str, rf.effects.Effect]:
    """One effect of each kind; those with a time window act until a time [s]."""
    return {
        "Traction": rf.Traction("x1", (0.0, 2.0, 3.0), until=until),
        "Gravity": rf.Gravity(until=until),
        "Pressure": rf.Pressure("z1", 0.5, until=until),
        "KelvinVoigt": rf.KelvinVoigt(20.0, until=until),
        "MassDamping": rf.MassDamping(0.05, until=until),
        "NumericalDamping": rf.NumericalDamping(0.05, until=until),
        # In front of a plane that is never reached: the cost of the search.
        "Contact": rf.Contact("z0", against=FAR, until=until),
        "PointMass": rf.PointMass("x1", 50.0),
        "Spring": rf.Spring("x0", 500.0, damping=5.0),
    }


def effects(options: Namespace) -> dict[str, Any]:
    """The bare step beside steps with effects."""
    along, across = cells_of_bar(options.unknowns)
    straight = bar(along, across)

    def shape(x: np.ndarray) -> np.ndarray:
        return 2e-2 * along * np.sin(np.pi * x[0] / along) * np.array([[0.0], [0.3], [1.0]])

    moving = rf.InitialVelocity(angular=(0.0, 0.0, 0.05), function=shape)
    every = each_effect(inf)
    single = {} if options.short else {name: [effect] for name, effect in every.items()}
    closed = [e for e in each_effect(DT).values() if isinstance(e, rf.effects.Windowed)]
    named = {"bare": [], **single, "all": [*every.values()], "all, windows closed": closed}
    end = DT * (options.steps + WARM)
    runs = {
        name: rf.simulate(rf.Scene(straight, MATERIAL, [moving, *own]), DT, end, progress=False)
        for name, own in named.items()
    }
    with Turns(runs, warm=1 + WARM) as turns:
        for _ in range(options.steps):
            turns.take()
    found = {
        "unknowns": turns.reports["bare"][-1].unknowns,
        "bare_seconds_per_step": turns.median("bare"),
        "ratio_per_step": {name: turns.ratio(name, "bare") for name in runs},
        "ratio_per_iteration": {name: turns.ratio(name, "bare", True) for name in runs},
        "newton_per_step": {name: turns.newton(name) for name in runs},
    }
    iterations = found["newton_per_step"]
    assert iterations["all, windows closed"] <= iterations["bare"] + 1, iterations
    return found


def recorded(scene: rf.Scene, steps: int, folder: Path) -> dict[str, Any]:
    """Steps of a run with a recorder and of one without, in turn."""
    rows, parts = [], {}
    with (
        rf.Recorder(scene, folder / "default") as recorder,
        closing(rf.simulate(scene, DT, 1e6, progress=False)) as plain,
        closing(rf.simulate(scene, DT, 1e6, progress=False)) as run,
    ):
        for _ in range(WARM + steps):
            alone, _ = timed(partial(next, plain))
            step, report = timed(partial(next, run))
            write, _ = timed(partial(recorder.write, report))
            rows.append((alone, step, write))
        for name, how in RECORDS.items():
            with rf.Recorder(scene, folder / name, **how) as other:
                reports = (next(run) for _ in range(WRITES))
                times = [timed(partial(other.write, report))[0] for report in reports]
                parts[name] = float(np.median(times[1:]))
        unknowns = report.unknowns
    alone, step, write = np.array(rows[WARM:]).T  # s
    return {
        "share_of_run": float(write.sum() / (write.sum() + step.sum())),
        "recorded_to_plain_step": float(np.median(step / alone)),
        "seconds_per_step": float(np.median(step)),
        "seconds_to_write": parts,
        "unknowns": unknowns,
    }


def output(options: Namespace) -> dict[str, Any]:
    """A recorder beside a flexible bar, and beside one that is nine tenths rigid."""
    along, across = cells_of_bar(options.unknowns)
    domain = bar(along, across).with_cells("rest", lambda x: x[0] <= int(0.9 * along) + 1e-9)
    found = {
        name: recorded(rf.Scene(domain, MATERIAL, [PUSH, *own]), options.steps, options.out / name)
        for name, own in {"flexible": [], "rigid": [rf.Rigid("rest")]}.items()
    }
    assert found["rigid"]["unknowns"] < found["flexible"]["unknowns"]
    return {"output": found}


def machines(options: Namespace) -> dict[str, Any]:
    """Machines of rigid bars, whose steps cost mostly calls: processor time."""
    scenes = {
        "pendulum": hinged(1),
        "four-bar": four_bars(1),
        "four-bar, motor": with_motor(four_bars(1), "A0"),
        "chain of nine": hinged(9),
        "chain of nine, motor, springs": with_motor(hinged(9, springs=True), "hinge 0"),
    }
    rows = {}
    for name, scene in scenes.items():
        with closing(rf.simulate(scene, 0.005, 10.0, progress=False)) as run:
            began, reports = [], []
            for report in islice(run, 1 + WARM + 5 * options.steps):
                began.append(process_time())
                reports.append(report)
        rows[name] = {
            "unknowns": reports[-1].unknowns,
            "seconds_per_step": float(np.median(np.diff(began[WARM:]))),
            "newton_per_step": float(np.mean([report.iterations for report in reports[WARM:]])),
        }
    assert all(row["newton_per_step"] <= 4 for row in rows.values()), rows
    return {"machines": rows}


PARTS = {part.__name__: part for part in (effects, output, machines)}


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], short="500 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=20, help="timed steps")
    parser.add_only("parts")
    options = parser.read(unknowns=500, steps=4)
    run_parts(options, PARTS)
