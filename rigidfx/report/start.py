"""The state of a report as the start of a run, if the report is of this scene and its last step."""

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.effects import InitialDisplacement, Joint, Preload, Rigid, Spring
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.rigid_motions import best_motion
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.state import State


def check_scene(owner: str, scene: Any) -> None:
    """Check that a scene is one, or name its owner in a `SceneError`."""
    if not isinstance(scene, Scene):
        raise SceneError(f"{owner}: scene must be a Scene, got {type(scene).__name__}.")


def check_report(owner: str, scene: Scene, report: Any) -> None:
    """Refuse what is no report of this scene, or one whose run has gone on."""
    if not isinstance(report, Report):
        raise SceneError(f"{owner}: report must be a Report, got {type(report).__name__}.")
    _check_current(owner, report)
    if report.state.u.function_space is not scene.space:
        raise SceneError(f"{owner}: the report is of another scene.")


def _check_current(owner: str, report: Report) -> None:
    if not report.current:
        raise SceneError(
            f"{owner}: the report is of t = {report.t:g} s, and the run has gone on. Use each "
            "report before the next step."
        )


def check_about(owner: str, scene: Scene, report: Any) -> None:
    """Refuse what is no report of a scene of this mesh and order, or one whose run has gone on."""
    if not isinstance(report, Report):
        raise SceneError(f"{owner}: a Report is expected, got {type(report).__name__}.")
    _check_current(owner, report)
    state = report.state
    space = state.u.function_space
    if space.mesh is not scene.mesh or state.u.x.array.size != 3 * scene.nodal_mass.size:
        raise SceneError(
            f"{owner}: the report is of a scene with another mesh or order. Make both scenes from "
            "one domain, with the same order."
        )


@dataclass(frozen=True)
class Start:
    """A copy of displacements, of the poses of parts named rigid, and of the memory of effects."""

    u: Array  # displacement at all local dofs [m]
    bodies: tuple[Body, ...]  # parts named rigid
    notes: dict[int, Any]  # memory of effects, by their identity

    def apply(self, state: State) -> None:
        """Bring a state there, at rest."""
        state.place(self.u)
        bodies = Bodies.of_each(self.bodies)
        rest = np.zeros((len(bodies), 3))
        state.group(bodies.moving(rest, rest))
        state.notes.update(deepcopy(self.notes))


def start_of(scene: Scene, given: Any) -> Start | None:
    """The start that a report of a scene on the same mesh, or a start, is. Collective.

    It is refused if the scene names where it begins itself.
    """
    if given is None or isinstance(given, Start):
        return given
    check_about("simulate", scene, given)
    for kind in (Preload, InitialDisplacement):
        if scene.named(kind):
            raise SceneError(
                f"simulate: start goes not with {kind.__name__}, as both say where nodes begin. "
                "Leave one of them out."
            )
    for spring in scene.named(Spring):
        if spring.relaxed == "start":
            raise SceneError(
                f"simulate: {spring.owner} is relaxed where an InitialDisplacement puts its nodes; "
                "a run that starts from a report has none. Take relaxed='mesh', or an "
                "InitialDisplacement in place of the report."
            )
    return taken_from(scene, given)


def taken_from(scene: Scene, given: Report) -> Start:
    """The start that a report of a scene on the same mesh is. Collective."""
    state, u = given.state, given.to_start_from()
    # A reduced part deforms from these places on, which have its strains.
    named = {effect.name for effect in scene.named(Rigid) if effect.is_rigid}
    bodies = [body for body in state.bodies if body.data.name in named]
    if u is not state.u:
        bodies = [_moved(scene, body, u.x.array.reshape(-1, 3)) for body in bodies]
    notes = deepcopy(state.notes) | _turns(scene, given)
    return Start(u.x.array.copy(), tuple(bodies), notes)


def _moved(scene: Scene, body: Body, u: Array) -> Body:
    """A rigid body where displacements of nodes, (local nodes, 3) [m], take it. Collective."""
    data = body.data
    places = data.offsets + (u[data.nodes] - data.displacement)
    R, shift = best_motion(data.offsets, places, scene.sum)
    return Body(data, replace(body.motion, r=data.origin + shift, R=R))


def _turns(scene: Scene, given: Any) -> dict[int, Any]:
    """Memory of the joints that a report tells of: their angles, turns counted, and travels."""
    notes = {}
    for joint in scene.named(Joint):
        told, pieces = given.joints.get(joint.title), joint.pieces
        if told is not None:
            free = {name: getattr(told, name) for name in pieces.coordinates}
            notes[id(joint)] = np.zeros(len(pieces.rows)), free
    return notes
