# # A gong: long rigid, struck in one place, then in another
#
# A square plate of 1 m with a heavy hub hangs in soft springs at its rim and swings, as one body of
# few unknowns. It is struck near a corner, and later beside the hub. Each blow wakes it in the very
# step in which it begins; waves run over the plate and are damped by what is laid on it, and it
# swings on as one body. Nothing tells the run where the blows are, or when they are over.
#
#     python3 demos/gong.py --compare
#     mpirun -n 2 python3 demos/gong.py --short
#
# With `--compare` a fully flexible run goes beside it, step by step. It leaves in out/gong:
# `fields.pvd` for ParaView, `history.csv`, `events.csv`, pictures, and `summary.json`.

# +
import numpy as np
from common import Parser, conclude, draw, go, positive, say, share_of
from common.machines import pulse

import rigidfx as rf
from meshes.gong import HUB, MALLET, SIDE, gong
from rigidfx.plot import Curve, Shapes, curves

parser = Parser(__file__, "A gong is struck in one place, then in another.", "a coarse plate")
parser.add_argument("--compare", action="store_true", help="run the flexible twin beside it")
parser.add_argument("--across", type=int, default=32, help="cells along a side, in sixteens")
parser.add_argument("--tol", type=positive, default=8e-4, help="rigid below this rate [1/s]")
parser.add_argument("--t-end", type=positive, default=0.6, help="end [s]")
parser.add_resume()
options = parser.read(across=16, t_end=0.42)
# -

# ## The gong and its blows
#
# One layer of hexahedra that do not lock (`meshes/gong.py`). A blow is a force of 10 ms, 500 N at
# most, on a square of the face. On its springs the plate swings once in two seconds. It damps 30 %
# at 20 Hz, about the first frequency of a free plate: a blow is over after a tenth of a second.

# +
BLOWS = {"corner": 0.1, "side": 0.4}  # s; on which facets, and when they begin
LENGTH, PEAK = 0.01, 500.0  # s, N
plastic = rf.StVenantKirchhoff(E=3e9, nu=0.3, rho=1200.0)  # Pa, 1, kg/m³
steel = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
pressure = (0.0, 0.0, -PEAK / MALLET**2)  # Pa
blows = [rf.Traction(name, pressure, time=pulse(t, LENGTH)) for name, t in BLOWS.items()]
swing = rf.InitialVelocity(linear=(0, 0, 0.05))  # m/s
damping = rf.StiffnessDamping(ratio=0.3, frequency=20.0)
scene = rf.Scene(
    gong(options.across),
    {"plate": plastic, "hub": steel},
    [rf.Spring("rim", 330.0), damping, swing, *blows],  # N/m
    element="enhanced",
    probes={"corner": (SIDE, SIDE, 0), "across": (0, 0, 0), "hub": (SIDE / 2, SIDE / 2, 0)},
)
# -

# ## The runs
#
# A load releases nothing by itself: a body gets shapes as its force calls for them, and wakes where
# these do not follow. A criterion of tolerance zero finds nothing rigid in the twin, but measures
# how fast its cells strain, and so which of them might have been rigid.

# +
DT, WINDOW = 2e-3, 20  # s, steps
FEW = 0.02  # of the unknowns of the flexible plate
rule = rf.StrainRate(options.tol, WINDOW * DT)
measuring = rf.StrainRate(0.0, 1e9, wake="none")
owned = scene.mesh.topology.index_map(3).size_local


def shares(report: rf.Report) -> dict[str, float]:
    """Rigid shares in a step, and of what is below the mallet where a blow begins in it."""
    if not report.step:
        return {}
    below = [name for name, t in BLOWS.items() if t < report.t < t + 1.5 * DT]
    names = "plate", "hub", *(f"under {name}" for name in below)
    return {name: share_of(name, scene, report) for name in names}


def all_rates(report: rf.Report) -> np.ndarray | None:
    """Strain rates of all cells in a step of the twin, on rank 0 [1/s]."""
    if not report.step:
        return None
    numbers = scene.mesh.topology.original_cell_index[:owned]
    parts = scene.comm.gather((numbers, report.strain_rate[:owned]))
    if parts is None:
        return None
    order, rates = (np.concatenate(both) for both in zip(*parts, strict=True))
    return rates[np.argsort(order)]


