"""What each effect costs: a step with it against the bare step, alone and together.

A bar flies and bends. Runs with one effect each, with all of them, and with all of them after their
time windows have closed take their steps in turn, so that a change of the machine's speed hits them
alike. What a scene does not call for, or no longer, costs nothing: the last of these is as fast as
the bare one.

    ./fenicsx python3 demos/benchmarks/effects.py --unknowns 27000

`ratio_per_step` includes Newton iterations that an effect may add or save; `ratio_per_iteration`
does not.
"""

from __future__ import annotations

from math import inf

import numpy as np
from bench import DT, MATERIAL, Parser, Turns, bar, cells_of_bar, conclude

import rigidfx

FAR = rigidfx.Plane((0.0, 0.0, -100.0), (0.0, 0.0, 1.0))
WARM = 3  # steps before the timing; windows that close do so after the first


def effects(until: float) -> dict[str, rigidfx.effects.Effect]:
    """One effect of each kind; those with a time window act until a time [s]."""
    return {
        "Traction": rigidfx.Traction("x1", (0.0, 2.0, 3.0), until=until),
        "Gravity": rigidfx.Gravity(until=until),
        "Pressure": rigidfx.Pressure("z1", 0.5, until=until),
        "KelvinVoigt": rigidfx.KelvinVoigt(20.0, until=until),
        "MassDamping": rigidfx.MassDamping(0.05, until=until),
        "NumericalDamping": rigidfx.NumericalDamping(0.05, until=until),
        # In front of a plane that is never reached: what it costs to look.
        "Contact": rigidfx.Contact("z0", against=FAR, until=until),
        "PointMass": rigidfx.PointMass("x1", 50.0),
        "Spring": rigidfx.Spring("x0", 500.0, damping=5.0),
    }


def scenes(unknowns: int) -> dict[str, rigidfx.Scene]:
    """The bare problem and those with effects, on a bar ten times as long as thick."""
    along, across = cells_of_bar(unknowns)
    straight = bar(along, across)
    bend = 2e-2 * along

    def shape(x: np.ndarray) -> np.ndarray:
        return bend * np.sin(np.pi * x[0] / along) * np.array([[0.0], [0.3], [1.0]])

    moving = rigidfx.InitialVelocity(angular=(0.0, 0.0, 0.05), function=shape)
    every = effects(inf)
    closed = [e for e in effects(DT).values() if isinstance(e, rigidfx.effects.Windowed)]
    named = {
        "bare": [],
        **{name: [effect] for name, effect in every.items()},
        "all": list(every.values()),
        "all, windows closed": closed,
    }
    return {name: rigidfx.Scene(straight, MATERIAL, [moving, *own]) for name, own in named.items()}


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="1700 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=10, help="timed steps")
    options = parser.read(unknowns=1700, steps=5)
    end = DT * (options.steps + WARM)
    runs = {
        name: rigidfx.simulate(scene, DT, end, progress=False)
        for name, scene in scenes(options.unknowns).items()
    }
    with Turns(runs, warm=1 + WARM) as turns:
        for _ in range(options.steps):
            turns.take()
    summary = {
        "unknowns": turns.reports["all, windows closed"][-1].unknowns,
        "steps": options.steps,
        "bare_seconds_per_step": turns.median("bare"),
        "ratio_per_step": {name: turns.ratio(name, "bare") for name in runs},
        "ratio_per_iteration": {name: turns.ratio(name, "bare", True) for name in runs},
        "newton_per_step": {name: turns.newton(name) for name in runs},
    }
    conclude(options.out, summary)
    assert all(np.isfinite(value) for value in summary["ratio_per_step"].values())


if __name__ == "__main__":
    main()
