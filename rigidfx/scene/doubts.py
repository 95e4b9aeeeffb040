"""Scenes that can be computed and are hardly meant: units, flat facets, loads that do nothing.

A part read in millimetres in place of metres has 1e9 times its mass, so that forces are next to
nothing beside its weight. Without forces its Δt tells: waves take a thousand times as long through
the part. A round surface of flat facets meets an obstacle as a polygon of n sides, which stands
still on slopes below 180°/n, of which a hollow of radius R leaves 1 - r/R. It is round where facets
meet at a small convex angle θ, and their radius, width over θ, is no fillet's.
"""

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx import effects as fx
from rigidfx.base.inputs import numbers
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.base.warning import warn
from rigidfx.effects.contacts.surface import area_vectors, triangles_of
from rigidfx.effects.damping import warn_of_ratio
from rigidfx.effects.supports import FLAT
from rigidfx.scene.weights import inertial_masses

NOTHING = 1e-5  # of a scene's weight: a walker on a large bridge has more
HEAVY = 1e7  # kg: a steel part of 0.1 m weighs more if millimetres are taken for metres
LIGHT = 0.1  # kg/m³: aerogels have 1
FASTEST = 3e8  # m/s, of light
MILLI = 1e3  # of a metre
INSTEAD = "They have to be in metres (scale=1e-3 where a mesh is read), with Pa, kg/m³ and N."


def warn_of_units(scene: Any) -> None:
    """Warn of masses, forces, dampers and gravity that hardly go together. Collective."""
    mass = scene.sum(inertial_masses(scene).sum())
    earth = float(np.linalg.norm(numbers(fx.Gravity().value)))
    most, least = _largest_force(scene), NOTHING * earth * mass
    if 0 < most < least:
        warn(
            scene.comm,
            f"Scene: its forces of {most:.3g} N at most are next to nothing beside its weight, as "
            f"its mass is {mass:.3g} kg. Are lengths in millimetres? {INSTEAD}",
        )
    elif mass > HEAVY and not (most > 0 or any(s.moves for s in scene.named(fx.Support))):
        warn(scene.comm, f"Scene: its mass is {mass:.3g} kg. Are lengths in millimetres? {INSTEAD}")
    for spring in scene.named(fx.SpringDamper):
        if spring.stiffness > 0 and not spring.pulls_only:  # a cable may stop what flies
            ratio = 0.5 * spring.damping / float(np.sqrt(spring.stiffness * mass))
            warn_of_ratio(scene.comm, f"{spring.owner} under all mass", ratio)
    cells = scene.mesh.topology.index_map(3).size_global
    rho = mass / (cells * scene.mean_cell_size**3)  # with all masses that are given
    speed = min(float(np.sqrt(m.stiffness / m.rho)) for m, _ in scene.materials)
    if speed > FASTEST:  # one that is stiff on purpose may be so, not all
        warn(
            scene.comm,
            f"Scene: waves pass its softest material at {speed:.2g} m/s, faster than light. Moduli "
            "in Pa go with kg/m³, those in MPa with t/mm³.",
        )
    for gravity in scene.named(fx.Gravity):
        g = np.inf if callable(gravity.value) else float(np.linalg.norm(gravity.value))
        if rho >= LIGHT and MILLI / 10 < g / earth < 10 * MILLI:
            warn(
                scene.comm,
                f"{gravity.owner}: {g:g} is in m/s², where earth has {earth:g}; 9810 mm/s² goes "
                f"with densities in t/mm³, and the density here is {rho:.3g} kg/m³.",
            )
        if rho < LIGHT and earth < 10 * g and g < 10 * earth:
            warn(
                scene.comm,
                f"{gravity.owner}: {g:g} is in m/s², and the density {rho:g} hardly is in kg/m³. "
                "With t/mm³, MPa, mm, N and s take 9810; with kg/mm³, GPa, mm, kN and ms 0.00981.",
            )


