"""Which cells are flexible, which form bodies and which go with a support."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, agree
from rigidfx.effects import Resultant, Rigid, Support
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.mechanics.rigid_body import NOTHING, BodyMotion, RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.supports import dofs_of, supports_of
from rigidfx.switch.exchange import Selection, freeze

__all__ = ["Parts", "check_clamps", "named_parts"]

Nodes = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Parts:
    """A division of the cells, with the bodies and their motions.

    Attributes:
        flexible: Flexible owned cells by subdomain id.
        bodies: Rigid bodies that move freely.
        motions: Their motions.
        carried_cells: Owned cells that move with a support, by subdomain id; None if there are
            none.
        carried_nodes: Owned nodes that move with a support, by the support's number.
        clamped: Owned cells of each named part that moves with a support, by the part's number.
    """

    flexible: Cells
    bodies: tuple[RigidBody, ...]
    motions: tuple[BodyMotion, ...]
    carried_cells: Cells | None
    carried_nodes: Mapping[int, Nodes]
    clamped: Mapping[int, Nodes]


def check_clamps(scene: Scene, resolution: float) -> None:
    """Look ahead: will supports hold named bodies in a way that is refused? Collective.

    Args:
        scene: The problem.
        resolution: Times closer than this are the same [s].

    Raises:
        SceneError: If a support, at any time, holds a body other than by clamping it whole, or
            clamps one whose mass is given, or that a resultant acts on then.
    """
    held = [*scene.named(Support), *scene.named(Resultant)]
    times = sorted({0.0, *(t for e in held for t in e.ends if t > 0)})
    for effect in scene.named(Rigid) if scene.named(Support) else ():
        _, nodes = _cells_and_nodes(scene, effect)
        for t in times:
            acting = scene.acting(t, resolution)
            clamp = _clamp(scene, supports_of(acting), effect.name, nodes)
            if clamp is not None and effect.given:
                raise SceneError(
                    f"Rigid '{effect.name}': its mass or inertia is given, and at t = {t:g} s a "
                    "support clamps it, which would bear what its cells weigh. Leave mass and "
                    "inertia out, or a layer of flexible cells between body and support."
                )
            loads = [e for e in acting if isinstance(e, Resultant) and e.body == effect.name]
            if clamp is not None and loads:
                raise SceneError(
                    f"Resultant: at t = {t:g} s a support clamps the body '{effect.name}', so that "
                    "it is no body of its own. Name a NodalForce on its cells, which the support "
                    "then bears, or separate the two in time."
                )


def named_parts(
    scene: Scene,
    forces: InternalForces,
    state: State,
    active: tuple[Support, ...],
    found: Sequence[tuple[RigidBody, BodyMotion]] = (),
) -> Parts:
    """The parts that the scene names, and bodies found beside them. Collective.

    Args:
        scene: The problem.
        forces: Internal forces, which know the cells of each material.
        state: Current state; named bodies that are in it already keep data and motion.
        active: Supports that act now.
        found: Further bodies with their motions. Those that hold named sets stand for these.

    Raises:
        SceneError: If two bodies share a node, or a support holds a body other than by clamping
            it whole.
    """
    owned = scene.mesh.topology.index_map(3).size_local
    rigid: list[npt.NDArray[np.int32]] = [body.cells for body, _ in found]
    bodies: list[RigidBody] = []
    motions: list[BodyMotion] = []
    inside_found = {name for body, _ in found for name in body.named}
    carried: dict[int, Nodes] = {}
    clamped: dict[int, Nodes] = {}
    taken = np.zeros(scene.owned_nodes, dtype=np.int32)
    known = {b.name: (b, m) for b, m in zip(state.bodies, state.motions, strict=True)}
    for number, effect in enumerate(scene.named(Rigid), start=1):
        cells, nodes = _cells_and_nodes(scene, effect)
        name = effect.name
        clash = "Two bodies" if taken[nodes].any() else None
        agree(
            scene.comm,
            clash
            and f"Rigid '{name}' shares nodes with another body, which would be a hinge. Merge the "
            "two sets, or leave a layer of flexible cells between them.",
        )
        taken[nodes] = 1
        rigid.append(cells)
        support = _clamp(scene, active, name, nodes)
        if support is not None:
            clamped[number] = cells
            carried[support] = np.union1d(carried.get(support, nodes), nodes).astype(np.int32)
        elif name in inside_found:
            continue
        elif name in known:
            bodies.append(known[name][0])
            motions.append(known[name][1])
        else:
            body, motion = _freeze_named(scene, forces, state, effect, cells, nodes, number)
            bodies.append(body)
            motions.append(motion)
    for body, motion in found:
        bodies.append(body)
        motions.append(motion)
    if not rigid:
        return Parts(forces.cells(), (), (), None, {}, {})
    every = np.arange(owned, dtype=np.int32)
    flexible = np.setdiff1d(every, np.concatenate(rigid))
    with_bodies = np.concatenate([np.empty(0, np.int32), *(b.cells for b in bodies)])
    moved = np.setdiff1d(np.setdiff1d(every, flexible), with_bodies)
    some = scene.sum(moved.size) > 0
    return Parts(
        forces.cells(flexible),
        tuple(bodies),
        tuple(motions),
        forces.cells(moved) if some else None,
        carried,
        clamped,
    )


def _freeze_named(
    scene: Scene,
    forces: InternalForces,
    state: State,
    effect: Rigid,
    cells: Nodes,
    nodes: Nodes,
    number: int,
) -> tuple[RigidBody, BodyMotion]:
    """The body of an effect, with the mass and inertia that it may give. Collective."""
    name = effect.name
    selection = Selection(cells, nodes, name, number, (name,))
    body, motion, singular = freeze(scene, forces, state, selection)
    if singular:
        raise SceneError(
            f"Rigid body '{name}' has no nodes, or they lie on a line, so that it cannot be a body "
            f"of its own: its inertia is\n{body.inertia} kg m². Give it more cells."
        )
    if effect.given:
        mass = body.mass if effect.mass is None else effect.mass
        J = body.inertia if effect.inertia is None else np.asarray(effect.inertia, float)
        inertia = 0.5 * (J + J.T)  # momenta are kept as far as it is symmetric
        body = replace(body, mass=float(mass), inertia=inertia, given=True, frozen=NOTHING)
        if effect.inertia is not None:
            body = replace(body, excess=np.zeros((3, 3)))
    return body, motion


def _cells_and_nodes(scene: Scene, effect: Rigid) -> tuple[npt.NDArray[np.int32], Nodes]:
    """Owned cells and owned nodes of a body, sorted. Collective."""
    cells = scene.owned_cells(effect.where, "Rigid")
    if effect.where is None:
        return cells, np.arange(scene.owned_nodes, dtype=np.int32)
    nodes = scene.nodes(effect.where, "Rigid", (3,))
    return cells, nodes[nodes < scene.owned_nodes]


def _clamp(scene: Scene, active: tuple[Support, ...], name: str, nodes: Nodes) -> int | None:
    """Number of the support that clamps a body, None if nothing holds it. Collective."""
    inside = np.zeros(3 * scene.owned_nodes, dtype=bool)
    inside[(3 * nodes[:, None] + np.arange(3)).reshape(-1)] = True
    holding: list[int] = []
    for k, support in enumerate(active):
        dofs = dofs_of(scene, support)
        if scene.sum(np.count_nonzero(inside[dofs])) > 0:
            holding.append(k)
    if not holding:
        return None
    first = active[holding[0]]
    dofs = np.unique(np.concatenate([dofs_of(scene, active[k]) for k in holding]))
    counts = np.bincount(dofs[inside[dofs]] // 3, minlength=scene.owned_nodes)
    X = scene.space.tabulate_dof_coordinates()[np.flatnonzero(counts == 3)]
    partly = scene.sum(np.count_nonzero((counts > 0) & (counts < 3))) > 0
    points = np.concatenate(scene.comm.allgather(X))
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) if len(points) else [0]
    spans = len(points) >= 3 and spread[1] > 1e-9 * spread[0]
    same = all(active[k].same_motion(first) for k in holding)
    if partly or not spans or not same:
        raise SceneError(
            f"Rigid '{name}' has nodes held by the support on '{first.where}'. A body on a "
            "support would be a kinematic chain: leave a layer of flexible cells between them, or "
            "clamp all components (xyz) of at least three of its nodes that are not in line, by "
            "one motion; it is then fixed, or follows that motion."
        )
    return holding[0]
