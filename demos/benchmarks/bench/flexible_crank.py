"""A slider-crank whose crank and rod are flexible: aluminium bars with holes, driven by a torque.

The crank turns about the z axis at the origin, the rod lies between the pins at x = CRANK and
x = CRANK + ROD, and a rigid slider goes along x. Both bars lie in one plane: nothing touches.
"""

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from codes import matrices, part_of
from common.machines import ramp
from mpi4py import MPI

import rigidfx as rf

from .drilled import drilled
from .followed import Followed

Array = npt.NDArray[np.float64]
CRANK, ROD = 0.08, 0.24  # m, between the axes of holes
WIDE, THICK, RADIUS = 0.024, 0.016, 0.006  # m; half of it at z > 0
ALUMINIUM = rf.StVenantKirchhoff(rho=2700.0, E=7e10, nu=0.3)
SLIDER, CUBE = 0.4, 0.04  # kg, m
INERTIA = SLIDER * 1e-4 * np.eye(3)  # kg m²
CENTRE = np.array([CRANK + ROD + CUBE / 2, 0.0, 0.0])  # m
STARTS = {"crank": 0.0, "rod": CRANK}
SPANS = {"crank": CRANK, "rod": ROD}
FULL, PUSH = 0.01, 10.0  # s, N m: the torque is there from then on
Z = 0.0, 0.0, 1.0
PINS = {
    "crank": np.array([[0.0, 0, 0], [CRANK, 0, 0]]),
    "rod": np.array([[CRANK, 0, 0], [CRANK + ROD, 0, 0]]),
}
RIM = np.array([0.0, RADIUS, 0.0])  # m, from the axis of a hole to a point of it
PROBES = {
    "crank": PINS["crank"] + RIM,
    "rod": np.stack([PINS["rod"][0] + RIM, PINS["rod"].mean(axis=0), PINS["rod"][1] + RIM]),
}


def torque(t: float) -> float:
    """Torque of the motor [N m], smooth from rest."""
    return PUSH * ramp(t / FULL)


def _parts(names: tuple[str, ...], size: float, gmsh: Any) -> None:
    """The parts of some names, each a volume of its own, with its holes as surfaces."""
    occ, model = gmsh.model.occ, gmsh.model
    made = {
        name: drilled(occ, (span, WIDE, THICK), (x, -THICK / 2), (x, x + span), RADIUS)
        for (name, span), x in zip(SPANS.items(), STARTS.values(), strict=True)
        if name in names
    }
    if "slider" in names:
        made["slider"] = [(3, occ.addBox(CRANK + ROD, -CUBE / 2, -CUBE / 2, *(3 * [CUBE])))]
    occ.synchronize()
    for name, volumes in made.items():
        model.addPhysicalGroup(3, [tag for _, tag in volumes], name=name)
        for k in range(2 if name in SPANS else 0):
            at = STARTS[name] + k * SPANS[name]
            ends = np.array([at, 0, 0]), 1.01 * np.array([RADIUS, RADIUS, THICK / 2])
            inside = model.getEntitiesInBoundingBox(*(ends[0] - ends[1]), *(ends[0] + ends[1]), 2)
            of_part = {tag for _, tag in model.getBoundary(volumes, oriented=False)}
            hole = [tag for _, tag in inside if tag in of_part]
            model.addPhysicalGroup(2, hole, name=f"{name} {k}")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 6)
    model.mesh.generate(3)


def flexible_crank(size: float, *more: rf.effects.Effect) -> rf.Scene:
    """The whole, of cells of some size [m] and further effects, with mean faces in all holes."""
    face, wrist = rf.MeanFace, (CRANK + ROD, 0.0, 0.0)
    effects = [
        rf.Rigid("slider", mass=SLIDER, inertia=INERTIA),
        rf.Revolute("ground", face("crank 0"), (0, 0, 0), Z, name="bearing"),
        rf.Revolute(face("crank 1"), face("rod 0"), (CRANK, 0, 0), Z, name="crank pin"),
        rf.Spherical(face("rod 1"), "slider", wrist, name="wrist pin"),
        rf.Prismatic("ground", "slider", wrist, (1, 0, 0), name="guide"),
        rf.Motor("bearing", torque=torque),
        *more,
    ]
    domain = rf.from_gmsh(partial(_parts, ("crank", "rod", "slider"), size))
    return rf.Scene(domain, ALUMINIUM, effects, order=2, mass="consistent")


