"""Patterns of forces that act on a structure: a Ritz vector follows from each.

A force whose distribution over the nodes changes in time has as many patterns as differ; amplitudes
do not matter.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rigidfx.base.errors import together
from rigidfx.base.types import Array
from rigidfx.effects import DeadLoad, Effect, Resultant
from rigidfx.effects.base import vector_at
from rigidfx.effects.joints.remote import RemoteMotion
from rigidfx.effects.joints.vectors import slopes_of
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.scene.scene import Scene
from rigidfx.shapes.motion import of_state, of_supports
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.samples import compressed, instants, interleaved
from rigidfx.state import State
from rigidfx.step.equations.division import Hold


def patterns(responses: Responses, state: State, until: float, hold: Hold | None = None) -> Array:
    """Forces on nodes by all that acts from the present time on. Collective.

    Patterns of norm 1, the main ones of all effects first, shape (owned nodes, 3, k), less those
    that inertia balances. `hold` are the supports in the part that bears them. `SceneError` on
    every rank, if a function of time or place fails on any.
    """
    scene, span = responses.scene, (state.t, until)
    each = [compressed(scene, F) for F in _of_loads(responses, span)]
    each += of_supports(responses, span, hold)
    each += of_state(responses, state)
    return interleaved(responses, each)


def _of_loads(responses: Responses, span: tuple[float, float]) -> Iterator[Array]:
    """Forces of each load at its instants, shape (owned nodes, 3, instants). Collective."""
    scene = responses.scene
    for effect in map(_steady, scene.effects):
        times = instants(scene, [effect], span, _amplitude(scene, effect))
        if not times.size:
            continue
        if pushed := effect.pushes(times[0]):
            structure = responses.stiffness.structure
            yield structure.surface.outward_forces(pushed[0], effect.owner)[:, :, None]
        elif getattr(effect, "body", None) is not None:
            yield _on_body(responses, effect, times)
        elif effect.is_dead:
            yield _dead(responses, effect, times)
        elif effect.is_load and effect.face is not None:
            yield _couples(responses, effect, times)


def _steady(effect: Any) -> Any:
    """A load without its factor of time, which alters no pattern; any other effect as it is."""
    if effect.grows != "time" or effect.time is None or effect.face is not None:
        return effect
    return replace(effect, time=None)


def _amplitude(scene: Scene, effect: Effect) -> Callable[[float], Array] | None:
    """A uniform load's vector at an instant, shape (3,), zero but on rank 0; None of others."""
    if not (isinstance(effect, DeadLoad) and effect.uniform):
        return None

    def at(t: float) -> Array:
        own = partial(effect.intensity, t)
        known = effect.owner, "value or time function", t, own
        found = together(scene.comm, effect.owner, partial(vector_at, *known))
        return found if scene.comm.rank == 0 else np.zeros(3)

    return at


def _dead(responses: Responses, effect: Effect, times: Array) -> Array:
    """Forces of a dead load, also on the nodes of bodies. Collective."""
    actions, out = responses.stiffness.bound(effect), []
    for t in times:
        actions.set_time(t, 0.0)
        out.append(actions.loads.vector.array_r.reshape(-1, 3).copy())
    actions.destroy()
    return np.stack(out, axis=2)


def _evaluated(
    responses: Responses, effect: Resultant, times: Array, at: Callable[[float], Array]
) -> Array:
    """Values at some instants, shape (..., instants). Collective."""
    comm = responses.scene.comm
    return together(comm, effect.owner, lambda: np.stack([at(t) for t in times], axis=-1))


def _on_body(responses: Responses, effect: Resultant, times: Array) -> Array:
    """Forces on the nodes of a rigid body with the resultants of a load on it. Collective."""
    scene, bodies = responses.scene, responses.stiffness.bodies
    F = np.zeros((scene.owned_nodes, 3, times.size))
    six = _evaluated(responses, effect, times, lambda t: np.concatenate(effect.both_at(t)))
    for body in bodies:
        if body.data.name == effect.body:
            arms = body.data.offsets @ body.motion.R.T
            R = rigid_motions(arms, 1.0)
            gram = np.asarray(scene.sum(np.einsum("nai,naj->ij", R, R)))
            F[body.data.nodes] = R @ np.linalg.solve(gram, six)
    return F


def _couples(responses: Responses, effect: Resultant, times: Array) -> Array:
    """Forces of a load on a face that turns with it, on the nodes, at the start. Collective."""
    couple = effect.bind_points(responses.stiffness.structure)
    assert couple is not None
    ends = couple.nodes.ends
    start = np.stack([average.start for average in ends])

    def pushing(t: float) -> Array:
        couple.set_time(t, 0.0)
        forces = np.zeros_like(start)
        couple.resist(RemoteMotion(start, np.zeros_like(start), 1.0), forces)
        return -forces

    F = np.zeros((responses.scene.owned_nodes, 3, times.size))
    for average, f in zip(ends, _evaluated(responses, effect, times, pushing), strict=True):
        F[average.nodes] += np.einsum("nij,ik->njk", slopes_of(average), f)
    return F
