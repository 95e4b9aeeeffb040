"""Forces on the nodes of a body as combinations of few fields, and of what is beside them.

    ρ = B c + f ,    B = [f⁰, m, m V, m Φ₁, K Φ₁, ..., m Φ_m, K Φ_m] ,

with c of each field in each direction, and f of loads, springs, contacts and flexible cells, zero
at most nodes. With W the inverse masses of nodes, Γ = Bᵀ W B is known, and h = Bᵀ W f is all that f
adds, so that sizes of ρ take no sums over all nodes:

    ‖ρ‖² = ρ·W ρ = c·Γ c + 2 c·h + f·W f ,    [1, V, Φ]ᵀ ρ = the rows of Γ c + h of [m, m V, m Φ].

Inertia by a consistent mass, and by lumped ones that are negative, has fields M [1, V, Φ] beside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import IDENTITY, skew
from rigidfx.scene.scene import Scene

# Part of the terms of ‖ρ‖² below which rounding of these counts: ‖ρ‖ is that of its values then.
CANCELS = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True)
class Force:
    """A force on the nodes of a body in its frame."""

    nodes: Indices  # the body's owned nodes on this rank
    known: Array  # c, of each field in each direction, shape (fields, 3)
    beside: Array  # f, shape (nodes, 3) [N]
    products: Array  # h, shape (fields, 3)

    def __add__(self, other: Force) -> Force:
        known, beside = self.known + other.known, self.beside + other.beside
        return Force(self.nodes, known, beside, self.products + other.products)

    def __sub__(self, other: Force) -> Force:
        return self + -1.0 * other

    def __rmul__(self, factor: float) -> Force:
        parts = self.known, self.beside, self.products
        return Force(self.nodes, *(factor * part for part in parts))


class Fields:
    """The fields of a body.

    Attributes:
        data: The body's data.
        count: How many fields there are.
    """

    def __init__(
        self, scene: Scene, data: RigidBody, coordinates: Array, inert: Array, frozen: Array
    ) -> None:
        """Find the products of the fields of a body. Collective.

        At its nodes [1, V, Φ] are its coordinates, `inert` their products with the mass, both of
        the shape (nodes, 4 + 3 m), and `frozen` the forces f⁰ in its frame, (nodes, 3) [N].
        """
        self.data, self._scene = data, scene
        self._m = m = scene.averaging_mass[data.nodes][:, None]
        self._light: Array = np.divide(1.0, m, out=np.zeros_like(m), where=m > 0)
        n, count = len(data.nodes), data.deforms_by
        alike = scene.sum(float(np.count_nonzero(inert != m * coordinates))) == 0
        # Those of a shape come after those of the one before: new ones are the last.
        head, each = (7, 6) if alike else (11, 9)
        of_shapes = head + each * np.arange(count)[:, None, None] + np.arange(each).reshape(-1, 3)
        numbers = [of_shapes[:, k].reshape(-1) for k in range(each // 3)]
        self._places = np.r_[3:7, numbers[0]]
        self._inertia = self._places if alike else np.r_[head - 4 : head, numbers[2]]
        images = np.zeros(0) if data.shapes is None else data.shapes.images
        # Numbers of fields, these or those by W, and whether it is the latter.
        self._parts: list[tuple[Ints, Array, bool]] = [
            (np.arange(3), frozen, False),
            (self._places, coordinates, True),
            (numbers[1], images.reshape(n, 3 * count), False),
        ]
        if not alike:
            self._parts.append((self._inertia, inert, False))
        self.count, self._elastic = head + each * count, numbers[1]
        B = np.empty((n, self.count))
        for at, part, by_mass in self._parts:
            B[:, at] = m * part if by_mass else part
        self._gram = np.asarray(scene.sum(B.T @ (self._light * B)))
        # Rigid motions by numbers of [1, V], rotations as lengths.
        self._motions = np.zeros((6, 4, 3))
        self._motions[:3, 0] = IDENTITY
        self._motions[3:, 1:] = skew(IDENTITY).swapaxes(1, 2) / data.length
        moments = self._gram[np.ix_(self._places[:4], self._places[:4])]
        inertia = np.einsum("kjb,ji,lib->kl", self._motions, moments, self._motions)
        self._inverse = np.linalg.pinv(inertia)
        ends = self._places[4:], self._inertia[4:]
        self._masses = self._gram[ends].reshape(-1, 3).sum(axis=1)  # of shapes, ΦᵀMΦ

    def force(
        self, gained: Array, shorter: Array, e: Array, beside: Array, products: Array
    ) -> Force:
        """ρ without the part that would move the body as a whole.

        `gained` is the rate at which numbers of [1, V, Φ] change, shape (4 + 3 m, 3) [m/s², 1/s²],
        `shorter` the mean of the rotations, (3, 3), both in the body's frame. Shapes are
        stretched by e in the middle of the step [m]. `beside` is f, (nodes, 3) [N], and `products`
        its h.
        """
        known = np.zeros((self.count, 3))
        known[:3] = -shorter
        known[self._inertia] -= gained
        known[self._elastic] -= (e[:, None, None] * IDENTITY).reshape(-1, 3)
        out = Force(self.data.nodes, known, beside, products)
        sums = np.einsum("kjb,jb->k", self._motions, self._on_places(out)[:4])
        moving = np.tensordot(self._inverse @ sums, self._motions, 1)
        known[self._places[:4]] -= moving
        return out

    def _on_places(self, force: Force) -> Array:
        """[1, V, Φ]ᵀ F, shape (4 + 3 m, 3)."""
        return np.asarray(self._gram[self._places] @ force.known + force.products[self._places])

    def outside(self, force: Force) -> Force:
        """A force without those that shapes follow, by the mass."""
        each = self._on_places(force)[4:].reshape(-1, 3, 3)
        rates = np.trace(each, axis1=1, axis2=2) / self._masses
        known = force.known.copy()
        known[self._inertia[4:]] -= (rates[:, None, None] * IDENTITY).reshape(-1, 3)
        return Force(force.nodes, known, force.beside, force.products)

    def at_nodes(self, force: Force) -> Array:
        """A force, shape (nodes, 3) [N]."""
        out = force.beside.copy()
        for at, part, by_mass in self._parts:
            own = part @ force.known[at]
            out += self._m * own if by_mass else own
        return out

    def products(self, beside: Array) -> Array:
        """This rank's part of h, shape (fields, 3), of f at its nodes."""
        out, some = np.zeros((self.count, 3)), np.flatnonzero(beside.any(axis=1))
        if some.size:
            f, light = beside[some], self._light[some]
            for at, part, by_mass in self._parts:
                out[at] = part[some].T @ (f * (light > 0) if by_mass else f * light)
        return out

    def followed(self, force: Force) -> Force:
        """A force of the body when it had fewer shapes. Collective."""
        more = self.count - len(force.known)
        if not more:
            return force
        known = np.pad(force.known, ((0, more), (0, 0)))
        products = np.asarray(self._scene.sum(self.products(force.beside)))
        return Force(force.nodes, known, force.beside, products)

    def dot(self, a: Force, b: Force) -> tuple[float, float]:
        """This rank's part of f·W f of two forces, and the rest of their product on all ranks."""
        known = np.vdot(a.known, self._gram @ b.known) + np.vdot(a.known, b.products)
        known += np.vdot(b.known, a.products)
        return float(np.vdot(self._light * a.beside, b.beside)), float(known)

    def terms(self, force: Force) -> float:
        """The part of ‖ρ‖² by known fields alone."""
        return float(np.vdot(force.known, self._gram @ force.known))

    def square(self, force: Force) -> float:
        """This rank's part of ‖ρ‖² by its values [N²/kg]."""
        values = self.at_nodes(force)
        return float(np.vdot(self._light * values, values))


def dots(scene: Scene, pairs: Sequence[tuple[Fields, Force, Force]]) -> Array:
    """Products by W of two forces each, shape (pairs,) [N²/kg]. Collective."""
    beside, known = np.reshape([fields.dot(a, b) for fields, a, b in pairs], (-1, 2)).T
    return np.asarray(scene.sum(beside) + known)


def size(scene: Scene, forces: Sequence[tuple[Fields, Force]]) -> float:
    """Size of forces on some bodies, by masses: sqrt(Σ f·f/m) [N/√kg]. Collective."""
    square = dots(scene, [(fields, force, force) for fields, force in forces]).sum()
    if square < CANCELS * abs(sum(fields.terms(force) for fields, force in forces)):
        square = scene.sum(sum(fields.square(force) for fields, force in forces))
    return float(np.sqrt(square))
