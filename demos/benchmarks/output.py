"""What output costs: the time in a recorder as a share of the run, and what it does to steps.

A bar is pushed sideways at its end and swings. Two runs of it take their steps in turn: one with a
recorder at its default interval, one without any. Then the same with nine tenths of the bar rigid,
where a step is cheap and its output is not. The time of a row of the history and of the fields of
one time, with and without stresses, are told apart.

    ./fenicsx python3 demos/benchmarks/output.py --unknowns 27000
"""

from __future__ import annotations

from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
from bench import DT, MATERIAL, PUSH, Parser, bar, cells_of_bar, conclude, timed

import rigidfx

WARM = 3  # reports before the timing: the initial state and two steps
WRITES = 6  # of each kind of record


def scene(unknowns: int, *rigid: rigidfx.Rigid) -> rigidfx.Scene:
    """A bar with about so many unknowns, of which all but the last tenth may be rigid."""
    along, across = cells_of_bar(unknowns)
    domain = bar(along, across).with_cells("rest", lambda x: x[0] <= 0.9 * along + 1e-9)
    return rigidfx.Scene(domain, MATERIAL, [PUSH, *rigid])


def measure(problem: rigidfx.Scene, steps: int, folder: Path) -> dict[str, object]:
    """Steps of a run with a recorder and of one without, in turn."""
    kinds = {
        "row": {"every": 10**9},
        "fields": {"every": 1, "stress": False},
        "fields_and_stress": {"every": 1},
    }
    end = DT * (steps + 2 + WRITES * len(kinds))
    rows, parts = [], {}
    with (
        rigidfx.Recorder(problem, folder / "default") as recorder,
        closing(rigidfx.simulate(problem, DT, end, progress=False)) as plain,
        closing(rigidfx.simulate(problem, DT, end, progress=False)) as recorded,
    ):
        for _ in range(WARM + steps):
            alone, _ = timed(partial(next, plain))
            step, report = timed(partial(next, recorded))
            write, _ = timed(partial(recorder.write, report))
            rows.append((alone, step, write))
        for name, options in kinds.items():
            with rigidfx.Recorder(problem, folder / name, **options) as other:
                reports = (next(recorded) for _ in range(WRITES))
                times = [timed(partial(other.write, report))[0] for report in reports]
                parts[name] = float(np.median(times[1:]))
        unknowns = next(plain).unknowns
    alone, step, write = np.array(rows[WARM:]).T  # s
    return {
        "share_of_run": float(write.sum() / (write.sum() + step.sum())),
        "recorded_to_plain_step": float(np.median(step / alone)),
        "seconds_per_step": float(np.median(step)),
        "seconds_to_write": parts,
        "unknowns": unknowns,
    }


def main() -> None:
    """Measure both runs and write the summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="1700 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=40, help="timed steps")
    options = parser.read(unknowns=1700, steps=20)
    scenes = {"flexible": scene(options.unknowns)}
    scenes["rigid"] = scene(options.unknowns, rigidfx.Rigid("rest"))
    summary = {
        name: measure(problem, options.steps, options.out / name)
        for name, problem in scenes.items()
    }
    conclude(options.out, summary)
    assert summary["rigid"]["unknowns"] < summary["flexible"]["unknowns"]


if __name__ == "__main__":
    main()
