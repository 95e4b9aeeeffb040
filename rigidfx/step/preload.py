"""Static equilibrium before the dynamics start: a load path at the time t = 0."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.effects import Contact, Effect, Motor, Preload, Windowed
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.supports import PrescribedDofs, supports_of
from rigidfx.step.load_path import LoadPath
from rigidfx.step.system.rigid_motion import free_to_move


def apply_preload(
    scene: Scene,
    forces: InternalForces,
    state: State,
    start: float,
    divide: Callable[[Sequence[Windowed]], Division],
) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
    """Bring the state into the static equilibrium that the scene asks for, if it does. Collective.

    Effects that act at the start, just after t = 0 [s], take part. Force of each support on the
    structure [N], and its moment about the origin [N m], by the name of its set, shape (3,) each,
    are returned; none without a preload.

    Raises:
        SceneError: If the supports leave a rigid motion free, or bodies are to turn.
        StepError: If there is no equilibrium under the loads.
    """
    found: tuple[Mapping[str, Array], Mapping[str, Array]] = {}, {}
    for preload in scene.named(Preload):
        holds = [*supports_of(scene.acting(start)), *scene.named(Contact)]
        holds = [effect for effect in holds if effect.acts(start)]
        _check(scene, preload, holds, start)
        lasting = [effect for effect in scene.effects if effect.is_lasting]
        paths: list[LoadPath] = []
        spun = preload.centrifugal(scene, lambda paths=paths: paths[0].share)
        locks = [m for m in scene.named(Motor) if m.prescribes and m.acts(start)]
        effects: list[Effect] = [*preload.loads, *lasting, *spun, *holds, *locks]
        path = LoadPath(scene, state, forces, effects, divide, "Preload", fixed=0.0)
        paths.append(path)
        path.follow(0.0)
        if not preload.turns and path.load() == 0.0:
            raise SceneError(
                "Preload: its loads are zero at t = 0, when the statics are, so that there is "
                "nothing to be in equilibrium with. Look at their values and time functions."
            )
        for k in range(1, preload.increments + 1):
            end = k / preload.increments
            while path.t < end:
                result = path.advance(end)
        found = result.reactions, result.reaction_moments
        state.rebuild()
        path.close()
    return found


def _check(scene: Scene, preload: Preload, holds: Sequence[Windowed], start: float) -> None:
    """Refuse statics that have no solution. Collective."""
    if preload.turns and any(effect.is_rigid for effect in scene.effects):
        raise SceneError(
            "Preload: a spin with parts that are Rigid is not supported. Leave the spin out, or "
            "let these parts be flexible."
        )
    idle = [load for load in preload.loads if not load.acts(start)]
    if idle:
        raise SceneError(
            f"Preload: {idle[0].owner} does not act at t = 0, when the statics are. Give it no "
            "time window, or leave it out."
        )
    held = PrescribedDofs(scene, supports_of(holds))
    pressed = any(effect.is_contact for effect in holds)
    if not pressed and (free := free_to_move(scene, held, acting=scene.acting(start))):
        raise SceneError(
            "Preload: the supports that act at the start, and springs, leave a rigid motion "
            f"free, of {free}, so there is no static equilibrium. Add supports or drop the "
            "preload."
        )
