"""Displacements of second order: how bending shortens bodies with shapes.

A body that bends by d = Φ q alone gets longer, and its cells pull it back. With the forces f of its
cells about the frozen shape and the static response K⁺ of the whole structure, all nodes go by

    δ = -K⁺ h,    h = ½ [f(d) + f(-d)] - f(0) - ∫ S'[d] : ∇wᵀ∇d

more, in the frame of the body. h are forces of strains of second order, ½ ∫ S'[w] : ∇dᵀ∇d. Stresses
of d pull at cells that bend besides: K⁺ is too soft against tension, and shapes answer most. U(q)
is the energy with δ, to third order, so that steps go without it. Places that are shown contain it,
but for parts that joints alone hold.

Along the shapes it is -½ Ω⁻¹Γqq, see `rigidfx.mechanics.shapes`: K⁺ would make the rounding of
forces large there. A body with Γ moves so by itself, but for b. Beside the shapes it is at a probe,
whose response to unit forces is g = K⁺ e,

    δ = -½ Σ q_k q_l C_kl,    C_kl = g·K'[φ_k] φ_l - ∫ S'[φ_k] : sym(∇φ_lᵀ∇g) - (k ↔ l),

which is found once by K' along each g or φ, whichever are fewer, where δ counts for so many steps
that forces along d would cost more. K'[a] b · c is the same in any order of a, b and c.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import ANEW, Each, Remembered
from rigidfx.base.types import Array
from rigidfx.effects import Joint
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.shapes import Shapes
from rigidfx.scene.points import Point
from rigidfx.scene.scene import Scene
from rigidfx.shapes.bends import stresses, tension_of
from rigidfx.shapes.excess import About, deformed
from rigidfx.shapes.expanded import Expanded
from rigidfx.shapes.responses import LACKING, Responses

ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))  # of q, over the length of a body

# Steps by which cells relax where a run or modes begin: a bar that is bent by 5 % has a frequency
# that is 4.8, 0.33, 0.08 % too high with 0, 1, 4.
RELAXED = 4


@dataclass(frozen=True)
class Along:
    """How forces bend a body along its shapes alone.

    The inverse is that of shapes whose coordinates no support gives, zero for the others.
    """

    modes: Array  # Φ, shape (nodes, 3, m)
    images: Array  # KΦ, shape (nodes, 3, m) [N/m]
    inverse: Array  # (ΦᵀKΦ)⁻¹, shape (m, m) [m/N]


@dataclass
class Known:
    """What is known of a body of one frozen shape."""

    small: float  # Σ |q| up to which δ counts for little [m]
    counting: float  # Σ |q| from which it is shown [m]
    shown: int  # for how many steps, with forces along d
    asked: int  # m when Γ was asked for last
    tension: Array  # Γ of its first shapes, if it moves without
    hangs: bool | None = None  # whether joints alone hold it, once that is asked
    along: Along | None = None
    modes: tuple[Shapes, Array] | None = None  # its shapes, and these at probes
    terms: Array | None = None  # C, shape (3 · probes, m, m) [1/m]


class Shortening:
    """δ of the bodies of a run, at probes and as a field."""

    remembered: ClassVar[Remembered] = {"_known": Each(Known, along=ANEW, modes=ANEW)}

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
        # By its number, which a body keeps as it gains cells, and its origin
        self._known: dict[tuple[float, ...], Known] = {}
        self._units: dict[int, tuple[Responses, Array]] = {}  # g, (owned nodes, 3, 3 · probes)

    def _of(self, body: Body) -> Known:
        """What is known of a body, which is nothing at first."""
        key = body.data.number, *(float(x) for x in body.data.origin)
        return self._known.setdefault(key, Known(0.0, np.inf, 0, 0, np.zeros((0, 0, 0))))

    def at_probes(self, bodies: Bodies) -> dict[str, tuple[Array, Array]]:
        """δ [m] and its rate [m/s] at each probe; empty where no body bends by much. Collective."""
        counting, along = self._those(bodies) if self._points else ([], [])
        if not counting and not along:
            return {}
        moved = np.zeros((2, len(self._points), 3))
        for body, by in along:
            moved -= _seen(body, np.einsum("pka,ik->ipa", self._at_points(body), by))
        for body in counting:
            moved -= _seen(body, self._of_probes(body))
        return dict(zip(self._points, zip(*moved, strict=True), strict=True))

    def field(self, bodies: Bodies, every: bool = False) -> Array | None:
        """δ [m] and its rate [m/s] at the owned nodes, shape (2, owned nodes, 3). Collective.

        None where no body bends by much. If asked for, it is that of every body, however small, and
        cells relax further.
        """
        counting, along = self._those(bodies, every)
        if not counting and not along:
            return None
        moved = np.zeros((2, self._scene.owned_nodes, 3))
        for body, by in along:
            moved[:, body.data.nodes] -= _seen(body, np.stack([deformed(body, x) for x in by]))
        for body in counting:
            about = self._about(body)
            moved -= _seen(body, self._response(body, about, self._forces(body, about.part)))
        for body in counting if every else ():
            rolled = self._about(body).part.rolled(deformed(body, body.motion.q))
            moved[0, body.data.nodes] += rolled @ body.motion.R.T
            for _ in range(RELAXED):
                moved[0] += self._further(body, moved[0])
        return moved

    def _further(self, body: Body, moved: Array) -> Array:
        """By how much cells that are moved relax beside shapes, in space. Collective.

        Nodes go along K⁺ until their energy falls no more. Both displacements have the shape (owned
        nodes, 3) [m].
        """
        about, e, w = self._about(body), stresses(body), deformed(body, body.motion.q)
        w, part = w + moved[body.data.nodes] @ body.motion.R, about.part
        forces = part.left(e, w)
        (more,) = -self._response(body, about, forces[:, :, None])
        on, there = more[body.data.nodes], part.left(e, w + more[body.data.nodes])
        falls, after = self._scene.sum([float((f * on).sum()) for f in (forces, there)])
        way = min(falls / (falls - after), 1.0) if after > falls < 0 else 0.0
        return np.asarray(way * more @ body.motion.R.T)

    def _those(
        self, bodies: Bodies, every: bool = False
    ) -> tuple[list[Body], list[tuple[Body, Array]]]:
        """Bodies whose δ beside their shapes counts, and that along them by coordinates: see below.

        Every body that has any, if asked for. Collective.
        """
        some = [] if bodies.of.shapes is None else [b for b in bodies if b.data.shapes is not None]
        counting = [body for body in some if (self._stays if every else self._counts)(body)]
        along = [(body, self._along(body, every)) for body in some]
        return counting, [(body, by) for body, by in along if by is not None]

    def _along(self, body: Body, every: bool) -> Array | None:
        """Coordinates by which a body is shorter along its shapes, and their rates, (2, m).

        None if it is not. Collective.
        """
        shapes, motion = body.data.shapes, np.stack([body.motion.q, body.motion.q_rate])
        assert shapes is not None
        if shapes.tension is None:
            tension = self._of(body).tension
            if every and self._stays(body):
                tension = tension_of(body, self._about(body).part, tension)
            if not len(tension):
                return None
            e = np.stack(replace(shapes, tension=tension).stretched(*motion)) - motion
        elif shapes.shorter is not None and shapes.shorter.any() and self._stays(body):
            e = np.stack([shapes.shorter, 0 * shapes.shorter])
        else:
            return None
        by, k = np.zeros(e.shape), shapes.given
        K = shapes.stiffness[k:]
        by[:, k:] = e[:, k:] + np.linalg.solve(K[:, k:], K[:, :k] @ e[:, :k].T).T
        return by

    def _at_points(self, body: Body) -> Array:
        """Shapes of a body at probes, shape (probes, m, 3). Collective where they are new."""
        known, shapes = self._of(body), body.data.shapes
        assert shapes is not None
        if known.modes is None or known.modes[0] is not shapes:
            modes = np.zeros((self._scene.owned_nodes, len(shapes), 3))
            modes[body.data.nodes] = shapes.whole
            at = [np.tensordot(p.weights, modes[p.nodes], 1) for p in self._points.values()]
            known.modes = shapes, np.asarray(self._scene.sum(np.stack(at)))
        return known.modes[1]

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
        known, size = self._of(body), float(np.abs(body.motion.q).sum())
        counts, m = size >= known.counting, body.data.deforms_by
        if counts and known.asked == m:
            return True
        if not counts and (known.counting < np.inf or size <= known.small or not self._bends(body)):
            return False
        known.small, known.asked = np.inf, m
        if self._hangs(body):
            return False
        about, d = self._about(body), stresses(body)
        forces = about.part.lengthened(d)[:, :, None]
        (own,), along = self._response(body, about, forces), self._drawn_by(body, about, forces)
        own[body.data.nodes] += along
        size_of = _largest(self._scene, own)
        if not counts:
            part = 10 * size_of / max(LACKING * _largest(self._scene, d), self._allowed())
            known.small = size / min(max(part, ROUNDING) ** 0.5, 0.5)
            if 2 * part <= 1:
                return False
            known.counting = size / (2 * part)
        if _largest(self._scene, along) > LACKING * size_of:
            known.tension = tension_of(body, about.part, known.tension)
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
        follow = self._followed(body, about)
        drawn = follow.inverse @ about.part.dot(follow.modes, forces)[:, 0]
        image = shapes.mass @ q
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
                out[body.data.name] = float(self._scene.sum(part.missed(stresses(body), w).sum()))
        return out

    def _hangs(self, body: Body) -> bool:
        """Whether joints alone hold a body, so that K does not know where. Collective."""
        known, nodes = self._of(body), body.data.nodes
        if known.hangs is None:
            responses = self._about(body).responses
            loose = np.zeros_like(responses.motions)
            loose[nodes] = responses.motions[nodes]
            each = [v.nodes for joint in self._scene.named(Joint) for v in joint.averages]
            known.hangs = bool(responses.act_on(np.concatenate([nodes[:0], *each]), loose).any())
        return known.hangs

    def _response(self, body: Body, about: About, forces: Array) -> Array:
        """K⁺ f of forces on a body, both in its frame, shape (k, owned nodes, 3). Collective."""
        F = np.zeros((self._scene.owned_nodes, 3, forces.shape[2]))
        F[body.data.nodes] = np.einsum("ba,nbk->nak", about.Q, self._beside(body, about, forces))
        return np.einsum("ab,nbk->kna", about.Q, about.responses.solve(F))

    def _beside(self, body: Body, about: About, forces: Array) -> Array:
        """Forces less those by which a body follows along its shapes, (nodes, 3, k). Collective."""
        follow = self._followed(body, about)
        return forces - follow.images @ (follow.inverse @ about.part.dot(follow.modes, forces))

    def _followed(self, body: Body, about: About) -> Along:
        """How forces bend it along its shapes. Collective."""
        known, shapes = self._of(body), body.data.shapes
        assert shapes is not None
        if known.along is None or len(known.along.inverse) != len(shapes):
            modes = shapes.whole.swapaxes(1, 2)
            images = about.part.times_stiffness(modes)
            inverse, free = np.zeros((len(shapes), len(shapes))), slice(shapes.given, None)
            inverse[free, free] = np.linalg.inv(about.part.dot(modes, images)[free, free])
            known.along = Along(modes, images, inverse)
        return known.along

    def _forces(self, body: Body, part: Expanded) -> Array:
        """½ K'[d] d of a body and its rate, shape (nodes, 3, 2) [N, N/s]. Collective."""
        d, rate = (deformed(body, x) for x in body.stretched)
        sizes = _largest(self._scene, d), _largest(self._scene, rate)
        h = sizes[0] / sizes[1] if sizes[1] > 0 else 0.0
        change = part.lengthened(d + h * rate) - part.lengthened(d - h * rate)
        return np.stack([part.lengthened(d), change / (2 * h) if h > 0 else change], axis=2)

    def _of_probes(self, body: Body) -> Array:
        """-δ of a body at probes and its rate, in its frame, shape (2, probes, 3). Collective."""
        known, m, about = self._of(body), body.data.deforms_by, self._about(body)
        if known.terms is None or known.terms.shape[1] < m:
            g = self._unit(body, about)
            known.shown += 1
            # Two tangents each, for the price of six pairs of forces; there are three pairs a step.
            if known.shown <= 4 * min(g.shape[2], m):
                forces = self._beside(body, about, self._forces(body, about.part))
                return about.part.dot(g, forces).T.reshape(2, -1, 3) @ about.Q.T
            known.terms, known.shown = self._curvature(body, about, g), 0
        e, rate = body.stretched
        half = known.terms @ e
        return np.stack([0.5 * half @ e, half @ rate]).reshape(2, -1, 3) @ about.Q.T

    def _curvature(self, body: Body, about: About, g: Array) -> Array:
        """C of a body, by responses at its nodes, shape (nodes, 3, 3 · probes). Collective."""
        part, follow = about.part, self._followed(body, about)
        g = part.unmoved(g - follow.modes @ (follow.inverse @ part.dot(follow.images, g)))
        if g.shape[2] < follow.modes.shape[2]:
            each = [part.turned_by(x, follow.modes, follow.modes) for x in np.moveaxis(g, 2, 0)]
            found = np.stack(each)
        else:
            each = [part.turned_by(x, g, follow.modes) for x in np.moveaxis(follow.modes, 2, 0)]
            found = np.stack(each, axis=1)
        m = follow.modes.shape[2]
        pull = part.tension_by(follow.modes, np.concatenate([follow.modes, g], axis=2))[:, :m, m:]
        return found - (pull + pull.swapaxes(0, 1)).transpose(2, 0, 1)

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


def _seen(body: Body, by: Array) -> Array:
    """Displacements in the frame of a body and their rates there, (2, places, 3), in space."""
    moved, change = by @ body.motion.R.T
    return np.stack([moved, change + np.cross(body.motion.angular_velocity, moved)])


def _largest(scene: Scene, u: Array) -> float:
    """The largest norm of any node. Collective."""
    here = float(np.linalg.norm(u, axis=1).max(initial=0.0))
    return scene.comm.allreduce(here, op=MPI.MAX)
