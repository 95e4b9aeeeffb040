"""Rigid bodies of cells, by the mass matrix of the flexible cells: docs/theory.md, section 5.

Lumped masses sit at the corners of the cells, farther out than the mass they represent: moments of
inertia come out too large, threefold about the axis of a bar one cell across, by 1 + 2/n² of a
block of n cells across (the paper, Section 6.1). `excess_of_lumping` tells by how much.
"""

from dataclasses import dataclass
from typing import Any

import basix
import basix.ufl
import numpy as np
from dolfinx import fem

from rigidfx.base.types import Array, Indices
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.decide.bodies import PlannedBody
from rigidfx.domain.cell_quality import CHUNK, determinants
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.mechanics.rigid_body import Body, BodyMotion, Frozen, RigidBody
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.mechanics.rotation import skew
from rigidfx.scene.scene import Scene
from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.stiffness import times
from rigidfx.state import State

THIN = 1e-10  # least over largest principal moment below which a body counts as a line


@dataclass(frozen=True)
class MassProperties:
    """Mass, inertia and momenta of some nodes, as those of a rigid body."""

    mass: float  # m [kg]
    centre: Array  # centre of mass, shape (3,) [m]
    inertia: Array  # J about it, shape (3, 3) [kg m²]
    velocity: Array  # velocity of the centre that gives the nodes' linear momentum [m/s]
    angular_velocity: Array  # ω that gives their angular momentum [rad/s]; zero if singular
    kinetic: float  # kinetic energy of the nodes' velocities [J]
    singular: bool  # whether the nodes lie on a line, so that they are no body

    @property
    def rigid(self) -> float:
        """Kinetic energy of the rigid motion of these momenta [J]."""
        turning = self.angular_velocity @ self.inertia @ self.angular_velocity
        return 0.5 * float(self.mass * self.velocity @ self.velocity + turning)


def mass_properties(
    scene: Scene, cells: Cells, nodes: Indices, x: Array, v: Array, masses: Array | None = None
) -> MassProperties:
    """Rigid-body data of cells and nodes, equations (34)-(39). Collective.

    Masses of cells count if they are consistent, of sorted owned nodes if they are lumped, point
    masses always, or given ones of the nodes in their place [kg]. Positions x [m] and velocities v
    [m/s] are of all owned nodes, shape (nodes, 3).
    """
    total = np.asarray(scene.sum(np.r_[x[nodes].sum(axis=0), nodes.size]))
    reference = total[:3] / max(total[3], 1.0)
    # Rigid motions about the reference, and the nodes' velocities.
    fields = np.concatenate([rigid_motions(x[nodes] - reference, 1.0), v[nodes, :, None]], axis=2)
    if masses is None:
        rows = Rows(scene.space, nodes)
        operator = Mass(scene, rows, cells, np.ones(nodes.size, dtype=bool))
        images = times(operator, columns(fields), rows.vector)
        operator.destroy()
    else:
        images = columns(masses[:, None, None] * fields)
    product = np.asarray(scene.sum(columns(fields).T @ images))
    M_tot, momentum, kinetic = product[:6, :6], product[:6, 6], 0.5 * float(product[6, 6])
    m = np.trace(M_tot[:3, :3]) / 3  # (36)
    if not m > 0:
        zero = np.zeros(3)
        return MassProperties(0.0, reference, np.zeros((3, 3)), zero, zero, 0.0, True)
    # M_θu = m ĉ, c the centre of mass seen from the reference point (37)
    hat = M_tot[3:, :3] / m
    c = 0.5 * np.array([hat[2, 1] - hat[1, 2], hat[0, 2] - hat[2, 0], hat[1, 0] - hat[0, 1]])
    J = M_tot[3:, 3:] + m * skew(c) @ skew(c)  # (38), Steiner
    J = 0.5 * (J + J.T)
    moments = np.linalg.eigvalsh(J)
    singular = not moments[0] > THIN * moments[2]
    angular_velocity = np.zeros(3)
    if not singular:
        angular_velocity = np.linalg.solve(J, momentum[3:] - np.cross(c, momentum[:3]))
    velocity = momentum[:3] / m
    return MassProperties(float(m), reference + c, J, velocity, angular_velocity, kinetic, singular)


