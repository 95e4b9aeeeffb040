"""The linear equations of small vibrations about a state: M ÿ + K y = 0 in a run's own unknowns.

K = PᵀK P and M = PᵀM P have neither supports nor rigid parts in them. Joints leave y = Z q free:
docs/theory/joints.md#solving. K is the derivative of all forces in the state, also where they turn
along: with the energy V, the rows g and their forces λ, for which dV + λ dg = 0, that of
d²V + λ d²g (J. Nocedal and S. Wright, Numerical Optimization, 2nd ed., Section 12.5).

In the frame that turns with the state, with ω about a point c, the state is in equilibrium under
f = M S (x - c), S = |ω|² I - ω ωᵀ, whose derivative is the stiffness -M S (L. Meirovitch,
Computational Methods in Structural Dynamics, 1980, Section 2.6). Coriolis forces are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import qr, solve_triangular
from scipy.sparse import csr_array, dia_array, eye_array, kron

from rigidfx.base.errors import together
from rigidfx.base.matrices import distributed, free
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.ports import RANK, independent
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Joint, PointMass, Reduced, Windowed
from rigidfx.effects.damping import Centrifugal, StaticForces
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.growth.shaping import Shaping
from rigidfx.inventory.inventory import divide
from rigidfx.inventory.mass_properties import MassProperties, mass_properties
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.report.report import Report
from rigidfx.report.start import Start
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.scene.weights import inertial_masses
from rigidfx.state import State
from rigidfx.step.equations.constraints import Constraints
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.equations import Equations
from rigidfx.step.equations.supports import supports_of
from rigidfx.step.system.rigid_motion import free_to_move

# Part of an energy: of the kinetic one, by which a motion that turns may differ from a rigid one;
# of a mode's, by a spin that changes no frequency by more than half of it.
NEGLECTED = 0.01


@dataclass(frozen=True)
class Spin:
    """How a state turns."""

    omega: Array  # its angular velocity, shape (3,) [rad/s]; zero if it does not turn as a whole
    centre: Array  # a point of the axis, shape (3,) [m]
    apart: float  # largest difference to the angular velocity of a part [rad/s]

    @property
    def turns(self) -> bool:
        """Whether the state turns as a whole."""
        return bool(self.omega.any())

    @property
    def forces(self) -> list[StaticForces]:
        """Its centrifugal forces, without the stiffness of nodes; none if it does not turn."""
        return [StaticForces(partial(Centrifugal, self.omega, self.centre))] if self.turns else []


def spin_of(scene: Scene, about: Report | None) -> Spin:
    """How the state of a report turns, by the velocities of its nodes; rest if None. Collective."""
    omega: Array = np.zeros(3)
    centre: Array = np.zeros(3)
    # A structure that swings by little about its deformation may turn as a whole by chance.
    if about is None or about.kinetic <= NEGLECTED * about.strain:
        return Spin(omega, centre, 0.0)
    state = about.state
    every = np.arange(scene.owned_nodes, dtype=np.int32)
    x, v = state.places, state.velocities(every.astype(np.int64))
    part = parts_of_nodes(scene)[: every.size]

    def turning(nodes: Indices) -> MassProperties | None:
        p = mass_properties(scene, {}, nodes, x, v, scene.averaging_mass[nodes])
        is_rigid = p.kinetic - p.rigid <= NEGLECTED * p.kinetic
        return p if is_rigid and p.angular_velocity.any() else None

    if (whole := turning(every)) is not None:
        omega = whole.angular_velocity
        centre = whole.centre + np.cross(omega, whole.velocity) / (omega @ omega)
    of_parts = (turning(every[part == k]) for k in range(scene.parts.count))
    spins = np.reshape([p.angular_velocity for p in of_parts if p is not None], (-1, 3))
    apart = float(np.linalg.norm(spins - omega, axis=1).max(initial=0.0))
    return Spin(omega, centre, apart)


def softening(spin: Spin, mass: Mass, prolongation: Prolongation) -> PETSc.Mat:
    """-M S of the nodes by the unknowns in the pose of the state, a new matrix. Collective."""
    omega, M = spin.omega, mass.matrix()
    S = np.outer(omega, omega) - omega @ omega * np.eye(3)
    indptr, columns, values = M.getValuesCSR()
    own = csr_array((values, columns, indptr), shape=(M.local_size[0], M.size[1]))
    turned = csr_array(own @ kron(eye_array(M.size[1] // 3), S, format="csr"))
    product = distributed(turned, M.getSizes(), M.comm)
    out = prolongation.condense(product)
    free(M, product)
    return out


class HeldRows:
    """The rows that hold a state which vibrates, and the stiffness of their forces.

    Attributes:
        held: Derivatives of independent rows by the unknowns of all ranks, shape (rows, unknowns).
    """

    def __init__(self, constraints: Constraints, bodies: Bodies, p: Prolongation) -> None:
        """Find the rows of the state's equations, with the bodies as they are there. Collective."""
        self._constraints, self._p = constraints, p
        linkage, ports = constraints.linkage, constraints.ports
        active = linkage.rows.active.size
        self._locked = np.r_[np.ones(active, dtype=bool), linkage.drives.prescribed]
        rows, terms, compliance = ports.resisted(linkage, bodies)
        locks, of_locks = ports.led(linkage.test()[np.flatnonzero(self._locked)[active:]])
        rows = np.vstack([rows, locks])
        kept = independent(rows, np.vstack([terms, of_locks]), compliance)
        every = ports.everywhere()
        self.held = csr_array(csr_array(rows[kept]) @ every)
        self._averages = csr_array(csr_array(ports.lead(p.increments)) @ every)  # by unknowns

    def balance(self, y: PETSc.Vec, r: PETSc.Vec, masses: Array) -> None:
        """Set multipliers among unknowns y to forces of joints that balance r [N] best. Collective.

        At an equilibrium these are its own; elsewhere those that joints begin to have. Unknowns of
        this rank have masses [kg].
        """
        rows, p, locked = self._constraints, self._p, self._locked
        own = csr_array(csr_array(rows.linkage.test()) @ self._averages)
        own = own[:, p.first_column : p.first_column + p.owned].toarray()
        forces = np.zeros(locked.size)
        gaps, compliance = rows.of_rows(r.array_r) / rows.scale, rows.linkage.compliance()
        forces[~locked] = -gaps[~locked] / compliance[~locked]
        rest = r.array_r[: p.owned] + own.T @ forces
        G = own[locked]
        largest = p.comm.allreduce(masses.max(initial=0.0), MPI.MAX)
        weighted = G / np.maximum(masses, np.sqrt(np.finfo(np.float64).eps) * largest)
        A, b = p.comm.allreduce(weighted @ G.T), p.comm.allreduce(weighted @ rest)
        forces[locked] = p.comm.bcast(-np.linalg.lstsq(A, b, rcond=RANK)[0])
        y.array[p.owned :] = (forces / rows.scale)[: rows.own]

    def stiffness_matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """Stiffness of joints and springs at the last iterate, a new matrix like K. Collective."""
        linkage, E = self._constraints.linkage, self._averages
        along = csr_array(linkage.test()[linkage.rows.active.size :])
        springs = dia_array((linkage.drives.stiffness()[None], [0]), shape=2 * along.shape[:1])
        bent = linkage.curvature()  # of torques, which have no energy, the symmetric part
        C = csr_array(0.5 * (bent + bent.T) + along.T @ springs @ along)
        own = csr_array(csr_array(E.T @ C @ E)[slice(*K.getOwnershipRange())])
        return distributed(own, K.getSizes(), K.comm)


