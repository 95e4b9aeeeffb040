"""Sides of a joint and ends of springs: rigid parts, faces, the ground, mean places of sets.

Facets of holes, shafts, balls and sockets tell their axis and centre. Vertices of a sphere, or of a
cylinder across its axis, have |x - c|² = r², which is linear in c and in r² - |c|². Normals n of a
cylinder are perpendicular to its axis: there Σ A n nᵀ vanishes. Those of a sphere point along
x - c: the vertices of a hole between two rings lie on a sphere too.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.domain.domain import nodes_of
from rigidfx.effects.base import Vector as Point
from rigidfx.effects.base import must_be
from rigidfx.effects.joints.vectors import Vector, slopes_of
from rigidfx.effects.supports import Support
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import skew

GROUND = "ground"
ROUND = 0.02  # part of the normals' squares along the axis, or of the radius, that may be off
FAR = 20.0  # times its own size, that a surface may be away from its joint or remote point


class Grounded:
    """The ground as a side: it does not move, and has no nodes, extent and mass of its own."""

    size = mass = np.inf
    centre = np.full(3, np.nan)  # from which nothing is far
    nodes = np.empty(0, np.int64)

    def place(self, point: Array) -> Vector:
        """The point itself."""
        return Vector(constant=point, start=point, is_place=True)

    def direction(self, a: Array) -> Vector:
        """The direction itself."""
        return Vector(constant=a, start=a)


class Averages:
    """Nodes with weights as a side: `size` is the root of Σ w |X - X̄|², axes are its columns'."""

    def __init__(self, scene: Any, weights: Array, title: str) -> None:
        """Find centre and second moments, by w of each owned node in any unit. Collective.

        `SceneError` on every rank, if the nodes have no weight or lie on a line.
        """
        self.nodes = np.flatnonzero(weights)
        w, X = weights[self.nodes], scene.start_places[self.nodes]
        mass = scene.averaging_mass[self.nodes]
        sums = scene.sum(np.r_[w.sum(), w @ X, mass.sum(), self.nodes.size])
        self.count = int(sums[5])
        total = sums[0] if sums[0] > 0 else 1.0
        self.centre, self.mass = sums[1:4] / total, float(sums[4])
        self._w, self._arms = w / total, X - self.centre
        second = scene.sum((self._w[:, None] * self._arms).T @ self._arms)
        self._second, self.axes = np.linalg.eigh(second)
        self.axes[:, 0] *= np.linalg.det(self.axes)  # right-handed
        line = np.finfo(np.float64).eps ** (2 / 3)  # of the largest second moment
        if self.count < 3 or not sums[0] > 0 or not self._second[1] > line * self._second[2]:
            raise SceneError(
                f"{title}: a side of a joint needs nodes that span a plane at least; its "
                f"{self.count} with weight lie on a line. Name a larger set."
            )
        self.size = float(np.sqrt(np.trace(second)))

    def _inverse(self, a: Array) -> Array:
        """W⁻¹ a."""
        return np.asarray(self.axes @ (a @ self.axes / self._second))

    def place(self, point: Array) -> Vector:
        """Where a point of the side is by its affine mean."""
        arm = point - self.centre
        weights = self._w * (1.0 + self._arms @ self._inverse(arm))
        return Vector(self.nodes, weights, start=point, is_place=True)

    def direction(self, a: Array) -> Vector:
        """Where a direction of the side points by its affine mean."""
        return Vector(self.nodes, self._w * (self._arms @ self._inverse(a)), start=a)


