"""Forces between points and an obstacle in a step: penalty by its secant, and Coulomb friction.

With y the position relative to the obstacle, the resistance of a point is

    [U] m + μ N Δg_T/√(|Δg_T|² + (ε Δt)²),    N = -[U] |m|,    Δg_T = (I - n nᵀ) Δy,  n = m/|m|.

The work of the first term on Δy is U₁ - U₀, exactly. The second term is perpendicular to it and
takes energy in every step in which the point slides, μ N |Δg_T| above the sliding speed ε.

Newton's method on x/√(x² + e²) diverges for |x| > e, the case of each step in which a node begins
to stick. Linearised as a system, with t = x/√(x² + e²) as an additional unknown, it converges: the
derivative becomes (I - t xᵀ/√)/√ with t kept from iterate to iterate and |t| ≤ 1 (T. F. Chan,
G. H. Golub and P. Mulet, SIAM J. Sci. Comput. 20 (1999) 1964), which is the exact one in the limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.effects.contacts.asked import AskedObstacle
from rigidfx.effects.contacts.obstacles import Approach
from rigidfx.effects.contacts.penalty import outdated, secant

__all__ = ["Friction", "Points", "Pressed", "Sliding"]

IDENTITY = np.eye(3)
TINY = float(np.finfo(np.float64).tiny)

CLOSED = 1e-12  # of a point's coordinates: a gap that statics take for closed, as it rounds to zero


@dataclass(frozen=True)
class Friction:
    """Coulomb friction in a step.

    Attributes:
        mu: Coefficient μ.
        slip: Displacement ε Δt below which points creep [m].
        beside: How far each slides beside its partner, shape (points, 3) [m]; None for nothing.
        part: Part of its motion that counts as a slide.
    """

    mu: float
    slip: float
    beside: Array | None = None
    part: float = 1.0


@dataclass(frozen=True)
class Pressed:
    """The points that an obstacle presses at an iterate.

    Attributes:
        at: Which of the points they are.
        force: Their resistance, shape (n, 3) [N].
        moved: Δy, shape (n, 3) [m].
        normal: [U] and its derivative by g₁, shapes (n,) [N] and [N/m].
        approach: How their gaps change.
        sliding: None without friction.
    """

    at: Ints
    force: Array
    moved: Array
    normal: tuple[Array, Array]
    approach: Approach
    sliding: Sliding | None

    @property
    def stiffness(self) -> Array:
        """Derivative of the resistance by y₁, shape (n, 3, 3) [N/m]."""
        (value, slope), a = self.normal, self.approach
        out = slope[:, None, None] * a.m[:, :, None] * a.dg[:, None]
        if a.dm is not None:
            out = out + value[:, None, None] * a.dm
        return out if self.sliding is None else out + self._of_friction(self.sliding)

    def _of_friction(self, s: Sliding) -> Array:
        (value, slope), a = self.normal, self.approach
        n, length = s.n, s.length
        along = np.einsum("ni,ni->n", n, self.moved)
        # How N, and Δg_T, change with y₁.
        dN = -(slope * length)[:, None] * a.dg
        dg = IDENTITY - n[:, :, None] * n[:, None]
        if a.dm is not None:
            dlength = np.einsum("ni,nij->nj", n, a.dm)
            dN = dN - value[:, None] * dlength
            dn = (a.dm - n[:, :, None] * dlength[:, None]) / length[:, None, None]
            of_n = np.einsum("ni,nij->nj", self.moved, dn)
            dg = dg - n[:, :, None] * of_n[:, None] - along[:, None, None] * dn
        direction = s.slid / s.root[:, None]
        across = IDENTITY - s.t[:, :, None] * direction[:, None]
        across *= s.part
        N = -value * length
        # In statics points that have just closed stick, as if N/|slip| were their stiffness.
        N = np.where(2.0 * TINY * slope < N, N, slope * s.root)
        turned = (N / s.root)[:, None, None] * (across @ dg)
        return np.asarray(s.mu * (direction[:, :, None] * dN[:, None] + turned))

    @property
    def dissipated(self) -> float:
        """Energy that friction takes [J]."""
        if self.sliding is None:
            return 0.0
        s, N = self.sliding, -self.normal[0] * self.sliding.length
        return s.mu * float((N / s.root) @ (s.slid * s.slid).sum(axis=1))


@dataclass(frozen=True)
class Sliding:
    """How pressed points slide at an iterate.

    Attributes:
        mu: Coefficient μ.
        n: Normals, shape (n, 3).
        length: |m|, shape (n,).
        slid: Δg_T, shape (n, 3) [m].
        root: √(|Δg_T|² + (ε Δt)²), shape (n,) [m].
        t: Stand-in for Δg_T over that in derivatives, shape (n, 3).
        part: Part of Δy in it.
    """

    mu: float
    n: Array
    length: Array
    slid: Array
    root: Array
    t: Array
    part: float


NONE = np.empty((0, 3))
NOTHING = Pressed(
    np.empty(0, np.int64), NONE, NONE, (NONE[:, 0], NONE[:, 0]), Approach(NONE, None, NONE), None
)


class Points:
    """Points that an obstacle may press; their memory belongs to one step.

    Attributes:
        k: Stiffnesses, shape (n,) [N/m].
        y0: Positions relative to the obstacle at the start of the step, shape (n, 3) [m].
        g0: Gaps there, shape (n,) [m].
        pressed: Those that are pressed, at the last iterate.
    """

    def __init__(self, obstacle: AskedObstacle, k: Array, static: bool = False) -> None:
        """Take the stiffnesses over.

        Args:
            obstacle: The obstacle.
            k: Stiffnesses, shape (n,) [N/m].
            static: Whether forces are those at the end of a step, -U'(g₁) m(y₁).
        """
        self._obstacle, self.k, self._static = obstacle, k, static
        self._in_tangent: tuple[Array, Array] = np.zeros(k.size), np.zeros(k.size)
        self.begin(np.empty((0, 3)), None)

    def begin(self, y0: Array, friction: Friction | None) -> None:
        """Begin a step, or an attempt at it.

        Args:
            y0: Positions relative to the obstacle, shape (n, 3) [m].
            friction: None without.
        """
        self.y0, self._friction = y0, friction
        self.g0 = self._obstacle.gap(y0)
        self.pressed: Pressed | None = None
        self._t = np.zeros_like(y0)
        self._before = np.zeros_like(y0), np.ones(len(y0))  # slid and root of the last iterate ...
        self._known = np.zeros(len(y0), dtype=bool)  # ... if there is one

    def press(self, moved: Array) -> Pressed:
        """The forces at an iterate.

        Args:
            moved: Δy of all points, shape (n, 3) [m].
        """
        if not self.k.size:
            self.pressed = NOTHING
            return NOTHING
        y1 = self.y0 + moved
        y0, g0, g1 = self.y0, self.g0, self._obstacle.gap(y1)
        if self._static:  # both ends are the last one; what rounds to closed is stiff at once
            y0 = y1
            g0 = g1 = np.where(g1 <= CLOSED * np.abs(y1).max(axis=1), np.minimum(g1, -TINY), g1)
        at = np.flatnonzero((g0 < 0) | (g1 < 0))
        if not at.size:
            self.pressed = NOTHING
            return NOTHING
        moved, k = moved[at], self.k[at]
        approach = self._obstacle.approach(y0[at], y1[at])
        value, slope = secant(k, g0[at], g1[at])
        if self._static:  # derivatives by both ends, which are alike
            slope = 2 * slope
            approach = replace(approach, dm=None if approach.dm is None else 2 * approach.dm)
        force, sliding = value[:, None] * approach.m, None
        if self._friction is not None:
            sliding = self._sliding(self._friction, at, approach, moved)
            grip = -sliding.mu * value * sliding.length / sliding.root
            force = force + grip[:, None] * sliding.slid
        self.pressed = Pressed(at, force, moved, (value, slope), approach, sliding)
        return self.pressed

    def assembled(self) -> None:
        """Take note that a tangent has their stiffness at the last iterate."""
        self._in_tangent = self._stiffnesses()

    @property
    def outdated(self) -> bool:
        """Whether some have closed, opened, stuck or slipped since the tangent was assembled."""
        both = zip(self._in_tangent, self._stiffnesses(), strict=True)
        return any(outdated(self.k, then, now) for then, now in both)

    def _stiffnesses(self) -> tuple[Array, Array]:
        """Derivatives of [U] by g₁, and of friction across where points stick, [N/m]."""
        press, grip, p = np.zeros(self.k.size), np.zeros(self.k.size), self.pressed
        if p is not None:
            press[p.at] = p.normal[1]
            if p.sliding is not None:
                s = p.sliding
                grip[p.at] = -s.mu * p.normal[0] * s.length / s.root
        return press, grip

    def _sliding(self, friction: Friction, at: Ints, approach: Approach, moved: Array) -> Sliding:
        """How points slide; t follows from the linearised system of the last iterate."""
        length = np.linalg.norm(approach.m, axis=1)
        n = approach.m / length[:, None]
        slid = friction.part * moved + (0.0 if friction.beside is None else friction.beside[at])
        slid = slid - n * np.einsum("ni,ni->n", n, slid)[:, None]
        root = np.sqrt((slid * slid).sum(axis=1) + friction.slip**2)
        before, size, t = self._before[0][at], self._before[1][at], self._t[at]
        change = np.einsum("ni,ni->n", before, slid - before) / size
        t = (slid - t * change[:, None]) / size[:, None]
        t /= np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1.0)
        t[~self._known[at]] = 0.0
        self._t[at], self._before[0][at], self._before[1][at] = t, slid, root
        self._known[at] = True
        return Sliding(friction.mu, n, length, slid, root, t, friction.part)
