# # A tumbling L
#
# A free L-shaped body is pushed for five seconds and then left alone. It tumbles, bends and twists,
# and nothing acts on it any more: its energy and its angular momentum must stay constant, and its
# linear momentum zero, in runs of any length. Time integration schemes that look fine on paper fail
# here. This is the example of J. C. Simo and N. Tarnow, *The discrete energy-momentum method*, ZAMP
# 43 (1992) 757, doi:10.1007/BF00913408.
#
# Run it on any number of ranks:
#
#     python3 demos/tumbling_l.py
#     mpirun -n 2 python3 demos/tumbling_l.py --refine 2 --material neo-hooke
#
# It leaves in out/tumbling_l: `fields.pvd` for ParaView, `history.csv`, pictures of shapes,
# histories and of a comparison of three schemes, and `summary.json`.

# +
from contextlib import closing

import numpy as np
from common import Parser, conclude, draw, positive, say

import rigidfx as rf
from meshes.tumbling_l import tumbling_l
from rigidfx.plot import Curve, Shapes, curves, histories

MATERIALS = {  # E = 10⁴ Pa, ν = 0.3 at small strain, ρ0 = 10 kg/m³
    "svk": rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0),
    "neo-hooke": rf.NeoHooke(E=1e4, nu=0.3, rho=10.0),
    "mooney-rivlin": rf.MooneyRivlin(c10=1e4 / 6.5, c01=1e4 / 26, kappa=1e4 / 1.2, rho=10.0),
}
parser = Parser(__file__, "Tumbling L: conservation by three schemes.", "20 s, one Δt compared")
parser.add_argument("--dt", type=positive, default=0.1, help="time step [s]")
parser.add_argument("--t-end", type=positive, default=200.0, help="end of all runs [s] (200)")
parser.add_argument("--refine", type=int, default=1, help="cells per metre in the main run")
parser.add_argument("--cell", choices=["hexahedron", "tetrahedron"], default="hexahedron")
parser.add_argument("--order", type=int, choices=[1, 2], default=1)
parser.add_argument("--mass", choices=["lumped", "consistent"], default="lumped")
parser.add_argument("--material", choices=list(MATERIALS), default="svk")
parser.add_resume()
options = parser.read(t_end=20.0)
# -

# ## The body and its load
#
# Both end faces have 9 m²: opposite tractions on them have no resultant.

# +
LOAD = np.array([256.0, 512.0, 768.0]) / 90  # traction per second of the ramp [Pa/s]
RAMP = rf.Table([0.0, 2.5, 5.0], [0.0, 2.5, 0.0])  # p(t) [s]: up, and down again
FREE = 5.0  # s; nothing acts from here on


def push(factor: float) -> list[rf.Traction]:
    """The tractions t = ± factor p(t) LOAD on both end faces."""
    sides = {"top": factor * LOAD, "side": -factor * LOAD}
    return [rf.Traction(name, tuple(t), time=RAMP, until=FREE) for name, t in sides.items()]


scene = rf.Scene(
    tumbling_l(options.refine, options.cell),
    MATERIALS[options.material],
    push(1.0),
    order=options.order,
    mass=options.mass,
    probes={"top": (0.0, 10.0, 0.0), "corner": (0.0, 0.0, 0.0), "side": (6.0, 0.0, 0.0)},
)
# -

# ## Equations
#
# With the deformation gradient F, the second Piola-Kirchhoff stress S and the density ρ0, all in
# the reference configuration Ω, the motion u(t) fulfils for all δu
#
# $$ \int_Ω ρ_0\, \ddot u · δu \,dV + \int_Ω F S : ∇δu \,dV = \int_Γ t · δu \,dA. $$
#
# The material is St.Venant and Kirchhoff's, S = λ tr(E) I + 2μE. The traction t is a dead load: it
# does not turn with the body. It acts on the upper end of the L (y = 10 m), and its opposite on the
# side end (x = 6 m).

# ## Discretisation
#
# In space: cells with an edge of one metre, 117 of them, full integration. In time: the
# energy-momentum method. With u½ = ½ (u₀ + u₁), the averaged stress ½ (S₀ + S₁) and the mean t̄ of
# the traction, the step from t₀ to t₁ = t₀ + Δt solves
#
# $$ \int ρ_0\, \frac{v_1 - v_0}{Δt} · δu \,dV + \int F(u_½)\, \tfrac12 (S_0 + S_1) : ∇δu \,dV
#    = \int \bar t · δu \,dA, \qquad \frac{u_1 - u_0}{Δt} = \tfrac12 (v_0 + v_1). $$
#
# The choice δu = u₁ - u₀ shows that energy is conserved whatever Δt, a translation and a rotation
# of space as δu show that momenta are. For the other materials a discrete gradient takes the place
# of the averaged stress.

# ## The run
#
# The recorder adds a row per step to `history.csv` and, twice per second of simulated time, the
# displacement and the velocity to `fields.pvd`. In ParaView, apply *Warp By Vector* with
# `displacement` and scale factor 1 (a rotation must not be exaggerated), colour by `velocity`, and
# play: the fastest points change places as the axis of rotation wanders through the body.

# +
t_end = options.t_end  # s
if t_end <= FREE:
    parser.error("--t-end must be later than 5 s, when the load ends")