def excess_of_lumping(scene: Scene, cells: Indices, x: Array) -> Array:
    """Addition of lumped masses of cells to their inertia tensor, shape (3, 3) [kg m²]. Collective.

    A cell's lumped masses have its mass and its centre of mass, so that the excess is the same
    about any point and adds up over cells. With second-order hexahedra it is nearly nothing: their
    nodes and masses are a rule that integrates x² exactly. Local nodes, ghosts included, are at x,
    shape (nodes, 3) [m].
    """
    density = np.empty(scene.mesh.topology.index_map(3).size_local)
    for material, own in scene.materials:
        density[own] = material.rho
    kind = basix.CellType[scene.mesh.topology.cell_type.name]
    points, weights = basix.make_quadrature(kind, 2 * scene.order + 2)
    element = basix.ufl.element("Lagrange", kind.name, scene.order)
    N = element.tabulate(0, points)[0]
    second = np.zeros((3, 3))
    for start in range(0, cells.size, CHUNK):
        some = cells[start : start + CHUNK]
        det, _ = determinants(scene.mesh, some, points)
        dm = density[some, None] * np.abs(det) * weights
        corners = x[scene.space.dofmap.list[some]]
        corners = corners - corners.mean(axis=1, keepdims=True)
        inside = np.einsum("pn,cni->cpi", N, corners)
        second += np.einsum("cn,cni,cnj->ij", dm @ N, corners, corners, optimize=True)
        second -= np.einsum("cp,cpi,cpj->ij", dm, inside, inside, optimize=True)
    second = np.asarray(scene.sum(second))
    return np.asarray(np.trace(second) * np.eye(3) - second)


def at_nodes(state: State) -> tuple[Array, Array, Array]:
    """Places x, displacements u [m] and velocities v [m/s] of owned nodes, (nodes, 3) each."""
    n = state.u.function_space.dofmap.index_map.size_local
    u, v = (f.x.array[: 3 * n].reshape(-1, 3) for f in (state.u, state.v))
    return state.X[:n] + u, u, v


def freeze(scene: Scene, forces: InternalForces, state: State, what: PlannedBody) -> Body | None:
    """The body of planned cells, None if their inertia is singular. Collective.

    Displacement and velocity of its nodes are up to date.
    """
    x, u, v = at_nodes(state)
    cells = forces.cells(what.cells)
    p = mass_properties(scene, cells, what.nodes, x, v)
    if p.singular:
        return None
    motion = BodyMotion(p.centre.copy(), np.eye(3), p.velocity, p.angular_velocity)
    strain = float(fem.assemble_scalar(forces.bind_energy(cells)))
    strain, size = scene.sum([strain, what.cells.size])
    excess: Array = np.zeros((3, 3))
    if scene.mass == "lumped":
        everywhere = state.X + state.u.x.array.reshape(-1, 3)
        excess = excess_of_lumping(scene, what.cells, everywhere)
    kept = v[what.nodes] - motion.velocities(x[what.nodes] - p.centre)
    frozen = Frozen(what.nodes, kept, float(strain), max(p.kinetic - p.rigid, 0.0))
    more = {"size": int(size), "named": what.named, "excess": excess, "frozen": frozen}
    return Body(data_of(what, x, u, p.mass, p.inertia, p.centre, **more), motion)


def data_of(
    what: PlannedBody, x: Array, u: Array, mass: float, J: Array, origin: Array, **more: Any
) -> RigidBody:
    """The data of a planned body with this centre of mass [m], whose owned nodes are at x [m].

    They have displacements u [m]; J is about the centre [kg m²].
    """
    nodes = what.nodes
    known = what.name, what.cells, nodes, x[nodes] - origin, u[nodes]
    return RigidBody(*known, mass, J, origin, what.number, **more)
