# # A geometry of your own
#
# Give a mesh, a script of gmsh or a CAD file, a material, supports, loads and the end time. Parts
# that hardly strain become rigid in the run. The command `rigidfx`, which is installed with the
# package, does the same.
#
#     python3 demos/custom_geometry.py part.step --list
#     python3 demos/custom_geometry.py part.step --name wall=3,4 --name end=7 --size 0.005 \
#         --E 7e10 --rho 2700 --hold wall --load end 0 0 -200 --until 0.002 --dt 1e-4 --t-end 0.05
#     python3 demos/custom_geometry.py frame.msh --hold feet --gravity 0 0 -9.81 --dt 0.01 --t-end 5
#     mpirun -n 2 python3 demos/custom_geometry.py
#
# Without a file it runs `meshes/bracket.geo`: a block on a thin arm at a wall is
# pushed down for a moment, and swings.
# `--t-end` says how long the run is, in seconds: it has no default, as a file does not tell how
# fast things move. The parts of an assembly may have materials of their own:
# `--material post 1e7 0.45 1100`. Without anything held or loaded it shows the names that a file
# has. It leaves in out/NAME OF THE FILE of the folder where you are (or `--out`): `fields.pvd` for
# ParaView, `history.csv` and `events.csv`, pictures, and `summary.json`.

# +
from pathlib import Path

from common import ROOT

from rigidfx.command import Example, main

bracket = Example(ROOT / "meshes" / "bracket.geo", Path("out", "custom_geometry"))
# -

# ## The geometry and the scene
#
# Meshes and scripts bring physical names. CAD files do not: `--list` shows their surfaces, with
# numbers, places, areas and normals, and `--name` names some. Tetrahedra bend rightly with
# displacements of second order only, so these are the default; they want a consistent mass.
#
# ## The tolerance
#
# The tolerance is a strain rate, and depends on the motion. Without `--tol` the time of the load is
# run once without rigid parts, and the tolerance is a fiftieth of the largest strain rate.
#
# ## The run
#
# `--compare` runs the same all flexible beside it.

# +
summary = main(example=bracket)
# -

# ## Assertions
#
# Whatever the geometry: no switch loses energy. Of the example a part becomes rigid.

assert summary["energy_jump"] <= 1e-11
if summary["file"] == bracket.file.name and summary["tol_found"] and summary["window"] == "auto":
    assert summary["first_rigid_time"] is not None
    assert summary["unknowns_end"] < summary["unknowns_start"]
