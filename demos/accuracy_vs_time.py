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
import argparse
import csv
import inspect
import io
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import sha256
from itertools import product
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # where rigidfx and meshes are

import rigidfx as rf
from meshes.block_with_cantilever import block_with_cantilever
from meshes.spatial_frame import spatial_frame
from meshes.tumbling_l import tumbling_l
from rigidfx.base.errors import OutputError, agree
from rigidfx.base.text_files import write_text
from rigidfx.plot.curves import DPI, figure_of, on_first_rank, save

ROOT = Path(__file__).resolve().parents[1]
parser = argparse.ArgumentParser(description="What accuracy costs in time.")
parser.add_argument("--short", action="store_true", help="few runs, short, of first order")
parser.add_argument("--out", type=Path, default=ROOT / "out" / "accuracy_vs_time", help="folder")
options = parser.parse_args()
comm = MPI.COMM_WORLD


def say(text: str) -> None:
    """Print on rank 0."""
    if comm.rank == 0:
        print(text, flush=True)


# -

# ## The knobs
#
# Numerical damping is a knob that is easily misread. With it the stress of a step is
# $S_m + ξ (S_1 - S_0) ≈ S_m + ξ Δt\, \dot S$: a viscosity with the time constant ξΔt. Halving Δt
# alone would halve the damping, and a finer run would be another structure. So ξΔt is what is given
# here, and kept when Δt changes; turning the knob ξ means to change it.


# +
@dataclass(frozen=True)
class Setting:
    """The knobs of a run."""

    tol: float  # 1/s; nothing becomes rigid if 0
    window: float  # s
    dt: float  # s
    damping: float  # s; ξΔt
    refine: int = 1  # cells per edge of a cell of the base mesh
    order: int = 2
    mass: str = "lumped"
    newton: float = 1e-6  # reduction of the residual
    solver: str = "automatic"

    @property
    def effects(self) -> list[rf.NumericalDamping]:
        """The damping, if there is any."""
        return [rf.NumericalDamping(self.damping / self.dt)] if self.damping else []


