# # A drop test: rigid in flight, flexible in a hit
#
# A device falls half a metre onto a corner: a shell of 3 mm, two boards across it, and a heavy
# block between them. It touches the floor in a few milliseconds of the 0.4 s that are computed. In
# these cells strain at hundreds per second; then vibrations die away, and the device flies as one
# body of six unknowns. It rebounds, turns and hits again with another corner.
#
#     python3 demos/drop_test.py --compare
#     mpirun -n 2 python3 demos/drop_test.py --short
#
# With `--compare` a fully flexible run goes beside it, step by step. It leaves in out/drop_test:
# `fields.pvd` for ParaView with `contact_pressure` and `gap`, `history.csv`, `events.csv`,
# pictures, and `summary.json`.

# +
import numpy as np
from common import Parser, conclude, draw, go, positive

import rigidfx as rf
from meshes.device import device
from rigidfx.plot import Curve, Shapes, curves

parser = Parser(__file__, "A device falls on its corner, rebounds and hits again.", "a low fall")
parser.add_argument("--compare", action="store_true", help="run the flexible twin beside it")
parser.add_argument("--size", type=positive, default=0.02, help="largest edge of a cell [m]")
parser.add_argument("--tol", type=positive, default=0.7, help="rigid below this rate [1/s]")
parser.add_argument("--height", type=positive, default=0.5, help="of the corner at first [m]")
parser.add_argument("--after", type=positive, default=0.1, help="time after the touch [s]")
parser.add_resume()
options = parser.read(height=0.01, after=0.006, tol=5.0)
# -

# ## The device
#
# gmsh builds it of boxes that share their faces (`meshes/device.py`), in hexahedra of first order
# that do not lock. It is turned so that a corner leads, and the centre of mass is not quite above
# that.

# +
plastic = rf.NeoHooke(E=2.4e9, nu=0.35, rho=1200.0)  # Pa, 1, kg/m³
laminate = rf.StVenantKirchhoff(E=2e10, nu=0.2, rho=1900.0)
battery = rf.StVenantKirchhoff(E=1e10, nu=0.3, rho=2700.0)
body = device(options.size, up=(0.060, 0.035, 0.036), height=options.height)
# -

# ## The fall
#
# In free fall steps of 1 ms suffice. From a millisecond before the touch on they resolve the waves,
# also in the rigid flight. A step ends when the corner touches. With the rule `wake="all"` a
# contact that closes releases all bodies in that very step. Screwed and clipped joints damp: 5 % at
# 1 kHz.

# +
G, DT = 9.81, 1e-4  # m/s², s
touch = float(np.sqrt(2 * options.height / G))
closer = touch - 10.5 * DT  # on no step's end, so that it has to be foreseen
t_end = touch + options.after
floor = rf.Contact("skin", against=rf.Plane((0, 0, 0), (0, 0, 1)), title="floor")
scene = rf.Scene(
    body,
    {"shell": plastic, "board": laminate, "heavy": battery},
    [floor, rf.Gravity((0, 0, -G)), rf.StiffnessDamping(ratio=0.05, frequency=1000.0)],
    element="enhanced",
)
criterion = rf.StrainRate(options.tol, 20 * DT, wake="all", min_cells=20)
shots = np.array([-1e-3, 5e-4, 4e-3, 0.012, 0.03, 0.06, 0.075, 0.1])  # s after the touch
shapes = Shapes(scene, touch + shots[shots <= options.after], colour="rigid")
steps = {0.0: 1e-3, closer: DT}
how = {"record": {"every": 10}, "compare": options.compare}
run = go(options, scene, steps, t_end, criterion, shapes, **how)
# -

# ## Results
#
# A hit ends where the floor has let go for a millisecond; its peak is its largest force, and its
# rebound the speed of the centre away from the floor just after.

# +
PRESSED = 1e-5  # of the largest force; a foreseen touch errs by nanometres, and presses that much
mass = scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())


def forces(of: list[rf.Report]) -> np.ndarray:
    """Force of the floor in each step [N]."""
    return np.array([r.touches["floor"].force[2] if r.step else 0.0 for r in of])


def hits(of: list[rf.Report]) -> list[dict[str, float]]:
    """Time, peak force and rebound of each hit that is over [s, N, m/s]."""
    f, t = forces(of), np.array([r.t for r in of])
    pressed = np.flatnonzero(f > PRESSED * f.max())
    groups = np.split(pressed, np.flatnonzero(np.diff(t[pressed]) > 1e-3) + 1)
    found = []
    for group in groups:
        if group.size and t[-1] > t[group[-1]] + 1e-3:
            after = of[group[-1] + 1]
            begins, peak = float(t[group[0] - 1]), float(f[group].max())
            rebound = float(after.linear_momentum[2]) / mass
            found.append({"t": begins, "peak_force": peak, "rebound": rebound})
    return found


reports = run.adaptive
f, unknowns = forces(reports), np.array([r.unknowns for r in reports])
falling = [r for r in reports if r.t < touch - 1e-9]
struck = int(np.argmax(f > PRESSED * f.max()))
found = hits(reports)
summary = run.summary() | {
    "unknowns_before_touch": falling[-1].unknowns,
    "unknowns_at_touch": reports[struck].unknowns,
    "steps_of_six_unknowns": int(np.count_nonzero(unknowns == 6)),
    "first_touch": reports[struck - 1].t,
    "first_touch_error": abs(reports[struck - 1].t - touch),
    "hits": found,
}
if options.compare:
    twin = hits(run.flexible)
    summary["hits_flexible"] = twin
    for name in ("peak_force", "rebound"):
        off = [abs(a[name] / b[name] - 1) for a, b in zip(found, twin, strict=True)]
        summary[f"{name}_errors"] = off
conclude(options.out, summary)


def force(name: str, of: list[rf.Report]) -> Curve:
    """The force of the floor, from the touch on."""
    late = [r for r in of if r.t > closer]
    return Curve(name, [r.t for r in late], forces(late))


curves(
    {
        "Force of the floor": [force(name, of) for name, of in run.runs.items()],
        "Unknowns": run.curves("unknowns"),
        "Energy stored by strains": run.curves("strain"),
    },
    options.out / "motion.png",
    xlabel="time (s)",
    ylabel=["force (N)", "number", "energy (J)"],
    title="A device falls on its corner",
)
draw(options, shapes, "Drop test: rigid and flexible parts", view=(0.3, -1.0, 0.4))
# -

# ## Assertions

# +
assert struck > 0
# The energy of neo-Hooke's material at next to no strain rounds by ε E V.
rounding = float(np.finfo(np.float64).eps) * plastic.E * mass / plastic.rho
assert summary["energy_drift"] < rounding / max(r.energy for r in reports)
assert summary["first_touch_error"] < 1e-6
assert summary["unknowns_before_touch"] == 6
assert summary["unknowns_at_touch"] == summary["unknowns_start"]
if not options.short:
    assert len(found) >= 2
if options.compare and not options.short:
    assert max(summary["peak_force_errors"]) < 0.02
    assert max(summary["rebound_errors"]) < 0.02
# -
