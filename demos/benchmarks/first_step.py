"""How long the first step takes from the mesh on, and how long a freeze and a release.

All are told in *steps*: two Newton iterations with a new tangent each, of the flexible structure,
the tumbling L under a constant load. Importing and compiling are left out: the same scene with
large cells runs first. Nine tenths of the cells freeze after some steps, and are released again
after some more.

    ./fenicsx python3 demos/benchmarks/first_step.py --unknowns 200000

`first_step_over_step` is from the mesh to the report of the first step; `parts` are in seconds.
"""

from __future__ import annotations

from statistics import median

from bench import DT, Parser, conclude, timed
from flexible_step import scene, tumbling_l_nodes

import rigidfx
from meshes.tumbling_l import tumbling_l

NEWTON = {"snes_lag_jacobian": 1}  # a new tangent in each iteration
FREEZE, RELEASE, END = 4, 7, 9  # steps


def measure(refine: int) -> dict[str, float]:
    """Wall times of one run [s], and its unknowns."""
    mesh, domain = timed(lambda: tumbling_l(refine))
    domain = domain.with_cells("rest", lambda x: x[1] >= 9)  # nine of 117 m³
    criterion = rigidfx.StrainRate(
        1e9, FREEZE * DT, wake="all", never=["rest"], release=rigidfx.Release(at=RELEASE * DT)
    )
    building, problem = timed(lambda: scene(refine, domain))
    options = {"rigidify": criterion, "progress": False, "petsc_options": NEWTON}
    preparing, reports = timed(lambda: rigidfx.simulate(problem, DT, END * DT, **options))
    next(reports)
    seconds, steps = [], []
    while True:
        taken, report = timed(lambda: next(reports, None))
        if report is None:
            break
        seconds.append(taken)
        steps.append(report)
    assert steps[FREEZE - 1].events, "nothing has frozen"
    assert steps[RELEASE - 1].events, "nothing was released"
    flexible = [
        2 * s / r.tangents for s, r in zip(seconds[1 : FREEZE - 1], steps[1:], strict=False)
    ]
    step = median(flexible)
    condensed = median(seconds[FREEZE : RELEASE - 1])

    def beyond(k: int, usual: float) -> float:
        return seconds[k] - usual * steps[k].tangents / 2

    return {
        "unknowns": steps[0].unknowns,
        "rigid_unknowns": steps[FREEZE].unknowns,
        "step": step,
        "condensed_step": condensed,
        "mesh": mesh,
        "scene": building,
        "prepare": preparing,
        "first": seconds[0],
        "freeze": beyond(FREEZE - 1, step),
        "release": seconds[RELEASE - 1] - condensed,
    }


def main() -> None:
    """Run it and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="700 unknowns")
    parser.add_argument("--unknowns", type=int, default=200_000, help="about 700, 27000, 200000")
    options = parser.read(unknowns=700)
    sizes = {len(tumbling_l_nodes(r)) * 3: r for r in range(1, 16)}
    refine = sizes[min(sizes, key=lambda n: abs(n - options.unknowns))]
    measure(1)  # compiles
    found = measure(refine)
    first = found["scene"] + found["prepare"] + found["first"]
    conclude(
        options.out,
        {
            "unknowns": found["unknowns"],
            "rigid_unknowns": found["rigid_unknowns"],
            "first_step_over_step": first / found["step"],
            "freeze_over_step": found["freeze"] / found["step"],
            "release_over_step": found["release"] / found["step"],
            "parts": found,
        },
    )


if __name__ == "__main__":
    main()
