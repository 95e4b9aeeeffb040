"""Checks of a scene while it is made: discretisation, masses, supports, probes, contradictions."""

import re
from collections.abc import Iterable, Mapping, Sequence, Set
from itertools import combinations
from sys import maxsize
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import geometry
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base import compat
from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import numbers, shown
from rigidfx.base.sealed import read_only
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.domain.domain import Domain, box_of
from rigidfx.effects import rigid_faces
from rigidfx.mechanics.schemes import Scheme
from rigidfx.scene.mesh_checks import warn_of_bending

NEARLY_INCOMPRESSIBLE = 0.49  # ν above which first-order cells are warned of


def check_together(effects: Sequence[fx.Effect], scheme: Scheme) -> None:
    """Refuse effects that do not go together, or with the scheme, whatever the mesh."""

    def named(kind: type[fx.Effect]) -> list[Any]:
        return [e for e in effects if isinstance(e, kind)]

    for effect in effects:
        if not isinstance(effect, fx.Effect):
            raise SceneError(f"Scene: {effect!r} is not an effect. See rigidfx.effects.")
    if len(named(fx.Preload)) > 1:
        raise SceneError("Scene: only one Preload makes sense; give it all static loads.")
    if named(fx.InitialDisplacement) and (named(fx.Preload) or named(fx.Rigid)):
        raise SceneError(
            "Scene: an InitialDisplacement goes neither with a Preload, which finds a displacement "
            "of its own, nor with parts that are Rigid or Reduced from the start."
        )
    damping = named(fx.NumericalDamping)
    if damping and not scheme.damps:
        raise SceneError(
            f"Scene: numerical damping (22) goes with EnergyMomentum, not with "
            f"{type(scheme).__name__}."
        )
    parts = named(fx.Rigid)
    bodies = [part.where for part in parts]
    for k, part in enumerate(parts):
        for other in parts[:k]:
            if part.where == other.where or None in (part.where, other.where):
                raise SceneError(
                    f"Scene: a cell can be in one Rigid body only, and {other.owner} and "
                    f"{part.owner} hold the same ones. Leave one of the two out, or name sets that "
                    "have no node in common."
                )
    for name in bodies:
        if name is not None and re.fullmatch(r"part \d+", name):
            raise SceneError(
                f"Scene: '{name}' is what a part that is found is called in reports; give the set "
                "of this Rigid body another name."
            )
    if bodies and not scheme.couples:
        raise SceneError(
            f"Scene: {type(scheme).__name__} does not couple to rigid bodies; take "
            "EnergyMomentum or Midpoint."
        )
    for a, b in combinations(damping, 2):
        if overlap(a, b):
            raise SceneError("Scene: two NumericalDamping effects overlap in time.")


def overlap(a: fx.Windowed, b: fx.Windowed) -> bool:
    """Whether two time windows have more than an instant in common."""
    return max(a.since, b.since) < min(a.until, b.until)


def effects_of(domain: Any, effects: Any) -> tuple[Any, ...]:
    """The effects of a domain, in the order given; `SceneError` if they are no list of them."""
    if not isinstance(domain, Domain):
        raise SceneError(
            f"Scene: domain must be a Domain (box, from_arrays, read_msh, or Domain(mesh) of a "
            f"DOLFINx mesh), got {type(domain).__name__}."
        )
    if isinstance(effects, (str, Set)) or not isinstance(effects, Iterable):
        raise SceneError(f"Scene: effects must be a list of effects, got {shown(effects)}.")
    return tuple(effects)


def check_discretisation(scene: Any) -> None:
    """Refuse an order or a mass that is none, or does not go with the mesh."""
    order, mass = scene.order, scene.mass
    whole = isinstance(order, (int, np.integer)) and not isinstance(order, bool)
    if not whole or order not in (1, 2):
        raise SceneError(f"Scene: order must be 1 or 2, got {shown(order)}.")
    if mass not in ("lumped", "consistent"):
        raise SceneError(f"Scene: mass must be 'lumped' or 'consistent', got {shown(mass)}.")
    if scene.simplex and order == 2 and mass == "lumped":
        raise SceneError(
            "Scene: second-order tetrahedra have negative lumped masses at their vertices. "
            "Take mass='consistent', or order=1, or hexahedra."
        )
    curved = compat.coordinate_map(scene.mesh).degree
    if curved > order:
        raise SceneError(
            f"Scene: cells of geometry order {curved} need at least "
            f"that order of displacement (got {order}), or a rigid rotation would "
            "strain them."
        )


