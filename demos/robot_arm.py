# # A robot's arm: thick parts freeze while the thin one swings
#
# A linear axis moves the arm 50 mm to the side in 40 ms and stops. The hub, the link and the head
# are thick, and drilled; between link and head is a leaf of 2.5 mm, on which the head goes on
# swinging. Seen from the leaf the thick parts hardly strain: they become rigid, with the holes and
# fillets that took so many cells to mesh, and only the leaf, its roots and the seat on the axis are
# computed as flexible. When the axis moves back all is released, and becomes rigid again
# afterwards.
#
#     python3 demos/robot_arm.py
#     mpirun -n 2 python3 demos/robot_arm.py --size 0.010
#
# A fully flexible run goes beside it, step by step. It leaves in out/robot_arm: `fields.pvd` for
# ParaView, `history.csv` and `events.csv`, pictures of the motion and of the rigid parts, and
# `summary.json`.

# +
from functools import partial

import numpy as np
from common import Parser, conclude, draw, events_of, freezes_of, go, positive, say, share_of
from common.machines import travel

import rigidfx as rf
from meshes.robot_arm import HEIGHT, TIP, robot_arm
from rigidfx.plot import Curve, Shapes, curves

parser = Parser(
    __file__, "A robot's arm: thick parts freeze, thin ones swing.", "one move, order 1"
)
parser.add_argument("--size", type=positive, default=0.016, help="largest edge of a cell [m]")
parser.add_argument("--tol", type=positive, default=0.03, help="rigid below this rate [1/s]")
parser.add_resume()
options = parser.read(size=0.02, tol=1e-3)
# -

# ## The arm and its motion
#
# gmsh builds the arm from plates and cylinders, rounds its re-entrant corners, drills it and cuts
# it into tetrahedra (`meshes/robot_arm.py`). The leaf has one layer of cells, which bends rightly
# only if displacements are of second order; these want a consistent mass. With first-order cells,
# as in the short run, the leaf is many times too stiff: that run is a test of the program, not of
# an arm.
#
# The axis moves by a smooth path, at rest and without acceleration at both ends. Where it begins
# and where it ends all bodies are released, as wherever a support begins or ends.

# +
DISTANCE, TRAVEL = 0.05, 0.04  # m, s; of a move
BACK = 0.14  # s; the second move begins
order = 1 if options.short else 2


def way(begin: float, distance: float, t: float) -> tuple[float, float, float]:
    """A smooth way along y that begins at a time [s]: the displacement at t [m]."""
    return 0.0, distance * travel((t - begin) / TRAVEL), 0.0


there, back = partial(way, 0.0, DISTANCE), partial(way, BACK, -DISTANCE)
scene = rf.Scene(
    robot_arm(options.size, max(0.012, 0.6 * options.size)),
    rf.StVenantKirchhoff(E=7e10, nu=0.33, rho=2700.0),  # aluminium: Pa, 1, kg/m³
    [
        rf.PrescribedMotion("bore", displacement=there, until=TRAVEL),
        rf.Fixed("bore", since=TRAVEL, until=BACK),
        rf.PrescribedMotion("bore", displacement=back, since=BACK, until=BACK + TRAVEL),
        rf.Fixed("bore", since=BACK + TRAVEL),
        rf.NumericalDamping(0.05),
    ],
    order=order,
    mass="consistent" if order == 2 else "lumped",
    probes={"tip": (TIP, 0.0, HEIGHT / 2)},
)
# -

# ## The runs
#
# Observation begins when the axis stands still. By the rule `wake="all"` whatever a support does
# releases all bodies and begins a new window, so that no part becomes rigid during the second move
# either.

# +
DT = 0.001  # s
t_end = 0.08 if options.short else 0.26  # s
window = 0.02 if options.short else 0.04  # s; longer than a swing
tol = options.tol  # 1/s
criterion = rf.StrainRate(tol, window, wake="all", min_cells=20, since=TRAVEL)
times = [0.02, 0.04, 0.06, 0.08]  # s
if not options.short:
    times = [0.02, 0.05, 0.09, 0.13, 0.16, 0.19, 0.225, 0.25]