class FaceSide(Averages):
    """A face as a side, of which a body may hold all nodes; its averages are x̄ and the H_k."""

    def __init__(self, scene: Any, weights: Array, title: str) -> None:
        """See `Averages`. Collective."""
        super().__init__(scene, weights, title)
        middle = Vector(self.nodes, self._w, start=self.centre, is_place=True)
        along = self._w[:, None] * (self._arms @ self.axes) / self.size**2
        H = self._second[:, None] * self.axes.T / self.size**2
        turned = (Vector(self.nodes, w, start=own) for w, own in zip(along.T, H, strict=True))
        self.averages = (middle, *turned)

    def place(self, point: Array) -> Vector:
        """Where a point of the side is."""
        arm = point - self.centre
        rounding = self.count * np.spacing(np.abs(self.centre).max() + self.size)
        if np.abs(arm).max() <= rounding:
            return self.averages[0]
        return replace(self.direction(arm), start=self.centre + arm, is_place=True)

    def direction(self, a: Array) -> Vector:
        """Where a direction of the side points."""
        return Vector(self.nodes, self._w, start=a, face=self, holder=self, arm=a)

    def within(self, scene: Any, bodies: Sequence[RigidBody]) -> tuple[int, Array, Array] | None:
        """Number, V̄ [m] and Σ w (X - X̄) ⊗ V [m²] of the body that holds all nodes. Collective."""
        local = np.zeros((len(bodies), 1 + 3 + 9))
        for out, body in zip(local, bodies, strict=True):
            if body.shapes is not None:  # it deforms
                continue
            at = np.minimum(np.searchsorted(body.nodes, self.nodes), max(body.nodes.size - 1, 0))
            here = body.nodes[at] == self.nodes if body.nodes.size else np.zeros(at.size, bool)
            w, V = self._w[here, None], body.offsets[at[here]]
            out[0], out[1:4] = np.count_nonzero(here), (w * V).sum(axis=0)
            out[4:] = ((w * self._arms[here]).T @ V).reshape(-1)
        sums = np.asarray(scene.sum(local))
        found = np.flatnonzero(sums[:, 0] == self.count)
        if not found.size:
            return None
        own = sums[found[0]]
        return int(found[0]), own[1:4], own[4:].reshape(3, 3)

    def unit_loads(self) -> Array:
        """Forces by unit forces and couples along x, y, z at the start, shape (nodes, 3, 6) [N]."""
        turned = [0.5 * skew(e) @ slopes_of(self.direction(e)) for e in np.eye(3)]
        moved = slopes_of(self.averages[0]), np.sum(turned, axis=0)
        return np.concatenate(moved, axis=1).swapaxes(1, 2)


Sided = Averages | Grounded


@dataclass(frozen=True)
class Surface:
    """A surface as a side: a set of boundary facets, such as a hole."""

    where: str

    def __post_init__(self) -> None:
        """Refuse a name that is none."""
        if not isinstance(self.where, str) or not self.where:
            kind, given = type(self).__name__, shown(self.where)
            raise SceneError(f"{kind}: where must be the name of a set of facets, got {given}.")

    @property
    def name(self) -> str:
        """Its name in messages and reports."""
        return f"{type(self).__name__} '{self.where}'"


@dataclass(frozen=True)
class MeanFace(Surface):
    """A surface that a joint holds by its mean position and the rotation that fits its nodes best.

    Nodes are weighted by areas. The joint's force is spread over the surface, which may deform
    (distributing coupling, RBE3).

    Attributes:
        where: Name of a set of boundary facets, such as a hole.
    """


@dataclass(frozen=True)
class RigidFace(Surface):
    """A surface whose nodes move as one rigid body (kinematic coupling, RBE2).

    It is stiffer than a real pin, and a `MeanFace` is softer. Stresses beside it are those of a
    glued pin. Its nodes have six unknowns. Cells round it become rigid all together or not at all.

    Attributes:
        where: Name of a set of boundary facets, such as a hole.
    """


Side = str | Surface


def one_side(named: str) -> Callable[[str, str, Any], None]:
    """A check that a field is a side; a text is the name of what `named` says."""
    words = f"'{GROUND}', {named}, a MeanFace or a RigidFace"
    return must_be(words, lambda side: isinstance(side, Surface | str) and side != "")


def side_name(side: Side) -> str:
    """A side in words."""
    return f"'{side}'" if isinstance(side, str) else side.name


def rigid_faces(effects: Iterable[Any]) -> tuple[RigidFace, ...]:
    """The rigid faces that effects take hold of, each once, in the order given."""
    sides = (side for effect in effects for side in getattr(effect, "sides", ()))
    return tuple(dict.fromkeys(side for side in sides if isinstance(side, RigidFace)))


