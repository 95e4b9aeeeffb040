"""Bars with holes: one that swings on a pin, and a connecting rod between faces."""

from functools import partial
from typing import Any

import numpy as np
from scipy.special import ellipk

import rigidfx as rf

from .followed import Followed

STEEL = rf.StVenantKirchhoff(rho=7800.0, E=2.1e11, nu=0.3)
WIDE, THICK, RADIUS = 0.04, 0.02, 0.01  # m
HUNG, ROD = 1.0, 0.2  # m, lengths
G = 9.81  # m/s²
UNIFORM = 4 * ellipk(0.5) * np.sqrt(2 * HUNG / (3 * G))  # s, of a thin bar on its end
FAR = ROD, 0.0, THICK / 2
AXES = {"tension": (1.0, 0.0, 0.0), "sideways": (0.0, 1.0, 0.0)}


def drilled(
    occ: Any, size: tuple[float, float, float], low: tuple[float, float], holes: Any, radius: float
) -> list[tuple[int, int]]:
    """Volumes of gmsh's of a bar along x with round ends about the axes of its holes, along z.

    It begins at `low` along x and z, with its middle at y = 0; holes are places along x [m].
    """
    (length, wide, thick), (x0, z0) = size, low
    bar = [(3, occ.addBox(x0, -wide / 2, z0, length, wide, thick))]
    for r, combined in ((wide / 2, occ.fuse), (radius, occ.cut)):
        bar, _ = combined(bar, [(3, occ.addCylinder(x, 0, z0, 0, 0, thick, r)) for x in holes])
    return list(bar)


def _bar(length: float, holes: tuple[float, ...], size: float, gmsh: Any) -> None:
    """A bar along x from the origin on, with a name."""
    occ, model = gmsh.model.occ, gmsh.model
    volumes = drilled(occ, (length, WIDE, THICK), (0.0, 0.0), holes, RADIUS)
    occ.synchronize()
    model.addPhysicalGroup(3, [volume for _, volume in volumes], name="bar")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)
    model.mesh.generate(3)


def hung_bar(size: float, *effects: rf.effects.Effect, joined: bool = True) -> rf.Scene:
    """The bar, of cells of some size [m]; its pin, if joined, finds place and axis in the hole."""
    domain = rf.from_gmsh(partial(_bar, HUNG, (0.0,), size))
    domain = domain.with_facets("hole", lambda x: np.hypot(x[0], x[1]) < 1.01 * RADIUS)
    pin = [rf.Revolute("ground", rf.MeanFace("hole"), name="pin")] if joined else []
    return rf.Scene(domain, STEEL, [*pin, rf.Gravity((0, -G, 0)), *effects])


def exact_period(size: float) -> float:
    """Period of a physical pendulum of the mesh's own mass and inertia, from 90° [s]."""
    body = hung_bar(size, rf.Rigid("bar"), joined=False)
    first, *_ = rf.simulate(body, 1e-3, 1e-3)
    data = next(iter(first.rigid)).data
    away = float(np.hypot(*data.origin[:2]))
    about = data.inertia[2, 2] + data.mass * away**2
    return float(4 * ellipk(0.5) * np.sqrt(about / (data.mass * G * away)))


def swing(size: float, dt: float) -> tuple[float, Followed]:
    """Period [s], between two passes of the vertical in the same direction, and the run."""

    def look(report: rf.Report) -> tuple[float, float]:
        """Time and angle from the vertical; the bar starts level."""
        turned = abs(report.joints["pin"].angle) if report.step else 0.0
        return report.t, turned - np.pi / 2

    run = Followed(hung_bar(size), dt, 1.3 * UNIFORM, look)
    t, angle = np.array(run.seen).T
    passed = [k for k in range(2, len(t) - 2) if angle[k - 1] < 0 <= angle[k]]
    at = []
    for k in passed[:2]:
        near = slice(k - 2, k + 2)
        at.append(t[k] + np.polyfit(angle[near], t[near] - t[k], 3)[-1])
    return at[1] - at[0], run


def rod_numbers(face: type[rf.MeanFace] | type[rf.RigidFace], size: float) -> dict[str, Any]:
    """Stiffness [N/m, N m/rad], frequencies between two pins [Hz] and unknowns of the rod."""
    domain = rf.from_gmsh(partial(_bar, ROD, (0.0, ROD), size))
    for name, x in (("near", 0.0), ("far", ROD)):
        hole = partial(lambda at, p: np.hypot(p[0] - at, p[1]) < 1.01 * RADIUS, x)
        domain = domain.with_facets(name, hole)
    near, far = face("near"), face("far")

    def scene(*effects: rf.effects.Effect) -> rf.Scene:
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