shapes = Shapes(scene, times, colour="rigid")


def frozen(report: rf.Report) -> dict[str, float]:
    """These parts of some sets where something has been frozen."""
    if not any(event.kind == "freeze" for event in report.events):
        return {}
    return {name: share_of(name, scene, report) for name in ("arm", "link", "leaf", "head")}


record = {"interval": 2 * DT}
run = go(options, scene, DT, t_end, criterion, shapes, record=record, note=frozen)
shares = next((found for found in reversed(run.notes) if found), {})
# -

# ## Results
#
# The swing is the motion of the head's end relative to the axis. The runs are compared by it, by
# their energies from the end of the first move on, where no support does work, and by their times
# in the steps with rigid parts.


# +
def swing(of: list[rf.Report]) -> np.ndarray:
    """y of the head's end relative to the axis [m]."""
    return np.array([r.probes["tip"][1] - there(r.t)[1] - back(r.t)[1] for r in of])


def period(t: np.ndarray, y: np.ndarray) -> float:
    """Mean time between zeros of the same direction [s]."""
    k = np.flatnonzero(np.diff(np.sign(y)))
    zeros = t[k] - y[k] * (t[k + 1] - t[k]) / (y[k + 1] - y[k])
    return float(2 * np.diff(zeros).mean())


reports, both = run.adaptive, run.matched()
t = np.array([r.t for r, _ in both])
y, reference = (swing([pair[k] for pair in both]) for k in (0, 1))
events, freezes = events_of(reports), freezes_of(reports)
most = reports[0].unknowns
rigid = [r for r in reports if r.unknowns < most]
beside_rigid = [b for a, b in both if a.unknowns < most]
free = (t > TRAVEL + 1e-9) & (t < BACK - 1e-9)
last = t > BACK + TRAVEL
summary = run.summary() | {
    "rigid_shares": shares,
    "period_s": period(t[free], y[free]),
    "period_flexible_s": period(t[free], reference[free]),
    "swing_m": float(np.abs(reference).max()),
    "swing_deviation": float(np.abs(y - reference).max() / np.abs(reference).max()),
    "energy_deviation": max(
        abs(a.energy - b.energy) / b.energy
        for (a, b), f in zip(both, free | last, strict=True)
        if f
    ),
    "time_ratio_window": sum(r.wall for r in rigid) / sum(r.wall for r in beside_rigid)
    if rigid
    else None,
    "cuts": [sum(r.cuts for r in of) for of in run.runs.values()],
    "order": order,
    "tol": tol,
}
conclude(options.out, summary)

curves(
    {
        "Swing of the head's end relative to the axis": [
            Curve("adaptive", t, 1e3 * y),
            Curve("all flexible", t, 1e3 * reference),
            Curve("their distance", t, 1e3 * (y - reference)),
        ],
        "Total energy": run.curves("energy"),
        "Unknowns": run.curves("unknowns"),
    },
    options.out / "motion.png",
    xlabel="time (s)",
    ylabel=["displacement (mm)", "energy (J)", "number"],
    title="Robot's arm: a move there and a move back",
)
draw(options, shapes, "Robot's arm: rigid and flexible parts", view=(0.45, -1.0, 0.55))
# -

# ## Assertions

assert summary["energy_jump"] <= 1e-11
if parser.defaults(options, "tol", "size"):
    assert summary["unknowns_end"] < 0.7 * summary["unknowns_start"]
    assert shares["head"] > 0.5 > shares["leaf"]
    assert summary["swing_deviation"] <= 0.05
    assert summary["energy_deviation"] <= (0.1 if options.short else 0.05)
if parser.defaults(options, "tol", "size") and not options.short:
    assert sum(event.kind == "release" for event in events) >= 1
    assert len(freezes) >= 2
    assert reports[-1].unknowns < summary["unknowns_start"]
say("The thick parts are rigid, the leaf swings.")