def warn_of_locking(scene: Any) -> None:
    """Warn of first-order cells that lock, but for those of parts named rigid. Collective."""
    if scene.order != 1 or not scene.element.locks:
        return
    instead = "order=2" if scene.simplex else "element='enhanced' or order=2"
    strained = np.ones(scene.owned_cells(None, "Scene").size, dtype=bool)
    for rigid in (effect for effect in scene.effects if effect.is_rigid):
        strained[scene.owned_cells(rigid.where, rigid.kind)] = False
    counts = [scene.sum(np.count_nonzero(strained[cells])) for _, cells in scene.materials]
    found = zip(scene.materials, counts, strict=True)
    nu = max((getattr(m, "nu", 0.0) for (m, _), count in found if count > 0), default=0.0)
    if nu > NEARLY_INCOMPRESSIBLE:
        warn(
            scene.comm,
            f"Scene: first-order cells lock at ν = {nu:g}: they keep their volume at the price "
            f"of hardly bending at all. Take {instead}, or a smaller ν.",
        )
    warn_of_bending(scene.domain, strained)


def check_masses(scene: Any) -> None:
    """Refuse nodal masses that are not positive, or overflow in sums. Collective."""
    n, mass = scene.owned_nodes, scene.nodal_mass
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (scene.space.tabulate_dof_coordinates()[:n] ** 2).sum(axis=1)
        m, J = scene.sum([mass[:n].sum(), mass[:n] @ squares])
    if not (np.isfinite(m) and np.isfinite(J)):
        raise SceneError(
            f"Scene: the masses of the nodes add up to {m:.3g} kg, with a moment of inertia "
            f"of {J:.3g} kg m² about the origin: too large for the arithmetic. Check the "
            "densities, the PointMass effects and the units."
        )
    if scene.mass == "lumped":
        worst = mass.min(initial=np.inf)
        agree(
            scene.comm,
            None
            if worst > 0
            else f"Scene: a node has the lumped mass {worst:.3g} kg ≤ 0 (strongly curved "
            "cells?). Take mass='consistent'.",
        )


def check_supports(scene: Any) -> None:
    """Refuse supports that prescribe different motions of the same nodes. Collective."""
    for (a, nodes_a), (b, nodes_b) in combinations(scene.supports, 2):
        shared = np.intersect1d(nodes_a, nodes_b).size
        axes = set(a.axes) & set(b.axes)
        clash = bool(axes) and overlap(a, b) and not a.same_motion(b)
        if clash and scene.sum(shared) > 0:
            raise SceneError(
                f"Scene: {a.kind} on '{a.where}' and {b.kind} on "
                f"'{b.where}' prescribe different motions of the same nodes at the same "
                "time. Separate their sets, components or time windows."
            )


def check_rigid(scene: Any) -> None:
    """Refuse parts named rigid that share nodes, and rigid faces that share some. Collective."""
    _check_faces(scene)
    bodies = [effect for effect in scene.effects if effect.is_body]
    taken = np.full(len(scene.nodal_mass), -1)
    for k, rigid in enumerate(bodies):
        if rigid.where is None:
            return
        nodes = scene.nodes(rigid.where, rigid.kind, (3,))
        other = int(scene.comm.allreduce(int(taken[nodes].max(initial=-1)), op=MPI.MAX))
        if other >= 0:
            raise SceneError(
                f"{rigid.kind} '{rigid.name}' shares nodes with another body, "
                f"{bodies[other].kind} '{bodies[other].name}', which would be a hinge. Merge the "
                "two sets, or leave a layer of flexible cells between them."
            )
        taken[nodes] = k


def _check_faces(scene: Any) -> None:
    """Refuse rigid faces that are in part of something else that moves as one. Collective.

    That is a support, another face, or a part named rigid that has not all of their nodes.
    """
    n, taken = scene.owned_nodes, np.zeros(scene.owned_nodes, dtype=np.int64)
    named = [effect for effect in scene.effects if effect.is_body]
    for number, rigid in enumerate(named, start=1):
        inside = scene.members(rigid.where, rigid.kind)[:n, 0]
        taken[inside > 0] = number
    for number, face in enumerate(rigid_faces(scene.effects), start=len(named) + 1):
        nodes = scene.nodes(face.where, face.name, (2,))
        nodes = nodes[nodes < n]
        for support, held in scene.supports:
            if scene.sum(np.intersect1d(nodes, held).size) > 0:
                raise SceneError(
                    f"{face.name}: {support.owner} holds some of its nodes, which move as one "
                    f"body. Join the 'ground', take MeanFace('{face.where}'), or separate the two "
                    "sets."
                )
        parts = {k for some in scene.comm.allgather(np.unique(taken[nodes])) for k in some.tolist()}
        if parts == {0}:
            taken[nodes] = number
        elif len(parts) > 1 or max(parts) > len(named):
            raise SceneError(
                f"{face.name}: it shares nodes with another rigid face, or with a part named Rigid "
                "or Reduced that has not all of them. Leave cells between the two, or name the "
                "part as the side of the joint."
            )


