"""Rigid faces and carried masses as bodies of their own: no cells, six unknowns.

With a lumped mass such a body has the masses of its nodes. With a consistent one it has only point
masses; the mass of the cells beside it stays theirs, and its six unknowns move it.
"""

from collections.abc import Sequence

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Bools, Indices
from rigidfx.decide.bodies import PlannedBody
from rigidfx.effects import PointMass, Reduced, Rigid, RigidFace, rigid_faces
from rigidfx.effects.joints.remote import body_of
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import NOTHING, Body, BodyMotion, RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.switch.mass_properties import at_nodes, freeze, mass_properties


def named_parts(scene: Scene, flexible: bool) -> list[Rigid]:
    """Parts that are bodies by name, with `stiff` cells of those that are flexible, if they are."""
    inside = [name for part in scene.named(Reduced) for name in part.stiff if flexible]
    return [*scene.named(Rigid), *map(Rigid, inside)]


def nodes_of(scene: Scene, part: Rigid) -> Indices:
    """Owned nodes of a named part, sorted. Collective."""
    if part.where is None:
        return np.arange(scene.owned_nodes, dtype=np.int32)
    nodes = scene.nodes(part.where, "Rigid", (3,))
    return nodes[nodes < scene.owned_nodes]


def face_bodies(
    scene: Scene,
    forces: InternalForces,
    state: State,
    held: Bools,
    first: int,
    others: Sequence[Body],
) -> list[Body]:
    """The bodies of carried masses, and of the rigid faces that no other body has. Collective.

    Faces that are bodies in the state keep their motion. Other bodies and supports that clamp a
    part hold some owned nodes. Nodes of a face that lie on a line are a SceneError on every rank.
    """
    out: list[Body] = []
    known = {body.data.name: body for body in state.bodies}
    for number, face in enumerate(rigid_faces(scene.effects), start=first):
        nodes = scene.nodes(face.where, face.name, (2,))
        nodes = nodes[nodes < scene.owned_nodes]
        if scene.sum(np.count_nonzero(held[nodes])) > 0:
            continue
        if face.name in known:
            out.append(known[face.name])
        else:
            out.append(_body(scene, forces, state, face, nodes, number))
    first += len(rigid_faces(scene.effects))
    carried = (effect for effect in scene.named(PointMass) if effect.is_carried)
    there = {body.data.name for body in others}
    for number, effect in enumerate(carried, start=first):
        if effect.title in there:
            continue
        if effect.title in known:
            out.append(known[effect.title])
        else:
            x, _, v = at_nodes(state)
            out.append(Body(*body_of(effect, scene, x, v, number)))
    return out


def has_bodies(scene: Scene) -> bool:
    """Whether rigid faces or carried masses are bodies of a scene."""
    masses = any(effect.is_carried for effect in scene.named(PointMass))
    return masses or bool(rigid_faces(scene.effects))


def with_faces(scene: Scene, forces: InternalForces, state: State) -> set[int]:
    """Add rigid faces that no body holds, moving as their nodes; their numbers. Collective."""
    if not has_bodies(scene):
        return set()
    others = [body for body in state.bodies if not body.data.is_face]
    held = np.zeros(scene.owned_nodes, dtype=bool)
    for body in others:
        held[body.data.nodes] = True
    for part in scene.named(Rigid):
        held[nodes_of(scene, part)] = True
    there = {body.data.number for body in state.bodies}
    first = len(named_parts(scene, True)) + 1
    faces = face_bodies(scene, forces, state, held, first, others)
    state.group(Bodies.of_each([*others, *faces]))
    return {face.data.number for face in faces} - there


def _body(
    scene: Scene, forces: InternalForces, state: State, face: RigidFace, nodes: Indices, number: int
) -> Body:
    """The body of a face, with the motion that fits its nodes. Collective."""
    what = PlannedBody(np.empty(0, np.int32), nodes, face.name, number)
    body = freeze(scene, forces, state, what) if scene.mass == "lumped" else None
    if body is None:
        body = _without_mass(scene, forces, state, what)
    if body is None:
        raise SceneError(
            f"{face.name}: its nodes lie on a line or are too few, so that they are no body. Name "
            "a larger set of facets."
        )
    return body


def _without_mass(
    scene: Scene, forces: InternalForces, state: State, what: PlannedBody
) -> Body | None:
    """A face beside cells whose mass is consistent; None if its nodes lie on a line. Collective."""
    nodes, (x, u, v) = what.nodes, at_nodes(state)
    points = mass_properties(scene, forces.cells(what.cells), nodes, x, v)
    area = mass_properties(scene, {}, nodes, x, v, scene.averaging_mass[nodes])
    if area.singular:
        return None
    centre = points.centre if points.mass else area.centre
    omega = area.angular_velocity
    velocity = area.velocity + np.cross(omega, centre - area.centre)
    data = RigidBody(
        name=what.name,
        cells=what.cells,
        nodes=nodes,
        offsets=x[nodes] - centre,
        displacement=u[nodes],
        mass=points.mass,
        inertia=points.inertia,
        origin=centre,
        number=what.number,
        frozen=NOTHING,
        extent=float(np.sqrt(np.trace(area.inertia) / (2 * area.mass))),
    )
    return Body(data, BodyMotion(centre.copy(), np.eye(3), velocity, omega))