def side_of(scene: Any, owner: str, side: Side) -> Sided:
    """A side as averages over nodes; raise `SceneError` if there is none such. Collective."""
    title, n = f"{owner}, {side_name(side)}", scene.owned_nodes
    if isinstance(side, Surface):
        weights = np.asarray(scene.facet_weights(side.where, owner)[:n])
        return FaceSide(scene, weights, title)
    if side == GROUND:
        return Grounded()
    rigid = _rigid_parts(scene)
    if side not in rigid:
        raise SceneError(
            f"{owner}: '{side}' is no Rigid part; there are {sorted(rigid) or 'none'}. A surface "
            f"is joined by MeanFace('{side}'), the ground is '{GROUND}'."
        )
    where, kind = rigid[side]
    weights = np.array(scene.averaging_mass[:n])
    weights *= scene.members(where, owner)[:n, 0]
    return kind(scene, weights, title)


def _rigid_parts(scene: Any) -> dict[str, tuple[str | None, type[Averages]]]:
    """Sets of rigid parts by name, and how they are sides: as faces in a part that deforms."""
    parts = (e for e in scene.effects if e.is_body and e.deforms)
    inside = {name: (name, FaceSide) for part in parts for name in part.stiff}
    return {e.name: (e.where, Averages) for e in scene.effects if e.is_rigid} | inside


def end_of(scene: Any, owner: str, side: Side, at: Point | None = None) -> Vector:
    """An end, for `RemoteNodes`; `SceneError` on every rank if there is none. Collective.

    Of the ground its place `at` the start is needed [m]; of a part or a face it is the centre if
    None.
    """
    given = None if at is None else np.asarray(at, dtype=np.float64)
    if isinstance(side, Surface) or side == GROUND or side in _rigid_parts(scene):
        found = side_of(scene, owner, side)
        point = found.centre if given is None else given
        if np.isnan(point).any():
            raise SceneError(f"{owner}: its end on the ground needs a place: give it [m].")
        _check_place(scene, owner, side, found, point)
        return found.place(point)
    if given is not None:
        raise SceneError(
            f"{owner}: its end on {side_name(side)} is the mean place of the nodes of a set. Leave "
            "its place out, or name a Rigid part, a MeanFace or a RigidFace."
        )
    own = scene.nodes(side, owner)
    own = own[own < scene.owned_nodes].astype(np.int64)
    weights = np.full(own.size, 1.0 / scene.sum(own.size))
    point = np.asarray(scene.sum(weights @ scene.start_places[own]))
    return Vector(own, weights, start=point, is_place=True)


def check_sides(
    scene: Any, owner: str, names: tuple[Side, ...], sides: tuple[Sided, ...], at: Array
) -> None:
    """Check the sides of a joint, or the face of a remote point, as far as possible. Collective.

    `SceneError` on every rank, if both are in one rigid part, if a support holds all of one, or if
    a surface is far away from the joint, which is `at` there [m].
    """
    moving = [(n, s) for n, s in zip(names, sides, strict=True) if not isinstance(s, Grounded)]
    for name, side in moving:
        for support in scene.named(Support):
            if len(support.axes) == 3 and _among(scene, side, support.where, support.kind):
                raise SceneError(
                    f"{owner}: {support.owner} holds all of {side_name(name)}. Join the 'ground' "
                    "in its place, or hold less."
                )
    for rigid in () if len(moving) < 2 else (e for e in scene.effects if e.is_rigid):
        if all(_among(scene, side, rigid.where, rigid.kind) for side in sides):
            raise SceneError(
                f"{owner}: both sides are of one part, {rigid.owner}, and cannot move against each "
                "other."
            )
    for name, side in moving:
        _check_place(scene, owner, name, side, at, joined=len(sides) > 1)


def _check_place(
    scene: Any, owner: str, name: Side, side: Any, at: Array, joined: bool = False
) -> None:
    """Refuse a point that is very far away from its surface, and warn of one far from its side.

    A joint is expected on its surface. Remote points may be on arms, and so may joints of parts.
    The cells of parts of given mass or inertia may be anywhere.
    """
    away = float(np.linalg.norm(at - side.centre))
    is_surface = isinstance(name, Surface)
    if is_surface and round(away / side.size, 6) > FAR:
        raise SceneError(
            f"{owner}: {'its sides do not meet: ' * joined}it is at {_place(at)} m, and "
            f"{side_name(name)} is around {_place(side.centre)} m, {away:.3g} m away and "
            f"{side.size:.3g} m large."
        )
    most = FAR / 4 if joined and is_surface else FAR / 2  # sizes of the side
    given = [rigid.name for rigid in scene.effects if rigid.is_rigid and rigid.given]
    if away > most * side.size and name not in given:
        warn(
            scene.comm,
            f"{owner}: it is at {_place(at)} m, {away:.3g} m away from the middle of "
            f"{side_name(name)}, which is {side.size:.3g} m large (root mean square): it moves "
            "with it as on a rigid arm. Check `at`, in metres, and the side.",
        )


