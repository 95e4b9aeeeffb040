# # A geometry of your own
#
# A mesh, a script of gmsh or a CAD file, a material, what is held, what is loaded and for how long:
# the rest is found by itself. What hardly strains becomes rigid while it runs.
#
#     python3 demos/custom_geometry.py part.step --list
#     python3 demos/custom_geometry.py part.step --name wall=3,4 --name end=7 --size 0.005 \
#         --E 7e10 --rho 2700 --hold wall --load end 0 0 -200 --until 0.002 --dt 1e-4 --t-end 0.05
#     python3 demos/custom_geometry.py frame.msh --hold feet --gravity 0 0 -9.81 --dt 0.01 --t-end 5
#     mpirun -n 2 python3 demos/custom_geometry.py
#
# Without a file it runs `meshes/bracket.geo`: a block on a thin arm at a wall is
# pushed down for a moment, and swings.
# Without anything held or loaded it shows the names that a file has. It leaves in
# out/custom_geometry: `fields.pvd` for ParaView, `history.csv` and `events.csv`, pictures, and
# `summary.json`.

# +
import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NoReturn

import dolfinx.mesh as dmesh
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # where rigidfx and meshes are

import rigidfx as rf
from rigidfx.base.text_files import write_text
from rigidfx.plot.pictures import Curve, curves
from rigidfx.plot.shapes import Shapes

ROOT = Path(__file__).resolve().parents[1]
GEO = (".geo", ".geo_unrolled")
CAD = (".step", ".stp", ".brep", ".iges", ".igs")
comm = MPI.COMM_WORLD


class Parser(argparse.ArgumentParser):
    """All ranks read the options, rank 0 says what is wrong with them."""

    def _print_message(self, message, file=None) -> None:
        if comm.rank == 0:
            super()._print_message(message, file)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}\n")


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is no finite number")
    return value


def positive(text: str) -> float:
    """A number above zero."""
    if number(text) <= 0:
        raise argparse.ArgumentTypeError(f"must be > 0, got {text}")
    return number(text)


def tolerance(text: str) -> float:
    """A number that is not below zero."""
    if number(text) < 0:
        raise argparse.ArgumentTypeError(f"must be ≥ 0, got {text}")
    return number(text)


def length(text: str) -> float | str:
    """A window of observation."""
    return text if text == "auto" else positive(text)


parser = Parser(
    description="Simulate a geometry of your own; parts that hardly strain become rigid.",
    epilog="Names are physical names of gmsh, labels of CAD parts, or those given by --name. "
    "All is in SI units.",
)
parser.add_argument("file", nargs="?", type=Path, help=".msh, .geo, .step, .iges or .brep")
geometry = parser.add_argument_group("geometry")
geometry.add_argument("--list", action="store_true", help="show what is in the file, and stop")
geometry.add_argument("--size", type=positive, help="largest edge of a cell [m] (.geo and CAD)")
geometry.add_argument("--scale", type=positive, default=1.0, help="metres per unit of the file (1)")
geometry.add_argument(
    "--set", metavar="NAME=VALUE", action="append", default=[], help="a parameter of a .geo script"
)
geometry.add_argument(
    "--name", metavar="NAME=3,4", action="append", default=[], help="surfaces of CAD, by number"
)
geometry.add_argument("--order", type=int, choices=[1, 2], help="of the displacement (2)")
problem = parser.add_argument_group("problem")
problem.add_argument("--E", type=positive, default=2.1e11, help="Young's modulus [Pa] (2.1e11)")
problem.add_argument("--nu", type=number, default=0.3, help="Poisson's ratio (0.3)")
problem.add_argument("--rho", type=positive, default=7850.0, help="density [kg/m³] (7850)")
problem.add_argument("--hold", metavar="NAME[:xyz]", nargs="+", default=[], help="what is held")
problem.add_argument(
    "--load",
    metavar=("NAME", "FX", "FY", "FZ"),
    nargs=4,
    action="append",
    default=[],
    help="a total force [N], spread evenly over the area of the facets NAME",
)
problem.add_argument("--until", type=positive, help="when the loads end [s] (a tenth of the run)")
problem.add_argument("--gravity", metavar="G", type=number, nargs=3, help="acceleration [m/s²]")
problem.add_argument("--damping", type=tolerance, default=0.05, help="numerical damping ξ (0.05)")
run = parser.add_argument_group("run")
run.add_argument("--dt", type=positive, help="time step [s] (a 400th of the run)")
run.add_argument("--t-end", type=positive, help="end of the run [s]")
run.add_argument("--tol", type=tolerance, help="strain rate that counts as rigid [1/s] (found)")
run.add_argument(
    "--window", type=length, default="auto", help="length of observation [s], or auto (auto)"
)
run.add_argument("--compare", action="store_true", help="run the fully flexible body as well")
run.add_argument("--short", action="store_true", help="a coarse bracket for a short time")
run.add_argument("--out", type=Path, default=ROOT / "out" / "custom_geometry", help="folder")
options = parser.parse_args()


