# # A slider-crank: a few unknowns while it runs, more when it is struck
#
# A motor brings a crankshaft to 100 rad/s within 20 ms, turns it three times, and stops it. A slim
# rod moves a heavy block along a guide. At each inner dead centre the block meets a sprung stop,
# half a millimetre before its way ends. While the machine runs smoothly its parts hardly strain:
# they become bodies, with all holes and fillets, and joints hold them together. At the blow of the
# stop, and at the brake, bodies get the shapes that forces call for, in the step in which these
# begin, or cells wake.
#
#     python3 demos/mechanism.py --compare
#     mpirun -n 2 python3 demos/mechanism.py --short
#
# With `--compare` a fully flexible run goes beside it, step by step. It leaves in out/mechanism:
# `fields.pvd` for ParaView, `history.csv` and `events.csv`, pictures of the motion and of the rigid
# parts, and `summary.json`. Pictures of all times: `pvbatch out/mechanism/view.py --film`.

# +
import numpy as np
from common import Parser, conclude, draw, events_of, freezes_of, go, positive, say, share_of
from common.machines import ramp

import rigidfx as rf
from meshes.mechanism import FILLET, LENGTH, RADIUS, slider_crank
from rigidfx.plot import Curve, Shapes, curves

parser = Parser(
    __file__, "A slider-crank: few unknowns while it runs smoothly.", "a third of a turn, order 1"
)
parser.add_argument("--compare", action="store_true", help="run the flexible twin beside it")
parser.add_argument("--size", type=positive, default=0.03, help="largest edge of a cell [m]")
parser.add_argument("--tol", type=positive, default=0.01, help="quiet below this rate [1/s]")
parser.add_argument("--turns", type=positive, default=3.0, help="until the brake begins")
parser.add_resume()
options = parser.read(turns=0.65)
# -

# ## Parts, joints and the motor
#
# gmsh builds the parts of steel (`meshes/mechanism.py`); none touches another. In the rod cells are
# half as long. Each joint takes hold of the mean motion of two surfaces. The ball joint at the
# wrist, and the crank pin, which leaves the rod free along it, hold no direction twice. The speed
# follows smooth ramps.

# +
order = 1 if options.short else 2
SPEED, RAMP = 100.0, 0.02  # rad/s, s
BRAKE = RAMP / 2 + 2 * np.pi * options.turns / SPEED  # s; when the brake begins
Z = 0.0, 0.0, 1.0
wrist = RADIUS + LENGTH, 0.0, 0.0
face = rf.MeanFace


def speed(t: float) -> float:
    """Speed of the crank [rad/s]."""
    return SPEED * (ramp(t / RAMP) - ramp((t - BRAKE) / RAMP))


scene = rf.Scene(
    slider_crank(options.size, options.size / 2),
    rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7800.0),  # Pa, 1, kg/m³
    [
        rf.Revolute("ground", face("journals"), (0, 0, 0), Z, name="bearing"),
        rf.Cylindrical(face("pin"), face("big eye"), (RADIUS, 0, 0), Z, name="crank pin"),
        rf.Spherical(face("small eye"), face("wrist"), wrist, name="wrist pin"),
        rf.Prismatic("ground", face("slides"), wrist, (1, 0, 0), name="guide"),
        rf.Motor("bearing", speed=speed),
        rf.Stop("guide", low=-2 * RADIUS + 5e-4, stiffness=2e7),  # N/m
        rf.NumericalDamping(0.1),
    ],
    order=order,
    mass="consistent" if order == 2 else "lumped",
    probes={"fillet": FILLET, "block": (RADIUS + LENGTH + 0.069, 0.0, 0.03)},
)
# -

# ## The runs
#
# The fastest strain of the smooth run is some hundredth per second, at the fillets; a blow strains
# at 0.3 to 0.8 per second. Joints, and a stop, release nothing by themselves: found bodies
# grow the shapes that their forces call for.

