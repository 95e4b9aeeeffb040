"""A trial step of bodies that deform by shapes: what Δq changes in the step of rigid bodies.

docs/theory/shapes.md has the rows of a body, with w₁, Z, p and S, how nodes move, and the
derivative, which is complete, forces on nodes included. Where stretches stiffen, their forces are
in place of Ω q½. In a frame that a support holds some Δq may be given, too, by which nodes of
further supports move there.

Bodies without shapes take the step of rigid ones; arrays named (some, ...) are of the others.
shaped_step.c has residual and tangent: by NumPy, steps of a plate took 1.4 times as long.
"""

from functools import cache, cached_property
from itertools import accumulate

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.mechanics.rotation import IDENTITY, cayley
from rigidfx.mechanics.shapes import ShapesOfBodies, times


@cache
def places(m: int) -> dict[str, tuple[int, int]]:
    """Places of the results of a trial for a body with m shapes, `told` in shaped_step.c."""
    row = 9 * (m + 1)
    kinds = {"q1": m, "S": 9, "de": m, "elastic": m, "middle": m, "stress": m}
    kinds |= {"W1": 3, "rates1": m, "E1": row, "half": row}
    ends = accumulate(kinds.values())
    return {name: (end - kinds[name], end) for name, end in zip(kinds, ends, strict=True)}


def increments_of(step: Step, unknowns: Array) -> Increments:
    """A trial step by Δr, ℓθ and Δq, shape (bodies, 6 + m) [m], from then on not to be changed."""
    kind = Increments if step.start.of.shapes is None else ShapedIncrements
    return kind(step, unknowns)


