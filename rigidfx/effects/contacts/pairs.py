"""Contact between two surfaces that deform: nodes of one against triangles of the other.

docs/theory/contact.md has the gap ḡ, which is summed up while a node is pressed. By the rotation of
the normal in a step ḡ drifts from the distance, by second order in Δt. The derivative neglects the
changes of n and N: Newton's method takes one or two more iterations for that. A mesh that overlaps
itself is refused where a surface may meet itself: a point inside a cell is in no other cell of a
sound mesh.

All ranks know both surfaces, by numbers that are the same everywhere: a contact couples nodes of
any two ranks, and surfaces are small beside their parts. Which triangle a node may meet is found by
SciPy's cKDTree over their centres.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from dolfinx import geometry
from dolfinx import mesh as dmesh
from mpi4py import MPI
from petsc4py import PETSc
from scipy.spatial import cKDTree

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.effects.action import Structure, Touch
from rigidfx.effects.contacts.surface import (
    CLOSED,
    ContactForces,
    Pressed,
    area_vectors,
    once,
    secant,
    soonest,
    surface_of,
    triangles_of,
)
from rigidfx.effects.nodes import Instant, Motion, SharedNodes, Tangent, on_all_ranks

NEAREST = 12  # triangles that are looked at for a node
BESIDE = 1e-6  # of a triangle: how far beside it a node may be and still meet it
FLAT = 1e-9  # of the cosine of two normals
TINY = float(np.finfo(np.float64).tiny)
EQUALLY = 9  # digits of a gap over the distance of nodes: what agrees in them is equally near
INSIDE = 0.1  # of the way from a triangle to the middle of the cell behind: surfaces may touch
DEEPEST = 0.5  # of the distance of nodes: what is deeper has come from the other side


@dataclass(frozen=True)
class Met:
    """The nodes that may meet a triangle in a step."""

    at: Ints  # their places among those kept out
    slaves: Ints  # their numbers
    corners: Ints  # numbers of the nodes of their triangles, shape (n, 3)

    def projected(self, x: Array) -> tuple[Array, Array, Array]:
        """Gaps, normals and weights where all nodes are at x, shape (size, 3) [m]."""
        return projected(x[self.slaves], x[self.corners])

    def apart(self, v: Array, N: Array) -> Array:
        """Motion of the nodes against their triangles by that of all, shape (n, 3)."""
        return np.asarray(v[self.slaves] - np.einsum("na,nai->ni", N, v[self.corners]))


@dataclass(frozen=True)
class PairSurface:
    """Both surfaces; numbers count the nodes and triangles of both alike on any number of ranks."""

    nodes: Ints  # owned nodes of this rank in them
    numbers: Ints  # their numbers
    size: int  # how many nodes there are in all
    slaves: Ints  # numbers of the nodes that are kept out, shape (n,)
    stiffness: Array  # their stiffnesses, shape (n,) [N/m]
    triangles: Ints  # numbers of the nodes of triangles, normals outwards, shape (m, 3)
    reach: float  # distance within which a node may meet a triangle [m]
    spacing: float  # a typical distance of nodes [m]
    X: Array  # reference positions of all nodes, shape (size, 3) [m]
    itself: bool  # whether both are one surface

    def mates(self, x: Array, bodies: Ints) -> Ints:
        """The triangle that each slave may meet with nodes at x [m], -1 if none, shape (n,)."""
        out = np.full(self.slaves.size, -1)
        node, triangle = self._nearest(x)
        slaves, of_triangles = self.slaves[node], self.triangles[triangle]
        of = bodies[of_triangles]  # -1 if in none; surfaces of one body do not meet
        one = (of == bodies[slaves, None]).all(axis=1) & (of[:, 0] >= 0)
        one |= (of_triangles == slaves[:, None]).any(axis=1)  # its own
        node, triangle = node[~one], triangle[~one]
        g, _, N = projected(x[self.slaves[node]], x[self.triangles[triangle]])
        may = np.flatnonzero((N.min(axis=1, initial=1.0) > -BESIDE) & (g > -DEEPEST * self.spacing))
        if self.itself:
            may = may[~self._of_one_wall(node[may], triangle[may])]
        node, triangle, g = node[may], triangle[may], np.abs(g[may]) / self.spacing
        order = np.lexsort((triangle, g.round(EQUALLY), node))
        node, first = np.unique(node[order], return_index=True)
        out[node] = triangle[order][first]
        return out

    def _nearest(self, x: Array) -> tuple[Ints, Ints]:
        """Slaves and the triangles near them, or near and facing them, shapes (n,) and (n,).

        A surface that may meet itself is all near: triangles are found by places and normals
        together, and those that look the same way as the node are far.
        """
        centres, p = x[self.triangles].mean(axis=1), x[self.slaves]
        low, high = centres.min(axis=0) - self.reach, centres.max(axis=0) + self.reach
        near = np.flatnonzero(((p >= low) & (p <= high)).all(axis=1))
        low = p[near].min(axis=0, initial=np.inf) - self.reach
        high = p[near].max(axis=0, initial=-np.inf) + self.reach
        facing = np.flatnonzero(((centres >= low) & (centres <= high)).all(axis=1))
        if not near.size or not facing.size:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        places, wanted, farthest = centres[facing], p[near], self.reach
        if self.itself:
            normals, at_nodes = self._normals(x)
            places = np.c_[places, self.reach * normals[facing]]
            wanted = np.c_[wanted, -self.reach * at_nodes[self.slaves[near]]]
            # At 60° within reach, at a right angle nowhere: not the next side of its own edge.
            farthest *= np.sqrt(2.0)
        count = min(NEAREST, facing.size)
        far, found = cKDTree(places).query(wanted, k=count, distance_upper_bound=farthest)
        far, found = far.reshape(near.size, -1), found.reshape(near.size, -1)
        row, column = np.nonzero(np.isfinite(far))
        return near[row], facing[found[row, column]]

    def _normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals of triangles, (m, 3), and means of theirs at all nodes, (size, 3)."""
        # All count alike at a node: by areas, the rim of a thin plate would look as its sides do.
        normals, at_nodes = _unit(area_vectors(x[self.triangles])), np.zeros((self.size, 3))
        np.add.at(at_nodes, self.triangles, normals[:, None])
        return normals, _unit(at_nodes)

    def _of_one_wall(self, node: Ints, triangle: Ints) -> Bools:
        """Whether nodes are near triangles in the reference, and behind: on a wall's other side."""
        X, corners = self.X[self.slaves[node]], self.X[self.triangles[triangle]]
        g, _, _ = projected(X, corners)
        apart = np.linalg.norm(X - corners.mean(axis=1), axis=1)
        return np.asarray((g < 0) & (apart < 2 * self.reach))

    @property
    def flat(self) -> bool:
        """Whether all triangles look the same way in the reference."""
        normals, _ = self._normals(self.X)
        return bool((normals @ normals[0] > 1 - FLAT).all())

    def met(self, mate: Ints) -> Met:
        """Those slaves that have a mate."""
        at = np.flatnonzero(mate >= 0)
        return Met(at, self.slaves[at], self.triangles[mate[at]])

    def gaps(self, comm: MPI.Intracomm, x: Array) -> tuple[Ints, Array]:
        """Slaves near a triangle, and distances from its plane, local nodes at x [m]. Collective.

        Both have the shape (n,).
        """
        x = on_all_ranks(comm, self.size, self.numbers, x[self.nodes])
        near = self.met(self.mates(x, np.full(self.size, -1)))
        return near.slaves, near.projected(x)[0]