SOLVERS = {
    "automatic": {},
    "direct": {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"},
    "Krylov": {"ksp_type": "gmres", "pc_type": "bjacobi", "ksp_rtol": 1e-8, "ksp_max_it": 1000},
}


@contextmanager
def petsc_options(setting: Setting) -> Iterator[None]:
    """Newton's tolerance and the solver, while a run lasts."""
    database = PETSc.Options("rigidfx_")
    wanted = {"snes_rtol": setting.newton, **SOLVERS[setting.solver]}
    for name, value in wanted.items():
        database[name] = value
    try:
        yield
    finally:
        for name in wanted:
            database.delValue(name)


# -

# ## The structures
#
# They are those of the other demos, over shorter times, and with less damping where it was chosen
# to tell a story. The free-flying body is pushed by tractions: equal forces on the nodes would
# change with the mesh. The plate of the frame is meshed three times as coarsely.
#
# The motion that is compared must not depend on where a free body has drifted to or how far it has
# turned. It is the difference between the distances of one end from two points on opposite sides
# of the body: zero at first, and proportional to the bending between them. Of the frame it is the
# displacement of a point of the plate.

# +
Points = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Structure:
    """What is run again and again."""

    name: str
    mesh: Callable[[int], rf.Domain]  # by the number of cells per edge of one of the base
    scene: Callable[[rf.Domain, Setting], rf.Scene]
    motion: Callable[[Points], float]  # of the current positions of the probes [m]
    free: float  # s; nothing acts from here on
    t_end: float  # s
    min_cells: int  # of a new body, in the base mesh
    base: Setting
    reference: Setting
    turned: Mapping[str, Setting]  # label → one knob of the base turned
    combined: Mapping[str, Setting]  # label → several

    @property
    def fingerprint(self) -> str:
        """Changes with the mesh and the scene, so that old runs are not taken for new ones."""
        mesh = self.mesh.func if isinstance(self.mesh, partial) else self.mesh
        sources = (inspect.getmodule(mesh), self.scene, self.motion)
        text = [*map(inspect.getsource, sources), repr(getattr(self.mesh, "keywords", {}))]
        return sha256("".join(text).encode()).hexdigest()[:16]


def bending(x: Points) -> float:
    """Difference between two distances of a free body's end [m]."""
    return float(np.linalg.norm(x["end"] - x["one"]) - np.linalg.norm(x["end"] - x["other"]))


def sway(x: Points) -> float:
    """Displacement of the frame's point a in x [m]."""
    return float(x["a"][0] - 6.0)


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

# ## The settings
#
# The base: elements of second order, 15 to 40 steps per period of the main vibration, lumped mass,
# Newton's iteration to 10⁻⁶, a tolerance at which much of the damped structures becomes rigid, and
# little of the tumbling L, which nothing damps. The reference is finer in everything: cells of half
# the size, a fourth of Δt (in the short version half), a consistent mass, Newton's iteration to
# 10⁻¹², and nothing in it becomes rigid. So the errors include those of the base's mesh.


# +
def turned(
    base: Setting, tols: list[float], windows: list[float], finer: bool
) -> dict[str, Setting]:
    """One knob of the base turned at a time, by labels that name the knob first.

    The solvers are compared with elements of first order. With those of second order a run by the
    less suitable one takes a quarter of an hour, and one of the body on a finer mesh an hour.
    """
    order_1 = replace(base, order=1)
    settings = {
        "all flexible": replace(base, tol=0.0),
        "Δt × 2": replace(base, dt=2 * base.dt),
    }
    if options.short:
        return settings
    ξ = {"ξ × 2": replace(base, damping=2 * base.damping), "ξ = 0": replace(base, damping=0.0)}
    return {
        **{f"tolerance × {tol / base.tol:g}": replace(base, tol=tol) for tol in tols},
        **{f"window × {w / base.window:g}": replace(base, window=w) for w in windows},
        **settings,
        "Δt / 2": replace(base, dt=base.dt / 2),
        **({"mesh / 2": replace(base, refine=2)} if finer else {}),
        "order 1": order_1,
        "order 1, mesh / 2": replace(order_1, refine=2),
        "order 1, direct": replace(order_1, solver="direct"),
        "order 1, Krylov": replace(order_1, solver="Krylov"),
        "consistent mass": replace(base, mass="consistent"),
        **(ξ if base.damping else {"ξ = 0.02": replace(base, damping=0.02 * base.dt)}),
        **{f"Newton {rtol:g}": replace(base, newton=rtol) for rtol in (1e-12, 1e-3)},
    }


def combined(base: Setting, sharp: float, blunt: float) -> dict[str, Setting]:
    """Settings that turn several knobs: coarse ones and a fine one.

    What Δt and Newton save is not to be credited to rigid parts: each is there without them too.
    """
    if options.short:
        return {}
    times = f"tolerance × {sharp / base.tol:g}" if sharp else "all flexible"
    return {
        f"Δt × 2, tolerance × {blunt / base.tol:g}, Newton 0.001": replace(
            base, dt=2 * base.dt, tol=blunt, newton=1e-3
        ),
        f"Δt / 2, {times}": replace(base, dt=base.dt / 2, tol=sharp),
        "flexible, Newton 0.001": replace(base, tol=0.0, newton=1e-3),
        "Δt × 2, flexible, Newton 0.001": replace(base, dt=2 * base.dt, tol=0.0, newton=1e-3),
        "Δt × 2, Newton 0.001": replace(base, dt=2 * base.dt, newton=1e-3),
    }


def structure(
    name: str,
    mesh: Callable[[int], rf.Domain],
    scene: Callable[[rf.Domain, Setting], rf.Scene],
    motion: Callable[[Points], float],
    free: float,
    t_end: tuple[float, float],
    base: Setting,
    tols: list[float],
    windows: list[float],
    sharp: float,
    min_cells: int = 1,
    finer: bool = True,
) -> Structure:
    """A structure with its settings; of the ends of its runs [s] the second is the short one."""
    if options.short:
        base = replace(base, order=1)
    dt = base.dt / 2 if options.short else base.dt / 4
    finest = {"refine": 2, "dt": dt, "newton": 1e-12}
    return Structure(
        name=name,
        mesh=mesh,
        scene=scene,
        motion=motion,
        free=free,
        t_end=t_end[options.short],
        min_cells=min_cells,
        base=base,
        reference=replace(base, tol=0.0, mass="consistent", **finest),
        turned=turned(base, tols, windows, finer),
        combined=combined(base, sharp, max(tols)),
    )


STRUCTURES = [
    structure(
        "free-flying body",
        block_with_cantilever,
        body,
        bending,
        free=2.0,
        t_end=(30.0, 16.0),
        base=Setting(tol=5e-3, window=5.0, dt=0.2, damping=0.025),
        tols=[1e-3, 2e-2],
        windows=[2.5, 10.0],
        sharp=1e-3,
        min_cells=20,
        finer=False,
    ),
    structure(
        "frame",
        partial(spatial_frame, coarse=3),
        frame,
        sway,
        free=0.05,
        t_end=(1.25, 0.8),
        base=Setting(tol=5e-5, window=0.25, dt=0.01, damping=0.00125),
        tols=[1e-5, 2e-4],
        windows=[0.125, 0.5],
        sharp=1e-5,
    ),
    structure(
        "tumbling L",
        tumbling_l,
        tumbling,
        bending,
        free=5.0,
        t_end=(20.0, 12.0),
        base=Setting(tol=1.5e-3, window=2.0, dt=0.1, damping=0.0),
        tols=[3e-3, 6e-3],
        windows=[1.0, 4.0],
        sharp=0.0,
    ),
]
# -

# ## A run
#
# Of each step are kept: time, energy, the motion, the number of unknowns, the Newton iterations and
# the wall time.


# +
COLUMNS = "t", "dt", "energy", "motion", "unknowns", "newton", "wall"


def known(path: Path, fingerprint: str, t_end: float) -> dict[str, list[float]] | None:
    """The history that a file holds; None if there is none, or of another structure. Collective."""
    found, problem = None, None
    if comm.rank == 0 and path.exists():
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["fingerprint"] == fingerprint:
                found = content["history"]
                t, *others = np.array([found[name] for name in COLUMNS])
                if not np.isfinite(others).all() or abs(t[-1] - t_end) > 1e-6:
                    raise ValueError("a run that does not go to its end")
        except (OSError, ValueError, KeyError, TypeError) as error:
            problem = f"accuracy_vs_time: '{path}' is damaged ({error!r}); delete it."
    agree(comm, problem, OutputError)
    return comm.bcast(found)


def run(structure: Structure, setting: Setting) -> dict[str, list[float]]:
    """The history of a run, out of its file if there is one. Collective."""
    what = {"t_end": structure.t_end, **asdict(setting)}
    if setting != structure.reference:  # whose time does not matter
        what |= {"ranks": comm.size}
    if setting.tol:
        what |= {"min_cells": structure.min_cells}
    key = " ".join([structure.name, *(f"{name}={value}" for name, value in what.items())])
    path = options.out / "runs" / f"{key}.json"
    found = known(path, structure.fingerprint, structure.t_end)
    if found is not None:
        return found
    scene = structure.scene(structure.mesh(setting.refine), setting)
    criterion = rf.StrainRate(
        setting.tol, setting.window, min_cells=structure.min_cells * setting.refine**3
    )
    rows = []
    with petsc_options(setting):
        for report in rf.simulate(
            scene,
            setting.dt,
            structure.t_end,
            rigidify=criterion if setting.tol else None,
            progress=True,
        ):
            x = {name: X + report.probes[name] for name, X in scene.probes.items()}
            motion, newton = structure.motion(x), report.iterations
            row = report.t, report.dt, report.energy, motion, report.unknowns, newton, report.wall
            rows.append(row)
    # All ranks take over the wall times of rank 0.
    history = comm.bcast(dict(zip(COLUMNS, map(list, zip(*rows, strict=True)), strict=True)))
    content = {"settings": what, "fingerprint": structure.fingerprint, "history": history}
    write_text(comm, path, json.dumps(content))
    return history


planned = [
    (s, label, setting)
    for s in STRUCTURES
    for label, setting in {
        "reference": s.reference,
        "base": s.base,
        **s.turned,
        **s.combined,
    }.items()
]
planned.sort(key=lambda entry: entry[2].refine * entry[2].order)  # what is quick comes first
plan = [{"structure": s.name, "label": label, **asdict(setting)} for s, label, setting in planned]
# If it cannot be written, then now:
write_text(comm, options.out / "plan.json", json.dumps(plan, indent=1) + "\n")
histories: dict[str, dict[str, dict[str, list[float]]]] = {s.name: {} for s in STRUCTURES}
for k, (s, label, setting) in enumerate(planned):
    say(f"[{k + 1}/{len(planned)}] {s.name}: {label}")
    histories[s.name][label] = run(s, setting)
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


# +
def harmonic(
    structure: Structure, history: dict[str, list[float]], near: tuple[float, float] | None = None
) -> tuple[float, float, complex]:
    """ω [rad/s], δ [1/s] and a - ib [m] of the fit, which begins near given ω and δ."""
    t, q = np.array(history["t"]), np.array(history["motion"])
    late = t >= structure.free - 1e-9
    t, q = t[late] - (structure.free + structure.t_end) / 2, q[late]
    if near is None:
        frequencies = np.fft.rfftfreq(16 * t.size, np.median(np.diff(t)))
        spectrum = np.abs(np.fft.rfft((q - q.mean()) * np.hanning(t.size), 16 * t.size))
        near = 2 * np.pi * frequencies[np.argmax(spectrum)], 0.0
    scale = near[0]

    def basis(shape: np.ndarray) -> np.ndarray:
        ω, δ = scale * shape
        decay = np.exp(-δ * t)
        return np.stack([decay * np.cos(ω * t), decay * np.sin(ω * t), np.ones_like(t)], axis=1)

    def misfit(shape: np.ndarray) -> np.ndarray:
        columns = basis(shape)
        return (columns @ np.linalg.lstsq(columns, q, rcond=None)[0] - q) / np.abs(q).max()

    best = least_squares(misfit, np.array(near) / scale, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    a, b, _ = np.linalg.lstsq(basis(best), q, rcond=None)[0]
    return float(scale * best[0]), float(scale * best[1]), complex(a, -b)


def differences(
    structure: Structure, one: dict[str, list[float]], other: dict[str, list[float]]
) -> dict[str, float]:
    """The four errors of one history with respect to another, and the largest of them."""
    t = np.array(min(one["t"], other["t"], key=len))
    t = t[t >= structure.free - 1e-9]
    H, H_ref = (np.interp(t, h["t"], h["energy"]) for h in (one, other))
    ω_ref, δ_ref, z_ref = harmonic(structure, other)
    ω, _, z = harmonic(structure, one, (ω_ref, δ_ref))
    errors = {
        "energy": float(np.abs(H - H_ref).max() / H_ref.max()),
        "amplitude": abs(abs(z) / abs(z_ref) - 1),
        "phase": float(abs(np.angle(z / z_ref)) / (2 * np.pi)),
        "frequency": abs(ω / ω_ref - 1),
    }
    return {**errors, "error": max(errors.values())}


# -

# ## The table
#
# Besides the errors there is, for each knob, what it changes by itself: the same four numbers with
# respect to the base. A knob that changes little and saves time is to be turned.


# +
def row(s: Structure, label: str, setting: Setting) -> dict[str, str | float]:
    """A run in numbers."""
    own = histories[s.name]
    history = own[label]
    errors = differences(s, history, own["reference"])
    return {
        "structure": s.name,
        "label": label,
        **asdict(setting),
        "steps": len(history["t"]) - 1,
        "newton_iterations": sum(history["newton"]),
        "unknowns_start": history["unknowns"][1],
        "unknowns_end": history["unknowns"][-1],
        "unknowns_integral": float(np.dot(history["unknowns"], history["dt"])),  # s
        "wall_s": sum(history["wall"]),
        **errors,
        "change_from_base": differences(s, history, own["base"])["error"],
    }


def front(rows: list[dict]) -> list[dict]:
    """The runs that no other run beats in both time and error, the fastest first."""
    best: list[dict] = []
    for candidate in sorted(rows, key=lambda r: r["wall_s"]):
        if not best or candidate["error"] < best[-1]["error"]:
            best.append(candidate)
    return best


table = [row(*entry) for entry in planned]
compared = {
    s.name: [r for r in table if r["structure"] == s.name and r["label"] != "reference"]
    for s in STRUCTURES
}
fronts = {name: front(rows) for name, rows in compared.items()}


def doubt(s: Structure) -> float | None:
    """Estimate of the reference's own error.

    All three have edges that bend inwards, where second-order cells are far from their order (of
    an L in plane strain the first frequency converged with order 1.1): what halving the cells of
    the base changed may be as much as what is left. Then the base with these cells differs from the
    reference by its Δt, of second order, and by what is rigid.
    """
    own = histories[s.name]
    if "mesh / 2" not in own:
        return None
    steps = (s.base.dt / s.reference.dt) ** 2
    mesh = differences(s, own["base"], own["mesh / 2"])
    time = differences(s, own["mesh / 2"], own["reference"])
    return mesh["error"] + time["error"] / (steps - 1)


doubts = {s.name: doubt(s) for s in STRUCTURES}


def choice(name: str, target: float) -> dict[str, str | float] | None:
    """The fastest run with an error up to a target, and its time relative to the base's."""
    base = next(r for r in compared[name] if r["label"] == "base")
    flexible = next(r for r in compared[name] if r["label"] == "all flexible")
    good = [r for r in fronts[name] if r["error"] <= target]
    if not good:
        return None
    wall = good[0]["wall_s"]
    return {
        **{key: good[0][key] for key in ("label", "wall_s", "unknowns_integral", "error")},
        "time_to_base": wall / base["wall_s"],
        "time_to_flexible_base": wall / flexible["wall_s"],
        "below_reference_error": good[0]["error"] < (doubts[name] or 0.0),
    }


summary = {
    "choices": {
        name: {f"{100 * target:g} %": choice(name, target) for target in (0.1, 0.01, 0.001)}
        for name in compared
    },
    "reference_error": doubts,
    "base_error": {r["structure"]: r["error"] for r in table if r["label"] == "base"},
    "pareto_front": {name: [r["label"] for r in rows] for name, rows in fronts.items()},
    "runs": len(table),
    "wall_s": sum(r["wall_s"] for r in table),
    "ranks": comm.size,
}
text = io.StringIO()
rows_of_csv = csv.DictWriter(text, table[0], lineterminator="\n")
rows_of_csv.writeheader()
rows_of_csv.writerows(table)
write_text(comm, options.out / "accuracy_vs_time.csv", text.getvalue())
write_text(comm, options.out / "accuracy_vs_time.json", json.dumps(table, indent=2) + "\n")
told = json.dumps(summary, indent=2, ensure_ascii=False)
write_text(comm, options.out / "summary.json", told + "\n")
for r in table:
    say(
        f"{r['structure']:17} {r['label']:24} {r['wall_s']:7.2f} s {r['unknowns_integral']:9.0f} "
        + " ".join(f"{name} {100 * r[name]:7.3f} %" for name in ("energy", "amplitude", "phase"))
        + f" frequency {100 * r['frequency']:6.3f} % change {100 * r['change_from_base']:.2g} %"
    )
say(told)
# -

# ## The picture
#
# Error against wall time, both on logarithmic scales: down and to the left is better. Each point is
# a run, labelled by what differs from the base. The line joins the runs that no other run beats in
# both. What is grey at the bottom is below the estimated error of the reference.

# +
KNOBS = {  # how labels begin → colour
    "base": "#222222",
    "all flexible": "#d55e00",
    "flexible": "#d55e00",
    "tolerance": "#d55e00",
    "window": "#d55e00",
    "Δt": "#0072b2",
    "order 1": "#009e73",
    "mesh": "#009e73",
    "consistent": "#009e73",
    "ξ": "#cc79a7",
    "Newton": "#888888",
}
PIXELS = np.array([14, 26, 40, 56, 74, 94, 116, 140, 170, 200])  # how far a label may be away
ANGLES = np.pi * np.array([0, 1, 0.1, -0.1, 0.9, -0.9, 0.25, -0.25, 0.75, -0.75, 0.4, -0.4])


def colour(label: str) -> str:
    """The colour of the knob that a label names first."""
    return next(c for knob, c in KNOBS.items() if label.startswith(knob))


def place_labels(ax, rows: list[dict]) -> None:
    """Write each run's label near its point where there is room, and join the two if it is far.

    Args:
        ax: Axes with their final limits.
        rows: Runs, shown at (wall time, error in %); the first have the choice.
    """
    points = ax.transData.transform([(r["wall_s"], 100 * r["error"]) for r in rows])
    taken = [(x - 8, y - 8, x + 8, y + 8) for x, y in points]
    frame = ax.get_window_extent()
    for (x, y), r in zip(points, rows, strict=True):
        text = ax.text(x, y, r["label"], transform=None, fontsize=10, color=colour(r["label"]))
        text.set_in_layout(False)  # the axes are to stay where they are
        size = text.get_window_extent()
        for away, angle in product(PIXELS, ANGLES):
            dx, dy = away * np.cos(angle), away * np.sin(angle)
            left, middle = x + dx - (size.width if dx < 0 else 0), y + dy
            low, high = middle - 0.55 * size.height, middle + 0.55 * size.height
            right = left + size.width
            inside = frame.x0 < left and right < frame.x1 and frame.y0 < low and high < frame.y1
            if inside and not any(
                left < b[2] and b[0] < right and low < b[3] and b[1] < high for b in taken
            ):
                break
        taken.append((left, low, right, high))
        text.set(x=left, y=middle, verticalalignment="center_baseline")
        if away > PIXELS[0]:
            end = ax.transData.inverted().transform((x + dx, y + dy))
            start = r["wall_s"], 100 * r["error"]
            ax.plot(*zip(start, end, strict=True), color="0.75", linewidth=0.8, zorder=1.5)


def picture() -> None:
    """Draw one panel for each structure."""
    title = "What accuracy costs in time: each point is a run, down and to the left is better"
    figure, axes = figure_of(len(STRUCTURES), 1, (11.0, 5.2 * len(STRUCTURES)), title)
    figure.set_dpi(DPI)
    for ax, (name, rows) in zip(axes[:, 0], compared.items(), strict=True):
        ax.set(title=name[0].upper() + name[1:], xlabel="wall time (s)", ylabel="error")
        ax.set(xscale="log", yscale="log")
        walls, errors = ([r[key] for r in rows] for key in ("wall_s", "error"))
        ax.set_xlim(min(walls) / 1.5, max(walls) * 2.6)
        ax.set_ylim(min(0.08, 50 * min(errors)), 300.0)
        ax.set_yticks([0.1, 1.0, 10.0, 100.0], ["0.1 %", "1 %", "10 %", "100 %"])
        ax.xaxis.set_major_formatter("{x:g}")
        ax.minorticks_off()
        line = np.array([(r["wall_s"], 100 * r["error"]) for r in fronts[name]])
        ax.plot(*line.T, color="0.85", linewidth=7, solid_capstyle="round", zorder=1)
        if own := doubts[name]:
            ax.axhspan(1e-9, 100 * own, color="0.94", zorder=0.5)
        for r in rows:
            shape = {"marker": "*", "markersize": 16} if r["label"] == "base" else {"marker": "o"}
            ax.plot(r["wall_s"], 100 * r["error"], color=colour(r["label"]), **shape)
    figure.draw_without_rendering()  # the layout, on which places in pixels depend
    for ax, (name, rows) in zip(axes[:, 0], compared.items(), strict=True):
        best = fronts[name]
        place_labels(ax, [*best, *(r for r in rows if r not in best)])
    save(figure, options.out / "accuracy_vs_time.png")


on_first_rank(comm, picture, "accuracy_vs_time")
# -

# ## What has to hold
#
# Wall times are no matter of assertions, but unknowns and errors are: what is rigid saves unknowns;
# elements of first order make the structures too stiff; halving Δt changes less than doubling it;
# and Newton's iteration may end long before rounding.

for name, rows in compared.items():
    assert all(np.isfinite(r["error"]) and r["error"] > 0 for r in rows), name
    runs = {r["label"]: r for r in rows}
    assert runs["base"]["unknowns_integral"] < runs["all flexible"]["unknowns_integral"], name
    if not options.short:
        assert runs["order 1"]["frequency"] > runs["base"]["frequency"], name
        changes = {label: r["change_from_base"] for label, r in runs.items()}
        assert changes["Δt × 2"] > 2 * changes["Δt / 2"], name
        assert changes["Newton 1e-12"] < 1e-4, name
say("Which knob comes first differs from structure to structure: look at the picture.")