begin = np.array([0.0, 2.5, 5.0, 7.5])  # s
shapes = Shapes(scene, np.union1d(begin, begin + t_end - 7.5))
if options.resume:
    reports = rf.resume(options.out, scene, progress=True)
else:
    left = rf.Checkpoint(options.out)
    reports = rf.simulate(scene, options.dt, t_end, progress=True, checkpoint=left)
with rf.Recorder(scene, options.out, interval=0.5) as recorder:
    say(f"Main run: Δt = {options.dt:g} s to t = {t_end:g} s on {scene.comm.size} rank(s)")
    for report in reports:
        recorder.write(report)
        shapes.add(report)
# -

# ## Conservation

history = rf.read_history(recorder.history)
free = np.asarray(history["t"]) >= FREE - 1e-9
steps = np.asarray(history["step"]) > 0


def column(name: str) -> np.ndarray:
    """A vector of history.csv, shape (steps, 3)."""
    return np.stack([np.asarray(history[f"{name}_{axis}"]) for axis in "xyz"], axis=1)


H, J = np.asarray(history["energy"])[free], column("J")[free]  # J, kg m²/s
L = np.linalg.norm(column("L"), axis=1) / np.maximum(history["momentum_scale"], 1e-300)
summary = {
    "energy_drift": float(np.abs(H / H[0] - 1).max()),
    "angular_momentum_drift": float(np.linalg.norm(J - J[0], axis=1).max() / np.linalg.norm(J[0])),
    "linear_momentum_relative": float(np.max(L[steps])),
    "steps": int(steps.sum()),
    "cuts": int(np.sum(history["cuts"])),
    "newton_mean": float(np.mean(history["iterations"][steps])),
    "wall_per_step_s": float(np.mean(history["wall"][steps])),
    "unknowns": int(np.max(history["unknowns"])),
    "ranks": scene.comm.size,
}

# ## Three schemes compared
#
# The same body under four times that load, with strains of about 12 % and large steps. The midpoint
# rule takes S(u½), the trapezoidal rule (Newmark's method with β = ¼, γ = ½) ½ (F₀S₀ + F₁S₁) in
# place of F½ ½ (S₀ + S₁). Both are "unconditionally stable" for linear problems only. A scheme has
# broken down here when Newton's method fails in a step of the given length, or when the energy has
# doubled since the load ended.

# +
SCHEMES = {
    "energy-momentum": rf.EnergyMomentum(),
    "midpoint": rf.Midpoint(),
    "trapezoidal": rf.Trapezoidal(),
}
unit_cells = tumbling_l()


def run(scheme: rf.EnergyMomentum | rf.Midpoint | rf.Trapezoidal, dt: float) -> tuple:
    """Times and energies of one run from the end of the load on, and why it broke down, if so."""
    pushed = rf.Scene(unit_cells, MATERIALS["svk"], push(4.0), mass="consistent", scheme=scheme)
    t, energies = [], []
    try:
        with closing(rf.simulate(pushed, dt, t_end, progress=True)) as steps:
            for r in steps:
                if r.cuts:
                    return t, energies, "Newton failed"
                if r.t >= FREE - 1e-9:
                    t.append(r.t)
                    energies.append(r.energy)
                    if not r.energy <= 2 * energies[0]:
                        return t, energies, "the energy doubled"
    except rf.StepError:
        return t, energies, "Newton failed"
    return t, energies, None


# -

summary["comparison"] = []
panels = {}
for dt in [0.5] if options.short else [0.2, 0.5]:  # s
    panels[f"Δt = {dt:g} s"] = group = []
    for name, scheme in SCHEMES.items():
        say(f"Four times the load, Δt = {dt:g} s: {name}")
        t, energies, reason = run(scheme, dt)
        relative = np.array(energies) / energies[0]
        group.append(Curve(name, t, relative, reason is not None))
        summary["comparison"].append(
            {
                "scheme": name,
                "dt": dt,
                "reached": t[-1],
                "breaks_down": reason is not None,
                "reason": reason,
                "energy_drift": float(np.abs(relative - 1).max()),
            }
        )

# ## Pictures and numbers

histories(
    recorder.history,
    options.out / "histories.png",
    free_since=FREE,
    title=f"Tumbling L, energy-momentum method, Δt = {options.dt:g} s",
)
draw(options, shapes, "Tumbling L", "shapes", view=(0.45, -0.5, 1.0), up=(0.0, 1.0, 0.0))
curves(
    panels,
    options.out / "comparison.png",
    xlabel="time (s)",
    ylabel="energy / energy at 5 s",
    title="Four times the load: crosses mark where a scheme breaks down",
)
conclude(options.out, summary)

# ## Assertions
#
# The drifts are set by Newton's tolerance alone. The energy-momentum method reaches the end in
# every comparison. All numbers are the same on all ranks, so that a failure is one of all.

assert summary["energy_drift"] <= 1e-10
assert summary["angular_momentum_drift"] <= 1e-10
assert summary["linear_momentum_relative"] <= 1e-10
for entry in summary["comparison"]:
    if entry["scheme"] == "energy-momentum":
        assert not entry["breaks_down"], entry
        assert entry["energy_drift"] <= 1e-10, entry
    elif t_end >= 200.0 or options.short:
        assert entry["breaks_down"], entry