def free_motions(held: csr_array, prolongation: Prolongation) -> tuple[PETSc.Mat, Ints]:
    """Z, which the caller destroys, and the unknowns of this rank that are in q. Collective.

    Independent rows that are held, shape (rows, unknowns), are equal on all ranks.
    """
    comm, size, count = prolongation.comm, prolongation.size, held.shape[0]
    used = np.unique(held.tocoo().coords[1])
    rows = held[:, used].toarray()
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    R, order = qr(rows, mode="r", pivoting=True)
    by = -solve_triangular(R[:count, :count], R[:count, count:])
    given, others, by = comm.bcast((used[order[:count]], used[order[count:]], by))
    free = np.setdiff1d(np.arange(size), given)
    row = np.r_[free, np.repeat(given, others.size)]
    column = np.r_[np.arange(free.size), np.tile(np.searchsorted(free, others), count)]
    values = np.r_[np.ones(free.size), by.ravel()]
    Z = csr_array((values, (row, column)), shape=(size, free.size))
    first, owned = prolongation.first_column, prolongation.owned
    kept = free[(free >= first) & (free < first + owned)] - first
    sizes = (owned, size), (kept.size, free.size)
    return distributed(csr_array(Z[first : first + owned]), sizes, comm), kept


BALANCED = float(np.cbrt(np.finfo(np.float64).eps))  # part of the loads that rounding may leave


