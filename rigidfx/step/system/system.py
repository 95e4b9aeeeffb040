"""Everything that is bound to one division: forms, mass, actions of effects, equations.

It is made when the division changes and destroyed when the next one takes over; a step works on
nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rigidfx import effects as fx
from rigidfx.base.errors import together
from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Indices
from rigidfx.coupling.dealt_rows import Dealing
from rigidfx.effects.nodes import ForcesOfNodes
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.kernels import integral
from rigidfx.mechanics.body_step import Increments
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.energies import Energies
from rigidfx.step.equations.equations import Equations, Kind, Trial
from rigidfx.step.equations.shape_damping import ShapeDamping
from rigidfx.step.equations.supports import supports_of
from rigidfx.step.newton.first_guess import predict
from rigidfx.step.newton.newton import Newton, Solution
from rigidfx.step.system import constraint_forces as of_constraints
from rigidfx.step.system.held_bodies import HeldBodies

Links = tuple[fx.JointReports, Mapping[str, fx.SpringDamperReport]]
OfSupports = tuple[dict[str, Array], dict[str, Array]]


@dataclass(frozen=True)
class Work:
    """Effect of external forces in a step."""

    work_of_loads: float  # work of the loads [J]
    work_of_supports: float  # work of the reactions, and of obstacles that move [J]
    dissipated: Mapping[str, float]  # energy taken by each kind of damping [J]
    # Force of each support on the structure, by the name of its set, shape (3,) [N]
    reactions: Mapping[str, Array]
    # Its moment about the origin, at the midpoint, shape (3,) [N m]
    reaction_moments: Mapping[str, Array]
    # Impulse of supports besides, by velocities that alternate, and its moment, shape (2, 3) [N s,
    # N m s]
    alternating_impulse: Array
    touches: Mapping[str, fx.Touch]  # touch of each contact, by its title
    joints: fx.JointReports  # force and motion of each joint, by its title
    # Force and length of each spring between two points, by its title
    spring_dampers: Mapping[str, fx.SpringDamperReport]


@dataclass(frozen=True, kw_only=True)
class StepResult(Work):
    """Result of one accepted step, or of a load step."""

    dt: float  # its length [s]
    solution: Solution  # how its equations were solved
    cuts: int  # how often it was cut before it converged


class System(Equations):
    """The equations of one division, for steps or load steps.

    Attributes:
        acting: The effects with a time window that act.
        energies: Measures states.
        newton: Solves steps.
        held: Bodies whose frames supports hold.
    """

    def __init__(
        self,
        kind: Kind,
        scene: Scene,
        forces: InternalForces,
        state: State,
        effects: Sequence[fx.Effect],
        acting: Sequence[fx.Windowed],
        division: Division,
        *,
        dealing: Dealing | None = None,
        loose: bool = False,
    ) -> None:
        """Bind everything to a division, whose bodies the state gets, and to effects. Collective.

        Of effects with a time window the given ones act. `dealing` deals flexible cells out among
        the ranks; a `StepDrag` is among the effects if `loose`.
        """
        state.group(division.bodies)
        state.clamp(division.clamped)
        if steps := kind == "step":
            forces.select(acting)
        known = state, division, supports_of(acting)
        super().__init__(kind, scene, forces, *known, notes=state.notes, dealing=dealing)
        self._state, self.acting = state, tuple(acting)
        state.follow(self.layout.following)
        state.rebuild()  # effects may look at the displacement inside bodies
        self._damping = ShapeDamping(scene, forces, state.bodies) if steps else None
        self.bind(effects, acting, loose=loose, damping=self._damping)
        self.energies = Energies(scene, forces, self)
        cells = division.flexible, division.driven_cells
        self._taken = forces.bind_taken(*cells) if steps else None
        self.newton = Newton(self)
        self.held = HeldBodies(scene, division.held, state.bodies)
        self._v0: Any = self.layout.rows.vector() if steps else None  # of statics there is none
        # Takes the alternating part out of forces of constraints.
        self._mean: of_constraints.AddedForces | None = None
        joined = self.linkage is not None
        if steps and (self.prescribed.active or joined) and scene.named(fx.ResolvedForces):
            self._mean = of_constraints.ResolvedConstraints(self, scene)
        elif steps and (self.prescribed.moves or joined):
            self._mean = of_constraints.MeanConstraints(self)

    def follow(self, acting: Sequence[fx.Windowed]) -> bool:
        """Let dead loads begin and end; False if other effects do, which takes a new system."""
        now, before = ([id(e) for e in some if not e.is_dead] for some in (acting, self.acting))
        if now != before:
            return False
        self.acting = tuple(acting)
        self.actions.select(acting)
        return True

    def begin_step(
        self, t0: float, t1: float, dt: float, motors: tuple[float, float], moves: bool = True
    ) -> Trial:
        """Begin a step with the loads that are set, from t0 to t1, of length Δt [s]. Collective.

        Motors act at a time and for a time. Supports rest unless they move. A user's function that
        fails, or gives no numbers, is a `SceneError` on every rank.
        """
        bodies, given = self._state.bodies, None
        if self.linkage is not None:
            together(self._scene.comm, "A motor", partial(self.linkage.set_time, *motors))
        imposed: Array = np.zeros(self.prolongation.prescribed.size)
        if moves:
            imposed = self.prescribed.increments(t0, t1, self._state.u.x.array)
            given = self.held.given(t0, t1, bodies) if len(self.held) else None
        return self.begin(dt, self._v0, imposed, bodies, given)

    def solve(self, state: State, dt: float) -> Solution:
        """Find the increment of a step of length dt [s]; the state is not changed. Collective."""
        middle = state.t + dt / 2
        self._forces.set_time(middle, dt)
        self.actions.set_time(middle, dt)
        self._v0.array[:] = state.v.x.array[self.layout.rows.dofs]
        trial = self.begin_step(state.t, state.t + dt, dt, (state.t, dt))
        v, bodies = trial.v0.array_r, state.bodies
        return self.newton.solve(predict(self._scene, self.layout, trial.start, v, bodies, dt))

    def explain(self, solution: Solution) -> None:
        """Raise the `SceneError` of a user's force that is no number. Collective."""
        if not (solution.residuals and np.isfinite(solution.residuals).all()):
            self.actions.explain(self.motion)

    def resist_at_nodes(self, nodes: Indices, forces: Array) -> None:
        """Add resistance at owned nodes that is not bound to bodies' nodes [N]."""
        every = ForcesOfNodes(np.zeros((self._scene.owned_nodes, 3)))
        self.actions.resist_at_nodes(self.motion, every)
        if self.linkage is not None:
            self.linkage.resist_at_nodes(self.motion, every)
        forces += every.nodes[nodes]

    @property
    def increments(self) -> Increments:
        """Increment of the rigid bodies in the last solution."""
        return self.prolongation.increments

    def accept_step(self, state: State, dt: float, t: float) -> Work:
        """Add the found increment to the state, which then is at time t. Collective."""
        work = self.foresee(state, dt, t)
        self.accept()
        self.actions.accept()
        if self._mean is not None:
            self._mean.accept(state)
        return work

    def foresee(self, state: State, dt: float, t: float) -> Work:
        """Put the state where the found increment leads, and nothing else. Collective."""
        work = self._effect(state, dt)
        self.move(t, 2 / dt * self.d.array_r - self._v0.array_r)
        return work

    def move(self, t: float, v: Array) -> None:
        """Put the state where the found increment leads: to a time [s], and velocities [m/s]."""
        p, dofs, bodies = self.prolongation, self.layout.rows.dofs, self.increments.end
        d, moved = self.d.array_r, p.displacement(bodies)
        self._state.advance(t, dofs, d, v, bodies, dofs[p.attached], moved)

    def told(self, added: of_constraints.Added | None = None) -> Links:
        """Forces and motions of joints, and of springs between two points, by their titles."""
        return (fx.JointReports(), {}) if self.linkage is None else self.linkage.told(added)

    def taken(self, *local: float) -> tuple[list[float], dict[str, float]]:
        """Sums of numbers over ranks, and the energy that each kind of damping takes [J]."""
        cells = {} if self._taken is None else self._taken.dissipated
        kinds = [(kind, integral(form)) for kind, form in cells.items()]
        kinds += self.actions.dissipated(self.motion)
        sums = [*map(float, self._scene.sum([*local, *(energy for _, energy in kinds)]))]
        dissipated: dict[str, float] = {}
        for (kind, _), energy in zip(kinds, sums[len(local) :], strict=True):
            dissipated[kind] = dissipated.get(kind, 0.0) + energy
        return sums[: len(local)], dissipated

    def of_supports(self, forces: Array, part: float, frames: bool = True) -> OfSupports:
        """Force [N] and moment [N m] of each support on the structure, by its set. Collective.

        Forces on held dofs [N] act after a part of the last increment. Those on frames of bodies
        may be left out.
        """
        found: OfSupports = {}, {}
        if self.prescribed.active:
            rows, d = self.layout.rows, self.d.array_r
            at = self.prolongation.prescribed // 3
            x = rows.X[at] + (self.start + part * d).reshape(-1, 3)[at]
            found = self.prescribed.reactions(forces, x)
        if frames and len(self.held):
            increments: Any = self.increments
            for where, *both in self.held.reactions(increments, self.body_rows):
                for out, more in zip(found, both, strict=True):
                    out[where] = out.get(where, 0.0) + more
        return found

    def _effect(self, state: State, dt: float) -> Work:
        """Effect of forces in the step that has been solved. Collective."""
        prolongation, actions = self.prolongation, self.actions
        d, forces = self.d.array_r, self.forces_out_of_balance.array_r
        prescribed = prolongation.prescribed
        held, added = forces[prescribed], None
        if self._mean is not None:
            more, added = self._mean.find(state)
            held = held + more
        of_supports = self.of_supports(held, 0.5)
        alternating = np.zeros((2, 3))
        if self._mean is not None:
            rest = self.of_supports(forces[prescribed] - held, 0.5, frames=False)
            alternating += dt * np.array([sum(of.values(), np.zeros(3)) for of in rest])
        touches = actions.touches()
        assert self._taken is not None
        (dead, supports, followed), dissipated = self.taken(
            actions.work(self.motion),
            forces[prescribed] @ d[prescribed],
            -sum(map(integral, self._taken.against_loads)),
        )
        loads, further = dead + followed, list[tuple[str, float]]()
        if self._damping is not None:
            further += self._damping.taken(self.increments, dt).items()
        if len(self.held):
            supports += self.increments.work_of_supports(self.body_rows)
        supports += sum(touch.work for touch in touches.values())
        if self.linkage is not None:
            driven, damped = self.linkage.work()
            loads += driven
            further += damped
        for kind, energy in further:
            dissipated[kind] = dissipated.get(kind, 0.0) + energy
        named = *of_supports, alternating, touches, *self.told(added)
        return Work(loads, supports, dissipated, *named)

    def lead_frames(self, state: State, dt: float) -> bool:
        """Give frames that supports hold the velocity of these; whether any changed. Collective.

        Δt is that of the next step, the scale of difference quotients.
        """
        if not len(self.held):
            return False
        bodies = self.held.moving(state.t, dt, state.bodies)
        changed = not np.array_equal(bodies.rates, state.bodies.rates)
        if changed:
            state.kick(self.layout.rows.dofs[:0], np.empty(0), bodies)
        return changed

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        free(self.newton, self.energies, self._v0, self._mean)
        super().destroy()
