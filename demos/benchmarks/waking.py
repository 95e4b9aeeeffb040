"""Bodies while loads act: what rigidity and growing shapes miss and cost, beside flexible twins.

Each scene runs fully flexible, and in two ways with `StrainRate(…, wake="local")`: bodies are rigid
and the error motion e goes beside them, or with grow=True bodies get shapes. The strains of the
twin judge both, in windows of 20 steps. Each scene and way is an entry of summary.json, and a row
of table.md:

- refused: why the way does not run; all that follows is null then;
- missed: of the cell-windows in which the twin strains at more than twice κ tol, the share in which
  the cell is in a body and strains otherwise than in the twin by more than that, in two steps
  running;
- woken: number of cells that forces wake, without the ring round them; in_vain: the share of them
  that stays below tol in the twin for two windows from then on;
- share: time × cells in bodies; quiet_share: cell-windows below tol in the twin; of_quiet: the
  share in bodies of these. Such a cell strains too little in a window to spend ν;
- promise: 0.8 κ tol over the twin's peak strain rate; error: that of the probe in u, over its
  largest displacement; error_shown: the same of what is shown, u + e where e is known;
- time_ratio: processor time of all steps over that of the twin.

Runs outside the gate are told. Each way has to keep to MISSED in the mean of its scenes.

    nice ./fenicsx python3 demos/benchmarks/waking.py --across 6
    ./fenicsx python3 demos/benchmarks/waking.py --short --only gong       # in parts
    ./fenicsx python3 demos/benchmarks/waking.py --short --seeds 0-9       # random scenes instead
"""

from __future__ import annotations

import warnings
from argparse import ArgumentTypeError
from time import process_time
from typing import Any

import numpy as np
from bench import Parser, chosen, conclude, write
from bench.cell_strains import CellStrains
from bench.judged import KAPPA, WINDOW, Record, errors, judged
from bench.random_waking import random_case, seeds_of
from bench.waking_named import ALONE
from bench.waking_scenes import CASES, Case
from bench.waking_structures import LARGE, STRUCTURES, Built

import rigidfx as rf

WAYS: dict[str, dict[str, bool]] = {"rigid": {}, "grown": {"grow": True}}
MISSED, IN_VAIN = 0.01, 0.05  # shares, at most
SHORT = {**CASES, **STRUCTURES, **ALONE}
HEAD = "| scene | way | missed | in vain | error / promise | of quiet | in bodies | time / twin |"


def followed(
    scene: rf.Scene, case: Case | Built, rule: rf.StrainRate, twin: Record | None
) -> Record:
    """Run a case, and keep what is judged.

    Args:
        scene: Its scene.
        case: Its times.
        rule: When parts become bodies.
        twin: The flexible run; None for this one itself.
    """
    begun = process_time()
    run = rf.simulate(scene, case.dt, case.t_end, rigidify=rule, progress=False)
    strains, before, seconds = CellStrains(scene), np.zeros(0), 0.0
    places, tips, motions, rates, bodies, lost, woken = [], [], [], [], [], [], []
    for step, report in enumerate(run):
        seconds += process_time() - begun
        x = np.array(report.state.places)
        tips.append(report.probes["tip"])
        motions.append(report.error_motion["tip"])
        E = strains.of(x) - strains.of(twin.places[step]) if twin else np.zeros(0)
        if step:
            rates.append(report.strain_rate.astype(np.float32))
            bodies.append(report.state.body_numbers() > 0)
            woken.append(np.concatenate([np.zeros(0, int), *(e.woken for e in report.events)]))
            lost.append(strains.sizes(E - before) / case.dt if twin else np.zeros(0))
        else:
            unknowns = report.unknowns
        before = E
        places += [] if twin else [x]
        begun = process_time()
    kept = map(np.array, (rates, bodies, lost))
    return Record(unknowns, places, *kept, woken, np.array(tips), np.array(motions), seconds)


def measured(name: str, case: Case | Built, seed: int | None, across: int) -> list[dict[str, Any]]:
    """The entries of a case, one for each way."""
    case = case.at(across)
    twin = followed(case.scene(across), case, rf.StrainRate(0.0, 1e9, wake="none"), None)
    tol, promise, entries = case.tol * float(twin.rates.max()), 0.8 * KAPPA * case.tol, []
    for way, how in WAYS.items():
        entry = dict.fromkeys(KEYS) | {"scene": name, "seed": seed, "way": way, "promise": promise}
        entry["unknowns"] = twin.unknowns
        rule = rf.StrainRate(tol, WINDOW * case.dt, kappa=KAPPA, **how)
        try:
            ours = followed(case.scene(across), case, rule, twin)
        except (rf.SceneError, rf.StepError) as why:
            entry["refused"] = str(why).splitlines()[0]
        else:
            entry |= judged(twin, ours, tol) | errors(twin, ours)
            entry["time_ratio"] = ours.seconds / twin.seconds
        entries.append(entry)
    return entries


KEYS = (
    "scene", "seed", "unknowns", "way", "refused", "missed", "woken", "in_vain", "share",
    "quiet_share", "of_quiet", "promise", "error", "error_shown", "time_ratio",
)  # fmt: skip


def row(entry: dict[str, Any]) -> str:
    """A row of the table."""
    start = f"| {entry['scene']} | {entry['way']} |"
    if entry["refused"]:
        return f"{start} refused | | | | | |"
    numbers = [entry["missed"], entry["in_vain"], entry["error"] / entry["promise"]]
    numbers += [entry["of_quiet"], entry["share"], entry["time_ratio"]]
    return f"{start} {' | '.join(f'{number:.3g}' for number in numbers)} |"


def outside(entry: dict[str, Any]) -> bool:
    """Whether a run is not within the gate."""
    if entry["refused"]:
        return True
    close = entry["error"] <= entry["promise"]
    return not (close and entry["missed"] <= MISSED and entry["in_vain"] <= IN_VAIN)


def seeds(text: str) -> list[int]:
    """Numbers of random scenes, for --seeds."""
    try:
        return seeds_of(text)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} should be numbers such as 0-9,12") from None


def main() -> None:
    """Run the comparison, and write its summary and its table."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="some 400 unknowns, no large scenes")
    parser.add_argument("--across", type=int, default=6, help="cells across a bar")
    parser.add_argument("--seeds", type=seeds, help="random scenes instead, such as 0-9,12")
    parser.add_only("scenes")
    options = parser.read(across=2)
    warnings.simplefilter("ignore", rf.RigidfxWarning)
    if options.seeds:
        cases = [(*random_case(seed), seed) for seed in options.seeds]
    else:
        every = SHORT if options.short else {**SHORT, **LARGE}
        cases = [(name, every[name], None) for name in chosen(options, every)]
    summary, table = [], [HEAD, "|---" * HEAD.count(" | ") + "|---|"]
    for name, case, seed in cases:
        made = measured(name, case, seed, options.across)
        summary += made
        table += map(row, made)
        print("\n".join(map(row, made)), flush=True)
    write(options.out / "table.md", "\n".join(table) + "\n")
    conclude(options.out, summary)
    for entry in filter(outside, summary):
        print(f"outside: {entry['scene']}, {entry['way']}: {entry['refused'] or 'see table'}")
    for way in ("rigid", "grown"):
        done = [e for e in summary if e["way"] == way and not e["refused"]]
        assert np.mean([e["missed"] for e in done] or [0.0]) <= MISSED, way


if __name__ == "__main__":
    main()
