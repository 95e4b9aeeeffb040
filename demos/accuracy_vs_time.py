# # What accuracy costs in time
#
# A simulation has many knobs: the rigidity tolerance and its observation window, Δt, the order of
# its elements, the mass matrix, damping, Newton's tolerance. Each buys accuracy or time. How much
# of which? Here three structures are run again and again, with one knob turned at a time, with a
# few settings that combine what turns out to be worthwhile, and by themselves, to an accuracy that
# is asked for. Each run is compared with one on the same mesh, all flexible, with steps a 32nd
# as long.
#
#     python3 demos/accuracy_vs_time.py
#     python3 demos/accuracy_vs_time.py --only frame --minutes 4
#     mpirun -n 2 python3 demos/accuracy_vs_time.py --short
#
# `--only` takes the structures whose names contain a word; after `--minutes` no further run begins,
# and the same command goes on from there. A run that is finished is a file in
# out/accuracy_vs_time/runs, named by its settings; a further call of the demo skips it, unless the
# structure has changed since; delete these files after other changes, of rigidfx itself say. When
# all are there, the demo leaves `accuracy_vs_time.png` and, with all numbers,
# `accuracy_vs_time.csv`, `accuracy_vs_time.json` and `summary.json`; `plan.json` is there from the
# start.

# +
import time
from functools import partial

import numpy as np
from accuracy import Points, Setting, Structure, Study, draw, known, plan, run, written_as_csv
from common import Parser, chosen, comm, conclude, say, write, write_json

import rigidfx as rf
from meshes.block_with_cantilever import block_with_cantilever
from meshes.spatial_frame import spatial_frame
from meshes.tumbling_l import tumbling_l

parser = Parser(__file__, "What accuracy costs in time.", "few runs, short")
parser.add_only("structures")
parser.add_argument("--minutes", type=float, default=np.inf, help="after which no run begins")
options = parser.read()
# -

# ## Three structures, and the knobs of a run
#
# A scene takes the knobs of a run, a `Setting`: order, mass matrix and damping are the scene's; the
# tolerance and its window, Δt, Newton's tolerance and the solver are the run's; the mesh comes with
# its fineness.


# +
def body(domain: rf.Domain, setting: Setting) -> rf.Scene:
    """The block with a cantilever, thrown into a turn."""
    domain = domain.with_facets(
        "block faces", lambda x: (x[0] < 9.01) & (np.abs(x[2] - 3.0) > 2.99)
    ).with_facets("tip face", lambda x: (x[0] > 14.99) & (x[2] > 3.99))
    return rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=5e5, nu=0.3, rho=100.0),  # Pa, 1, kg/m³
        [
            rf.Traction("block faces", (0.0, 0.0, -1e4 / 97.2), until=2.0),  # N/m²
            rf.Traction("tip face", (0.0, 0.0, 1e4 / 14.4), until=2.0),
            *setting.effects,
        ],
        order=setting.order,
        mass=setting.mass,
        probes={"end": (23.0, 2.7, 3.0), "one": (9.0, 2.7, 0.0), "other": (9.0, 2.7, 6.0)},
    )


def frame(domain: rf.Domain, setting: Setting) -> rf.Scene:
    """The plate on four columns, under a shock."""
    return rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=7e10, nu=0.2, rho=2700.0),  # Pa, 1, kg/m³
        [
            rf.Fixed("feet"),
            rf.Fixed("symmetry", "y"),
            rf.Traction("side", (4250.0, 0.0, 0.0), until=0.05),  # Pa
            *setting.effects,
        ],
        order=setting.order,
        mass=setting.mass,
        probes={"a": (6.0, 3.0, 4.5)},
    )


def tumbling(domain: rf.Domain, setting: Setting) -> rf.Scene:
    """The L, pushed and let go."""
    load = np.array([256.0, 512.0, 768.0]) / 90  # Pa/s
    ramp = rf.Table([0.0, 2.5, 5.0], [0.0, 2.5, 0.0])  # s
    return rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0),  # Pa, 1, kg/m³
        [
            rf.Traction("top", tuple(load), time=ramp, until=5.0),
            rf.Traction("side", tuple(-load), time=ramp, until=5.0),
            *setting.effects,
        ],
        order=setting.order,
        mass=setting.mass,
        probes={"end": (0.0, 10.0, 1.5), "one": (6.0, 1.5, 0.0), "other": (6.0, 1.5, 3.0)},
    )


# -

