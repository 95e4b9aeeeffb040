"""Static equilibrium before the dynamics start."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, StepError
from rigidfx.base.failures import Failures
from rigidfx.coupling.dof_layout import DofLayout, dof_layout
from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Contact, Preload
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.static_forces import static_forces
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.equations.structure import BoundStructure
from rigidfx.step.newton.first_guess import Guess
from rigidfx.step.newton.newton import Newton
from rigidfx.step.system.rigid_motion import free_to_move
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["apply_preload"]

Array = npt.NDArray[np.float64]


def apply_preload(
    scene: Scene, forces: InternalForces, state: State, prescribed: PrescribedDofs, start: float
) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
    """Bring the state into the static equilibrium that the scene asks for, if it does. Collective.

    Args:
        scene: The problem.
        forces: Internal forces.
        state: The state at rest; its displacement is changed.
        prescribed: Dofs held by supports at the start.
        start: Time just after t = 0 [s], at which what begins there acts.

    Returns:
        Force of each support on the structure in it [N], and its moment about the origin [N m], by
        the name of its set, shape (3,) each; none without a preload.

    Raises:
        SceneError: If the supports leave a rigid motion free, or bodies are rigid from the start;
            if a contact would be pressed.
        StepError: If an increment does not converge.
    """
    found: tuple[Mapping[str, Array], Mapping[str, Array]] = {}, {}
    share = [1.0]  # of the loads, in the present increment
    for preload in scene.named(Preload):
        _check(scene, preload, prescribed, start)
        layout = dof_layout(scene, forces.cells(), state.bodies.of, prescribed.mask)
        actions = _actions(scene, forces, state, layout, preload, lambda: share[0])
        statics = Equilibrium(
            scene,
            forces,
            static_forces(scene, forces, forces.cells()),
            None,
            Prolongation(layout, scene.comm),
            actions,
        )
        newton = Newton(statics, scene)
        actions.set_time(0.0, 1.0)
        full = actions.external.copy()
        if full.norm() == 0.0 and not preload.turns:
            raise SceneError(
                "Preload: its loads are zero at t = 0, when the statics are, so that there is "
                "nothing to be in equilibrium with. Look at their values and time functions."
            )
        rest = Guess(np.zeros(layout.rows.dofs.size), np.empty((0, 6)))
        for k in range(1, preload.increments + 1):
            full.copy(actions.external)
            share[0] = k / preload.increments
            actions.external.scale(share[0])
            nothing = np.zeros(statics.prolongation.prescribed.size)
            statics.begin(1.0, None, nothing, state.bodies)
            solution = newton.solve((rest,))
            actions.failures.settle()
            if not solution.converged:
                raise StepError(
                    f"Preload: increment {k} of {preload.increments} did not converge "
                    f"({solution.reason}); the largest residual is at X = {solution.place} m. "
                    "Use more increments or smaller loads."
                )
            state.place(forces.u1.x.array)
        held, rows = statics.prolongation.prescribed, layout.rows
        at = held // 3
        x = rows.X[at] + state.u.x.array.reshape(-1, 3)[rows.nodes[at]]
        found = prescribed.reactions(statics.forces_out_of_balance.array_r[held], x)
        for item in (newton, statics, actions, full):
            item.destroy()
        deformed = scene.space.tabulate_dof_coordinates() + state.u.x.array.reshape(-1, 3)
        for contact in scene.named(Contact):
            contact.check_preloaded(scene, deformed, start)
    return found


def _check(scene: Scene, preload: Preload, prescribed: PrescribedDofs, start: float) -> None:
    """Refuse statics that have no solution. Collective."""
    if any(effect.is_rigid for effect in scene.effects):
        raise SceneError("Preload: statics with parts that are Rigid is not supported.")
    idle = [load for load in preload.loads if not load.acts(start)]
    if idle:
        raise SceneError(
            f"Preload: {idle[0].owner} does not act at t = 0, when the statics are. Give it no "
            "time window, or leave it out."
        )
    free = free_to_move(scene, prescribed)
    if free:
        raise SceneError(
            "Preload: the supports that act at the start, and springs, leave a rigid motion "
            f"free, of {free}, so there is no static equilibrium. Add supports or drop the "
            "preload."
        )


def _actions(
    scene: Scene,
    forces: InternalForces,
    state: State,
    layout: DofLayout,
    preload: Preload,
    share: Callable[[], float],
) -> Actions:
    """The loads of a preload, its centrifugal forces, and the scene's springs. Collective."""
    rows, own = layout.rows, layout.massive[layout.rows.nodes]
    structure = BoundStructure(
        scene=scene,
        rows=rows,
        own=own,
        bodies=state.bodies,
        mass=mass_operator(scene, rows, forces.cells(), own) if preload.turns else None,
        u=state.u.x.array,
        surface=forces.surface,
        failures=Failures(scene.comm),
        static=True,
    )
    lasting = [effect for effect in scene.effects if effect.is_lasting]
    spun = preload.centrifugal(scene, share)
    return Actions(structure, [*preload.loads, *lasting, *spun], preload.loads)
