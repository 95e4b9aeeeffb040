"""The surface that a contact acts on, its stiffnesses, and the penalty U(g) = ½ k g₋² of a gap g.

Contact acts at nodes, by areas and secants of docs/theory/contact.md. By default the stiffness is
that of a layer of the cells behind, `LAYERS` (λ + 2μ)/h for an area, h being their thickness there.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import basix
import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering

from rigidfx.base.errors import SceneError
from rigidfx.base.form_cache import form_on
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Action, Structure, Touch
from rigidfx.effects.nodes import Instant
from rigidfx.mechanics.materials import Material

LAYERS = 5.0  # default stiffness in those of a layer of cells
STRAIN = 1e-4  # at which a material's modulus is measured

Found = TypeVar("Found")
_known: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()  # of each scene


@dataclass(frozen=True)
class ContactSurface:
    """Nodal data of a surface, per local node with ghosts; zero off the surface."""

    area: Array  # in the reference [m²]
    stiffness: Array  # [N/m]
    size: float  # a typical distance of its nodes [m], equal on all ranks


def once(find: Callable[..., Found]) -> Callable[..., Found]:
    """Let a function of a scene find data once for all owners, who come last and for messages."""

    @wraps(find)
    def found(scene: Any, *given: Any) -> Found:
        known, key = _known.setdefault(scene, {}), (find, *given[:-1])
        if key not in known:
            known[key] = find(scene, *given)
        out: Found = known[key]
        return out

    return found


@once
def surface_of(scene: Any, where: str, stiffness: float | None, owner: str) -> ContactSurface:
    """The surface of a set of facets; found once for a scene. Collective.

    Stiffness of an area [N/m³] is that of the material if None. `SceneError` if the set is unknown,
    has facets inside the mesh or none, or a material tells no stiffness.
    """
    area = _weights(scene, where, owner)
    if stiffness is not None:
        k = stiffness * area
    else:
        k = _weights(scene, where, owner, _layers(scene, where, owner))
    own = area[: scene.owned_nodes]
    total, count = scene.sum([own.sum(), np.count_nonzero(own)])
    if not count:
        raise SceneError(f"{owner}: '{where}' has no facets.")
    return ContactSurface(area, k, float(np.sqrt(total / count)))


def _weights(scene: Any, where: str, owner: str, density: fem.Function | None = None) -> Array:
    """Areas of nodes, times a density of the cells behind if there is one. Collective."""
    if not (scene.simplex and scene.order == 2):
        return np.asarray(scene.facet_weights(where, owner, 1.0 if density is None else density))
    out = fem.Function(scene.space)
    nodal, X = out.x.array.reshape(-1, 3)[:, 0], scene.space.tabulate_dof_coordinates()
    cells, nodes = triangles_of(scene, where, owner)
    share = np.linalg.norm(area_vectors(X[nodes]), axis=1) / 3
    if density is not None:
        share *= density.x.array[density.function_space.dofmap.list[cells, 0]]
    np.add.at(nodal, nodes, share[:, None])
    out.x.scatter_reverse(la.InsertMode.add)
    out.x.scatter_forward()
    return out.x.array[::3].copy()


def triangles_of(scene: Any, where: str, owner: str) -> tuple[Ints, Ints]:
    """Flat triangles of a set's owned boundary facets: cells behind, local nodes. Collective."""
    facets, dofs = scene.boundary(where, owner), scene.space.dofmap.list
    cells, nodes = [np.empty(0, np.int64)], [np.empty((0, 3), np.int64)]
    for number, triangles in enumerate(_reference_triangles(scene)):
        mine = facets[facets[:, 1] == number, 0]
        cells.append(np.repeat(mine, len(triangles)))
        nodes.append(dofs[mine][:, triangles].reshape(-1, 3))
    every, out = np.concatenate(cells), np.concatenate(nodes)
    X = scene.space.tabulate_dof_coordinates()
    outwards = X[out].mean(axis=1) - X[dofs[every]].mean(axis=1)
    # Nodes have such an order that normals point out of the cell.
    inwards = (outwards * area_vectors(X[out])).sum(axis=1) < 0
    out[inwards] = out[inwards][:, [0, 2, 1]]
    return every, out