def warn_of_short_steps(scene: Any, dt: float) -> None:
    """Warn of a heavy body without forces whose waves take hundreds of steps. Collective.

    Those in which waves are of interest pass a cell in a few steps.
    """
    mass = scene.sum(inertial_masses(scene).sum())
    if MILLI * mass < HEAVY or _largest_force(scene) > 0 or scene.named(fx.Contact):
        return
    speed = max(float(np.sqrt(m.stiffness / m.rho)) for m, _ in scene.materials)
    low, high = scene.box_of(scene.mesh.geometry.x)
    length = float(np.max(high - low))
    if 3 * length > MILLI * speed * dt and scene.mean_cell_size > 10 * speed * dt:
        warn(
            scene.comm,
            f"simulate: a wave needs {length / (speed * dt):.3g} steps of Δt = {dt:.3g} s through "
            f"the {length:.4g} m of this scene of {mass:.3g} kg. Are lengths in millimetres? "
            f"{INSTEAD}",
        )


def _largest_force(scene: Any) -> float:
    """That of loads on nodes and bodies [N]."""
    kinds = fx.NodalForce, fx.Resultant
    return max((_largest(effect) for kind in kinds for effect in scene.named(kind)), default=0.0)


def _largest(effect: Any) -> float:
    """The largest force of a load [N]; inf if a function tells it."""
    force = effect.force if hasattr(effect, "force") else effect.value
    if callable(force) or not isinstance(effect.time, fx.Table | None):
        return np.inf
    factor = 1.0 if effect.time is None else float(np.abs(effect.time.values).max())
    return factor * float(np.linalg.norm(force))


SMOOTH = 0.01  # rad: facets that meet at less are one
SHARP = 0.9  # rad, above an octagon's 45°: facets that meet at more are an edge of a part
ROLLS = 0.5  # of the distance from the middle of a part: least radius of what rolls
FINE = np.radians(3.0)  # half the angle between facets that is not worth a word: 60 in a turn


def warn_of_facets(scene: Any) -> None:
    """Warn of round surfaces that obstacles with friction meet. Collective."""
    for contact in (c for c in scene.named(fx.Contact) if c.friction > 0):
        against = contact.against
        inside = getattr(against, "inside", False)
        hollow = getattr(against, "radius", np.inf) if inside else np.inf
        angle, radius = _round(scene, contact.where, contact.owner)
        half = 0.5 * angle
        if half * (1.0 - radius / hollow) <= FINE:
            continue
        count = round(np.pi / half)
        warn(
            scene.comm,
            f"{contact.owner}: the surface is round, and its flat facets meet at "
            f"{np.degrees(2 * half):.3g}°, some n = {count} in a turn. Nodes are the contact: it "
            "rolls as a polygon, which stands still on slopes below 180°/n = "
            f"{np.degrees(half):.3g}° and rolls too slowly on steeper ones. Take four times as "
            "many facets around, or curved cells of second order (gmsh's ElementOrder 2, and "
            "order=2).",
        )


def _round(scene: Any, where: str, owner: str) -> tuple[float, float]:
    """Angle between neighbouring facets of a round surface, and its radius [m]. Collective.

    Half of all turning is at angles as large or larger: sides around an axis, that hardly turn, do
    not count.
    """
    cells, nodes = triangles_of(scene, where, owner)
    X = scene.space.tabulate_dof_coordinates()
    centre = scene.parts.middle[scene.parts.of_cell[cells]]
    numbers = scene.space.dofmap.index_map.local_to_global(nodes.reshape(-1).astype(np.int32))
    mine = numbers.reshape(-1, 3), X[nodes], centre
    every = [np.concatenate(of) for of in zip(*scene.comm.allgather(mine), strict=True)]
    return _of_triangles(*every)