times = [0.08, 0.102, 0.18, 0.3, 0.402, 0.42, 0.46, 0.5]  # s
shapes = Shapes(scene, [t for t in times if t <= options.t_end], colour="rigid")
how = {"record": {"every": 10}, "compare": options.compare, "beside": measuring}
how |= {"note": shares, "note_beside": all_rates}
run = go(options, scene, DT, options.t_end, rule, shapes, **how)
# -

# ## Results
#
# A cell is quiet in a window of 20 steps in none of which the twin strains it faster than the
# tolerance. The effect of rigid parts on the motion is measured by the displacement of a corner,
# most of which is the swing, and by the bend of a diagonal, which does not contain the swing.

# +
reports, notes = run.adaptive, run.notes[1:]
rigid = {part: [found[part] for found in notes] for part in ("plate", "hub")}
struck = {name: n[f"under {name}"] for name in BLOWS for n in notes if f"under {name}" in n}
rates = scene.comm.bcast(run.notes_beside[1:])
summary = run.summary() | {
    "steps_of_few_unknowns": sum(r.unknowns < FEW * reports[0].unknowns for r in reports),
    "rigid_share": float(np.mean(rigid["plate"]) * (1 - HUB**2) + np.mean(rigid["hub"]) * HUB**2),
    "rigid_share_of_hub": float(np.mean(rigid["hub"])),
    "rigid_when_struck": struck,
}


def quiet_share() -> float:
    """Share of time × cells that might have been rigid."""
    windows = [np.array(rates[k : k + WINDOW]) for k in range(0, len(rates), WINDOW)]
    quiet = sum(np.count_nonzero((w <= options.tol).all(axis=0)) * len(w) for w in windows)
    return quiet / (rates[0].size * len(rates))


def way(of: list[rf.Report]) -> np.ndarray:
    """Displacement of the corner, across the plate [m]."""
    return np.array([r.probes["corner"][2] for r in of])


def bend(of: list[rf.Report]) -> np.ndarray:
    """Displacement of the diagonal's ends relative to its middle, their sum [m]."""
    corner, across, hub = np.array([list(r.probes.values()) for r in of])[:, :, 2].T
    return corner + across - 2 * hub


def deviation(ours: np.ndarray, twin: np.ndarray) -> float:
    """Largest difference, over the largest value."""
    return float(np.abs(ours - twin).max() / np.abs(twin).max())


if options.compare:
    peak = max(float(of_step.max()) for of_step in rates)
    summary |= {
        "tol_over_peak": options.tol / peak,
        "quiet_share": quiet_share(),
        "error_of_way": deviation(way(reports), way(run.flexible)),
        "error_of_bend": deviation(bend(reports), bend(run.flexible)),
    }
conclude(options.out, summary)

curves(
    {
        "Way of a corner": [
            Curve(name, [r.t for r in of], 1e3 * way(of)) for name, of in run.runs.items()
        ],
        "Energy stored by strains": run.curves("strain"),
        "Unknowns": run.curves("unknowns"),
    },
    options.out / "motion.png",
    xlabel="time (s)",
    ylabel=["displacement (mm)", "energy (J)", "number"],
    title="A gong is struck twice",
)
draw(options, shapes, "Gong: rigid and flexible parts", view=(0.3, -0.8, 0.9))
# -

# ## Assertions

# +
assert summary["energy_drift"] < 1e-10
assert summary["steps_of_few_unknowns"] > 0.3 * summary["steps"]
assert struck == dict.fromkeys(BLOWS, 0.0)
# All freezes together, and the hub stays a body as the plate wakes round it.
assert summary["rigid_share_of_hub"] >= summary["rigid_share"]
if options.compare:
    assert summary["quiet_share"] >= 0.3
    assert summary["rigid_share"] >= 0.6 * summary["quiet_share"]
    assert summary["error_of_way"] <= 0.005
say("Struck, it wakes; left alone, it is one body.")
# -