def say(text: str) -> None:
    """Print on rank 0."""
    if comm.rank == 0:
        print(text, flush=True)


@contextmanager
def told() -> Iterator[None]:
    """Stop all ranks over an error of rigidfx, which all have: a message instead of a traceback."""
    try:
        yield
    except rf.SceneError as error:  # of what is asked for
        parser.error(str(error))
    except rf.RigidfxError as error:  # of the run
        parser.exit(1, f"{parser.prog}: {type(error).__name__}: {error}\n")


# -

# ## The geometry
#
# Meshes and scripts bring physical names. CAD files do not: `--list` shows their surfaces, with
# numbers, places, areas and normals, and `--name` names some. Tetrahedra bend rightly with
# displacements of second order only, so these are the default; they want a consistent mass.

# +
own = options.file is not None
path = options.file if own else ROOT / "meshes" / "bracket.geo"
kind = path.suffix.lower()
order = options.order or (1 if options.short else 2)
if not own:  # the example
    options.size = options.size or (0.02 if options.short else 0.012)
    options.hold = options.hold or ["wall"]
    options.load = options.load or [["end", "0", "0", "-300"]]
    options.until = options.until or 0.004
    options.t_end = options.t_end or (0.044 if options.short else 0.2)
    options.dt = options.dt or (8e-4 if options.short else 5e-4)


def pairs(option: str, suits: tuple[str, ...]) -> dict[str, str]:
    """What an option says as NAME=VALUE, as a dict."""
    texts = getattr(options, option)
    if texts and kind not in suits:
        parser.error(f"--{option} is for {', '.join(suits)} only, not for '{path.name}'")
    found: dict[str, str] = {}
    for text in texts:
        name, _, value = text.layout("=")
        if not (name and value):
            parser.error(f"--{option}: '{text}' should be NAME=VALUE")
        if name in found:
            parser.error(f"--{option}: the name '{name}' is given twice")
        found[name] = value
    return found


