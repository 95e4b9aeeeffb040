"""Displacements of second order: how bending shortens bodies with shapes.

A body that bends by d = Φ q alone gets longer, and its cells pull it back. With the forces f of its
cells about the frozen shape and the static response K⁺ of the whole structure, all nodes go by

    δ = -K⁺ (½ [f(d) + f(-d)] - f(0)) = -½ K⁺ K'[d] d

more, in the frame of the body. U(q) is the energy with δ, to third order, so that steps go without
it. Places that are shown contain it, but for parts that joints alone hold.

Along the shapes it is -½ Ω⁻¹Γqq, see `rigidfx.mechanics.shapes`: K⁺ would make the rounding of
forces large there. A body with Γ moves so by itself, but for b. Beside the shapes it is at a probe,
whose response to unit forces is g = K⁺ e,

    δ = -½ Σ q_k q_l C_kl,    C_kl = g·K'[φ_k] φ_l,

which is found once for each pair of shapes, by forces along φ_k + φ_l, where δ counts for so many
steps that forces along d would cost more.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Joint
from rigidfx.flexible.surface import SMALL_WAY
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.shapes import Shapes
from rigidfx.scene.points import Point
from rigidfx.scene.scene import Scene
from rigidfx.shapes.bends import tension_of
from rigidfx.shapes.excess import About, deformed
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.part import LACKING
from rigidfx.shapes.responses import Responses

Key = tuple[float, ...]
Followed = tuple[Array, Array, Array]
NONE: Array = np.zeros((0, 0, 0))
ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))  # of q, over the length of a body


@dataclass(frozen=True)
class Terms:
    """Forces F_kl = K'[φ_k] φ_l of a body, against responses to unit forces at probes and shapes.

    `at` is g·F_kl of the whole response, shape (3 · probes, m, m) [1/m], and C the same without the
    part along the shapes. `along` is φ_j·F_kl, the same in any order, shape (m, m, m) [N/m²].
    """

    at: Array
    along: Array
    C: Array


class Shortening:
    """δ of the bodies of a run, at probes and as a field."""

    remembered: ClassVar[Remembered] = same(
        "_small", "_counting", "_shown", "_tension", "_asked", "_hung"
    )

    def __init__(
        self,
        scene: Scene,
        points: Mapping[str, Point],
        about: Callable[[Body], About],
        allowed: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """Nothing is computed; `about` expands a body with shapes, collectively.

        Of displacements that are allowed to err [m] it counts from a twentieth on.
        """
        self._scene, self._points, self._about, self._allowed = scene, points, about, allowed
        self._small: dict[Key, float] = {}  # Σ |q| of each body up to which δ counts for little [m]
        self._counting: dict[Key, float] = {}  # Σ |q| from which it is shown [m]
        self._shown: dict[Key, int] = {}  # for how many steps, with forces along d
        self._terms: dict[Key, Terms] = {}  # of each body
        self._follows: dict[Key, Followed] = {}  # how forces bend each body along its shapes
        self._units: dict[int, tuple[Responses, Array]] = {}  # g, (owned nodes, 3, 3 · probes)
        self._tension: dict[Key, Array] = {}  # Γ of the first shapes of bodies that move without it
        self._asked: dict[Key, int] = {}  # m of each body when Γ was asked for last
        self._hung: dict[Key, bool] = {}  # whether joints alone hold each body
        self._modes: dict[Key, tuple[Shapes, Array]] = {}  # shapes of each body, at probes
        self._seen: dict[Key, tuple[int, Array]] = {}  # m of a body, and g without its shapes

    def at_probes(self, bodies: Bodies) -> dict[str, tuple[Array, Array]]:
        """δ [m] and its rate [m/s] at each probe; empty where no body bends by much. Collective."""
        counting = self._those(bodies) if self._points else []
        along = self._along(bodies) if self._points else []
        if not counting and not along:
            return {}
        moved, moving = np.zeros((2, len(self._points), 3))
        for body, by in along:
            motion, modes = body.motion, self._at_points(body)
            own, change = (np.einsum("pka,k->pa", modes, x) @ motion.R.T for x in by)
            moved -= own
            moving -= change + np.cross(motion.angular_velocity, own)
        for body in counting:
            motion, about = body.motion, self._about(body)
            turn = (motion.R @ about.Q).T
            own, change = (x.reshape(-1, 3) @ turn for x in self._of_probes(body, about))
            moved -= own
            moving -= change + np.cross(motion.angular_velocity, own)
        return dict(zip(self._points, zip(moved, moving, strict=True), strict=True))

    def field(self, bodies: Bodies, every: bool = False) -> tuple[Array, Array] | None:
        """δ [m] and its rate [m/s] at the owned nodes; None where no body bends by much.

        It is that of every body, however small, if asked for. Collective.
        """
        counting, along = self._those(bodies, every), self._along(bodies, every)
        if not counting and not along:
            return None
        moved, moving = np.zeros((2, self._scene.owned_nodes, 3))
        for body, by in along:
            nodes, motion = body.data.nodes, body.motion
            own, change = (deformed(body, x) @ motion.R.T for x in by)
            moved[nodes] -= own
            moving[nodes] -= change + np.cross(motion.angular_velocity, own)
        for body in counting:
            motion, about = body.motion, self._about(body)
            forces = self._forces(body, about.part)
            own, change = self._response(body, about, forces)
            moved += own
            moving += change + np.cross(motion.angular_velocity, own)
        return moved, moving

    def _along(self, bodies: Bodies, every: bool = False) -> list[tuple[Body, tuple[Array, Array]]]:
        """Bodies that are shorter along their shapes, with coordinates and rates of that, (m,).

        Collective.
        """
        some = []
        for body in bodies if bodies.of.shapes is not None else ():
            shapes, tension = body.data.shapes, self._tension.get(_key(body), NONE)
            if shapes is None:
                continue
            if shapes.tension is None:
                if every and self._stays(body):
                    tension = tension_of(body, self._about(body).part, tension)
                if len(tension):
                    some.append((body, _drawn(body, tension)))
            elif shapes.shorter is not None and shapes.shorter.any() and self._stays(body):
                shorter = _relieved(shapes, shapes.stiffness @ shapes.shorter)
                some.append((body, (shorter, 0 * shorter)))
        return some

    def _at_points(self, body: Body) -> Array:
        """Shapes of a body at probes, shape (probes, m, 3). Collective where they are new."""
        key, shapes = _key(body), body.data.shapes
        assert shapes is not None
        known = self._modes.get(key)
        if known is None or known[0] is not shapes:
            modes = np.zeros((self._scene.owned_nodes, len(shapes), 3))
            modes[body.data.nodes] = shapes.whole
            at = [np.tensordot(p.weights, modes[p.nodes], 1) for p in self._points.values()]
            self._modes[key] = known = shapes, np.asarray(self._scene.sum(np.stack(at)))
        return known[1]

    def _those(self, bodies: Bodies, every: bool = False) -> list[Body]:
        """The bodies whose δ counts, or every one that has any. Collective."""
        counts = self._stays if every else self._counts
        return [] if bodies.of.shapes is None else [body for body in bodies if counts(body)]

    def _stays(self, body: Body) -> bool:
        """Whether a body bends, and K knows where it is. Collective."""
        return self._bends(body) and not self._hangs(body)

    def _bends(self, body: Body) -> bool:
        return float(np.abs(body.motion.q).sum()) > ROUNDING * body.data.length

    def _counts(self, body: Body) -> bool:
        """Whether δ is above `LACKING`/20 of a body's bend, and of what may err. Collective.

        Of a part p of that, which grows as the body bends, it is looked at again at p^-½ times |q|:
        that leaves as much for shapes that shorten more.
        """
        key, size = _key(body), float(np.abs(body.motion.q).sum())
        counts, m = size >= self._counting.get(key, np.inf), body.data.deforms_by
        if counts and self._asked[key] == m:
            return True
        if not counts and (key in self._counting or size <= self._small.get(key, 0.0)):
            return False
        self._small[key], self._asked[key] = np.inf, m
        if not self._stays(body):
            return False
        about, d = self._about(body), deformed(body, body.stretched[0])
        forces = about.part.even(d)[:, :, None]
        (own,), along = self._response(body, about, forces), self._drawn_by(body, about, forces)
        own[body.data.nodes] -= along @ body.motion.R.T
        size_of = self._largest(own)
        if not counts:
            part = 10 * size_of / max(LACKING * self._largest(d), self._allowed())
            self._small[key] = size / min(max(part, ROUNDING) ** 0.5, 0.5)
            if 2 * part <= 1:
                return False
            self._counting[key] = size / (2 * part)
        if self._largest(along) > LACKING * size_of:
            self._tension[key] = tension_of(body, about.part, self._tension.get(key, NONE))
        return True

    def _drawn_by(self, body: Body, about: About, forces: Array) -> Array:
        """How far forces of second order, (nodes, 3, 1), draw a body without Γ along its shapes.

        The displacement, of shape (nodes, 3) [m], is without its part along q, by which stresses
        stiffen the body. Collective.
        """
        shapes, q = body.data.shapes, body.motion.q
        assert shapes is not None
        if shapes.tension is not None:
            return 0 * forces[:, :, 0]
        modes, _, inverse = self._followed(body, about)
        drawn, image = inverse @ about.part.dot(modes, forces)[:, 0], shapes.mass @ q
        return deformed(body, drawn - q * (image @ drawn) / (image @ q))

    def excess(self, bodies: Bodies, moved: Array | None) -> dict[str, float]:
        """Strain energy of cells, where δ has moved nodes, beyond that of shapes, over this.

        Of bodies by their names; δ has the shape (owned nodes, 3) [m], None for none. Collective.
        """
        out = {}
        for body in bodies if bodies.of.shapes is not None else ():
            if body.data.shapes is not None and self._bends(body):
                part, w = self._about(body).part, deformed(body, body.motion.q)
                if moved is not None:
                    w = w + moved[body.data.nodes] @ body.motion.R
                missed = part.missed(deformed(body, body.stretched[0]), w)
                out[body.data.name] = float(self._scene.sum(missed.sum()))
        return out

    def _hangs(self, body: Body) -> bool:
        """Whether joints alone hold a body, so that K does not know where. Collective."""
        key = _key(body)
        if key not in self._hung:
            self._hung[key] = self._found_to_hang(body, self._about(body).responses)
        return self._hung[key]

    def _found_to_hang(self, body: Body, responses: Responses) -> bool:
        part = responses.rigid.part
        nodes = [v.nodes for joint in self._scene.named(Joint) for v in joint.averages]
        jointed = np.concatenate([part[:0], *(part[own] for own in nodes)])
        jointed = np.concatenate(self._scene.comm.allgather(np.unique(jointed)))
        loose = responses.motions[body.data.nodes].any(axis=(1, 2))
        hangs = loose & np.isin(part[body.data.nodes], jointed)
        return bool(self._scene.sum(np.count_nonzero(hangs)) > 0)

    def _largest(self, u: Array) -> float:
        """The largest norm of any node. Collective."""
        here = float(np.linalg.norm(u, axis=1).max(initial=0.0))
        return self._scene.comm.allreduce(here, op=MPI.MAX)

    def _response(self, body: Body, about: About, forces: Array) -> list[Array]:
        """-K⁺ f in space of forces on a body in its frame, each (owned nodes, 3). Collective."""
        assert body.data.shapes is not None
        modes, weighted, inverse = self._followed(body, about)
        forces = forces - weighted @ (inverse @ about.part.dot(modes, forces))
        F = np.zeros((self._scene.owned_nodes, 3, forces.shape[2]))
        F[body.data.nodes] = np.einsum("ba,nbk->nak", about.Q, forces)
        found, turn = about.responses.solve(F), (body.motion.R @ about.Q).T
        return [-found[:, :, k] @ turn for k in range(forces.shape[2])]

    def _followed(self, body: Body, about: About) -> Followed:
        """Φ, KΦ and (ΦᵀKΦ)⁻¹: forces that bend it along its shapes alone. Collective.

        The inverse is that of shapes whose coordinates no support gives, zero for the others.
        """
        key, shapes = _key(body), body.data.shapes
        assert shapes is not None
        known = self._follows.get(key)
        if known is None or known[0].shape[2] != len(shapes):
            modes = shapes.whole.swapaxes(1, 2)
            weighted = about.part.times_stiffness(modes)
            inverse, free = np.zeros((len(shapes), len(shapes))), slice(shapes.given, None)
            inverse[free, free] = np.linalg.inv(about.part.dot(modes, weighted)[free, free])
            self._follows[key] = known = modes, weighted, inverse
        return known

    def _forces(self, body: Body, part: Expanded) -> Array:
        """½ K'[d] d of a body and its rate, shape (nodes, 3, 2) [N, N/s]. Collective."""
        d, rate = (deformed(body, x) for x in body.stretched)
        sizes = self._largest(d), self._largest(rate)
        h = sizes[0] / sizes[1] if sizes[1] > 0 else 0.0
        change = part.even(d + h * rate) - part.even(d - h * rate)
        return np.stack([part.even(d), change / (2 * h) if h > 0 else change], axis=2)

    def _of_probes(self, body: Body, about: About) -> tuple[Array, Array]:
        """-δ of a body at probes and its rate, in the frame of the start, each (3 · probes,).

        Collective.
        """
        key, m = _key(body), body.data.deforms_by
        known = self._terms.get(key)
        self._shown[key] = self._shown.get(key, 0) + 1
        if 6 * self._shown[key] < m * (m + 1):  # three pairs of forces a step
            forces = self._forces(body, about.part)
            shown, rates = about.part.dot(self._remaining(body, about), forces).T
            return shown, rates
        if known is None or known.C.shape[1] < m:
            known = self._terms[key] = self._grown(body, about, known)
        e, rate = body.stretched
        half = known.C @ e
        return 0.5 * half @ e, half @ rate

    def _grown(self, body: Body, about: About, known: Terms | None) -> Terms:
        """Terms of a body with those of the shapes that it had before. Collective."""
        part, shapes, m = about.part, body.data.shapes, body.data.deforms_by
        assert shapes is not None
        g = self._unit(body, about)
        modes, weighted, inverse = self._followed(body, about)
        h = np.sqrt(SMALL_WAY) * self._scene.mean_cell_size  # strains by h φ are small
        first, at, along = 0, np.zeros((g.shape[2], m, m)), np.zeros((m, m, m))
        if known is not None:
            first = known.C.shape[1]
            at[:, :first, :first], along[:first, :first, :first] = known.at, known.along

        def bent(*some: int) -> tuple[Array, Array]:
            """Half of g·F_kk and φ_i·F_kk along the sum of some shapes."""
            F = part.even(h * shapes.whole[:, some].sum(axis=1))[:, :, None] / h**2
            return part.dot(g, F)[:, 0], part.dot(modes, F)[:, 0]

        for k in range(first, m):
            shown, own = bent(k)
            at[:, k, k] = 2 * shown
            for i in range(k + 1):
                _set(along, (i, k, k), 2 * own[i])
            for j in range(k):
                shown, own = bent(j, k)
                at[:, j, k] = at[:, k, j] = shown - 0.5 * (at[:, j, j] + at[:, k, k])
                for i in range(k):
                    _set(along, (i, j, k), own[i] - 0.5 * (along[i, j, j] + along[i, k, k]))
        follow = part.dot(g, weighted) @ inverse
        return Terms(at, along, at - np.einsum("pi,ijk->pjk", follow, along))

    def _remaining(self, body: Body, about: About) -> Array:
        """g of a body in its frame without the part along its shapes. Collective."""
        key, shapes = _key(body), body.data.shapes
        assert shapes is not None
        m, g = self._seen.get(key, (0, np.empty(0)))
        if m < len(shapes):
            modes, weighted, inverse = self._followed(body, about)
            g = self._unit(body, about)
            g = g - modes @ (inverse @ about.part.dot(weighted, g))
            self._seen[key] = len(shapes), g
        return g

    def _unit(self, body: Body, about: About) -> Array:
        """g of a body in its frame, shape (nodes, 3, 3 · probes) [m/N]. Collective."""
        key = id(about.responses)
        if key not in self._units:
            F = np.zeros((self._scene.owned_nodes, 3, len(self._points), 3))
            for p, point in enumerate(self._points.values()):
                for axis in range(3):
                    F[point.nodes, axis, p, axis] = point.weights
            found = about.responses.solve(F.reshape(len(F), 3, -1))
            self._units[key] = about.responses, found  # which keeps the key from other responses
        return np.asarray(np.einsum("ab,nbp->nap", about.Q, self._units[key][1][body.data.nodes]))


def _drawn(body: Body, tension: Array) -> tuple[Array, Array]:
    """½ Ω⁻¹Γqq and its rate, each (m,) [m, m/s], with Γ of the first shapes."""
    shapes, (q, rate), n = body.data.shapes, (body.motion.q, body.motion.q_rate), len(tension)
    assert shapes is not None
    gained = np.zeros((len(shapes), 2))
    gained[:n] = np.stack([tension @ x[:n] @ q[:n] for x in (0.5 * q, rate)], axis=1)
    drawn, change = _relieved(shapes, gained).T
    return drawn, change


def _relieved(shapes: Shapes, forces: Array) -> Array:
    """Coordinates that balance forces along shapes, (m, ...), but those that supports give."""
    out, k = np.zeros(forces.shape), shapes.given
    out[k:] = np.linalg.solve(shapes.stiffness[k:, k:], forces[k:])
    return out


def _set(symmetric: Array, at: tuple[int, ...], value: float) -> None:
    for order in permutations(at):
        symmetric[order] = value


def _key(body: Body) -> Key:
    """A body of one frozen shape: its number, which it keeps as it gains cells, and its origin."""
    return body.data.number, *(float(x) for x in body.data.origin)
