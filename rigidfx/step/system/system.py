"""Everything that is bound to one division: forms, mass, actions of effects, equations.

It is made when the division changes and destroyed when the next one takes over; a step works on
nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigidfx.base.errors import together
from rigidfx.base.types import Array, Indices
from rigidfx.coupling.dealt_rows import Dealing
from rigidfx.effects import (
    JointReports,
    ResolvedForces,
    SpringDamperReport,
    Touch,
    Windowed,
)
from rigidfx.effects.motion import ForcesOfNodes
from rigidfx.flexible.eased_stress import EasedStress
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import integral
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.eased_forces import EasedForces
from rigidfx.step.equations.energies import Energies
from rigidfx.step.equations.shape_damping import ShapeDamping
from rigidfx.step.newton.first_guess import predict
from rigidfx.step.newton.newton import Newton
from rigidfx.step.newton.solution import Solution
from rigidfx.step.system.constraint_forces import MeanConstraints
from rigidfx.step.system.division import Hold
from rigidfx.step.system.equations import Equations
from rigidfx.step.system.held_bodies import HeldBodies
from rigidfx.step.system.resolved_forces import ResolvedConstraints
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["System", "Work"]


@dataclass(frozen=True)
class Work:
    """Effect of external forces in a step.

    Attributes:
        work_of_loads: Work of the loads [J].
        work_of_supports: Work of the reactions, and of obstacles that move [J].
        dissipated: Energy taken by each kind of damping [J].
        reactions: Force of each support on the structure, by the name of its set, shape (3,) [N].
        reaction_moments: Its moment about the origin, at the midpoint, shape (3,) [N m].
        alternating_impulse: Impulse of supports besides, by velocities that alternate, and its
            moment, shape (2, 3) [N s, N m s].
        touches: Touch of each contact, by its title.
        joints: Force and motion of each joint, by its title.
        spring_dampers: Force and length of each spring between two points, by its title.
    """

    work_of_loads: float
    work_of_supports: float
    dissipated: Mapping[str, float]
    reactions: Mapping[str, Array]
    reaction_moments: Mapping[str, Array]
    alternating_impulse: Array
    touches: Mapping[str, Touch]
    joints: JointReports
    spring_dampers: Mapping[str, SpringDamperReport]


class System(Equations):
    """The equations of motion of one division.

    Attributes:
        acting: The effects with a time window that act.
        energies: Measures states.
        newton: Solves steps.
        held: Bodies whose frames supports hold.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        state: State,
        acting: Sequence[Windowed],
        flexible: Cells,
        prescribed: PrescribedDofs,
        dealing: Dealing,
        eased_stress: EasedStress,
        driven: Cells | None = None,
        held: Mapping[str, Hold] | None = None,
    ) -> None:
        """Bind everything to a division and to the effects that act. Collective.

        Args:
            scene: The problem.
            forces: Compiled internal forces.
            state: State with its bodies.
            acting: The effects with a time window that act from now on.
            flexible: Flexible owned cells by subdomain id.
            prescribed: Dofs held by supports.
            dealing: Deals flexible cells out among the ranks where that pays.
            eased_stress: Form of the stresses that releases have let down.
            driven: Owned cells by subdomain id that move with a support: not flexible, all their
                dofs prescribed, their mass counted.
            held: The supports in each body that deforms and is held, by the body's name.
        """
        forces.select(acting)
        of_division = state, flexible, prescribed.mask, driven
        super().__init__("step", scene, forces, *of_division, notes=state.notes, dealing=dealing)
        self._prescribed = prescribed
        self.acting = tuple(acting)
        state.follow(self.layout.following)
        state.rebuild()  # effects may look at the displacement inside bodies
        rows, u = self.layout.rows, self.structure.u
        easing = [EasedForces(eased_stress, eased, rows, u, flexible) for eased in state.eased]
        self._damping = ShapeDamping(scene, forces, state.bodies)
        self.bind(scene.effects, acting, easing=easing, damping=self._damping)
        self.energies = Energies(scene, forces, self.mass, self.layout, self.actions, self.linkage)
        self._taken = forces.bind_taken(flexible, driven)
        self.newton = Newton(self.equilibrium, scene)
        self.held = HeldBodies(scene, held or {}, state.bodies)
        self._v0 = rows.vector()
        self._bind_constraints(state.bodies)

    def _bind_constraints(self, bodies: Bodies) -> None:
        """Bind what takes the alternating part out of forces of constraints. Collective."""
        known = self.equilibrium, self.mass, self._prescribed
        constrained = self._prescribed.active or self.linkage is not None
        self._mean: MeanConstraints | ResolvedConstraints | None = None
        if constrained and self._scene.named(ResolvedForces):
            self._mean = ResolvedConstraints(*known, self._scene)
        elif self._prescribed.moves or self.linkage is not None:
            self._mean = MeanConstraints(*known, bodies)

    def follow(self, acting: Sequence[Windowed]) -> bool:
        """Let dead loads begin and end; False if other effects do, which takes a new system.

        Args:
            acting: The effects with a time window that act from now on.
        """
        if _lasting(acting) != _lasting(self.acting):
            return False
        self.acting = tuple(acting)
        self.actions.select(acting)
        return True

    def solve(self, state: State, dt: float) -> Solution:
        """Find the increment of a step of length dt [s]; the state is not changed. Collective."""
        middle = state.t + dt / 2
        self._forces.set_time(middle, dt)
        self.actions.set_time(middle, dt)
        if self.linkage is not None:
            start = partial(self.linkage.set_time, state.t, dt)
            together(self._scene.comm, "A motor", start)
        self._v0.array[:] = state.v.x.array[self.layout.rows.dofs]
        imposed = self._prescribed.increments(state.t, state.t + dt, state.u.x.array)
        given = self.held.given(state.t, state.t + dt, state.bodies) if len(self.held) else None
        trial = self.equilibrium.begin(dt, self._v0, imposed, state.bodies, given)
        v, bodies = trial.v0.array_r, state.bodies
        return self.newton.solve(predict(self._scene, self.layout, trial.start, v, bodies, dt))

    def explain(self, solution: Solution) -> None:
        """Raise the error of a user's function in a step that is objected to. Collective.

        Raises:
            SceneError: On every rank, if one has given forces that are no numbers on any.
        """
        if not (solution.residuals and np.isfinite(solution.residuals).all()):
            self.actions.explain(self.equilibrium.motion)

    @property
    def dead(self) -> bool:
        """Whether no force but those of cells and bodies depends on the motion."""
        return self.actions.dead and self.linkage is None

    def resist_at_nodes(self, nodes: Indices, forces: Array) -> None:
        """Add resistance at owned nodes, in bodies or not, that is not bound to bodies' nodes.

        Args:
            nodes: The nodes.
            forces: Shape (nodes, 3) [N], added to.
        """
        every = ForcesOfNodes(np.zeros((self._scene.owned_nodes, 3)))
        self.actions.resist_at_nodes(self.equilibrium.motion, every)
        if self.linkage is not None:
            self.linkage.resist_at_nodes(every)
        forces += every.nodes[nodes]

    @property
    def increments(self) -> Increments:
        """Increment of the rigid bodies in the last solution."""
        return self.equilibrium.prolongation.increments

    def accept(self, state: State, dt: float, t: float) -> Work:
        """Add the found increment to the state, which then is at time t. Collective."""
        work = self.foresee(state, dt, t)
        self.equilibrium.accept()
        self.actions.accept()
        if self._mean is not None:
            self._mean.accept(state)
        return work

    def foresee(self, state: State, dt: float, t: float) -> Work:
        """Put the state where the found increment leads, and nothing else. Collective."""
        work = self._work(state, dt)
        d, dofs = self.equilibrium.d.array_r, self.layout.rows.dofs
        prolongation, bodies = self.equilibrium.prolongation, self.increments.end
        state.advance(
            t,
            dofs,
            d,
            2 / dt * d - self._v0.array_r,
            bodies,
            dofs[prolongation.attached],
            prolongation.displacement(bodies),
        )
        return work

    def _work(self, state: State, dt: float) -> Work:
        """Effect of forces in the step that has been solved. Collective."""
        prolongation, actions = self.equilibrium.prolongation, self.actions
        d, forces = self.equilibrium.d.array_r, self.equilibrium.forces_out_of_balance.array_r
        prescribed = prolongation.prescribed
        held, added = forces[prescribed], None
        if self._mean is not None:
            more, added = self._mean.find(state)
            held = held + more
        of_supports = reactions, moments = self.of_supports(self._prescribed, held, 0.5)
        alternating = np.zeros((2, 3))
        if self._mean is not None:
            rest = self.of_supports(self._prescribed, forces[prescribed] - held, 0.5)
            alternating += dt * np.array([sum(of.values(), np.zeros(3)) for of in rest])
        touches = actions.touches()
        motion = self.equilibrium.motion
        by_kind = actions.dissipated(motion)
        local = [
            actions.work(motion),
            forces[prescribed] @ d[prescribed],
            -sum(map(integral, self._taken.against_loads)),
            *map(integral, self._taken.dissipated.values()),
            *(energy for _, energy in by_kind),
        ]
        dead, supports, followed, *lost = map(float, self._scene.sum(local))
        kinds = [*self._taken.dissipated, *(kind for kind, _ in by_kind)]
        dissipated: dict[str, float] = {}
        for kind, energy in zip(kinds, lost, strict=True):
            dissipated[kind] = dissipated.get(kind, 0.0) + energy
        for kind, energy in self._damping.taken(self.increments, dt).items():
            dissipated[kind] = dissipated.get(kind, 0.0) + energy
        loads = dead + followed
        if len(self.held):
            self.add_frames(self.held, of_supports)
            supports += self.increments.work_of_supports(self.equilibrium.body_rows)
        supports += sum(touch.work for touch in touches.values())
        joints, springs = JointReports(), dict[str, SpringDamperReport]()
        if self.linkage is not None:
            joints, springs = self.linkage.told(added), self.linkage.points.told()
            driven, damped = self.linkage.work()
            loads += driven
            for kind, energy in damped.items():
                dissipated[kind] = dissipated.get(kind, 0.0) + energy
        named = reactions, moments, alternating, touches, joints, springs
        return Work(loads, supports, dissipated, *named)

    def lead_frames(self, state: State, dt: float) -> bool:
        """Give frames that supports hold the velocity of these; whether any changed. Collective.

        Args:
            state: Its bodies get velocities.
            dt: Length of the next step [s], the scale of difference quotients.
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
        for item in (self.newton, self.energies, self._v0, self._mean):
            if item is not None:
                item.destroy()
        super().destroy()


def _lasting(acting: Sequence[Windowed]) -> list[int]:
    """Identities of those effects that are more than dead loads."""
    return [id(effect) for effect in acting if not effect.is_dead]