# The structures are those of the other demos, over shorter times, and with less damping where it
# was chosen to tell a story. The free-flying body is pushed by tractions: equal forces on the nodes
# would change with the mesh.
#
# The motion that is compared must not depend on where a free body has drifted to or how far it has
# turned. It is the difference between the distances of one end from two points on opposite sides
# of the body: zero at first, and proportional to the bending between them. Of the frame it is the
# displacement of a point of the plate.


# +
def bending(x: Points) -> float:
    """Difference between two distances of a free body's end [m]."""
    return float(np.linalg.norm(x["end"] - x["one"]) - np.linalg.norm(x["end"] - x["other"]))


def sway(x: Points) -> float:
    """Displacement of the frame's point a in x [m]."""
    return float(x["a"][0] - 6.0)


# -

# ## Damping
#
# Numerical damping is a knob that is easily misread. With it the stress of a step is
# $S_m + ξ (S_1 - S_0) ≈ S_m + ξ Δt\, \dot S$: a viscosity with the time constant ξΔt. Halving Δt
# alone would halve the damping, and a finer run would be another structure. So the viscous stress
# $β\, ℂ:\dot E$ itself is given here (`StiffnessDamping`), which is ξΔt's with β = ξΔt and does not
# depend on Δt; turning the knob means to change β.

# ## The settings
#
# The base: elements of first order, 15 to 40 steps per period of the main vibration, lumped mass,
# Newton's iteration to 10⁻⁶, a tolerance at which much of the damped structures becomes rigid, and
# little of the tumbling L, which nothing damps. The reference has the same mesh, a 32nd of Δt
# (in the short version half), Newton's iteration to 10⁻¹², and nothing in it becomes rigid. Its own
# error is a third of its difference from a run with steps twice as long. The error of the mesh is
# the same in all, but for a run of the L with elements of second order, and so in no error; that
# run and one with cells of half the size tell how large it is there.
#
# *Automatic* runs choose Δt and what becomes rigid themselves (`Accuracy`), for 5, 1 and 0.2 % of
# the motion of one probe; they know neither the mesh's error nor these four. Where most of that
# motion is rigid, per cent are meant of the largest bending: 1.7 m of the body, 30 mm of the L.

# +
STRUCTURES = [
    Structure(
        "free-flying body",
        block_with_cantilever,
        body,
        bending,
        free=2.0,
        t_end=12.0 if options.short else 30.0,
        min_cells=20,
        at="end",
        of=None if options.short else 1.7,
        settings=plan(
            Setting(tol=5e-3, window=5.0, dt=0.2, damping=0.025),
            options.short,
            tols=[1e-3, 2e-2],
            windows=[2.5, 10.0],
            sharp=1e-3,
        ),
    ),
    Structure(
        "frame",
        partial(spatial_frame, coarse=3) if options.short else spatial_frame,
        frame,
        sway,
        free=0.05,
        t_end=0.6 if options.short else 1.25,
        min_cells=1,
        at="a",
        of=None,
        settings=plan(
            Setting(tol=5e-5, window=0.25, dt=0.01, damping=0.00125),
            options.short,
            tols=[1e-5, 2e-4],
            windows=[0.125, 0.5],
            sharp=1e-5,
        ),
    ),
    Structure(
        "tumbling L",
        tumbling_l,
        tumbling,
        bending,
        free=5.0,
        t_end=9.0 if options.short else 20.0,
        min_cells=1,
        at="end",
        of=None if options.short else 0.03,
        settings=plan(
            Setting(tol=1.5e-3, window=2.0, dt=0.1, damping=0.0),
            options.short,
            tols=[3e-3, 6e-3],
            windows=[1.0, 4.0],
            sharp=0.0,
            finer=True,
        ),
    ),
]
# -

# ## The runs
#
# Of each step are kept: time, energy, the motion, the place of the probe that budgets are of, the
# number of unknowns, the Newton iterations, and two times: the clock's and the processor's, which
# hardly depends on what else is running. What is quick comes first.

# +
STRUCTURES = [s for s in STRUCTURES if s.name in chosen(options, [s.name for s in STRUCTURES])]
planned = [(s, label, setting) for s in STRUCTURES for label, setting in s.settings.items()]
planned.sort(key=lambda entry: entry[2].refine * entry[2].order)
# If it cannot be written, then now:
rows = [{"structure": s.name, "label": label, **vars(setting)} for s, label, setting in planned]
write_json(options.out / "plan.json", rows, indent=1)
histories: dict[str, dict[str, dict[str, list[float]]]] = {s.name: {} for s in STRUCTURES}
began, left = time.perf_counter(), 0
for k, (s, label, setting) in enumerate(planned):
    over = comm.bcast(time.perf_counter() - began > 60 * options.minutes)
    if over and not known(s, setting, options.out / "runs"):
        left += 1
        continue
    say(f"[{k + 1}/{len(planned)}] {s.name}: {label}")
    histories[s.name][label] = run(s, setting, options.out / "runs")