def _unit(v: Array) -> Array:
    """Vectors of length one, shape (n, 3)."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), TINY))


def projected(p: Array, corners: Array) -> tuple[Array, Array, Array]:
    """Gaps g [m], normals n and weights N of points p over triangles: p - Σ N corners = g n."""
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    area = np.linalg.norm(normal, axis=1)
    n = normal / area[:, None]
    g = ((p - a) * n).sum(axis=1)
    q = p - a - g[:, None] * n
    second = (np.cross(q, e2) * n).sum(axis=1) / area
    third = (np.cross(e1, q) * n).sum(axis=1) / area
    return g, n, np.stack([1 - second - third, second, third], axis=1)


@once
def pair_of(
    scene: Any, where: str, against: str, stiffness: float | None, owner: str
) -> PairSurface:
    """Surfaces of two sets, see `surface_of`; `where` is kept out of `against`. Collective."""
    surface = surface_of(scene, where, stiffness, owner)
    surface_of(scene, against, stiffness, owner)  # which refuses facets inside the mesh
    triangles = _on_all_ranks(scene, against, owner)
    named = np.concatenate([_on_all_ranks(scene, where, owner), triangles]).ravel()
    every, first, number = np.unique(named, return_index=True, return_inverse=True)
    order = np.argsort(first)  # numbers are in the order in which triangles name nodes
    number = np.argsort(order)[number.ravel()]
    begin, end = scene.space.dofmap.index_map.local_range
    numbers = np.flatnonzero((every[order] >= begin) & (every[order] < end))
    nodes = every[order][numbers] - begin
    of_nodes = np.c_[surface.stiffness, scene.space.tabulate_dof_coordinates()][nodes]
    k, X = np.split(on_all_ranks(scene.comm, every.size, numbers, of_nodes), [1], axis=1)
    slaves = np.flatnonzero(k)
    triangles = number[-triangles.size :].reshape(-1, 3)
    edges = X[triangles] - X[np.roll(triangles, 1, axis=1)]
    return PairSurface(
        nodes,
        numbers,
        every.size,
        slaves,
        k[slaves, 0],
        triangles,
        reach=float(np.linalg.norm(edges, axis=2).max(initial=0.0)) + surface.size,
        spacing=surface.size,
        X=X,
        itself=where == against,
    )


def _on_all_ranks(scene: Any, where: str, owner: str) -> Ints:
    """Triangles of a set by global numbers of nodes, shape (m, 3). Collective.

    They have the order of the cells in the mesh as it was given, whatever ranks have them.
    """
    cells, nodes = triangles_of(scene, where, owner)
    number = scene.space.dofmap.index_map.local_to_global
    corners = number(nodes.reshape(-1).astype(np.int32)).reshape(-1, 3)
    parts = scene.comm.allgather((scene.mesh.topology.original_cell_index[cells], corners))
    of_cells, every = (np.concatenate(of) for of in zip(*parts, strict=True))
    return np.asarray(every[np.argsort(of_cells, kind="stable")])


# Where a mesh overlaps itself -----------------------------------------------------------------


def refuse_overlap(scene: Any, where: str, owner: str) -> None:
    """Refuse a surface, by its name, behind which there are cells in cells. Collective."""
    comm, X = scene.comm, scene.space.tabulate_dof_coordinates()
    cells, triangles = triangles_of(scene, where, owner)
    dofmap = scene.space.dofmap
    dofs, number = dofmap.list, dofmap.index_map.local_to_global
    on = X[triangles].mean(axis=1)
    inside = on + INSIDE * (X[dofs[cells]].mean(axis=1) - on)
    each = dofs.shape[1]  # a rank may have none of the facets, or no cell at all
    of_cells = number(dofs[cells].reshape(-1).astype(np.int32)).reshape(-1, each)
    points = np.concatenate(comm.allgather(inside))
    nodes = np.concatenate(comm.allgather(of_cells))
    point, cell = _hits(scene.mesh, points)
    hit = number(dofs[cell].reshape(-1).astype(np.int32)).reshape(-1, each)
    shared = np.zeros(point.size, dtype=bool)
    for a in range(hit.shape[1]):  # nodes of one cell
        shared |= (nodes[point] == hit[:, a, None]).any(axis=1)
    point, cell = point[~shared], cell[~shared]
    held = [_holds(scene.mesh, c, points[p]) for p, c in zip(point, cell, strict=True)]
    every = np.unique(np.concatenate(comm.allgather(point[np.array(held, dtype=bool)])))
    if every.size:
        x, y, z = points[every[0]]
        raise SceneError(
            f"{owner}: the mesh overlaps itself at ({x:.6g}, {y:.6g}, {z:.6g}) m, and behind "
            f"{every.size} of {len(points)} triangles of '{where}' in all: a surface that may meet "
            "itself has to begin free of itself. Move its parts out of each other."
        )


def _hits(mesh: Any, points: Array) -> tuple[Any, Any]:
    """Points, and owned cells whose convex hulls they are in, by numbers, one for each pair."""
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    if not owned.size or not len(points):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    tree = geometry.bb_tree(mesh, 3, entities=owned)
    candidates = geometry.compute_collisions_points(tree, points)
    hits = geometry.compute_colliding_cells(mesh, candidates, points)
    return np.repeat(np.arange(len(points)), np.diff(hits.offsets)), hits.array


def _holds(mesh: Any, cell: int, point: Array) -> bool:
    """Whether a point is in a cell, which may be smaller than its hull; few are asked for."""
    corners = mesh.geometry.x[cell_geometry_dofs(mesh)[cell]]
    try:
        X = coordinate_map(mesh).pull_back(point.reshape(1, 3), corners)
    except RuntimeError:  # nowhere near: no such place is found
        return False
    simplex = mesh.topology.cell_type == dmesh.CellType.tetrahedron
    return bool((X > 0).all() and (X.sum() < 1 if simplex else (X < 1).all()))


_SEARCH = PETSc.Log.Event("rigidfxSearch")  # PETSc's log of the search for triangles


@dataclass(frozen=True)
class PairMemory:
    """Memory of a pair of each node kept out: ḡ, ∞ while free, and its triangle, -1 if none."""

    gap: Array
    mate: Ints


@dataclass(frozen=True)
class Pushed(Pressed):
    """How nodes are pushed at an iterate; forces are taken where all nodes are at `half`."""

    met: Met
    half: Array  # shape (size, 3) [m]
    n: Array  # normals, shape (n, 3)
    N: Array  # weights of the corners, shape (n, 3)


class PairForces(ContactForces):
    """The forces between two surfaces; its results are equal on all ranks."""

    couples = True

    def __init__(self, effect: Any, surface: PairSurface, structure: Structure) -> None:
        """Find which nodes are whose. Collective."""
        super().__init__(effect, surface.stiffness, structure)
        self._comm: MPI.Intracomm = structure.scene.comm
        self._surface, self._effect = surface, effect
        n = surface.slaves.size
        self._fresh = PairMemory(np.full(n, np.inf), np.full(n, -1))
        assert structure.notes is not None  # else it is not bound
        self._notes = structure.notes
        self._nodes = SharedNodes(structure, surface.nodes, surface.numbers, surface.size)
        self.rounding = float(np.linalg.norm(self._k)) * self._nodes.far()
        self.set_time(0.0, 0.0)

    @property
    def _memory(self) -> PairMemory:
        memory: PairMemory = self._notes.get(id(self._effect), self._fresh)
        return memory

    def set_time(self, t: float, dt: float) -> None:
        """Begin an attempt at a step: findings of the last one are forgotten."""
        self._x0: Array | None = None
        self._mate: Ints | None = None  # the triangle that each node may meet in the step
        self._g0: Array = np.empty(0)  # gaps of those that may meet one, at its start [m]
        self._pressed: Pushed | None = None

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add the resistance; between nodes of one body there is none. Collective."""
        if self._nodes.in_one_body:
            return
        moved = self._nodes.moved(motion)
        if self._x0 is None:
            self._x0 = self._nodes.positions(motion.start)
        half = self._x0 + self._nodes.share * moved
        if self._mate is None or self._static:
            self._mate = self._meet(self._x0, half)
        met = self._surface.met(self._mate)
        distance, n, N = met.projected(half)
        g0 = distance if self._static else self._g0
        g1 = distance if self._static else g0 + (n * met.apart(moved, N)).sum(axis=1)
        value, slope = secant(self._k[met.at], g0, g1, self._static)
        self._pressed = Pushed(met.at, (g0, g1), value, slope, met, half, n, N)
        pressure = value[:, None] * n
        force = np.zeros_like(half)
        np.add.at(force, met.slaves, pressure)
        np.add.at(force, met.corners, -N[:, :, None] * pressure[:, None])
        self._nodes.add(force, forces)

    def _meet(self, x0: Array, x: Array) -> Ints:
        """Find the triangle of each node at places x, and gaps at places x0, both (size, 3) [m]."""
        surface, memory = self._surface, self._memory
        with _SEARCH:
            mate = surface.mates(x, self._nodes.rigid)
        closed = memory.gap < 0
        mate = np.where(closed & (mate < 0), memory.mate, mate)
        met = surface.met(mate)
        distance = np.maximum(met.projected(x0)[0], 0.0)
        self._g0 = np.where(closed[met.at], memory.gap[met.at], distance)
        return mate

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add Σ [U]' (Lᵀ G)(Gᵀ P), G = n at the node and -N n at the triangle's."""
        self._in_tangent, p = self._slopes(), self._pressed
        if p is None or not (p.slope > 0).any():
            return
        used = np.flatnonzero(p.slope > 0)
        nodes = np.c_[p.met.slaves[used], p.met.corners[used]]
        weights = np.c_[np.ones(used.size), -p.N[used]]
        G = weights[:, :, None] * p.n[used, None]
        self._nodes.couple(nodes, G, p.slope[used], tangent)

    def accept(self) -> None:
        """Store ḡ and the triangle of each node."""
        if (p := self._pressed) is not None and self._mate is not None:
            gap = self._fresh.gap.copy()
            gap[p.at] = p.gaps[1]
            self._notes[id(self._effect)] = PairMemory(gap, self._mate)

    def _gap(self, at: Instant) -> Array:
        # All ranks have the same gaps, which count on the first one.
        return self._memory.gap if self._comm.rank == 0 else np.full(self._k.size, np.inf)

    def pressing(self) -> tuple[Ints, Array]:
        """Pressed nodes: along normals, for corners that bear a share of a node."""
        ways, p = np.zeros((self._surface.size, 3, 3)), self._pressed
        if p is not None:
            deepest = np.minimum(*p.gaps)
            deep = deepest < -CLOSED * np.abs(p.half[p.met.slaves]).max(axis=1, initial=0.0)
            push = (self._k[p.at] * deepest)[deep, None] * p.n[deep]
            share = np.where(p.N > CLOSED, p.N, 0.0)[deep]
            np.add.at(ways[:, 0], p.met.slaves[deep], -push)
            np.add.at(ways[:, 0], p.met.corners[deep], share[:, :, None] * push[:, None])
        return self._nodes.acted(ways)

    def touch(self) -> Touch:
        """Touch of the step; a node pressed within one body has no force, but keeps its energy."""
        none, p = np.zeros((self._k.size, 3)), self._pressed
        if self._comm.rank == 0 and self._nodes.in_one_body:
            return self._touched(self._k, self._memory.gap, none, none)
        if self._comm.rank or p is None:
            return Touch(self.title)
        force = -p.value[:, None] * p.n
        out = self._touched(self._k[p.at], p.gaps[1], force, p.half[p.met.slaves])
        if self._surface.itself:  # each has its reaction on the same surface
            out = replace(out, force=np.zeros(3), moment=np.zeros(3))
        return out

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """Time until the first gap closes; -1 if a node touches [s]. Collective."""
        if self._nodes.in_one_body:
            return np.inf
        x, w = self._nodes.positions(at), self._nodes.velocities(v, at.bodies)
        if (self._memory.gap < 0).any():
            return -1.0
        with _SEARCH:
            mate = self._surface.mates(x + 0.5 * dt * w, self._nodes.rigid)
        met = self._surface.met(mate)
        g, n, N = met.projected(x)
        return soonest(np.maximum(g, 0.0), (n * met.apart(w, N)).sum(axis=1))
