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
import numpy as np
from common import Pair, conclude, curve, energy_jump, events_of, freezes_of, say
from geometry import ask, read, supports_and_loads, told
from mpi4py import MPI

import rigidfx as rf
from rigidfx.plot import Shapes, curves

parser, options = ask(__file__)
# -

# ## The geometry and the scene
#
# Meshes and scripts bring physical names. CAD files do not: `--list` shows their surfaces, with
# numbers, places, areas and normals, and `--name` names some. Tetrahedra bend rightly with
# displacements of second order only, so these are the default; they want a consistent mass.

# +
with told(parser):
    domain = read(parser, options)
    t_end = options.t_end  # s
    until = options.until or t_end / 10  # s; where the loads end
    dt = options.dt or t_end / 400  # s
    scene = rf.Scene(
        domain,
        rf.StVenantKirchhoff(E=options.E, nu=options.nu, rho=options.rho),
        supports_and_loads(options, until),
        order=options.order,
        mass="consistent" if options.order == 2 else "lumped",
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
    return scene.comm.allreduce(largest, op=MPI.MAX)


window = options.window
since = until if options.load else 0.0  # s; observation begins
# -

# ## The run

# +
shapes = Shapes(scene, t_end * np.array([0.05, 0.35, 0.65, 1.0]), colour="rigid")
with told(parser), rf.Recorder(scene, options.out, interval=t_end / 100) as recorder:
    tol = options.tol if options.tol is not None else largest_rate() / 50
    criterion = rf.StrainRate(tol, window, min_cells=10, since=since)
    say(f"Δt = {dt:g} s to t = {t_end:g} s on {scene.comm.size} rank(s), tolerance {tol:.3g} 1/s")
    with Pair(scene, dt, t_end, criterion, compare=options.compare) as run:
        for report in run:
            recorder.write(report)
            shapes.add(report)
# -

# ## What came of it

# +
reports, flexible = run.adaptive, run.flexible
events, freezes = events_of(reports), freezes_of(reports)
largest = max(*(r.energy for r in reports), 1e-300)  # J
summary = {
    "file": options.file.name,
    "cells": int(scene.mesh.topology.index_map(3).size_global),
    "unknowns_start": reports[0].unknowns,
    "unknowns_end": min(r.unknowns for r in reports),
    "first_rigid_time": freezes[0].t if freezes else None,
    "bodies_end": len(reports[-1].bodies),
    "events": [f"{e.t:.4g} s: {e.kind} ({e.reason})" for e in events],
    "energy_jump": energy_jump(reports),
    "energy_deviation": abs(reports[-1].energy - flexible[-1].energy) / largest
    if flexible
    else None,
    "wall_adaptive_s": sum(r.wall for r in reports),
    "wall_flexible_s": sum(r.wall for r in flexible) if flexible else None,
    "tol": tol,
    "window": window,
    "dt": dt,
    "order": options.order,
    "ranks": scene.comm.size,
}
conclude(options.out, summary)
compared = {"all flexible": flexible} if flexible else {}
curves(
    {
        heading: [
            curve(label, of, name) for label, of in ({"adaptive": reports} | compared).items()
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
    title=f"{options.file.name}: energy and size of the problem",
)
shapes.draw(options.out / "rigid_parts.png", view=(0.7, -1.0, 0.45), title=options.file.name)
# -

# ## What has to hold
#
# Whatever the geometry: no switch loses energy. Of the example a part becomes rigid.

assert summary["energy_jump"] <= 1e-11
if options.example and options.tol is None and options.window == "auto":
    assert freezes
    assert summary["unknowns_end"] < summary["unknowns_start"]
say(f"Pictures and fields are in {options.out}")