# +
DT, WINDOW = (1e-3 if options.short else 2e-4), 0.005  # s
t_end = BRAKE + (0.0 if options.short else RAMP + 0.01)  # s
rule = rf.StrainRate(options.tol, WINDOW)
stops = [0.043 + k * 2 * np.pi / SPEED for k in range(3)]  # s
shapes = Shapes(scene, [t for t in (0.03, *stops, 0.08, 0.15, 0.2) if t < t_end], colour="rigid")


def share(report: rf.Report) -> dict[str, float]:
    """Part of the cells that are in rigid bodies, and the stress at the fillet [Pa]."""
    stress = report.stresses["fillet"].von_mises if report.step else 0.0
    return {"rigid": share_of(None, scene, report), "stress": float(stress)}


how = {"record": {"interval": 10 * DT}, "compare": options.compare}
run = go(options, scene, DT, t_end, rule, shapes, note=share, note_beside=share, **how)
# -

# ## Results
#
# Joints stay closed to rounding, and the motor's work equals the gain of energy and the losses by
# dampers. The effect of bodies on the motion is measured by the displacement
# of the block minus that of rigid links, 60 µm of 100 mm. It agrees with the twin to a hundredth
# of that, blows included.

# +
reports, notes = run.adaptive, run.notes


def way(of: list[rf.Report]) -> np.ndarray:
    """Displacement of the block less that of rigid links [m]."""
    turn = np.array([r.joints["bearing"].angle if r.step else 0.0 for r in of])
    rigid = RADIUS * np.cos(turn) + np.sqrt(LENGTH**2 - (RADIUS * np.sin(turn)) ** 2)
    return np.array([r.probes["block"][0] for r in of]) - (rigid - RADIUS - LENGTH)


rigid, stress = (np.array([note[key] for note in notes]) for key in ("rigid", "stress"))
summary = run.summary() | {
    "shapes_most": max((body.shapes for r in reports for body in r.bodies), default=0),
    "rigid_share": float(rigid.mean()),
    "joints_open_by_m": max(j.gap for r in reports[1:] for j in r.joints.values()),
    "freezes": len(freezes_of(reports)),
    "largest_stress_at_fillet_Pa": float(stress.max()),
    "order": order,
}
if options.compare:
    beside = np.array([note["stress"] for note in run.notes_beside])
    ours, theirs = (list(of) for of in zip(*run.matched(), strict=True))
    told = np.abs(way(ours) - way(theirs)).max() / np.abs(way(theirs)).max()
    off = stress[[r.step for r in ours]] - beside[[r.step for r in theirs]]
    summary |= {
        "error_of_way": float(told),
        "error_of_stress": float(np.abs(off).max() / beside.max()),
        "error_of_largest_stress": float(abs(stress.max() / beside.max() - 1)),
    }
conclude(options.out, summary)

stresses = {"adaptive": stress} | ({"all flexible": beside} if options.compare else {})
curves(
    {
        "Way of the block beside that of rigid links": [
            Curve(name, [r.t for r in of], 1e6 * way(of)) for name, of in run.runs.items()
        ],
        "Stress at the rod's fillet": [
            Curve(name, [r.t for r in of], 1e-6 * stresses[name]) for name, of in run.runs.items()
        ],
        "Unknowns": run.curves("unknowns"),
    },
    options.out / "motion.png",
    xlabel="time (s)",
    ylabel=["displacement (µm)", "von Mises stress (MPa)", "number"],
    title="Slider-crank: start, run, blows and stop",
)
draw(options, shapes, "Slider-crank: rigid and flexible parts", view=(0.35, -0.6, 1.0))
# -

# ## Assertions

# +
assert summary["energy_drift"] <= 1e-9
assert summary["energy_jump"] <= 1e-11
assert summary["joints_open_by_m"] <= 1e-11
if parser.defaults(options, "tol", "size", "turns"):
    assert summary["unknowns_end"] < 0.1 * summary["unknowns_start"]
    kinds = [event.kind for event in events_of(reports)]
    assert summary["shapes_most"] > 0 or "release" in kinds
if options.compare and parser.defaults(options, "tol", "size", "turns"):
    assert summary["error_of_way"] <= 0.01
    assert summary["error_of_largest_stress"] <= 0.02
say("Smoothly running it has few unknowns; struck, it gets more.")
# -
