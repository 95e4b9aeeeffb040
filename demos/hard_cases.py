# # Hard cases
#
# Cases at which structural dynamics fails: parts a hundred million times as stiff as their
# neighbours, plates a thousand times as wide as thick, most of a half turn per step, steps far
# longer than all periods, loads that reverse each time, bodies that come and go. Each case here is
# a small scene with the bounds that theory gives for it, run fully flexible and with parts that
# become rigid where both make sense. Each is a short function in `demos/hardcases/`, which names
# the difficulty and the bounds; the tests in `tests/hard/` run the same.
#
#     python3 demos/hard_cases.py
#     mpirun -n 3 python3 demos/hard_cases.py --short --only parallel
#     python3 demos/hard_cases.py --only none --all 500
#
# It prints a table and leaves in out/hard_cases: `summary.json`, a list with an entry per run, and
# a picture of all drifts.

# +
import time
from dataclasses import asdict

import numpy as np
from common import Parser, chosen, comm, say, write_json
from hardcases import CASES, Result, carry_out
from hardcases.stiffness import check, compare

from rigidfx.plot import figure_of, on_first_rank, save

parser = Parser(__file__, "Hard cases: which are stable, and how well.", "coarse and short")
parser.add_only("cases or groups")
parser.add_argument("--all", type=int, nargs="?", const=500, default=0, metavar="N",
                    help="also N random scenes (500), which takes hours")  # fmt: skip
options = parser.read()
# Before hours are spent for a folder that cannot be written:
write_json(options.out / "summary.json", [])
# -

# ## The table
#
# *Energy* is the largest error of its balance, with work of loads and supports and dissipation,
# relative to the largest energy. *Momentum* is the largest change of L
# relative to Σ m|v|, or of J relative to its size, where nothing acts from outside.

# +
say(f"{'case':38}{'way':32}{'steps':>7}{'Newton':>11}{'energy':>9}{'momentum':>10}  verdict")
results: list[Result] = []
begin = time.perf_counter()
for case in CASES:
    if not chosen(options, [case.name, case.group]):
        continue
    say(f"\n{case.group}: {case.hard}")
    for r in carry_out(case, options.short):
        results.append(r)
        momentum = "" if r.momentum_drift is None else f"{r.momentum_drift:.1e}"
        newton = f"{r.newton_mean:.2f} ({r.newton_worst})"
        cut = f", {r.cuts} cuts" if r.cuts else ""
        say(f"{r.case:38}{r.way:32}{r.steps:7}{newton:>11}{r.energy_drift:9.1e}{momentum:>10}  "
            f"{r.verdict}{cut}")  # fmt: skip
say(f"\n{len(results)} runs in {time.perf_counter() - begin:.0f} s")
# -

# ## A stiff part: rigid, flexible, or tied by a penalty
#
# Half of a bar is 1e8 times as stiff as the other. As a body it leaves the equations; as a flexible
# part its stiffness is their condition; as a part that springs tie to six more unknowns (their
# constant is a thousand times the largest entry of the diagonal) it makes things worse. Krylov
# iterations are those of GMRES with ILU(0) for a residual of 1e-8 of the first.

# +
ways = compare(options.short) if comm.size == 1 and options.only in "stiffness" else []
if ways:
    say(f"\n{'stiff half as':24}{'condition':>12}{'Krylov':>8}{'Newton':>8}")
for entry in ways:
    newton = "" if entry["newton_mean"] is None else f"{entry['newton_mean']:.2f}"
    krylov = entry["krylov"] or "fails"
    say(f"{entry['way']:24}{entry['condition']:12.1e}{krylov:>8}{newton:>8}")

summary = [*map(asdict, results), *ways]
write_json(options.out / "summary.json", summary)


def draw() -> None:
    """Drifts of energy and momenta, and Newton iterations, of all runs."""
    figure, axes = figure_of(1, 2, (13.0, 0.19 * len(results) + 2), "Hard cases")
    drifts, newton = axes[0]
    y = np.arange(len(results))
    eps = float(np.finfo(np.float64).eps)
    drifts.semilogx([max(r.energy_drift, eps) for r in results], y, "o", label="energy")
    momenta = [np.nan if r.momentum_drift is None else max(r.momentum_drift, eps) for r in results]
    drifts.semilogx(momenta, y, "x", label="momenta")
    drifts.set_yticks(y, [f"{r.case}, {r.way}" for r in results], fontsize=6)
    drifts.set_xlabel("relative drift")
    drifts.legend(loc="lower right")
    newton.plot([r.newton_mean for r in results], y, "o", label="mean")
    newton.plot([r.newton_worst for r in results], y, "|", label="worst")
    newton.set_yticks(y, [""] * len(y))
    newton.set_xlabel("Newton iterations per step")
    newton.legend(loc="lower right")
    for ax in (drifts, newton):
        ax.invert_yaxis()
    save(figure, options.out / "hard_cases.png")


on_first_rank(comm, draw, f"hard_cases: '{options.out / 'hard_cases.png'}'")
# -

# ## Random scenes
#
# With `--all`: each ends with an error before its first step, or keeps its balances. hypothesis
# draws them, and shows a scene that does neither as small as it can make it.

# +
if options.all:
    from hardcases.drafts import try_scenes

    seen = try_scenes(options.all)
    say(f"\n{options.all} random scenes: {seen}")
# -

# ## Assertions
#
# All cases are stable, except known ones: first-order cells lock where they cannot
# change their volume, and a scene says so when it is made.

if ways:
    check(ways)
for r in results:
    assert r.stable or r.known, f"{r.case}, {r.way}: {r.verdict}"
assert options.all or any(r.stable for r in results)
