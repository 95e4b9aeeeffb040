"""Everything that is bound to one partition: forms, mass, loads, monitor, equations.

It is made when the partition changes and destroyed when the next one takes over; a step works on
nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx import effects as fx
from rigidfx.equilibrium import Equilibrium, Solution
from rigidfx.internal import Cells, InternalForces
from rigidfx.loads import NodalLoads
from rigidfx.mass import mass_operator
from rigidfx.monitor import Monitor
from rigidfx.partition import partition
from rigidfx.prediction import predict
from rigidfx.prolongation import Prolongation
from rigidfx.scene import Scene
from rigidfx.state import State
from rigidfx.supports import HeldDofs

__all__ = ["System", "Work"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Work:
    """What external forces did in a step.

    Attributes:
        loads: Work of the loads [J].
        supports: Work of the reactions [J].
        reactions: Force of each support on the structure, by the name of its set, shape (3,) [N].
    """

    loads: float
    supports: float
    reactions: Mapping[str, Array]


class System:
    """The equations of motion of one partition.

    Attributes:
        partition: Division of cells and dofs.
        mass: Mass operator of the flexible cells.
        monitor: Measures states.
        equilibrium: Solves the equations of a step.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        state: State,
        flexible: Cells,
        held: HeldDofs,
        carried: Cells | None = None,
    ) -> None:
        """Bind everything to a partition. Collective.

        Args:
            scene: The problem.
            forces: Compiled internal forces.
            state: State with its bodies.
            flexible: Flexible owned cells by subdomain id.
            held: Dofs held by supports.
            carried: Owned cells by subdomain id that move with a support: not flexible, all their
                dofs held, their mass counted.
        """
        self._scene, self._forces, self._held = scene, forces, held
        part = self.partition = partition(scene, flexible, state.bodies, held.mask)
        rows = part.rows
        state.carried = tuple(
            np.arange(body.nodes.size, dtype=np.int32)
            if scene.mass == "lumped"
            else np.flatnonzero(~np.isin(body.nodes, rows.nodes)).astype(np.int32)
            for body in state.bodies
        )
        self.mass = mass_operator(scene, rows, flexible, part.masses, carried)
        loads, resultants = scene.named(fx.DeadLoad), scene.named(fx.Resultant)
        self._loads = NodalLoads(scene, loads, rows.nodes, state.bodies, resultants)
        self.monitor = Monitor(scene, forces, self.mass, part)
        self.equilibrium = Equilibrium(
            scene,
            forces,
            forces.bind(flexible, part.core, part.rim),
            self.mass,
            Prolongation(part, scene.comm),
        )
        self._f_ext, self._v0 = rows.vector(), rows.vector()

    def solve(self, state: State, dt: float) -> Solution:
        """Find the increment of a step of length dt [s]; the state is not changed. Collective."""
        middle = state.t + dt / 2
        self._forces.set_time(middle)
        self._resultants = self._loads.evaluate(middle, self._f_ext)
        self._v0.array[:] = state.v.x.array[self.partition.rows.dofs]
        return self.equilibrium.solve(
            dt,
            self._v0,
            self._f_ext,
            self._held.increments(state.t, state.t + dt),
            predict(self._scene, state, self.partition, dt),
            state.motions,
            self._resultants,
        )

    def accept(self, state: State, dt: float, t: float) -> Work:
        """Take the found increment over into the state, which then is at time t. Collective."""
        prolongation, dofs = self.equilibrium.prolongation, self.partition.rows.dofs
        d, forces = self.equilibrium.d.array_r, self.equilibrium.forces_out_of_balance.array_r
        reactions = forces[prolongation.held]
        work = self._f_ext.dot(self.equilibrium.d)
        supports = float(self._scene.sum(reactions @ d[prolongation.held]))
        state.u.x.array[dofs] += d
        state.v.x.array[dofs] = 2 / dt * d - self._v0.array_r
        increments = prolongation.increments
        for increment, load in zip(increments, self._resultants, strict=True):
            work += load.work(increment)
        state.motions = tuple(increment.end() for increment in increments)
        self._attach(state)
        state.u.x.scatter_forward()
        state.v.x.scatter_forward()
        state.t = t
        return Work(work, supports, self._held.reactions(reactions))

    def _attach(self, state: State) -> None:
        """Put attached nodes exactly where their bodies are: increments would add up rounding."""
        u = state.u.x.array.reshape(-1, 3)
        for body, motion, at in zip(
            state.bodies, state.motions, self.partition.attached, strict=True
        ):
            nodes = body.nodes[at]
            u[nodes] = motion.positions(body.offsets[at]) - state.X[nodes]

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        self.equilibrium.destroy()
        self.mass.destroy()
        self.monitor.destroy()
        self._f_ext.destroy()
        self._v0.destroy()