def motion(crank: Array, rod: Array, dt: float) -> tuple[Array, Array]:
    """Crank speed in each step [rad/s] and deflection of the rod, less that at the start [m].

    Crank and rod are places of two points of the crank, shape (steps + 1, 2, 3), and of points at
    an end of the rod, in its middle and at its other end, (steps + 1, 3, 3) [m]. The deflection is
    the distance of the middle from the line through the ends.
    """
    along = crank[:, 1] - crank[:, 0]
    angle = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    chord, middle = rod[:, 2] - rod[:, 0], rod[:, 1] - rod[:, 0]
    area = chord[:, 0] * middle[:, 1] - chord[:, 1] * middle[:, 0]
    bent = area / np.hypot(chord[:, 0], chord[:, 1])
    return np.diff(angle) / dt, bent - bent[0]


def crank_motion(scene: rf.Scene, dt: float, steps: int) -> tuple[tuple[Array, Array], Followed]:
    """The motion of the slider-crank of `flexible_crank`, as `motion` gives it, and the run."""
    X, comm = scene.space.tabulate_dof_coordinates(), scene.mesh.comm
    nodes = [nodes_of(scene, name)[:, None] for name in PROBES]

    def look(report: rf.Report) -> list[Array]:
        """Places of the probes of crank and rod."""
        report.state.rebuild()
        x = X + report.state.u.x.array.reshape(-1, 3)
        return [comm.allreduce(np.where(own < 0, 0.0, x[own[:, 0]])) for own in nodes]

    run = Followed(scene, dt, steps * dt, look)
    crank, rod = (np.array(path) for path in zip(*run.seen, strict=True))
    return motion(crank, rod, dt), run


def nodes_of(scene: rf.Scene, name: str) -> npt.NDArray[np.int64]:
    """Nodes of a part that are nearest to its probes; -1 of those that another rank owns."""
    cells = scene.domain.find(name, [3], "the crank").entities
    nodes = np.unique(scene.space.dofmap.list[cells])
    nodes = nodes[nodes < scene.owned_nodes]
    X, comm, out = scene.space.tabulate_dof_coordinates()[nodes], scene.mesh.comm, []
    for place in PROBES[name]:
        apart = np.linalg.norm(X - place, axis=1).round(9)  # of equal ones the least x, y, z
        first = np.lexsort((*X.T[::-1], apart))[:1]
        mine = (*apart[first], *X[first].ravel(), comm.rank) if first.size else (np.inf,)
        nearest = comm.allreduce(mine, MPI.MIN)
        out.append(int(nodes[first[0]]) if nearest[-1] == comm.rank and first.size else -1)
    return np.array(out)


def for_exudyn(scene: rf.Scene, dt: float, steps: int) -> dict[str, Any]:
    """The mechanism as `codes/exudyn_steps.py` reads it, without the number of modes; one rank."""
    out: dict[str, Any] = {"kind": "slider-crank", "dt": dt, "steps": steps}
    both = matrices(scene)
    for name, pins in PINS.items():
        faces = f"{name} 0", f"{name} 1"
        out |= part_of(name, scene, faces, pins, nodes_of(scene, name), both)
    times = np.linspace(0.0, steps * dt, 10 * steps + 1)
    out |= {"torque times": times, "torque": np.array([torque(t) for t in times])}
    out |= {"wrist": PINS["rod"][1], "slider centre": CENTRE}
    return out | {"slider mass": SLIDER, "slider inertia": INERTIA}
