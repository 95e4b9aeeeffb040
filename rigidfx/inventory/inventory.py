"""The inventory of bodies: those that a scene names, and those found beside them.

It says which cells are flexible, which form bodies and which go with a support. Rigid faces and
carried masses are bodies of their own: no cells, six unknowns. With a lumped mass such a body has
the masses of its nodes. With a consistent one it has only point masses; the mass of the cells
beside it stays theirs, and its six unknowns move it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np

from rigidfx import effects as fx
from rigidfx.base.errors import SceneError, agree
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.decide.bodies import PlannedBody
from rigidfx.effects.joints.remote import body_of
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.inventory.mass_properties import at_nodes, data_of, freeze, mass_properties
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import NOTHING, Body, BodyMotion, outside
from rigidfx.mechanics.rigid_motions import free_motions
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.shapes.responses import Responses
from rigidfx.state import State
from rigidfx.step.equations.division import Division, Hold
from rigidfx.step.equations.supports import dofs_of, supports_of

CHAIN = (
    "{} has nodes held by the support on '{}'. A body on a support would be a kinematic chain: "
    "leave a layer of flexible cells between them, or clamp all components (xyz) of at least three "
    "of its nodes that are not in line, by one motion; it is then fixed, or follows that motion."
)
HINGE = (
    "Rigid '{}' shares nodes with another body, which would be a hinge. Merge the two sets, or "
    "leave a layer of flexible cells between them."
)
Shape = Callable[[Any, Body, Hold | None], Body]  # of a `Reduced` part


def check_clamps(scene: Scene, timeline: Timeline) -> bool:
    """Whether a support ever clamps a named body: all that they will hold is looked at. Collective.

    A SceneError tells of one that holds a body other than by clamping it whole, or clamps one whose
    mass is given, or that a resultant acts on then.
    """
    windowed = [*scene.named(fx.Support), *scene.named(fx.Resultant)]
    times = sorted({0.0, *(t for e in windowed for t in e.ends if t > 0)})
    found = False
    for effect in scene.named(fx.Rigid) if scene.named(fx.Support) else ():
        known = f"{effect.kind} '{effect.name}'", nodes_of(scene, effect)
        held: list[Hold | None] = []
        for t in times:
            acting = scene.acting(timeline.after(t))
            if effect.deforms:
                held.append(_hold(scene, supports_of(acting), *known))
                if held[-1] == held[0]:
                    continue
                raise SceneError(
                    f"{effect.owner}: at t = {t:g} s a support begins or ends on it, and shapes "
                    "are those of a part that is held always, or never. Let the support act all "
                    "the time, or leave a layer of flexible cells between the two."
                )
            clamp = _clamp(scene, supports_of(acting), *known)
            found |= clamp is not None
            if clamp is not None and effect.given:
                raise SceneError(
                    f"Rigid '{effect.name}': its mass or inertia is given, and at t = {t:g} s a "
                    "support clamps it, which would bear what its cells weigh. Leave mass and "
                    "inertia out, or a layer of flexible cells between body and support."
                )
            loads = [e for e in acting if getattr(e, "body", None) == effect.name]
            if clamp is not None and loads:
                raise SceneError(
                    f"Resultant: at t = {t:g} s a support clamps the body '{effect.name}', so that "
                    "it is no body of its own. Name a NodalForce on its cells, which the support "
                    "then bears, or separate the two in time."
                )
    return found


def divide(
    scene: Scene,
    forces: InternalForces,
    state: State,
    active: tuple[fx.Support, ...],
    found: Sequence[Body] = (),
    shape: Shape | None = None,
) -> Division:
    """Divide the cells into flexible ones, bodies, and those that supports move. Collective.

    Named bodies that are in the state keep data and motion. Found ones that hold named sets stand
    for these. `shape` gives a body of a `Reduced` part its shapes, and is told which supports hold
    it, if any do; such parts are flexible without it, as in modes, but for `stiff` cells. Bodies
    that share a node, and supports that hold one other than by clamping it whole, are a SceneError.
    """
    bodies: list[Body] = []
    rigid: list[Indices] = [body.data.cells for body in found]
    inside_found = {name for body in found for name in body.data.named}
    driven: dict[int, Indices] = {}
    clamped: dict[int, Indices] = {}
    held: dict[str, Hold] = {}
    taken = np.zeros(scene.owned_nodes, dtype=bool)
    known = {body.data.name: body for body in state.bodies}
    for number, effect in enumerate(named_parts(scene, shape is None), start=1):
        if effect.deforms and shape is None:
            continue
        name = effect.name
        if effect.deforms and name in known:  # which some cells may have left
            cells, nodes = known[name].data.cells, known[name].data.nodes
        else:
            cells, nodes = scene.owned_cells(effect.where, "Rigid"), nodes_of(scene, effect)
        agree(scene.comm, HINGE.format(name) if taken[nodes].any() else None)
        taken[nodes] = True
        rigid.append(cells)
        title, support, hold = f"{effect.kind} '{name}'", None, None
        if not effect.deforms:
            support = _clamp(scene, active, title, nodes)
        elif (hold := _hold(scene, active, title, nodes)) is not None:
            held[name] = hold
        if support is not None:
            clamped[number] = cells
            driven[support] = np.union1d(driven.get(support, nodes), nodes).astype(np.int32)
        elif name in known and name not in inside_found:
            bodies.append(known[name])
        elif name not in inside_found:
            what = PlannedBody(cells, nodes, name, number, (name,))
            body = _freeze_named(scene, forces, state, effect, what)
            if effect.deforms and shape is not None:
                body = shape(effect, body, hold)
            bodies.append(body)
    bodies += found
    taken |= ~outside(taken.size, (body.data for body in found))
    bodies += face_bodies(scene, forces, state, taken, bodies)
    if not rigid:
        return Division(forces.cells(), Bodies.of_each(bodies), None, {}, {})
    of_parts = np.concatenate(rigid)
    flexible = np.setdiff1d(scene.owned_cells(None, ""), of_parts)
    with_bodies = np.concatenate([np.empty(0, np.int32), *(body.data.cells for body in bodies)])
    led = np.setdiff1d(of_parts, with_bodies)
    moved = forces.cells(led) if scene.sum(led.size) > 0 else None
    return Division(forces.cells(flexible), Bodies.of_each(bodies), moved, driven, clamped, held)


def about_start(
    scene: Scene, forces: InternalForces, start: Array, acting: Sequence[fx.Windowed]
) -> Responses:
    """Responses about a displacement at the start [m]; rigid parts stay rigid. Collective."""
    at_start = State(scene)
    at_start.u.x.array[: start.size] = start
    at_start.u.x.scatter_forward()
    rigid = divide(scene, forces, at_start, supports_of(acting))
    at_start.clamp(rigid.clamped)
    bodies = [body for body in rigid.bodies if scene.sum(body.data.nodes.size)]
    return Responses(scene, forces, at_start, acting, Bodies.of_each(bodies))


def _freeze_named(
    scene: Scene, forces: InternalForces, state: State, effect: fx.Rigid, what: PlannedBody
) -> Body:
    """The body of an effect, with the mass and inertia that it may give. Collective."""
    body = freeze(scene, forces, state, what)
    if body is None:
        raise SceneError(
            f"Rigid body '{what.name}' has no nodes, or they lie on a line, so that it cannot be a "
            "body of its own. Give it more cells."
        )
    if not effect.given:
        return body
    own = body.data
    mass = own.mass if effect.mass is None else float(effect.mass)
    J = own.inertia if effect.inertia is None else np.asarray(effect.inertia, float)
    inertia = 0.5 * (J + J.T)  # momenta are kept as far as it is symmetric
    excess = own.excess if effect.inertia is None else np.zeros((3, 3))
    given = replace(own, mass=mass, inertia=inertia, given=True, frozen=NOTHING, excess=excess)
    return Body(given, body.motion)


def _clamp(scene: Scene, active: Sequence[fx.Support], name: str, nodes: Indices) -> int | None:
    """Number of the support that clamps a body, None if nothing holds it. Collective."""
    holding = _holding(scene, active, name, nodes)
    if not holding:
        return None
    first = active[min(holding)]
    dofs = np.unique(np.concatenate(list(holding.values())))
    partly = scene.sum(np.count_nonzero(np.bincount(dofs // 3) % 3)) > 0
    same = all(active[k].same_motion(first) for k in holding)
    if partly or not same or not _holds(scene, dofs):
        raise SceneError(CHAIN.format(name, first.where))
    return min(holding)


def _hold(scene: Scene, active: Sequence[fx.Support], name: str, nodes: Indices) -> Hold | None:
    """The supports in a part that deforms, None if nothing holds it. Collective.

    The frame follows one that clamps nodes not in line, if there is any, one that does not turn if
    it can. Otherwise it rests, and all supports together prevent its six rigid motions.
    """
    holding = _holding(scene, active, name, nodes)
    if not holding:
        return None
    clamps = [
        active[k] for k, own in holding.items() if len(active[k].axes) == 3 and _holds(scene, own)
    ]
    frame = next((s for s in clamps if s.uniform), clamps[0] if clamps else None)
    guides = tuple(active[k] for k in holding if active[k] is not frame)
    partial = next((s for s in guides if len(s.axes) < 3), None)
    if frame is not None and not frame.uniform and partial is not None:
        raise SceneError(
            f"{name} turns with the support on '{frame.where}', and that on '{partial.where}' "
            f"holds {partial.components} alone. Let it hold xyz, or leave a layer of flexible "
            "cells at one of them."
        )
    if frame is None and not _holds(scene, np.unique(np.concatenate(list(holding.values())))):
        raise SceneError(CHAIN.format(name, guides[0].where))
    return Hold(frame, guides)


def _holding(
    scene: Scene, active: Sequence[fx.Support], name: str, nodes: Indices
) -> dict[int, Ints]:
    """Owned dofs of nodes that each support holds; `SceneError` if one strains them. Collective."""
    inside = (3 * nodes[:, None].astype(np.int64) + np.arange(3)).reshape(-1)
    holding = {}
    for k, support in enumerate(active):
        own = np.intersect1d(dofs_of(scene, support), inside)
        if not scene.sum(own.size):
            continue
        holding[k] = own
        if not support.keeps_rigid:
            raise SceneError(
                f"{name} is clamped by {support.kind} on '{support.where}', which would strain it: "
                "a part that a support takes along needs one that moves all its nodes alike, or a "
                "PrescribedRotation from the start on."
            )
    return holding


def _holds(scene: Scene, dofs: Ints) -> bool:
    """Whether owned dofs of all ranks prevent all rigid motions of their nodes. Collective."""
    nodes, axes = np.divmod(dofs, 3)
    x = scene.space.tabulate_dof_coordinates()[nodes]
    sums = np.asarray(scene.sum(np.r_[x.sum(axis=0), len(x)]))
    known = axes[:, None] == np.arange(3), scene.mean_cell_size, scene.comm
    return not free_motions(x - sums[:3] / sums[3], *known).size


# Rigid faces and carried masses -----------------------------------------------------------------


def named_parts(scene: Scene, flexible: bool) -> list[fx.Rigid]:
    """Parts that are bodies by name, with `stiff` cells of those that are flexible, if they are."""
    inside = [name for part in scene.named(fx.Reduced) for name in part.stiff if flexible]
    return [*scene.named(fx.Rigid), *map(fx.Rigid, inside)]


def nodes_of(scene: Scene, part: fx.Rigid) -> Indices:
    """Owned nodes of a named part, sorted. Collective."""
    if part.where is None:
        return np.arange(scene.owned_nodes, dtype=np.int32)
    nodes = scene.nodes(part.where, "Rigid", (3,))
    return nodes[nodes < scene.owned_nodes]


def face_bodies(
    scene: Scene, forces: InternalForces, state: State, held: Bools, others: Sequence[Body]
) -> list[Body]:
    """The bodies of carried masses, and of the rigid faces that no other body has. Collective.

    Faces that are bodies in the state keep their motion. Other bodies and supports that clamp a
    part hold some owned nodes. Nodes of a face that lie on a line are a SceneError on every rank.
    """
    out: list[Body] = []
    known, there = ({body.data.name: body for body in of} for of in (state.bodies, others))
    numbers = count(len(named_parts(scene, True)) + 1)
    for face, number in zip(fx.rigid_faces(scene.effects), numbers, strict=False):
        nodes = scene.nodes(face.where, face.name, (2,))
        nodes = nodes[nodes < scene.owned_nodes]
        if scene.sum(np.count_nonzero(held[nodes])) == 0:
            what = PlannedBody(np.empty(0, np.int32), nodes, face.name, number)
            out.append(known.get(face.name) or _face(scene, forces, state, what))
    carried = (effect for effect in scene.named(fx.PointMass) if effect.is_carried)
    for effect, number in zip(carried, numbers, strict=False):
        if effect.title not in there:
            x, _, v = at_nodes(state)
            own = known.get(effect.title)
            out.append(own or Body(*body_of(effect, scene, x, v, number)))
    return out


def with_faces(scene: Scene, forces: InternalForces, state: State) -> set[int]:
    """Add rigid faces that no body holds, moving as their nodes; their numbers. Collective."""
    carried = any(effect.is_carried for effect in scene.named(fx.PointMass))
    if not (carried or fx.rigid_faces(scene.effects)):
        return set()
    others = [body for body in state.bodies if not body.data.is_face]
    held = ~outside(scene.owned_nodes, (body.data for body in others))
    for part in scene.named(fx.Rigid):
        held[nodes_of(scene, part)] = True
    there = {body.data.number for body in state.bodies}
    faces = face_bodies(scene, forces, state, held, others)
    state.group(Bodies.of_each([*others, *faces]))
    return {face.data.number for face in faces} - there


def _face(scene: Scene, forces: InternalForces, state: State, what: PlannedBody) -> Body:
    """The body of a face, with the motion that fits its nodes. Collective."""
    body = freeze(scene, forces, state, what) if scene.mass == "lumped" else None
    body = body or _without_mass(scene, forces, state, what)
    if body is None:
        raise SceneError(
            f"{what.name}: its nodes lie on a line or are too few, so that they are no body. Name "
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
    extent = float(np.sqrt(np.trace(area.inertia) / (2 * area.mass)))
    data = data_of(what, x, u, points.mass, points.inertia, centre, extent=extent)
    return Body(data, BodyMotion(centre.copy(), np.eye(3), velocity, omega))