def _among(scene: Any, side: Sided, where: str | None, kind: str) -> bool:
    """Whether all nodes of a side are in a set. Collective."""
    outside = scene.members(where, kind)[side.nodes, 0] == 0.0
    return bool(scene.sum(np.count_nonzero(outside)) == 0)


def _place(x: Array) -> str:
    """A place, without the rounding of coordinates that are zero."""
    return f"({', '.join(f'{each:.4g}' for each in x.round(9) + 0.0)})"


def cylinder_of(scene: Any, owner: str, where: str) -> tuple[Array, Array] | None:
    """Middle and unit axis of a surface, shapes (3,); None if it is no cylinder. Collective."""
    x, middle, n = _facets(scene, owner, where)
    area = np.linalg.norm(n, axis=1)
    n /= np.where(area > 0, area, 1.0)[:, None]
    second = np.asarray(scene.sum((area[:, None] * n).T @ n))
    values, axes = np.linalg.eigh(second / np.trace(second))
    axis = axes[:, 0] * np.sign(axes[np.argmax(np.abs(axes[:, 0])), 0])
    across, points = axes[:, 1:], x.reshape(-1, 3)
    centre, radius, off = _fitted(scene, points @ across)
    along = points @ axis
    (low,), (high,) = scene.box_of(along[:, None])
    worst = max(scene.comm.allgather(off))
    if values[0] > ROUND or values[1] < ROUND or not worst <= ROUND * radius:
        return None
    return middle + across @ centre + 0.5 * (low + high) * axis, axis


def sphere_of(scene: Any, owner: str, where: str) -> tuple[Array, Array] | None:
    """Centre of a spherical surface, and no axis, shapes (3,); None if it is none. Collective."""
    x, middle, n = _facets(scene, owner, where)
    centre, radius, off = _fitted(scene, x.reshape(-1, 3))
    out = (x - centre).mean(axis=1)
    sizes = np.linalg.norm(n, axis=1) * np.linalg.norm(out, axis=1)
    along = np.abs((n * out).sum(axis=1))
    tilted = 1 - (along / np.where(sizes > 0, sizes, 1.0)).min(initial=1.0)
    worst, tilt = np.max(scene.comm.allgather((off, tilted)), axis=0)
    round_enough = worst <= ROUND * radius and tilt <= ROUND
    return (middle + centre, np.full(3, np.nan)) if round_enough else None


def _facets(scene: Any, owner: str, where: str) -> tuple[Array, Array, Array]:
    """Corners of owned facets less their mean place on all ranks, that, and normals. Collective."""
    mesh, pairs = scene.mesh, scene.boundary(where, owner)
    mesh.topology.create_connectivity(3, 2)
    facets = mesh.topology.connectivity(3, 2)
    numbers = np.array([facets.links(cell)[k] for cell, k in pairs], dtype=np.int32)
    corners = nodes_of(mesh, 2, numbers)[:, : 3 if scene.simplex else 4]
    x: Array = mesh.geometry.x[corners]
    n = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    total = np.asarray(scene.sum(np.r_[x.sum(axis=(0, 1)), float(x[..., 0].size)]))
    middle = total[:3] / max(total[3], 1.0)  # a fit about a far origin would lose digits
    return x - middle, middle, np.asarray(n)


def _fitted(scene: Any, x: Array) -> tuple[Array, float, float]:
    """Centre and radius of the circle or sphere that fits best, and this rank's error [m]."""
    rows, squares = np.c_[2 * x, np.ones(len(x))], (x**2).sum(axis=1)
    left, right = (np.asarray(scene.sum(v)) for v in (rows.T @ rows, rows.T @ squares))
    *found, rest = np.linalg.lstsq(left, right, rcond=None)[0]
    centre = np.array(found)
    radius = float(np.sqrt(max(rest + centre @ centre, 0.0)))
    off = np.abs(np.linalg.norm(x - centre, axis=1) - radius).max(initial=0.0)
    return centre, radius, float(off)
