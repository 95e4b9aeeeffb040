"""Static equilibrium before the dynamics start."""

from __future__ import annotations

import numpy as np

from rigidfx.base.errors import SceneError, StepError
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Preload, Rigid, Spring
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations import Equilibrium
from rigidfx.step.first_guess import Guess
from rigidfx.step.loads import NodalLoads
from rigidfx.step.rigid_motion import free_to_move
from rigidfx.step.springs_and_drag import Springs
from rigidfx.step.supports import PrescribedDofs

__all__ = ["apply_preload"]


def apply_preload(
    scene: Scene, forces: InternalForces, state: State, prescribed: PrescribedDofs
) -> None:
    """Bring the state into the static equilibrium that the scene asks for, if it does. Collective.

    Raises:
        SceneError: If the supports leave a rigid motion free, or bodies are rigid from the start.
        StepError: If an increment does not converge.
    """
    for preload in scene.named(Preload):
        if scene.named(Rigid):
            raise SceneError("Preload: statics with parts that are Rigid is not supported.")
        idle = [load for load in preload.loads if not load.active(0.0)]
        if idle:
            where = getattr(idle[0], "where", None)
            raise SceneError(
                f"Preload: {type(idle[0]).__name__} on '{where or 'all cells'}' does not act at "
                "t = 0, when the statics are. Give it no time window, or leave it out."
            )
        free = free_to_move(scene, prescribed)
        if free:
            raise SceneError(
                "Preload: the supports that act at the start, and springs, leave a rigid motion "
                f"free, of {free}, so there is no static equilibrium. Add supports or drop the "
                "preload."
            )
        cells = forces.cells()
        part = dof_layout(scene, cells, (), prescribed.mask)
        loads = NodalLoads(scene, preload.loads, part.rows.nodes)
        prolongation = Prolongation(part, scene.comm)
        own = np.ones(part.rows.nodes.size, dtype=bool)
        springs = [Springs(scene, s, part.rows, own, state, True) for s in scene.named(Spring)]
        statics = Equilibrium(scene, forces, forces.bind_static(cells), None, prolongation, springs)
        full, share = (part.rows.vector() for _ in range(2))
        rest = Guess(np.zeros(part.rows.dofs.size), np.empty((0, 6)))
        on_bodies = loads.evaluate(0.0, full)
        if full.norm() == 0.0:
            raise SceneError(
                "Preload: its loads are zero at t = 0, when the statics are, so that there is "
                "nothing to be in equilibrium with. Look at their values and time functions."
            )
        for k in range(1, preload.increments + 1):
            full.copy(share)
            share.scale(k / preload.increments)
            nothing = np.zeros(prolongation.prescribed.size)
            none = part.ensemble.moving(())
            solution = statics.solve(1.0, None, share, nothing, (rest,), none, on_bodies)
            if not solution.converged:
                raise StepError(
                    f"Preload: increment {k} of {preload.increments} did not converge "
                    f"({solution.reason}); the largest residual is at X = {solution.place} m. "
                    "Use more increments or smaller loads."
                )
            state.u.x.array[:] = forces.u1.x.array
        for item in (statics, full, share):
            item.destroy()
