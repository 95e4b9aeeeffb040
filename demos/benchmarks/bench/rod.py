"""A connecting rod with two holes: its stiffness and frequencies between faces of one kind."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import rigidfx as rf

__all__ = ["rod_numbers"]

LENGTH, WIDE, THICK, RADIUS = 0.2, 0.04, 0.02, 0.01  # m
STEEL = rf.StVenantKirchhoff(rho=7800.0, E=2.1e11, nu=0.3)
FAR = LENGTH, 0.0, THICK / 2
AXES = {"tension": (1.0, 0.0, 0.0), "sideways": (0.0, 1.0, 0.0)}


def _rod(size: float, gmsh: Any) -> None:
    """A bar with round ends and two holes along z, "near" at the origin and "far"."""
    occ, model = gmsh.model.occ, gmsh.model
    bar = [(3, occ.addBox(0, -WIDE / 2, 0, LENGTH, WIDE, THICK))]
    ends = [(3, occ.addCylinder(x, 0, 0, 0, 0, THICK, WIDE / 2)) for x in (0.0, LENGTH)]
    whole, _ = occ.fuse(bar, ends)
    pins = [(3, occ.addCylinder(x, 0, 0, 0, 0, THICK, RADIUS)) for x in (0.0, LENGTH)]
    drilled, _ = occ.cut(whole, pins)
    occ.synchronize()
    model.addPhysicalGroup(3, [volume for _, volume in drilled], name="rod")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)
    model.mesh.generate(3)


def rod_numbers(face: type[rf.MeanFace] | type[rf.RigidFace], size: float) -> dict[str, Any]:
    """Stiffness [N/m, N m/rad], frequencies between two pins [Hz] and unknowns of the rod.

    Args:
        face: Kind of both holes.
        size: Length of its cells [m].
    """
    domain = rf.from_gmsh(partial(_rod, size))
    for name, x in (("near", 0.0), ("far", LENGTH)):
        hole = partial(lambda at, p: np.hypot(p[0] - at, p[1]) < 1.01 * RADIUS, x)
        domain = domain.with_facets(name, hole)
    near, far = face("near"), face("far")

    def scene(*effects: rf.Effect) -> rf.Scene:
        return rf.Scene(domain, STEEL, effects, order=2, mass="consistent")

    out: dict[str, Any] = {}
    held = rf.Tied("ground", near)
    for name, axis in AXES.items():
        slide = rf.Prismatic("ground", far, FAR, axis, name="far")
        *_, last = rf.static(scene(held, slide, rf.Motor("far", force=100.0)), 1)
        out[name] = 100.0 / last.joints["far"].travel
    turning = rf.Revolute("ground", far, FAR, AXES["tension"], name="far")
    *_, last = rf.static(scene(held, turning, rf.Motor("far", torque=1.0)), 1)
    out["torsion"] = 1.0 / last.joints["far"].angle
    pinned = scene(rf.Revolute("ground", near), rf.Revolute("ground", far))
    out["frequencies"] = rf.modes(pinned, 4).frequencies[:4].tolist()
    out["unknowns"] = 3 * pinned.space.dofmap.index_map.size_global
    return out
