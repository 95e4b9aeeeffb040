"""The equations of one division, for steps, statics or vibrations: residual and tangent.

The unknowns y are increments, of the free dofs and of the rigid bodies, so that a motion far from
the origin loses no digits; with d = d(y) = u₁ - u₀ and v₁ = 2 d/Δt - v₀ the residual reads, in N,

    f(d) = M (2 d/Δt - 2 v₀)/Δt + f_int(u₀, u₀ + d) - f̄_ext,    R(y) = Lᵀ f + bodies' own.

d and f have rows for the active nodes only. Multipliers of joints come last, see `constraints`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.matrices import free
from rigidfx.base.types import Array
from rigidfx.coupling.cell_forces import CellForces
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.dealt_rows import Dealing
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Effect, Structure, Support, Windowed
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.nodes import Forces, Instant, Motion, Tangent
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.linear_forms import static_forces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import StaticStep, Step
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.constraints import Constraints, linked
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.round_off import Rounding
from rigidfx.step.equations.shape_damping import ShapeDamping
from rigidfx.step.equations.supports import PrescribedDofs

Kind = Literal["step", "static", "linear"]
WELL_CONDITIONED = 50.0  # cells that the fastest wave passes in a step; its square is the condition


@dataclass(frozen=True)
class Trial:
    """One trial of a step, or of statics."""

    dt: float  # Δt [s]; of no meaning in statics
    v0: PETSc.Vec  # velocity of the active nodes at the start of the step [m/s]; None in statics
    imposed: Array  # increments of the held dofs [m]
    start: Array  # displacements of the active nodes at the start of the step [m]
    bodies: Step  # the step of the bodies
    begun: Instant  # bodies at the start of the step, as effects see them


class Inertia:
    """The resistance of masses in a step, M (v₁ - v₀)/Δt with v₁ = 2 d/Δt - v₀.

    Attributes:
        before: M v₀ of the active nodes [kg m/s].
        gained: M (v₁ - v₀) at the last iterate [kg m/s].
    """

    def __init__(self, mass: Mass, rows: Rows) -> None:
        self._mass = mass
        self._v, self.before, self.gained = (rows.vector() for _ in range(3))

    def begin(self, v0: PETSc.Vec) -> None:
        """Begin a step at velocities v₀ [m/s]. Collective."""
        self._mass.mult(v0, self.before)

    def add_to(self, f: PETSc.Vec, d: PETSc.Vec, trial: Trial) -> None:
        """Add it to forces [N], rounded as the update of the velocity is. Collective."""
        trial.v0.copy(self._v)
        self._v.axpby(2 / trial.dt, -2.0, d)
        self._mass.mult(self._v, self.gained)
        f.axpy(1 / trial.dt, self.gained)

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        free(self._v, self.before, self.gained)


class Equations:
    """The equations of one division: unknowns, masses, effects, joints; `destroy` frees them.

    Attributes:
        kind: Which equations they are.
        prescribed: Dofs that supports hold.
        layout: Division of cells and dofs.
        mass: Mass operator of the flexible cells.
        structure: The division as effects see it.
        prolongation: Map between unknowns and dofs.
        actions: Actions on nodes and bodies.
        constraints: Rows and multipliers of joints; None without any.
        rounding: Rounding in residuals and strains.
        trial: The step that is being solved, frozen.
        d: Increments of the active nodes at the iterate of the last residual [m].
        forces_out_of_balance: Residual at the active nodes there [N]; at held dofs it is the force
            of the supports.
        body_rows: Residual of the bodies there, shape (bodies, 6 + m) [N]; the first six of a body
            that is held are what its support exerts.
    """

    actions: Actions
    constraints: Constraints | None
    rounding: Rounding

    def __init__(
        self,
        kind: Kind,
        scene: Scene,
        forces: InternalForces,
        state: State,
        division: Division,
        supports: tuple[Support, ...],
        *,
        notes: dict[int, Any] | None = None,
        dealing: Dealing | None = None,
        instant: bool = False,
    ) -> None:
        """Number the unknowns and assemble the mass of a division, under supports that act.

        `notes` is the memory of effects (`Structure`); `dealing` deals flexible cells out among the
        ranks where that pays. Loads are those of an `instant`, or means over steps. Collective.
        """
        flexible, bodies, driven = division.flexible, division.bodies, division.driven_cells
        self.kind, self._scene, self._forces, self._driven = kind, scene, forces, driven
        known = division.driven_nodes, division.nodes_of_held
        self.prescribed = PrescribedDofs(scene, supports, *known)
        self.layout = layout = dof_layout(scene, flexible, bodies.of, self.prescribed.mask, driven)
        own = layout.massive[layout.rows.nodes]
        self.mass = Mass(scene, layout.rows, flexible, own, driven)
        self.structure = Structure(
            scene=scene,
            rows=layout.rows,
            own=own,
            bodies=bodies,
            mass=self.mass,
            u=state.u.x.array,
            surface=forces.surface,
            notes=notes,
            static=kind != "step",
            instant=instant,
        )
        self._dealt = (
            None if dealing is None else dealing.rows(layout, forces.loaded(flexible, driven or {}))
        )
        self.prolongation = Prolongation(layout, scene.comm, self._dealt)
        rows, p = layout.rows, self.prolongation
        self._inertia = Inertia(self.mass, rows) if kind == "step" else None
        self.d, self.forces_out_of_balance = rows.vector(), rows.vector()
        self._moments: Array = np.zeros_like(p.increments.displacement)
        self.body_rows: Array = p.no_bodies
        self._last: Array = np.empty(0)  # unknowns that d and u₁ belong to
        none, step = np.empty(0), p.increments.step
        self.trial = Trial(0.0, None, none, none, step, Instant(bodies))

    @property
    def inertial(self) -> bool:
        """Whether masses resist; in steps only."""
        return self._inertia is not None

    @property
    def linkage(self) -> Linkage | None:
        """The joints; None if there are none."""
        return None if self.constraints is None else self.constraints.linkage

    def bind(
        self,
        effects: Sequence[Effect],
        acting: Sequence[Windowed],
        *,
        joints: bool = True,
        loose: bool = False,
        damping: ShapeDamping | None = None,
    ) -> None:
        """Bind effects, of those with a time window the ones that act, and joints. Collective.

        If `loose`, a drag holds parts in statics, in place of springs that joints get. `damping` is
        that of the shapes of bodies.
        """
        scene, forces, p = self._scene, self._forces, self.prolongation
        self.actions, self._damping = Actions(self.structure, effects, acting), damping
        self.constraints = None
        if joints and (linkage := linked(self.structure, acting)) is not None:
            anchored = self.kind == "static" and not loose
            self.constraints = Constraints(linkage, self.structure.bodies, p, anchored)
        parts = self.layout.flexible, self.layout.interior, self.layout.interface
        if self.inertial:
            dealt = None if self._dealt is None else self._dealt.cells
            of = forces.bind(*parts, self._driven, dealt)
        else:
            loads = acting if self.kind == "static" else ()
            of = static_forces(scene, forces, *parts, self._driven, loads)
        self._cells = CellForces(p, of.residual, forces)
        self._forms = of.interior, of.interface
        self._tangent = self.new_tangent()
        self.rounding = Rounding(scene, forces, of.undeformed, self._tangent, p, self.actions)

    def begin(
        self,
        dt: float,
        v0: PETSc.Vec | None,
        imposed: Array,
        start: Bodies,
        given: Array | None = None,
    ) -> Trial:
        """Begin a step of Δt [s], under the loads that the actions have now; its data. Collective.

        Nodes have velocities v₀ [m/s], none in statics, and held dofs imposed increments [m].
        Frames of bodies that are held have given ones: see `Step`.
        """
        damping = None if self._damping is None else self._damping.matrix(dt)
        bodies = Step(start, dt, damping, given) if self.inertial else StaticStep(start, given)
        u0 = self.structure.u[self.layout.rows.dofs]
        self.trial = Trial(dt, v0, imposed, u0, bodies, Instant(start))
        self._cells.begin(self.trial.start)
        if self._inertia is not None:
            self._inertia.begin(v0)
        if self.constraints is not None:
            self.constraints.begin(dt, start)
        return self.trial

    def unknowns(self) -> PETSc.Vec:
        """A new vector of unknowns; the caller destroys it."""
        own = 0 if self.constraints is None else self.constraints.own
        return self.prolongation.unknowns(own)

    def guess(self, increment: Array, bodies: Array, y: PETSc.Vec) -> None:
        """Set unknowns to a first guess, multipliers to those of the last step. Collective.

        Increments have a number per row, those of the bodies the shape (bodies, 6 + m) [m].
        """
        self.prolongation.collapse(increment, bodies, y)
        if self.constraints is not None:
            self.constraints.guess(y.array)

    def cells_at(self, at_start: Array, at_end: Array) -> Array:
        """The cells' forces beside the last iterate, one number per row [N]. Collective.

        They are displaced [m] at the start of the step, which u₀ has already, and at its end in u₁.
        """
        self._cells.begin(self.start + at_start)
        self._cells.displace(self.start + self.d.array_r + at_end)
        self._cells.settle()
        forces = np.empty(at_end.size)
        self._cells.evaluate(forces)
        return forces

    def largest(self, y: PETSc.Vec) -> float:
        """Largest increment among unknowns [m]. Collective."""
        own = float(np.abs(self._own(y)).max(initial=0.0))
        return float(self.prolongation.comm.allreduce(own, op=MPI.MAX))

    def _own(self, y: PETSc.Vec) -> Array:
        """Entries of a vector on this rank that are no constraints'."""
        return np.asarray(y.array_r[: self.prolongation.owned])

    def accept(self) -> None:
        """Accept the last iterate as a step; raise as `Constraints.accept`."""
        if self.constraints is not None:
            self.constraints.accept()

    @property
    def dt(self) -> float:
        """Δt of the present step [s]."""
        return self.trial.dt

    @property
    def start(self) -> Array:
        """Displacements of the active nodes at the start of the step [m]."""
        return self.trial.start

    def return_to(self, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """Bring d, u₁ and forces back to these unknowns, as a rule the last ones. Collective.

        A solver of the user's, chosen by PETSc's options, may have looked elsewhere last; then the
        residual r [N] is overwritten.
        """
        same, joints = np.array_equal(self._last, self._own(y)), self.constraints
        if joints is not None:
            λ = joints.multipliers(y.array_r)
            same = same and np.array_equal(λ, joints.linkage.multipliers)
        if not self.prolongation.comm.allreduce(same, op=MPI.LAND):
            self.residual(y, r)
        self._cells.settle()

    def residual(self, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """Overwrite r by R at the unknowns y [N]. Collective."""
        joints, trial = self.constraints, self.trial
        self._last = self._own(y).copy()
        self.prolongation.expand(self._last, trial.bodies, trial.imposed, self.d)
        self._cells.displace(self.start + self.d.array_r)
        if joints is not None:
            joints.look(y.array_r)
        f = self.forces_out_of_balance
        self._cells.evaluate(f.array)
        f.axpy(-1.0, self.actions.loads.vector)
        if self._inertia is not None:
            self._inertia.add_to(f, self.d, trial)
        more = None
        if not (self.actions.dead and joints is None):
            resisting = Forces.none(f, self._moments)
            self.actions.resist(self.motion, resisting)
            if joints is not None:
                joints.resist(self.motion, resisting)
            more = resisting.moments
        self.prolongation.collapse(f.array_r, self._body_forces(f, more), r)
        if joints is not None:
            joints.fill(joints.linkage.residual(), r.array)

    @property
    def motion(self) -> Motion:
        """The iterate of the last residual, as effects see it."""
        return Motion(self.d, self.prolongation.increments, self.dt, self.trial.begun)

    def _body_forces(self, f: PETSc.Vec, more: Array | None) -> Array:
        """Residual of the bodies, shape (bodies, 6 + m), by forces on nodes [N]. Collective."""
        increments, loads = self.prolongation.increments, self.actions.loads
        if not len(increments):  # without bodies nothing of them is computed
            return increments.unknowns
        self._moments = self.prolongation.moments(f, more) - loads.moments
        self.body_rows = increments.balance(self._moments, loads.torques)
        return self.body_rows

    def new_tangent(self) -> CondensedMatrix:
        """Another matrix for `tangent`, which the caller destroys. Collective."""
        return CondensedMatrix(self.prolongation, *self._forms)

    def tangent(self, other: CondensedMatrix | None = None) -> None:
        """Assemble the condensed tangent at the last iterate, or in another matrix. Collective."""
        K = self._tangent if other is None else other
        K.assemble()
        if self.inertial:
            self.mass.add_to(K, 2 / self.dt**2, self.prolongation)
        tangent = None
        if self.actions.stiffens:
            tangent = Tangent(K, self.prolongation)
            self.actions.stiffen(self.motion, tangent)
        if self.constraints is not None and self.constraints.springs is not None:
            K.add_coupling(self.constraints.springs)
        K.finish(self._blocks(tangent) if self.prolongation.layout.bodies else None)

    def jumping(self) -> csr_array | None:
        """Stiffness of contacts at the last iterate: see `Actions.jumping`. Collective."""
        return self.actions.jumping(self.motion, self.prolongation)

    def _blocks(self, tangent: Tangent | None) -> Array:
        """Derivative of the bodies' rows that the condensed tangent does not hold. Collective."""
        increments = self.prolongation.increments
        blocks = increments.blocks(self._moments)
        if tangent is not None:
            self.actions.sum(tangent.moments)
            blocks += tangent.blocks
        return blocks

    @property
    def tangent_matrix(self) -> PETSc.Mat:
        """The reduced tangent as `tangent` has left it [N/m]."""
        return self._tangent.matrix

    @property
    def positions(self) -> Array:
        """Where the active nodes are at the iterate of the last residual, shape (nodes, 3) [m]."""
        u = self.start + self.d.array_r
        return np.asarray(self.layout.rows.X + u.reshape(-1, 3))

    @property
    def well_conditioned(self) -> bool:
        """Whether inertia is as large as any stiffness in the present step, but for some orders."""
        smooth = self.inertial and not self.actions.contacts
        return smooth and self.rounding.fastest(self.dt) <= WELL_CONDITIONED

    def noise(self) -> float:
        """Size of the terms whose small difference the last residual is [N]. Collective."""
        external = self.actions.loads.vector
        momentum = None if self._inertia is None else self._inertia.before
        found = self.rounding.in_residual(self.dt, momentum, external, self.trial.bodies.start)
        return found if self.constraints is None else found + self.constraints.noise

    def lost(self, y: PETSc.Vec, r: PETSc.Vec) -> Array:
        """Energy and momenta that a step with the last residual r at y is off by. Collective.

        See `Lost.of_all`; energy alone where supports hold something, nothing in statics.
        """
        if self._inertia is None:
            return np.empty(0)
        lost, known = self.rounding.lost, (self._inertia.before, self._inertia.gained)
        d, v0, before, gained = (v.array_r for v in (self.d, self.trial.v0, *known))
        energy = 0.5 * (v0 @ before) + abs(gained @ d) / self.dt
        energy += abs(self.actions.loads.vector.array_r @ d)
        if not lost.of_momenta:
            return lost.of_energy(self._own(y), self._own(r), energy)
        momentum = np.abs(before).sum() + np.abs(gained).sum()
        x = self.layout.rows.X + (self.start + 0.5 * d).reshape(-1, 3)
        return lost.of_all(self.dt, self._own(y), self._own(r), x, energy, momentum)

    def left(self, residual: PETSc.Vec) -> float:
        """Largest displacement of an unknown by the rest of R [N], by itself [m]. Collective."""
        return self.rounding.left(self._own(residual))

    def worst_place(self) -> Array:
        """Reference position of the node with the largest residual [m], shape (3,). Collective."""
        rows, free = self.layout.rows, self.prolongation.free
        f = np.zeros(rows.dofs.size)
        f[free] = self.forces_out_of_balance.array_r[free]
        size = np.nan_to_num(np.abs(f), nan=np.inf).reshape(-1, 3).max(axis=1)
        k = int(np.argmax(size)) if size.size else -1
        best: tuple[float, Any] = (float(size[k]), rows.X[k]) if k >= 0 else (-1.0, None)
        return max(self.prolongation.comm.allgather(best), key=lambda item: item[0])[1]

    def unbind(self) -> None:
        """Free what `bind` has made. Collective."""
        free(self._tangent, self.actions)

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        self.unbind()
        free(self.mass, self._dealt, self.d, self.forces_out_of_balance, self._inertia)