class ShapedIncrements(Increments):
    """A trial step of bodies some of which have shapes."""

    def __init__(self, step: Step, unknowns: Array) -> None:
        """See `Increments`; those that supports give are of no meaning."""
        shapes, start = step.start.of.shapes, step.start
        assert shapes is not None
        self._held = np.flatnonzero(shapes.held)
        if self._held.size:
            unknowns, held = unknowns.copy(), self._held
            given = np.zeros(unknowns.shape) if step.given is None else step.given
            unknowns[:, 6:][shapes.given] = given[:, 6:][shapes.given]
            # Increments by themselves: differences of places would lose digits.
            turn = np.array([cayley(theta) - IDENTITY for theta in given[held, 3:6]])
            gained = np.einsum("bkc,bk->bc", shapes.drift[held], unknowns[held, 6:])
            gained = times(start.R[held], gained)
            before = times(start.R[held], start.drifted[held])
            unknowns[held, :3] = given[held, :3] + gained + times(turn, before + gained)
            unknowns[held, 3:6] = given[held, 3:6] * start.of.length[held, None]
        unknowns = np.ascontiguousarray(unknowns)
        super().__init__(step, unknowns)
        m, n = shapes.most, len(self)
        self._all = np.empty(shapes.some.size * places(m)["half"][1])
        self._work = np.empty(4 * m * (m + 2))  # room for the C code
        self._pi1, self._inertia = np.empty((n, 3)), np.empty((n, 6 + m))
        self._displacement = np.empty((n, 4 + 3 * m, 3))
        (code, at), (told, _) = step.code, step.shaped
        arrays = unknowns, self._work, self._all, self._pi1, self._displacement, self._inertia
        code.shaped_trial(told, at(self._told), *map(at, arrays))

    @property
    def _shapes(self) -> ShapesOfBodies:
        shapes = self.start.of.shapes
        assert shapes is not None
        return shapes

    @property
    def _some(self) -> Ints:
        """Bodies that have shapes."""
        return self._shapes.some

    @property
    def dq(self) -> Array:
        """Δq, shape (bodies, m) [m]."""
        return self.unknowns[:, 6:]

    def _of_shapes(self, name: str) -> Array:
        """A result of the trial, of the bodies that have shapes, shape (some, numbers)."""
        some, (first, end) = self._some.size, places(self._shapes.most)[name]
        return self._all[some * first : some * end].reshape(some, -1)

    @property
    def S(self) -> Array:
        """S, with which nodes follow Δq; R₁ in statics, shape (some, 3, 3)."""
        return self._of_shapes("S").reshape(-1, 3, 3)

    @property
    def de(self) -> Array:
        """Δe, shape (bodies, m) [m]."""
        out = np.zeros(self.dq.shape)
        out[self._some] = self._of_shapes("de")
        return out

    @property
    def pi1(self) -> Array:
        """Angular momenta at the end of the step, with those of shapes, shape (bodies, 3)."""
        return self._pi1

    @cached_property
    def end(self) -> Bodies:
        """The bodies at the end of the step, with q and its rate."""
        rigid, start = super().end, self.start
        velocities = rigid.velocity, rigid.angular_velocity_body
        rates = self.step.rate * self.dq - start.q_rate
        return Bodies(start.of, rigid.frame, *velocities, start.q + self.dq, rates)

    def inertia_force(self) -> Array:
        """(p₁ - p₀)/Δt - ½ w₁·∂A/∂q w₀ and those of bodies, shape (bodies, 6 + m) [N]."""
        return self._inertia.copy()

    # Nodes ----------------------------------------------------------------------------------------

    @property
    def displacement(self) -> Array:
        """The matrices of the displacements, shape (bodies, n, 3) [m, 1]."""
        return self._displacement

    @cached_property
    def L(self) -> Array:
        """Of the displacements Δr + θ × (x½ - c½) + S Φ Δq, shape (bodies, 3 n, 6 + m)."""
        return self._followed_by(end=False)

    @cached_property
    def P(self) -> Array:
        """Derivative of `displacement`: δr + T δθ × v₁ + R₁ Φ δq, likewise."""
        return self._followed_by(end=True)

    def _followed_by(self, end: bool) -> Array:
        """L, or P at the end of the step."""
        out, (code, at) = np.empty(self.start.of.frames.shape), self.step.code
        told, _ = self.step.shaped
        code.shaped_follow(told, at(self._told), at(self._all), end, at(out))
        return out

    @cached_property
    def _apart(self) -> Array:
        """Unknowns with Δr less its part that follows Δq, shape (bodies, 6 + m)."""
        if not self._held.size:
            return self.unknowns
        out, some = self.unknowns.copy(), self._some
        follows = self.S @ self._shapes.drift[some].swapaxes(1, 2)  # of centres of mass
        out[some, :3] -= times(follows, self.dq[some])
        return out

    def work(self, forces: Array) -> float:
        """Work of forces in the step, less that on the part of Δr which follows Δq [J]."""
        return float(np.vdot(forces, self._apart))

    def work_of_supports(self, rows: Array) -> float:
        """Work of supports on the frames that they hold, and on shapes that they move [J].

        Rows of `balance` of what is given are what the supports exert.
        """
        given = ~self.start.of.known
        return float(np.vdot(rows[given], self._apart[given]))

    def _called(self, what: str, shape: tuple[int, ...], *arrays: Array) -> Array:
        """The result of a function of the C code, by arrays, after the trial."""
        out, (code, at), (told, _) = np.empty(shape), self.step.code, self.step.shaped
        given = (at(np.ascontiguousarray(values)) for values in arrays)
        getattr(code, what)(told, at(self._told), *given, at(out))
        return out

    def resultant(self, moments: Array) -> Array:
        """Lᵀ without L: torques Σ (x½ - c½) × f and Q = Σ Φᵀ Sᵀ f, shape (bodies, 6 + m) [N]."""
        return self._called("shaped_resultant", self.unknowns.shape, self._all, moments)

    def balance(self, moments: Array, torques: Array) -> Array:
        """Residual of the bodies with the rows of shapes, shape (bodies, 6 + m) [N]."""
        out = self.resultant(moments)
        out += self._inertia
        out[:, 3:6] -= torques / self.start.of.length[:, None]
        out[self._some, 6:] += self._of_shapes("elastic")
        return out

    def blocks(self, moments: Array) -> Array:
        """Derivative of the residual that P does not carry, shape (bodies, 6 + m, 6 + m) [N/m]."""
        shape, known = (*self.unknowns.shape, self.unknowns.shape[1]), (self.pi1, self._work)
        return self._called("shaped_blocks", shape, *known, self._all, moments)
