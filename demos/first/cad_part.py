"""A part from a STEP file is held at one face and loaded at another: the reaction of its support.

./fenicsx python3 demos/first/cad_part.py
"""

import tempfile
from pathlib import Path

import gmsh

import rigidfx as rf

L, B, H, R = 100.0, 20.0, 10.0, 5.0  # mm, as CAD has it: a plate, and the radius of its hole
FORCE = 200.0  # N, down on the end


def draw(path: Path) -> None:
    """A part to read; yours comes from a CAD program."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    plate = gmsh.model.occ.addBox(0, 0, 0, L, B, H)
    hole = gmsh.model.occ.addCylinder(0.7 * L, B / 2, 0, 0, 0, H, R)
    gmsh.model.occ.cut([(3, plate)], [(3, hole)])
    gmsh.model.occ.synchronize()
    gmsh.write(str(path))  # OpenCASCADE prints lines about it
    gmsh.finalize()


# Surfaces are named by conditions; the mesh is in metres, and its cells follow the hole.
faces = {
    "root": lambda s: s.normal[0] < -0.99,
    "end": lambda s: s.normal[0] > 0.99,
    "hole": lambda s: abs(s.radius - R / 1000) < 1e-6,
}
with tempfile.TemporaryDirectory() as folder:
    draw(Path(folder) / "plate.step")
    part = rf.read_cad(Path(folder) / "plate.step", surfaces=faces, size=0.008, order=2)

area = B * H * 1e-6  # m²
loads = [rf.Fixed("root"), rf.Traction("end", (0, 0, -FORCE / area))]
steel = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7850.0)  # Pa, 1, kg/m³
probes = {"end": (L / 1000, B / 2000, H / 2000)}  # m
scene = rf.Scene(part, steel, loads, order=2, mass="consistent", probes=probes)
*_, report = rf.static(scene, steps=1)

force, moment = report.reactions["root"], report.reaction_moments["root"]
beam = FORCE * 0.1**3 / (3 * 2.1e11 * 0.02 * 0.01**3 / 12)  # m, without the hole
print(f"support: {force[2]:.3f} N, {moment[1]:.3f} N m; deflection {report.probes['end'][2]:.2e} m")

assert abs(force[2] - FORCE) < 1e-6 * FORCE
assert abs(moment[1] + FORCE * 0.1) < 0.01 * FORCE * 0.1  # about y
assert 1.0 < -report.probes["end"][2] / beam < 1.1  # the hole takes a few per cent