class Problem:
    """Stiffness and mass about a state, by q; `destroy` frees them.

    Attributes:
        spin: How the state turns.
        K: Stiffness [N/m].
        M: Mass [kg].
        motions: Rigid motions of the connected parts, where some may take no energy.
        division: Of the cells into bodies and others.
        shaping: Gave reduced parts their shapes; None where all is flexible or rigid.
        lacking: Numbers of modes that shapes of parts lack, and ω² of these at most [1/s²].
        of_loads: Loads and forces of joints over mass and extent: ω² whose rounding may be all of
            that of a motion without energy [1/s²].
    """

    def __init__(
        self,
        scene: Scene,
        about: tuple[Report, Start] | None = None,
        turns: bool = True,
        division: Division | None = None,
    ) -> None:
        """Assemble both matrices, about the state of a report or the reference at t = 0.

        The start is that of the report. A state that turns may be taken to rest. The cells are
        divided unless a division is given. Collective.
        """
        state = self._state = State(scene)
        report, start = about or (None, None)
        if start is not None:
            start.apply(state)
        self.shaping: Shaping | None = None
        self.lacking: dict[int, float] = {}
        t = 0.0 if report is None else report.t
        acting = scene.acting(t)
        forces = InternalForces(scene, state.u, ())
        self.spin = spin_of(scene, report if turns else None)
        self.division = division or self._divided(scene, forces, acting, t)
        division = self.division
        state.group(division.bodies)
        known = state, division, supports_of(acting)
        self._scene, self._of = scene, Equations("linear", scene, forces, *known)
        p = self._of.prolongation
        p.pose(state.bodies)
        self._blocks = state.bodies.led_mass_blocks
        masses = self._of.mass.reduced(p, self._blocks)
        loose = bool(free_to_move(scene, self._of.prescribed, acting=acting))
        # A reference is without stresses, but a mechanism may be in balance there.
        loaded = about is not None or (loose and bool(scene.named(Joint)))
        if self._bind(acting, t, loaded, masses) > BALANCED and about is None:
            self._of.unbind()
            self._bind(acting, t, False, masses)
        self._Z: Any = None  # the identity
        self._kept: Any = slice(None)  # which of y are q
        if self._rows is not None and self._rows.held.shape[0]:
            self._Z, self._kept = free_motions(self._rows.held, p)
        self.K, self.M = self._in_q(self._stiffness()), self._in_q(masses)
        self.motions = self._rigid_motions() if loose else []

    def _divided(
        self, scene: Scene, forces: InternalForces, acting: Sequence[Windowed], t: float
    ) -> Division:
        """The division of the cells; reduced parts are flexible in a state that turns. Collective.

        They are flexible where no load gives them shapes, too.
        """
        active, state = supports_of(acting), self._state
        named = {effect.name for effect in scene.named(Reduced)}
        if named and not self.spin.turns:
            until = max([t, *(b for b in scene.breakpoints if np.isfinite(b))]) + 1.0
            shaping = Shaping(scene, forces, acting, until, 0.0)
            found = divide(scene, forces, state, active, (), partial(shaping.shaped, state))
            if all(b.shapes is not None for b in found.bodies.of.records if b.name in named):
                self.shaping = shaping
                return found
            shaping.destroy()
        return divide(scene, forces, state, active)

    def _bind(self, acting: Sequence[Windowed], t: float, loaded: bool, masses: PETSc.Mat) -> float:
        """Evaluate all forces at the state and time t [s], those of joints too. Collective.

        Dead loads act if it is loaded. The part of the loads that nothing balances is returned.
        """
        scene, of, bodies = self._scene, self._of, self._state.bodies
        dead = [e for e in acting if e.is_dead and loaded]
        lasting = [e for e in scene.effects if e.is_lasting and not e.is_windowed]
        there = [e for e in acting if loaded or e.grows != "time"]
        of.bind([*lasting, *dead, *self.spin.forces], there)
        p, linkage, rows = of.prolongation, of.linkage, of.constraints
        self._rows = None if rows is None else HeldRows(rows, bodies, p)
        of.actions.set_time(t, 1.0)
        if linkage is not None:
            together(scene.comm, "A motor", partial(linkage.set_time, t, 0.0))
        of.begin(1.0, None, np.zeros(p.prescribed.size), bodies)
        y, r = of.unknowns(), of.unknowns()
        of.residual(y, r)
        if self._rows is not None and loaded:
            self._rows.balance(y, r, masses.getDiagonal().array_r)
            of.residual(y, r)
        loads = of.actions.loads
        size = np.abs(loads.moments).sum() + np.abs(loads.torques).sum() + loads.vector.norm()
        left = float(np.sqrt(scene.sum((r.array_r[: p.owned] ** 2).sum())))
        free(y, r)
        mass = float(scene.sum(inertial_masses(scene).sum()))
        efforts = 0.0 if linkage is None else float(np.abs(linkage.multipliers).sum())
        self.of_loads = (float(size) + efforts) / (mass * scene.parts.extent)
        return left / size if size > 0 else 0.0

    @property
    def places(self) -> Array:
        """Places of the local nodes in the state, shape (nodes, 3) [m]."""
        return np.asarray(self._state.X + self._state.u.x.array.reshape(-1, 3))

    def _stiffness(self) -> PETSc.Mat:
        """The tangent of statics at the state, by the unknowns, with joints. Collective."""
        self._of.tangent()
        K = self._of.tangent_matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        more = []
        if self.spin.turns:
            more.append(softening(self.spin, self._of.mass, self._of.prolongation))
        if self._rows is not None:
            more.append(self._rows.stiffness_matrix(K))
        for A in more:
            K.axpy(1.0, A, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            A.destroy()
        return K

    def _in_q(self, A: PETSc.Mat) -> PETSc.Mat:
        """A matrix by the motions that joints leave free, in place of that by y. Collective."""
        if self._Z is None:
            return A
        out = A.ptap(self._Z)
        A.destroy()
        return out

    def _moved(self, centre: Array) -> tuple[Array, Array]:
        """The six rigid motions of the whole about a point, of rows and of unknowns of bodies.

        Shapes are (nodes, 3, 6) [m], and (bodies, 6 + m, 6).
        """
        bodies, turns = self._state.bodies, np.arange(3, 6)
        of_bodies = np.zeros((*bodies.rates.shape, 6))
        of_bodies[:, :3] = rigid_motions(bodies.r - centre, 1.0)
        of_bodies[:, turns, turns] = bodies.of.length[:, None]
        return rigid_motions(self.places[self._of.layout.rows.nodes] - centre, 1.0), of_bodies

    def _rigid_motions(self) -> list[PETSc.Vec]:
        """Six of each connected part, some of which joints may prevent. Collective."""
        scene, out, y = self._scene, [], self._of.prolongation.unknowns()
        of_node, parts = parts_of_nodes(scene), scene.parts
        of_row = of_node[self._of.layout.rows.nodes]
        masses = (effect for effect in scene.named(PointMass) if effect.is_carried)
        carried = {effect.title: effect.remote.place.nodes for effect in masses}
        records = self._state.bodies.of.records
        nodes = (carried.get(data.name, data.nodes) for data in records)
        own = np.array([of_node[some].min(initial=parts.count) for some in nodes], dtype=np.int64)
        of_body = np.empty_like(own)
        scene.comm.Allreduce(own, of_body, op=MPI.MIN)
        for k in range(parts.count):
            of_nodes, of_bodies = self._moved(parts.middle[k])
            of_nodes[of_row != k], of_bodies[of_body != k] = 0.0, 0.0
            for axis in range(6):
                at_rows = of_nodes[:, :, axis].reshape(-1)
                self._of.prolongation.collapse(at_rows, of_bodies[:, :, axis], y)
                q = y.duplicate() if self._Z is None else self._Z.createVecRight()
                q.array[:] = y.array_r[self._kept]
                out.append(q)
        y.destroy()
        return out

    def seen(self, q: PETSc.Vec) -> tuple[Array, Array]:
        """Displacements of all local nodes by q, (nodes, 3) [m], and qᵀM r, (6,). Collective.

        These r are rigid motions of the whole, held nodes among it: three translations [kg], and
        three rotations about the centre of mass [kg m].
        """
        bodies, p, rows, y = self._state.bodies, self._of.prolongation, self._of.layout.rows, q
        if self._Z is not None:
            self._Z.mult(q, y := p.unknowns())
        six, d, f = p.bodies_part(y), rows.vector(), rows.vector()
        p.apply(y, six, np.zeros(p.prescribed.size), d)
        self._of.mass.mult(d, f)
        of_rows, r = self._moved(self._scene.centre_of(1.0, self.places))
        gamma = np.asarray(self._scene.sum(f.array_r @ of_rows.reshape(-1, 6)))
        gamma += np.einsum("bij,bj,bik->k", self._blocks, six, r)
        out = fem.Function(self._scene.space)
        out.x.array[rows.dofs] = d.array_r
        moved: Array = (p.increments.L @ six[:, :, None]).reshape(bodies.pose.shape)
        for k, body in enumerate(bodies.of.records):
            a = body.coordinates()
            out.x.array.reshape(-1, 3)[body.nodes] = a @ moved[k, : a.shape[1]]
        out.x.scatter_forward()
        free(d, f)
        return out.x.array.reshape(-1, 3).copy(), gamma

    def richer(self, shapes: Array) -> Division | None:
        """The division with more shapes of reduced parts; None if there are none. Collective.

        They are for modes φ at all local nodes, (n, nodes, 3): see `Shaping.richer`.
        """
        if self.shaping is None:
            return None
        fields = shapes[:, : self._scene.owned_nodes].transpose(1, 2, 0)
        return replace(self.division, bodies=self.shaping.richer(self._state.bodies, fields))

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        free(*self.motions, self.K, self.M, self._Z, self.shaping, self._of)