def in_order(given: Any) -> Any:
    """A dict in an order that is the same on all ranks, in which its own does not matter."""
    if not isinstance(given, Mapping):
        return given
    return {name: given[name] for name in sorted(given, key=repr)}


def points(comm: MPI.Intracomm, probes: Mapping[str, Sequence[float]]) -> dict[str, Array]:
    """Probes as read-only arrays, shape (3,) each [m], in the order of rank 0. Collective.

    `SceneError` if one is not three finite numbers, or two names are the same text, by which files
    and pictures know them.
    """
    if not isinstance(probes, Mapping):
        raise SceneError(
            f"Scene: probes must be a dict of names to three numbers each, got {shown(probes)}."
        )
    found: dict[str, Array] = {}
    called: dict[str, Any] = {}
    for name, given in probes.items():
        point = numbers(given)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise SceneError(
                f"Scene: probe '{name}' must be three finite numbers, got {shown(given)}."
            )
        if not str(name) or not str(name).isprintable():
            raise SceneError(
                f"Scene: the name of a probe must be one that can be printed, got {shown(name)}."
            )
        if str(name) in called:
            raise SceneError(
                f"Scene: the probes {called[str(name)]!r} and {name!r} would have the same columns "
                f"'u_{name}' in history.csv. Give one of them another name."
            )
        called[str(name)] = name
        found[name] = read_only(point)
    return {called[text]: found[called[text]] for text in comm.bcast(list(called))}


def cells_of(mesh: dmesh.Mesh, points: Mapping[str, Array]) -> dict[str, tuple[int, int]]:
    """Rank and local number of the cell that holds each point, the same on all ranks. Collective.

    Of several cells that share a point it is the first one of the mesh file, on any ranks.
    `SceneError` on every rank, if a point [m] lies in no cell.
    """
    if not points:
        return {}
    X = np.stack([*points.values()])
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    # A corner of a mesh may be a rounding away from where its name says.
    largest = max(np.abs(X).max(), np.abs(mesh.geometry.x).max(initial=0.0))
    room = 10 * np.finfo(float).eps * largest
    tree = geometry.bb_tree(mesh, 3, entities=owned, padding=room)
    candidates = geometry.compute_collisions_points(tree, X)
    hits = geometry.compute_colliding_cells(mesh, candidates, X)
    numbers, found = mesh.topology.original_cell_index, {}
    for k, name in enumerate(points):
        cell = min(map(int, hits.links(k)), key=lambda c: numbers[c], default=-1)
        number = int(numbers[cell]) if cell >= 0 else maxsize
        ends = mesh.comm.allgather((number, mesh.comm.rank, cell))
        first, rank, local = min(ends)
        if first == maxsize:
            low, high = (tuple(map(float, ends)) for ends in box_of(mesh.comm, mesh.geometry.x))
            distance, nearest = _nearest(mesh, X[k])
            raise SceneError(
                f"Scene: the probe '{name}' at {tuple(map(float, X[k]))} m lies in no cell: it is "
                f"{distance:.3g} m outside, and the nearest point of the mesh is {nearest} m. The "
                f"mesh reaches from {low} to {high} m."
            )
        found[name] = rank, local
    return found


def _nearest(mesh: dmesh.Mesh, point: Array) -> tuple[float, tuple[float, ...]]:
    """Distance of a point from the mesh [m], and the nearest point of it [m]. Collective.

    Cells with curved edges are taken by their corners.
    """
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    offer: tuple[float, ...] = (np.inf, 0.0, 0.0, 0.0)
    if owned.size:
        tree = geometry.bb_tree(mesh, 3, entities=owned)
        middles = geometry.create_midpoint_tree(mesh, 3, owned)
        cell = geometry.compute_closest_entity(tree, middles, mesh, point[None])[0]
        corners = dmesh.entities_to_geometry(mesh, 3, np.array([cell], dtype=np.int32))[0]
        x = mesh.geometry.x[corners[: 4 if mesh.topology.cell_name() == "tetrahedron" else 8]]
        apart = geometry.compute_distance_gjk(x, point[None])
        x0, x1, x2 = map(float, (point + apart).round(12))
        offer = float(np.linalg.norm(apart)), x0, x1, x2
    distance, *place = min(mesh.comm.allgather(offer))
    return distance, tuple(place)