def _reference_triangles(scene: Any) -> list[Ints]:
    """For each local facet of a cell, triangles between its nodes, as places in a cell's dofs."""
    cell = basix.CellType.tetrahedron if scene.simplex else basix.CellType.hexahedron
    vertices, edges = basix.topology(cell)[2], basix.topology(cell)[1]
    layout = scene.space.dofmap.dof_layout
    corner = [layout.entity_dofs(0, v)[0] for v in range(len(basix.topology(cell)[0]))]

    def between(a: int, b: int) -> int:
        return int(layout.entity_dofs(1, edges.index(sorted((a, b))))[0])

    out = []
    for f, own in enumerate(vertices):
        c = [corner[v] for v in own]
        if scene.simplex and scene.order == 1:
            out.append([c])
        elif scene.simplex:
            (a, b, d), e = c, [between(own[i], own[j]) for i, j in ((0, 1), (1, 2), (0, 2))]
            out.append([[a, e[0], e[2]], [e[0], b, e[1]], [e[2], e[1], d], e])
        else:
            grid = np.reshape(c, (2, 2))
            if scene.order == 2:
                e = [between(own[i], own[j]) for i, j in ((0, 1), (0, 2), (1, 3), (2, 3))]
                middle = layout.entity_dofs(2, f)[0]
                grid = np.array([[c[0], e[0], c[1]], [e[1], middle, e[2]], [c[2], e[3], c[3]]])
            quads = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
            q = np.stack([part.reshape(-1) for part in quads], axis=1)
            out.append(np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]]))
    return [np.asarray(triangles, dtype=np.int64) for triangles in out]