if left:
    say(f"{left} runs are left: the same command goes on with them.")
    raise SystemExit
# -

# ## Four errors
#
# *Energy*: the largest $|H - H_{ref}|$ after the loads have ended, divided by the largest
# $H_{ref}$. *Motion*: to the motion after the end of the loads a decaying harmonic is fitted,
#
# $$ q(t) ≈ c + e^{-δ(t - t_m)} \big( a \cos ω(t - t_m) + b \sin ω(t - t_m) \big), $$
#
# with $t_m$ in the middle of that time. *Amplitude*: $\sqrt{a^2 + b^2}$ relative to the
# reference's. *Phase*: the difference between the phases at $t_m$, in periods; ½ is the largest
# there is. *Frequency*: ω relative to the reference's.
#
# The error of a run is the largest of the four. Nearly always that is the phase: an error of the
# frequency adds up over the periods. A budget is none of the four: it is of the *distance* of a
# probe from where it is in the reference, which is in the table.

# ## The table
#
# Besides the errors there is, for each knob, what it changes by itself: the same four numbers with
# respect to the base. A knob that changes little and saves time is to be turned.

# +
studies = {s.name: Study(s, histories[s.name]) for s in STRUCTURES}
table = [studies[s.name].rows[label] for s, label, _ in planned]
summary = {
    "choices": {
        name: {f"{100 * target:g} %": study.choice(target) for target in (0.1, 0.01, 0.001)}
        for name, study in studies.items()
    },
    "reference_error": {name: study.doubt for name, study in studies.items()},
    "reference_distance": {name: study.away for name, study in studies.items()},
    "mesh_error": {name: study.mesh for name, study in studies.items()},
    "automatic": {
        name: {r["budget"]: r["distance"] for r in study.compared if r["budget"]}
        for name, study in studies.items()
    },
    "base_error": {name: study.rows["base"]["error"] for name, study in studies.items()},
    "pareto_front": {name: [r["label"] for r in study.front] for name, study in studies.items()},
    "runs": len(table),
    "wall_s": sum(r["wall_s"] for r in table),
    "cpu_s": sum(r["cpu_s"] for r in table),
    "ranks": comm.size,
}
write(options.out / "accuracy_vs_time.csv", written_as_csv(table))
write_json(options.out / "accuracy_vs_time.json", table)
for r in table:
    say(
        f"{r['structure']:17} {r['label']:24} {r['cpu_s']:7.2f} s {r['unknowns_integral']:9.0f} "
        + " ".join(f"{name} {100 * r[name]:7.3f} %" for name in ("energy", "amplitude", "phase"))
        + f" frequency {100 * r['frequency']:6.3f} % change {100 * r['change_from_base']:.2g} %"
        + f" distance {100 * r['distance']:.3g} %"
    )
conclude(options.out, summary)
# -

# ## The picture
#
# Error against time, both on logarithmic scales: down and to the left is better. Each point is
# a run, labelled by what differs from the base. The line joins the runs that no other run beats in
# both. What is grey at the bottom is below three times the estimated error of the reference.

draw(list(studies.values()), options.out / "accuracy_vs_time.png")

# ## What has to hold
#
# Times are no matter of assertions, but unknowns and errors are: what is rigid saves unknowns; what
# is asked for is kept, as far as the reference can tell; halving Δt changes less than doubling it;
# and Newton's iteration may end long before rounding.

for name, study in studies.items():
    runs = study.rows
    assert all(np.isfinite(r["error"]) and r["error"] > 0 for r in study.compared), name
    assert runs["base"]["unknowns_integral"] < runs["all flexible"]["unknowns_integral"], name
    if not options.short:
        automatic = [r for r in study.compared if r["budget"]]
        assert all(r["distance"] <= r["budget"] + 2 * study.away for r in automatic), name
        changes = {label: r["change_from_base"] for label, r in runs.items()}
        assert changes["Δt × 2"] > 2 * changes["Δt / 2"], name
        assert changes["Newton 1e-12"] < 1e-4, name
say("Which knob comes first differs from structure to structure: look at the picture.")
