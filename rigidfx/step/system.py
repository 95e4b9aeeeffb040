"""Everything that is bound to one partition: forms, mass, loads, energies, equations.

It is made when the partition changes and destroyed when the next one takes over; a step works on
nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import is_not

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx import effects as fx
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.mechanics.body_step import BodyTerm
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.energies import Energies
from rigidfx.step.equations import Equilibrium, Solution
from rigidfx.step.first_guess import predict
from rigidfx.step.loads import NodalLoads
from rigidfx.step.springs_and_drag import Drag, GroundForces, Springs
from rigidfx.step.supports import PrescribedDofs

__all__ = ["System", "Work"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Work:
    """What external forces did in a step.

    Attributes:
        loads: Work of the loads [J].
        supports: Work of the reactions [J].
        dissipated: Energy taken by each kind of damping [J].
        reactions: Force of each support on the structure, by the name of its set, shape (3,) [N].
        reaction_moments: Its moment about the origin, at the midpoint, shape (3,) [N m].
    """

    loads: float
    supports: float
    dissipated: Mapping[str, float]
    reactions: Mapping[str, Array]
    reaction_moments: Mapping[str, Array]


class System:
    """The equations of motion of one layout.

    Attributes:
        acting: The effects with a time window that act.
        partition: Division of cells and dofs.
        mass: Mass operator of the flexible cells.
        energies: Measures states.
        equilibrium: Solves the equations of a step.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        state: State,
        acting: Sequence[fx.Windowed],
        flexible: Cells,
        prescribed: PrescribedDofs,
        carried: Cells | None = None,
    ) -> None:
        """Bind everything to a partition and to the effects that act. Collective.

        Args:
            scene: The problem.
            forces: Compiled internal forces.
            state: State with its bodies.
            acting: The effects with a time window that act from now on.
            flexible: Flexible owned cells by subdomain id.
            prescribed: Dofs held by supports.
            carried: Owned cells by subdomain id that move with a support: not flexible, all their
                dofs prescribed, their mass counted.
        """
        self._scene, self._forces, self._prescribed, self.acting = (
            scene,
            forces,
            prescribed,
            tuple(acting),
        )
        part = self.layout = dof_layout(scene, flexible, state.bodies, prescribed.mask, carried)
        rows = part.rows
        state.carried = tuple(
            np.arange(body.nodes.size, dtype=np.int32)
            if scene.mass == "lumped"
            else np.flatnonzero(~np.isin(body.nodes, rows.nodes)).astype(np.int32)
            for body in state.bodies
        )
        own = part.massive[rows.nodes]
        self.mass = mass_operator(scene, rows, flexible, own, carried)
        loads, resultants = scene.named(fx.DeadLoad), scene.named(fx.Resultant)
        self._loads = NodalLoads(scene, loads, rows.nodes, state.bodies, resultants)
        self._loads.select(acting)
        forces.select(acting)
        drag = [e.alpha for e in acting if isinstance(e, fx.MassDamping)]
        springs = scene.named(fx.Spring)
        if state.bodies and (springs or scene.named(fx.Pressure)):
            state.rebuild()
        self._ground: list[GroundForces] = [
            *(Springs(scene, spring, rows, own, state) for spring in springs),
            *(Drag(alpha, self.mass, rows, state) for alpha in drag),
        ]
        self._pressed = forces.pressures.on_bodies(state.bodies, state.motions)
        terms: list[BodyTerm] = [*(item.bodies for item in self._ground), *self._pressed]
        self.energies = Energies(scene, forces, self.mass, part, self._ground)
        pressed = [*flexible.values(), *(carried or {}).values()]
        self._against_pressure = forces.pressures.bind_work(pressed)
        self._lost = forces.bind_dissipation(flexible)
        self.equilibrium = Equilibrium(
            scene,
            forces,
            forces.bind(flexible, part.interior, part.interface, carried),
            self.mass,
            Prolongation(part, scene.comm),
            self._ground,
            terms,
        )
        self._f_ext, self._v0 = rows.vector(), rows.vector()

    def follow(self, acting: Sequence[fx.Windowed]) -> bool:
        """Let loads begin and end; False if other effects do, which takes a new system.

        Args:
            acting: The effects with a time window that act from now on.
        """
        now, before = _others(acting), _others(self.acting)
        if len(now) != len(before) or any(map(is_not, now, before)):
            return False
        self.acting = tuple(acting)
        self._loads.select(acting)
        return True

    def solve(self, state: State, dt: float) -> Solution:
        """Find the increment of a step of length dt [s]; the state is not changed. Collective."""
        middle = state.t + dt / 2
        self._forces.set_time(middle, dt)
        self._resultants = self._loads.evaluate(middle, self._f_ext)
        self._v0.array[:] = state.v.x.array[self.layout.rows.dofs]
        start = self.layout.ensemble.moving(state.motions)
        return self.equilibrium.solve(
            dt,
            self._v0,
            self._f_ext,
            self._prescribed.increments(state.t, state.t + dt),
            predict(self._scene, state, self.layout, start, dt),
            start,
            self._resultants,
        )

    def accept(self, state: State, dt: float, t: float) -> Work:
        """Take the found increment over into the state, which then is at time t. Collective."""
        prolongation, dofs = self.equilibrium.prolongation, self.layout.rows.dofs
        d, forces = self.equilibrium.d.array_r, self.equilibrium.forces_out_of_balance.array_r
        increments, prescribed = prolongation.increments, prolongation.prescribed
        at, rows = prescribed // 3, self.layout.rows
        u = state.u.x.array.reshape(-1, 3)[rows.nodes[at]]
        x = rows.X[at] + u + 0.5 * d.reshape(-1, 3)[at]
        reactions, moments = self._prescribed.reactions(forces[prescribed], x)
        local = [
            self._f_ext.array_r @ d,
            forces[prescribed] @ d[prescribed],
            -sum(map(fem.assemble_scalar, self._against_pressure)),
            *map(fem.assemble_scalar, self._lost.values()),
            *(item.dissipated(self.equilibrium.d, dt) for item in self._ground),
        ]
        dead, supports, pressed, *lost = map(float, self._scene.sum(local))
        work = dead + pressed
        kinds = [*self._lost, *(item.kind for item in self._ground)]
        dissipated = dict.fromkeys(kinds, 0.0)
        for kind, energy in zip(kinds, lost, strict=True):
            dissipated[kind] += energy
        if state.bodies:
            work += self._resultants.work(increments)
            work += sum(load.work(increments) for load in self._pressed)
            for item in self._ground:
                dissipated[item.kind] += item.bodies.dissipated(increments)
        state.u.x.array[dofs] += d
        state.v.x.array[dofs] = 2 / dt * d - self._v0.array_r
        state.motions = increments.end()
        self._attach(state)
        state.u.x.scatter_forward()
        state.v.x.scatter_forward()
        state.t = t
        return Work(work, supports, dissipated, reactions, moments)

    def _attach(self, state: State) -> None:
        """Put attached nodes exactly where their bodies are: increments would add up rounding."""
        u = state.u.x.array.reshape(-1, 3)
        for body, motion, at in zip(state.bodies, state.motions, self.layout.attached, strict=True):
            nodes = body.nodes[at]
            u[nodes] = motion.positions(body.offsets[at]) - state.X[nodes]

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        self.equilibrium.destroy()
        self.mass.destroy()
        self.energies.destroy()
        for item in self._ground:
            item.destroy()
        self._f_ext.destroy()
        self._v0.destroy()


def _others(acting: Sequence[fx.Windowed]) -> list[fx.Windowed]:
    """The effects that are more than a vector of forces."""
    return [e for e in acting if not isinstance(e, fx.DeadLoad | fx.Resultant)]