def _of_triangles(numbers: Ints, corners: Array, centre: Array) -> tuple[float, float]:
    """The same of triangles by numbers, (n, 3), and positions of corners, (n, 3, 3) [m]; 0 if none.

    The parts that they bound have their middles at `centre`, shape (n, 3) [m].
    """
    normal, middle = area_vectors(corners), corners.mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    normal /= area[:, None]
    ends = np.concatenate([numbers[:, [0, 1]], numbers[:, [1, 2]], numbers[:, [2, 0]]])
    ends.sort(axis=1)
    order = np.lexsort(ends.T)
    first = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    a, b = order[first], order[first + 1]  # sides of two triangles, of which n come first
    n = len(numbers)
    along = np.linalg.norm(corners[a % n, (a // n + 1) % 3] - corners[a % n, a // n], axis=1)
    edge = 0.5 * (corners[a % n, (a // n + 1) % 3] + corners[a % n, a // n])
    a, b = a % n, b % n
    angle = np.arccos(np.clip((normal[a] * normal[b]).sum(axis=1), -1.0, 1.0))
    convex = ((middle[b] - middle[a]) * normal[a]).sum(axis=1) < 0
    radius = _widths(a, b, angle, along, area) / np.maximum(angle, SMOOTH)
    rolls = radius >= ROLLS * np.linalg.norm(edge - centre[a], axis=1)
    found = convex & rolls & (angle > SMOOTH) & (angle < SHARP)
    if not found.any():
        return 0.0, 0.0
    angle, turning, radius = angle[found], (angle * along)[found], radius[found]
    order = np.argsort(angle)
    half = int(np.searchsorted(np.cumsum(turning[order]), 0.5 * turning.sum()))
    return float(angle[order][half]), float(np.median(radius))


def _widths(a: Ints, b: Ints, angle: Array, along: Array, area: Array) -> Array:
    """Width of the narrower one of the two facets at each side, across it [m].

    A side lies along the triangles a and b, which meet at an angle [rad] over its length [m].
    """
    flat = angle <= SMOOTH
    graph = coo_array((np.ones(int(flat.sum())), (a[flat], b[flat])), (area.size, area.size))
    count, facet = connected_components(graph, directed=False)
    areas = np.bincount(facet, weights=area, minlength=count)
    sides = np.sort(np.stack([facet[a], facet[b]]), axis=0)
    _, pair = np.unique(sides, axis=1, return_inverse=True)
    common = np.bincount(pair.reshape(-1), weights=along)[pair.reshape(-1)]
    return np.asarray(areas[sides].min(axis=0) / common)


LOADS: tuple[Any, ...] = (fx.DeadLoad, fx.Pressure)  # whose forces are on nodes of a set


def warn_of_idle(scene: Any, t_end: float) -> None:
    """Warn of loads that do nothing, by their time or as supports hold their nodes. Collective."""
    for effect in scene.named(fx.Windowed):
        if not effect.is_load or effect.is_support:
            continue
        first, last = effect.start, min(effect.until, t_end)
        if not first < last or _is_zero(effect, first, last):
            warn(
                scene.comm,
                f"{effect.owner}: it does nothing from 0 to {t_end:g} s, where the run is. Check "
                "since, until, the times of its Table, and t_end: all are in seconds.",
            )
        elif isinstance(effect, LOADS) and effect.where and _held(scene, effect, first, last):
            warn(
                scene.comm,
                f"{effect.owner}: supports hold all nodes that it acts on, so that it moves "
                "nothing and only adds to reactions. Name another set, or let supports hold fewer "
                "nodes or components.",
            )


def _is_zero(effect: Any, first: float, last: float) -> bool:
    """Whether the factor of a load is a table that is zero between two times [s]."""
    table = getattr(effect, "time", None)
    if not isinstance(table, fx.Table):
        return False
    return not any(table(t) for t in (first, last, *(t for t in table.times if first < t < last)))


def _held(scene: Any, load: Any, first: float, last: float) -> bool:
    """Whether supports hold all dofs that a load acts on between two times [s]. Collective."""
    n = scene.owned_nodes
    held = np.zeros((n, 3), dtype=bool)
    for support, nodes in scene.supports:
        if support.since <= first and last <= support.until:
            held[np.ix_(nodes[nodes < n], support.axes)] = True
    for rigid in scene.named(fx.Rigid):  # a part that a support holds moves with it
        if rigid.deforms:
            continue
        nodes = scene.nodes(rigid.where, rigid.kind)
        nodes = nodes[nodes < n]
        held[nodes] |= bool(scene.sum(held[nodes].any()) > 0)
    nodes = scene.nodes(load.where, load.kind)
    nodes = nodes[nodes < n]
    free = np.asarray(scene.sum((~held[nodes]).sum(axis=0)))
    along = _directions(scene, load, scene.start_places[nodes])
    return bool(along.any() and not free[along].any())


def _directions(scene: Any, load: Any, X: Array) -> Bools:
    """Components that a load has: those of its value, or the normal of an even face. Collective."""
    value = getattr(load, "value", None)
    if isinstance(load, fx.Pressure):
        low, high = scene.box_of(X)
        extent = high - low
        flat = extent <= FLAT * extent.max()
        return flat if flat.any() else ~flat
    return np.ones(3, dtype=bool) if callable(value) else np.asarray(value, dtype=bool)