def value_of(text: str) -> float | str:
    """A number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


named, given = pairs("name", CAD), pairs("set", GEO)
if options.size and kind not in CAD + GEO:
    parser.error(f"--size is for what is meshed here, not for '{path.name}'")


def read() -> rf.Domain:
    """The domain of the file."""
    if kind in CAD:
        surfaces = {
            name: [int(n) if n.isdecimal() else n for n in numbers.split(",")]
            for name, numbers in named.items()
        }
        return rf.read_cad(path, surfaces=surfaces, size=options.size, scale=options.scale)
    if kind in GEO:
        parameters = {name: value_of(text) for name, text in given.items()}
        return rf.read_geo(path, parameters, size=options.size, scale=options.scale)
    return rf.read_msh(path, scale=options.scale)


with told():
    if options.list and kind in CAD:
        say(str(rf.list_cad(path, scale=options.scale)))
        sys.exit(0)
    domain = read()
cells = domain.mesh.topology.index_map(3).size_global
x = np.concatenate(comm.allgather(domain.mesh.geometry.x))
say(f"{path}: {cells} cells, {np.round(np.ptp(x, axis=0), 6)} m; names: {domain.names}")
nothing = not (options.hold or options.load or options.gravity)
if options.list or nothing:
    if nothing:
        say("Say what is held and loaded: --hold NAME --load NAME FX FY FZ. See also --help.")
    sys.exit(0)
if options.t_end is None:
    parser.error("--t-end is missing: how long is the run [s]?")
# -

# ## The scene
#
# A load is a total force; over the area of its facets it is a traction. Names that are not there
# are answered with those that are.


# +
def area(name: str) -> float:
    """Area of named facets of the boundary, straight or curved [m²]."""
    mesh = domain.mesh
    mesh.topology.create_connectivity(2, 3)
    outside = dmesh.exterior_facet_indices(mesh.topology)
    facets = np.intersect1d(domain.find(name, (2,), "--load").entities, outside)
    tags = dmesh.meshtags(mesh, 2, facets, np.ones_like(facets))
    # by the rule of `Traction`, so that the force is right to rounding
    rule = {"quadrature_degree": 2 * order + 2}
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=tags, metadata=rule)
    one = fem.Constant(mesh, 1.0)
    found = comm.allreduce(fem.assemble_scalar(fem.form(one * ds(1))))
    if found == 0:
        parser.error(f"--load {name}: its facets lie inside the mesh; it needs boundary facets")
    return found


def effects() -> list:
    """What acts."""
    found: list = [rf.NumericalDamping(options.damping)] if options.damping else []
    for text in options.hold:
        name, _, components = text.layout(":")
        found.append(rf.Fixed(name, components or "xyz"))
    for name, force in loads:
        traction = force / area(name)
        found.append(rf.Traction(name, tuple(traction), until=until))
    if options.gravity:
        found.append(rf.Gravity(tuple(options.gravity)))
    return found


def force_of(name: str, texts: list[str]) -> np.ndarray:
    """A total force [N]."""
    try:
        return np.array([number(text) for text in texts])
    except argparse.ArgumentTypeError as error:
        parser.error(f"--load {name}: {error}")


t_end = options.t_end
loads = [(name, force_of(name, texts)) for name, *texts in options.load]
until = options.until or t_end / 10
dt = options.dt or t_end / 400
with told():
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=options.E, nu=options.nu, rho=options.rho),
        effects(),
        order=order,
        mass="consistent" if order == 2 else "lumped",
    )
# -

# ## The tolerance
#
# It is a strain rate, and what is small depends on the motion. Unless it is given, the time of the
# load is run once without rigid parts, and a fiftieth of the largest strain rate is taken.


# +
def largest_rate() -> float:
    """Largest strain rate of any cell until the loads end [1/s]."""
    largest = 0.0
    watched = rf.StrainRate(0.0, 2 * t_end)
    for r in rf.simulate(scene, dt, min(until, t_end), rigidify=watched, progress=False):
        if r.strain_rate is not None:
            largest = max(largest, float(r.strain_rate.max(initial=0.0)))
    return comm.allreduce(largest, op=MPI.MAX)


window = options.window
since = until if options.load else 0.0  # s; observation begins
# -

# ## The run

# +
shapes = Shapes(scene, t_end * np.array([0.05, 0.35, 0.65, 1.0]), colour="rigid")
reports: list[rf.Report] = []
flexible: list[rf.Report] = []
with told(), ExitStack() as stack:
    recorder = stack.enter_context(rf.Recorder(scene, options.out, interval=t_end / 100))
    tol = options.tol if options.tol is not None else largest_rate() / 50
    criterion = rf.StrainRate(tol, window, min_cells=10, since=since)
    say(f"Δt = {dt:g} s to t = {t_end:g} s on {comm.size} rank(s), tolerance {tol:.3g} 1/s")
    adaptive = rf.simulate(scene, dt, t_end, rigidify=criterion, progress=True)
    stack.callback(adaptive.close)
    beside = rf.simulate(scene, dt, t_end, progress=False) if options.compare else None
    if beside is not None:
        stack.callback(beside.close)
    for report in adaptive:
        recorder.write(report)
        shapes.add(report)
        reports.append(report)
        if beside is not None and (not flexible or flexible[-1].t < report.t * (1 - 1e-9)):
            flexible.append(next(beside))
        for event in report.events:
            say(
                f"t = {event.t:.4g} s: {event.kind}, {event.unknowns_before} → "
                f"{event.unknowns_after} unknowns ({event.reason})"
            )
# -

# ## What came of it

# +
t = np.array([r.t for r in reports])
events = [event for report in reports for event in report.events]
freezes = [event for event in events if event.kind == "freeze"]
energy = np.array([r.energy for r in reports])
scale = max(float(energy.max()), 1e-300)
summary = {
    "file": path.name,
    "cells": int(cells),
    "unknowns_start": reports[0].unknowns,
    "unknowns_end": min(r.unknowns for r in reports),
    "first_rigid_time": freezes[0].t if freezes else None,
    "bodies_end": len(reports[-1].bodies),
    "events": [f"{e.t:.4g} s: {e.kind} ({e.reason})" for e in events],
    "energy_jump": max((abs(e.energy_lost) for e in events), default=0.0) / scale,
    "energy_deviation": abs(reports[-1].energy - flexible[-1].energy) / scale if flexible else None,
    "wall_adaptive_s": sum(r.wall for r in reports),
    "wall_flexible_s": sum(r.wall for r in flexible) if flexible else None,
    "tol": tol,
    "window": window,
    "dt": dt,
    "order": order,
    "ranks": comm.size,
}
write_text(comm, options.out / "summary.json", json.dumps(summary, indent=2) + "\n")
say(json.dumps(summary, indent=2))
compared = {"all flexible": flexible} if flexible else {}
curves(
    {
        heading: [
            Curve(label, [r.t for r in of], [getattr(r, name) for r in of])
            for label, of in ({"adaptive": reports} | compared).items()
        ]
        for heading, name in (
            ("Total energy", "energy"),
            ("Kinetic energy", "kinetic"),
            ("Unknowns", "unknowns"),
        )
    },
    options.out / "energy_unknowns.png",
    xlabel="time (s)",
    ylabel=["energy (J)", "energy (J)", "number"],
    title=f"{path.name}: energy and size of the problem",
)
shapes.draw(options.out / "rigid_parts.png", view=(0.7, -1.0, 0.45), title=path.name)
# -

# ## What has to hold
#
# Whatever the geometry: no switch loses energy. Of the example a part becomes rigid.

assert summary["energy_jump"] <= 1e-11
if not own and options.tol is None and options.window == "auto":
    assert freezes
    assert summary["unknowns_end"] < summary["unknowns_start"]
say(f"Pictures and fields are in {options.out}")