def area_vectors(corners: Array) -> Array:
    """Normals of triangles, shape (n, 3, 3) [m], as long as their areas, shape (n, 3) [m²]."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(0.5 * np.cross(a, b))


def _layers(scene: Any, where: str, owner: str) -> fem.Function:
    """Stiffness of a layer of cells for an area, (λ + 2μ)/h, behind facets [N/m³]. Collective."""
    space = scene.cell_space
    test, facets = ufl.TestFunction(space), scene.boundary(where, owner)
    ds = ufl.Measure("ds", domain=scene.mesh, subdomain_data=[(1, facets.reshape(-1))])(1)
    forms = test * ufl.dx(domain=scene.mesh), test * ds
    volume, area = (fem.assemble_vector(form_on(scene.comm, form)).array for form in forms)
    # h is the volume of a cell by the area of its facets in the set; the height of a tetrahedron.
    count = np.bincount(space.dofmap.list[facets[:, 0], 0], minlength=volume.size)
    out = scene.cellwise([(_modulus(scene, m, owner), cells) for m, cells in scene.materials])
    thickness = (3.0 if scene.simplex else 1.0) * volume * count
    out.x.array[:] *= LAYERS * np.divide(area, thickness, where=count > 0, out=np.zeros(area.size))
    out.x.scatter_forward()
    return out


def _modulus(scene: Any, material: Material, owner: str) -> float:
    """λ + 2μ of a material at rest [Pa]; `SceneError` on every rank if unknown. Collective."""
    modulus = modulus_of(scene.comm, material)
    if np.isnan(modulus):
        raise SceneError(
            f"{owner}: {type(material).__name__} does not tell how stiff contact is to be; give "
            "stiffness [N/m³], some ten times (λ + 2μ)/h of a cell of size h."
        )
    return modulus


def modulus_of(comm: MPI.Intracomm, material: Material) -> float:
    """λ + 2μ of a material at rest by its energy [Pa]; NaN if that does not tell it. Collective."""

    def energy(strain: float) -> float:
        C = ufl.as_matrix(np.diag([1 + 2 * strain, 1.0, 1.0]).tolist())
        W = ufl.as_ufl(material.energy(C, **material.parameters))
        return float(apply_algebra_lowering(W)((0.0, 0.0, 0.0)))

    try:
        modulus = (energy(STRAIN) - 2 * energy(0.0) + energy(-STRAIN)) / STRAIN**2
    except Exception:  # whatever UFL may raise about a user's energy
        modulus = np.nan
    known = comm.allreduce(bool(modulus > 0), op=MPI.LAND)
    return float(modulus) if known else np.nan


CLOSED = 1e-12  # of a point's coordinates: a gap that statics take for closed, as it rounds to zero
STALE = 0.05  # change of a derivative, which is k/2 at most, by k: a tangent does not fit any more


def stored(k: Array, g: Array) -> Array:
    """U of gaps g [m] with stiffnesses k [N/m], shape (n,) [J]."""
    return np.asarray(0.5 * k * np.minimum(g, 0.0) ** 2)


def secant(k: Array, g0: Array, g1: Array, static: bool = False) -> tuple[Array, Array]:
    """[U] ≤ 0 at gaps from g0 to g1 [m], and its derivative by g1, never negative, shape (n,).

    In statics both gaps are those at the end, and the derivative is by both.
    """
    closes, opens = (g0 >= 0) & (g1 < 0), (g0 < 0) & (g1 >= 0)
    apart = np.where(closes | opens, g1 - g0, 1.0)
    share0, share1 = g0 / apart, g1 / apart
    half = np.where((g0 < 0) & (g1 < 0), 0.5 * k, 0.0)
    value, slope = half * (g0 + g1), half
    value = np.where(closes, 0.5 * k * g1 * share1, value)
    slope = np.where(closes, 0.5 * k * share1 * (2 - share1), slope)
    value = np.where(opens, -0.5 * k * g0 * share0, value)
    slope = np.where(opens, 0.5 * k * share0**2, slope)
    return value, 2 * slope if static else slope


def soonest(g: Array, rate: Array) -> float:
    """Time [s] until the first of some gaps ≥ 0 closes at constant rates [m/s]; inf if none."""
    comes = rate < 0
    with np.errstate(over="ignore"):  # in longer than there are numbers
        return float((g[comes] / -rate[comes]).min(initial=np.inf))


@dataclass(frozen=True)
class Pressed:
    """Points on which forces may act at an iterate."""

    at: Ints  # their places among all points
    gaps: tuple[Array, Array]  # at both ends of the step [m]
    value: Array  # [U] [N]
    slope: Array  # its derivative by the second gap [N/m]

    @property
    def grip(self) -> Array:
        """Friction over the slide, shape (n,) [N/m]; none without."""
        return np.zeros(len(self.at))


class ContactForces(Action):
    """The forces of a contact at points with stiffnesses; its kind says which gaps they have."""

    presses = True

    def __init__(self, effect: Any, k: Array, structure: Structure) -> None:
        """Store the stiffnesses, shape (n,) [N/m]."""
        self.kind, self.title = effect.kind, effect.title
        self._k, self._static = k, structure.static
        self._pressed: Any = None  # at the last iterate; None before the first of a step
        self._in_tangent: Array = np.zeros((2, k.size))

    def _slopes(self) -> Array:
        """Derivatives of [U] by g₁, and of friction where points stick, shape (2, n) [N/m]."""
        out, p = np.zeros((2, self._k.size)), self._pressed
        if p is not None:
            out[:, p.at] = p.slope, p.grip
        return out

    def _gap(self, at: Instant) -> Array:
        """Gaps of all points, shape (n,) [m]."""
        raise NotImplementedError

    def outdated(self) -> bool:
        """Whether points of this rank closed, opened, stuck or slipped since the last tangent."""
        now = self._slopes()
        return bool((np.abs(now - self._in_tangent) > STALE * np.maximum(self._k, now)).any())

    def stored(self, at: Instant) -> float:
        """Σ U of the gaps [J]."""
        return float(stored(self._k, self._gap(at)).sum())

    def creep_for(self, time: float, began: Instant) -> None:
        """Let friction be that of a longer motion [s] from `began` on, until times are set anew."""

    def pressing(self) -> tuple[Ints, Array]:
        """Owned nodes that are pressed, deeper than rounding, and up to three directions of forces.

        The main one is first, zero ones stand for none, shape (nodes, 3, 3).
        """
        raise NotImplementedError

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """Time until a node of this rank touches, at constant velocities v of the rows. Collective.

        Infinity if none does, -1 if one touches already [s]; dt is the length of the next step [s].
        """
        raise NotImplementedError

    def touch(self) -> Touch:
        """Touch of the contact on this rank in the step that has been solved."""
        raise NotImplementedError

    def _touched(self, k: Array, g: Array, force: Array, place: Array) -> Touch:
        """Touch of some points by their gaps, the forces on them and where these act."""
        return Touch(
            self.title,
            force=force.sum(axis=0),
            moment=np.cross(place, force).sum(axis=0),
            pressing=float(np.linalg.norm(force, axis=1).sum()),
            energy=float(stored(k, g).sum()),
            penetration=float(np.maximum(-g, 0.0).max(initial=0.0)),
            nodes=int(np.count_nonzero(g < 0)),
        )
