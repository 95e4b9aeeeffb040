# # What accuracy costs in time
#
# A simulation has many knobs: the rigidity tolerance and its observation window, Δt, the mesh, the
# order of its elements, the mass matrix, damping, Newton's tolerance, the linear solver. Each buys
# accuracy or time. How much of which? Here three structures are run again and again, with one knob
# turned at a time, and with a few settings that combine what turns out to be worthwhile. Each run
# is compared with a reference that is finer in everything.
#
#     python3 demos/accuracy_vs_time.py
#     mpirun -n 2 python3 demos/accuracy_vs_time.py --short
#
# A run that is finished is a file in out/accuracy_vs_time/runs, named by its settings; a further
# call of the demo skips it, unless the structure has changed since; delete these files after other
# changes, of rigidfx itself say. When all are there, the demo leaves `accuracy_vs_time.png` and,
# with all numbers, `accuracy_vs_time.csv`, `accuracy_vs_time.json` and `summary.json`; `plan.json`
# is there from the start.

# +
from functools import partial

import numpy as np
from accuracy import Points, Setting, Structure, Study, draw, plan, run, written_as_csv
from common import Parser, comm, conclude, say, write, write_json

import rigidfx as rf
from meshes.block_with_cantilever import block_with_cantilever
from meshes.spatial_frame import spatial_frame
from meshes.tumbling_l import tumbling_l

parser = Parser(__file__, "What accuracy costs in time.", "few runs, short, of first order")
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
# would change with the mesh. The plate of the frame is meshed three times as coarsely.
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
# alone would halve the damping, and a finer run would be another structure. So ξΔt is what is given
# here, and kept when Δt changes; turning the knob ξ means to change it.

# ## The settings
#
# The base: elements of second order, 15 to 40 steps per period of the main vibration, lumped mass,
# Newton's iteration to 10⁻⁶, a tolerance at which much of the damped structures becomes rigid, and
# little of the tumbling L, which nothing damps. The reference is finer in everything: cells of half
# the size, a fourth of Δt (in the short version the same cells and half of Δt), a consistent mass,
# Newton's iteration to 10⁻¹², and nothing in it becomes rigid. So the errors include those of the
# base's mesh.
#
# *Automatic* runs choose Δt and what becomes rigid themselves (`Accuracy`), for 5, 1 and 0.2 % of
# the motion of one probe; they know neither the mesh's error nor these four. Their damping is the
# viscous stress $ξΔt\, ℂ:\dot E$ itself, which does not depend on Δt.

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
        settings=plan(
            Setting(tol=5e-3, window=5.0, dt=0.2, damping=0.025),
            options.short,
            tols=[1e-3, 2e-2],
            windows=[2.5, 10.0],
            sharp=1e-3,
            finer=False,
        ),
    ),
    Structure(
        "frame",
        partial(spatial_frame, coarse=3),
        frame,
        sway,
        free=0.05,
        t_end=0.6 if options.short else 1.25,
        min_cells=1,
        at="a",
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
        settings=plan(
            Setting(tol=1.5e-3, window=2.0, dt=0.1, damping=0.0),
            options.short,
            tols=[3e-3, 6e-3],
            windows=[1.0, 4.0],
            sharp=0.0,
        ),
    ),
]
# -

# ## The runs
#
# Of each step are kept: time, energy, the motion, the number of unknowns, the Newton iterations and
# the wall time. What is quick comes first.

# +
planned = [(s, label, setting) for s in STRUCTURES for label, setting in s.settings.items()]
planned.sort(key=lambda entry: entry[2].refine * entry[2].order)
# If it cannot be written, then now:
rows = [{"structure": s.name, "label": label, **vars(setting)} for s, label, setting in planned]
write_json(options.out / "plan.json", rows, indent=1)
histories: dict[str, dict[str, dict[str, list[float]]]] = {s.name: {} for s in STRUCTURES}
for k, (s, label, setting) in enumerate(planned):
    say(f"[{k + 1}/{len(planned)}] {s.name}: {label}")
    histories[s.name][label] = run(s, setting, options.out / "runs")
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
# frequency adds up over the periods.

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
    "base_error": {name: study.rows["base"]["error"] for name, study in studies.items()},
    "pareto_front": {name: [r["label"] for r in study.front] for name, study in studies.items()},
    "runs": len(table),
    "wall_s": sum(r["wall_s"] for r in table),
    "ranks": comm.size,
}
write(options.out / "accuracy_vs_time.csv", written_as_csv(table))
write_json(options.out / "accuracy_vs_time.json", table)
for r in table:
    say(
        f"{r['structure']:17} {r['label']:24} {r['wall_s']:7.2f} s {r['unknowns_integral']:9.0f} "
        + " ".join(f"{name} {100 * r[name]:7.3f} %" for name in ("energy", "amplitude", "phase"))
        + f" frequency {100 * r['frequency']:6.3f} % change {100 * r['change_from_base']:.2g} %"
    )
conclude(options.out, summary)
# -

# ## The picture
#
# Error against wall time, both on logarithmic scales: down and to the left is better. Each point is
# a run, labelled by what differs from the base. The line joins the runs that no other run beats in
# both. What is grey at the bottom is below the estimated error of the reference.

draw(list(studies.values()), options.out / "accuracy_vs_time.png")

# ## What has to hold
#
# Wall times are no matter of assertions, but unknowns and errors are: what is rigid saves unknowns;
# elements of first order make the structures too stiff; halving Δt changes less than doubling it;
# and Newton's iteration may end long before rounding.

for name, study in studies.items():
    runs = study.rows
    assert all(np.isfinite(r["error"]) and r["error"] > 0 for r in study.compared), name
    assert runs["base"]["unknowns_integral"] < runs["all flexible"]["unknowns_integral"], name
    if not options.short:
        assert runs["order 1"]["frequency"] > runs["base"]["frequency"], name
        changes = {label: r["change_from_base"] for label, r in runs.items()}
        assert changes["Δt × 2"] > 2 * changes["Δt / 2"], name
        assert changes["Newton 1e-12"] < 1e-4, name
say("Which knob comes first differs from structure to structure: look at the picture.")
