"""Shapes of a body: it deforms by a few given fields in its own frame.

docs/theory/shapes.md has the places of nodes, x = c + R (ξ + Φ q), the energies U(q) and
½ w·A(q) w, frames that supports hold, and stresses that stiffen. A body without shapes is rigid.
Where further supports hold nodes of a body whose frame is held, the first shapes are static
responses to unit motions of these, and their coordinates are given.

All of it comes from the second moments G_kl = Σ m Φ_k Φ_lᵀ, with Φ₀ = ξ, which are summed once; a
step then costs the same whatever the mesh.

Arrays of several bodies have an axis over those first that have shapes: those without cost nothing.
Bodies may have different numbers of shapes: what a body lacks up to the largest number is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rigidfx.base.sealed import Sealed, seal
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.mechanics.rotation import IDENTITY, axial, skew

EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class SelfStresses(Sealed):
    """Stresses of second order in q that no displacement relieves: see docs/theory/shapes.md.

    They are s_a = ½ q·V_a q less its value where they began, with the energy ½ s·s.
    """

    nodes: Indices  # owned nodes of the body on this rank, sorted
    tension: Array  # V, of the first n shapes, shape (s, n, n) [√N/m^(3/2)]
    before: Array  # shape (s,) [√J]
    # Strains of each are ½ Σ B_jk ∇φ_jᵀ∇φ_k, shape (s, n, n) [m²/√J], and those of displacements,
    # shape (nodes, s, 3) [m/√J]
    bends: Array
    fields: Array

    def __len__(self) -> int:
        return len(self.before)

    def of(self, q: Array) -> Array:
        """s by coordinates, shape (s,) [√J]."""
        n = self.tension.shape[1]
        return np.asarray(0.5 * self.tension @ q[:n] @ q[:n] - self.before)

    def strained(self, q: Array) -> tuple[Array, list[tuple[Array, float]]]:
        """Displacement whose strains they have, shape (nodes, 3) [m], and q of others.

        Strains of second order of these, (n,) [m], come on top, or are taken away, by signs.
        """
        s = self.of(q)
        squares, vectors = np.linalg.eigh(np.tensordot(s, self.bends, 1))
        some = np.abs(squares) > EPS * np.abs(squares).max(initial=0.0)
        fields = (vectors * np.sqrt(np.abs(squares))).T[some]
        curves = list(zip(fields, np.sign(squares[some]).tolist(), strict=True))
        return np.asarray(s @ self.fields), curves

    def turned(self, T: Array, back: Array, inside: Bools) -> SelfStresses:
        """Those by other coordinates, Φ T and T⁻¹ q, at some of the nodes."""
        n = self.tension.shape[1]
        bends = back[:, :n] @ self.bends @ back[:, :n].T
        tension = T[:n].T @ self.tension @ T[:n]
        return SelfStresses(self.nodes[inside], tension, self.before, bends, self.fields[inside])


@dataclass(frozen=True)
class Shapes(Sealed):
    """The constant data of the m shapes of a body."""

    nodes: Indices  # owned nodes of the body on this rank, sorted
    modes: Array  # Φ at these nodes in the body's frame, shape (nodes, m, 3)
    # G, shape (m + 1, m + 1, 3, 3) [kg m², kg m, kg]; that of ξ alone is left to the inertia of the
    # body
    moments: Array
    stiffness: Array  # Ω, shape (m, m) [N/m]
    force: Array  # f₀, shape (m,) [N]
    # Of a body whose frame is held, by how much its centre of mass moves in the frame per
    # coordinate, shape (m, 3); None of a body that moves freely
    drift: Array | None = None
    # Γ of the first n shapes, by which stretches stiffen, (n, n, n) [N/m²]; None where they do not
    tension: Array | None = None
    # b, by how much shapes do not get shorter, as they had bent before they had Γ, shape (m,) [m];
    # None without Γ
    shorter: Array | None = None
    # K Φ at the nodes, of a body that may get more shapes, shape (nodes, m, 3) [N/m]
    images: Array = field(default_factory=lambda: np.array([]))
    given: int = 0  # number of the first shapes whose coordinates supports give
    selves: SelfStresses | None = None  # None until supports call for them

    def __post_init__(self) -> None:
        if self.images.ndim < self.modes.ndim:  # of a body that gets no more
            object.__setattr__(self, "images", np.zeros((len(self.nodes), 0, 3)))
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.force)

    @property
    def mass(self) -> Array:
        """D, shape (m, m) [kg]."""
        return np.asarray(np.einsum("klii->kl", self.moments[1:, 1:]))

    @cached_property
    def flexibility(self) -> Array:
        """Ω⁻¹, zero along motions that supports give and nothing resists, shape (m, m) [m/N]."""
        return inverse(self.stiffness)

    def bent(self, q: Array, at: Ints | slice = slice(None)) -> Array:
        """Φ q at the nodes, or at some of them, shape (nodes, 3)."""
        return np.asarray(q @ self.modes[at])

    def stretched(self, q: Array, rate: Array) -> tuple[Array, Array]:
        """e(q) and its rate, each (m,) [m, m/s]."""
        if self.tension is None:
            return q, rate
        n = len(self.tension)
        gained = np.zeros((len(self), 2))
        gained[:n] = np.stack([self.tension @ x[:n] @ q[:n] for x in (0.5 * q, rate)], axis=1)
        relieved = (self.flexibility @ gained).T
        return self.free(q) + relieved[0], rate + relieved[1]

    def free(self, q: Array) -> Array:
        """q where shapes had always got shorter, q - b, shape (m,) [m]."""
        return q if self.shorter is None else q - self.shorter

    def begun(self, q: Array, before: Shapes, q_before: Array) -> Shapes:
        """Shapes that go on with the stretches of others, which are the first ones."""
        if self.tension is None:
            return self
        e, _ = before.stretched(q_before, q_before)
        now, _ = replace(self, shorter=None).stretched(q, q)
        selves = self.selves
        if selves is not None and before.selves is None:
            selves = replace(selves, before=selves.of(q) + selves.before)
        return replace(self, shorter=now - np.pad(e, (0, len(now) - len(e))), selves=selves)

    def tightened(self, q: Array) -> Array:
        """Ω with what the stretch at q adds, shape (m, m) [N/m]."""
        if self.tension is None:
            return self.stiffness
        out, n = self.stiffness.copy(), len(self.tension)
        out[:n, :n] += np.tensordot(self.stretched(q, q)[0][:n], self.tension, 1)
        if (own := self.selves) is not None:
            n = own.tension.shape[1]
            out[:n, :n] += np.tensordot(own.of(q), own.tension, 1)
        return out

    @property
    def whole(self) -> Array:
        """Φ with the drift, zero where a support holds the frame, shape (nodes, m, 3)."""
        return self.modes if self.drift is None else self.modes + self.drift


class ShapesOfBodies:
    """The shapes of some bodies as arrays; `some` of all bodies have any.

    Attributes:
        some: Numbers of these, sorted.
        counts: m of each of all bodies.
        most: The largest m.
        moments: G, shape (some, most + 1, most + 1, 3, 3).
        couplings: Σ m Φ_j × Φ_k, shape (some, most, most, 3).
        mass: D, shape (some, most, most) [kg].
        stiffness: Ω, likewise [N/m].
        force: f₀, shape (some, most) [N].
        drift: See `Shapes`, of all bodies, shape (all, most, 3); zero of those that move freely.
        held: Whether the frame of each of all bodies is held.
        selves: V, shape (some, s, most, most): see `SelfStresses`, as of `before`, (some, s).
        given: Which coordinates supports give, of all bodies, shape (all, most).
    """

    def __init__(self, each: Sequence[Shapes | None]) -> None:
        """Stack the shapes of each body, of one at least; None if it is rigid."""
        self.counts = np.array([0 if own is None else len(own) for own in each])
        self.some, self.most = np.flatnonzero(self.counts), int(self.counts.max(initial=0))
        k, m = self.some.size, self.most
        self.moments = np.zeros((k, m + 1, m + 1, 3, 3))
        self.stiffness, self.force = np.zeros((k, m, m)), np.zeros((k, m))
        self.drift = np.zeros((len(each), m, 3))
        self.held = np.array([own is not None and own.drift is not None for own in each])
        count = np.array([0 if own is None else own.given for own in each])
        self.given = np.arange(m) < count[:, None]
        for k, body in enumerate(self.some):
            own, n = each[int(body)], self.counts[body]
            assert own is not None
            if own.drift is not None:
                self.drift[body, :n] = own.drift
            self.moments[k, : n + 1, : n + 1] = own.moments
            self.stiffness[k, :n, :n], self.force[k, :n] = own.stiffness, own.force
        self.couplings = axial(self.moments[:, 1:, 1:])
        self.mass = np.einsum("bklii->bkl", self.moments[:, 1:, 1:])
        self.relieved, self.shorter = self._of_tension(each)
        self.selves, self.before = self._of_selves(each)
        self._rows = self.moments.reshape(len(self.some), m + 1, -1)
        seal(self)

    def _of_tension(self, each: Sequence[Shapes | None]) -> tuple[Array | None, Array]:
        """Ω⁻¹Γ of each, shape (some, most, most, most), None if no body has Γ, and b."""
        shorter = np.zeros((self.some.size, self.most))
        if all(own is None or own.tension is None for own in each):
            return None, shorter
        out = np.zeros((self.some.size, *3 * (self.most,)))
        for k, body in enumerate(self.some):
            own = each[int(body)]
            assert own is not None
            if own.tension is not None:
                m, n = len(own), len(own.tension)
                out[k, :n, :n, :n] = own.tension
                flat = out[k, :m, :m, :m].reshape(m, m * m)
                out[k, :m, :m, :m] = (own.flexibility @ flat).reshape(m, m, m)
                shorter[k, :m] = own.shorter
        return out, shorter

    def _of_selves(self, each: Sequence[Shapes | None]) -> tuple[Array, Array]:
        """V and s before it counted, shapes (some, s, most, most) and (some, s): `SelfStresses`."""
        shapes = [each[int(body)] for body in self.some]
        own = [None if one is None else one.selves for one in shapes]
        count = max((len(one.before) for one in own if one is not None), default=0)
        V, before = np.zeros((len(own), count, self.most, self.most)), np.zeros((len(own), count))
        for k, one in enumerate(own):
            if one is not None:
                s, n = one.tension.shape[:2]
                V[k, :s, :n, :n], before[k, :s] = one.tension, one.before
        return V, before

    @cached_property
    def known(self) -> Bools:
        """Which coordinates there are, of all bodies, shape (all, most)."""
        return np.arange(self.most) < self.counts[:, None]

    # Functions of q, shape (some, most) ---------------------------------------------------------

    def weighted(self, q: Array) -> Array:
        """E_k = Σ m y Φ_kᵀ, but for the part of ξ ξᵀ, row by row, shape (some, most + 1, 9)."""
        out = (q[:, None] @ self._rows[:, 1:])[:, 0]
        out += self._rows[:, 0]
        return np.asarray(out.reshape(len(q), self.most + 1, 9))

    def added_inertia(self, q: Array, E: Array) -> Array:
        """Addition of the shapes to J, shape (some, 3, 3) [kg m²]."""
        Y = (E[:, 0] + (q[:, None] @ E[:, 1:])[:, 0]).reshape(-1, 3, 3)
        return np.asarray(np.trace(Y, axis1=1, axis2=2)[:, None, None] * IDENTITY - Y)

    @staticmethod
    def coupling(E: Array) -> Array:
        """B, shape (some, 3, most) [kg m]."""
        return axial(E[:, 1:].reshape(len(E), -1, 3, 3)).swapaxes(1, 2)

    def momenta(self, q: Array, W: Array, rates: Array, E: Array) -> tuple[Array, Array]:
        """Addition to J W by shapes [kg m²/s], and p = Bᵀ W + D q̇ [kg m/s]; see `weighted`."""
        own, both = E[:, 1:], np.empty((len(q), 2, self.most))
        both[:, 0], both[:, 1] = q, rates
        sums = (both @ own).reshape(-1, 2, 3, 3)
        Y = E[:, 0].reshape(-1, 3, 3) + sums[:, 0]
        turning = np.trace(Y, axis1=1, axis2=2)[:, None] * W - times(Y, W) + axial(sums[:, 1])
        return turning, times(own, skew(-W).reshape(-1, 9)) + times(self.mass, rates)

    def stretched(self, q: Array) -> Array:
        """e(q), shape (some, most) [m]."""
        if self.relieved is None:
            return q
        return q - self.shorter + 0.5 * times(self._slopes(q), q)

    def _slopes(self, q: Array) -> Array:
        """Ω⁻¹Γ q = ∂e/∂q - 1, shape (some, most, most)."""
        assert self.relieved is not None
        return np.asarray((self.relieved @ q[:, None, :, None])[..., 0])

    def on_coordinates(self, q: Array, s: Array) -> Array:
        """Forces ∂e/∂q·s at q by stresses s [N], shape (some, most) [N]."""
        return s if self.relieved is None else s + times(self._slopes(q).swapaxes(1, 2), s)

    def selves_of(self, q: Array) -> tuple[Array, Array]:
        """Self-stresses s and ∂s/∂q = V q, shapes (some, s) and (some, s, most)."""
        pulls = np.asarray((self.selves @ q[:, None, :, None])[..., 0])
        return 0.5 * times(pulls, q) - self.before, pulls

    def linear(self, q: Array, e: Array) -> Array:
        """Coordinates whose linear forces Ωq are those of stretches e at q, shape (some, most)."""
        if self.relieved is None:
            return e
        s, (own, pulls) = times(self.stiffness, e), self.selves_of(q)
        tension = self.on_coordinates(q, s) - s + times(pulls.swapaxes(1, 2), own)
        return np.asarray(e + times(self._flexibility, tension))

    @cached_property
    def _flexibility(self) -> Array:
        """Ω⁻¹ of the shapes that there are, shape (some, most, most) [m/N]."""
        return inverse(self.stiffness)

    def even_force(self, q: Array) -> Array:
        """What Γ adds to Ωq to second order, shape (some, most) [N]."""
        added = times(self.stiffness, self.stretched(q) - q + self.shorter)
        return added + self.on_coordinates(q, times(self.stiffness, q)) - times(self.stiffness, q)

    def energy(self, q: Array) -> Array:
        """U(q) - U₀ of each body, shape (some,) [J]."""
        e = self.stretched(q)
        own = (self.force * q + 0.5 * times(self.stiffness, e) * e).sum(axis=1)
        return np.asarray(own + 0.5 * (self.selves_of(q)[0] ** 2).sum(axis=1))


def inverse(stiffness: Array) -> Array:
    """The inverse of stiffnesses, shape (..., m, m), zero along motions that nothing resists."""
    found = np.linalg.pinv(stiffness, rcond=EPS ** (2 / 3), hermitian=True)
    return np.asarray(found, dtype=np.float64)


def times(matrices: Array, vectors: Array) -> Array:
    """Each matrix times its vector, shapes (n, i, j) and (n, j)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
