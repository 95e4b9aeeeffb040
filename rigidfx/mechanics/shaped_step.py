"""A trial step of bodies that deform by shapes: what Δq changes in the step of rigid bodies.

With w = (W, q̇), w₁ = 2 (R₀ᵀθ, Δq)/Δt - w₀, (Z, p) = A(q) w, q½ = q₀ + ½ Δq and S = (1 + ½θ̂) R₀, the
rows of a body are, Q = Σ Φᵀ Sᵀ f the forces on its nodes,

    (R₁ Z₁ - R₀ Z₀)/Δt = Σ (x½ - c½) × f,
    (p₁ - p₀)/Δt - ½ w₁·∂A/∂q(q½) w₀ + f₀ + Ω q½ + C Δq = Q,

or with stretches in place of Ω q½, see `rigidfx.mechanics.shapes`. A is of second order in q, so
that A₁ - A₀ = ∂A/∂q(q½) Δq; the rows times θ and Δq then add up to the gain of kinetic energy and
of U(q), as nodes move by exactly

    Δx = Δc + θ × (x½ - c½) + S Φ Δq.

The frame of a body that a support holds is given: Δr follows Δq by Δc₀ and the drift, and the rows
of Δr and θ are the force and the moment of the support. So are some Δq, by which nodes of further
supports move in the frame.

The derivative is complete, forces on nodes included: with v₁ = R₁ (V + Φ q₁), moments change by
½ (T dθ × v₁ + R₁ Φ dq) × f, and Q_k by ½ dθ · (R₀ Φ_k × f).

Bodies without shapes take the step of rigid ones; arrays named (some, ...) are of the others.
"""

from functools import cached_property

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.mechanics.rotation import IDENTITY, axial, cayley, skew
from rigidfx.mechanics.shapes import ShapesOfBodies, contracted, times


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
        super().__init__(step, unknowns)

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

    # Of the bodies that have shapes ---------------------------------------------------------------

    @cached_property
    def _q(self) -> tuple[Array, Array]:
        """q at the start and at the end of the step, shape (some, m)."""
        q0, dq = self.start.q[self._some], self.dq[self._some]
        return q0, q0 + dq

    @cached_property
    def _R(self) -> tuple[Array, Array]:
        """R₀ and R₁, shape (some, 3, 3)."""
        return self.start.R[self._some], self.R1[self._some]

    @cached_property
    def _before(self) -> tuple[Array, Array]:
        """W and q̇ at the start of the step."""
        return self.start.angular_velocity_body[self._some], self.start.q_rate[self._some]

    @cached_property
    def _rates(self) -> tuple[Array, Array]:
        """W and q̇ at the end of the step."""
        (W, rates), rate = self._before, self.step.rate
        turned = (self.theta[self._some, None] @ self._R[0])[:, 0]
        return rate * turned - W, rate * self.dq[self._some] - rates

    @cached_property
    def S(self) -> Array:
        """S, with which nodes follow Δq; R₁ in statics, shape (some, 3, 3)."""
        R0, R1 = self._R
        if self.step.share == 1.0:
            return R1
        return np.asarray(R0 + 0.5 * skew(self.theta[self._some]) @ R0)

    @cached_property
    def _drift(self) -> Array:
        return self._shapes.drift[self._some]

    # Inertia and elastic energy -------------------------------------------------------------------

    @cached_property
    def _weighted(self) -> Array:
        """E of the shapes at the end of the step: see `ShapesOfBodies.weighted`."""
        return self._shapes.weighted(self._q[1])

    @cached_property
    def _half(self) -> Array:
        """The same in the middle: it is linear in q."""
        return np.asarray(0.5 * (self.start.weighted + self._weighted))

    @cached_property
    def _momenta(self) -> tuple[Array, Array]:
        """Addition of shapes to J W at the end of the step, and p, shapes (some, 3), (some, m)."""
        return self._shapes.momenta(self._q[1], *self._rates, self._weighted)

    @cached_property
    def pi1(self) -> Array:
        """Angular momenta at the end of the step, with those of shapes, shape (bodies, 3)."""
        out = super().pi1.copy()
        if self.step.rate:
            W = times(self.start.of.inertia[self._some], self._rates[0])
            out[self._some] = times(self._R[1], W + self._momenta[0])
        return out

    @cached_property
    def end(self) -> Bodies:
        """The bodies at the end of the step, with q and its rate."""
        rigid, start = super().end, self.start
        velocities = rigid.velocity, rigid.angular_velocity_body
        rates = self.step.rate * self.dq - start.q_rate
        return Bodies(start.of, rigid.frame, *velocities, start.q + self.dq, rates)

    def inertia_force(self) -> Array:
        """(p₁ - p₀)/Δt - ½ w₁·∂A/∂q w₀ and those of bodies, shape (bodies, 6 + m) [N]."""
        return self._inertia_force.copy()

    @cached_property
    def _inertia_force(self) -> Array:
        out = np.zeros(self.unknowns.shape)
        out[:, :6] = self._part("force")
        if self.step.rate == 0.0:
            return out
        some, dt, start = self._some, self.step.dt, self.start
        turned = self.pi1[some] - start.angular_momentum[some]
        out[some, 3:6] = turned / (dt * start.of.length[some])[:, None]
        own = (self._momenta[1] - start.momenta_of_shapes[1]) / dt
        own -= self._shapes.gradient(self._half, self._rates, self._before)
        if self._held.size:
            own += times(self._drifts(self.S), out[some, :3])
        out[some, 6:] = own
        return out

    def _drifts(self, R: Array) -> Array:
        """How centres of mass follow shapes in frames that are held, shape (some, m, 3)."""
        return self._drift @ R.swapaxes(1, 2)

    def elastic_force(self) -> Array:
        """f₀ + ∂e/∂q·s, shape (bodies, m) [N]; at the end of a step of statics."""
        out, q = np.zeros(self.dq.shape), self._middle
        out[self._some] = self._shapes.force + self._shapes.on_coordinates(q, self._stress)
        return out

    @cached_property
    def de(self) -> Array:
        """Δe, shape (bodies, m) [m]."""
        if self._shapes.relieved is None:
            return self.dq
        out, some = self.dq.copy(), self._some
        out[some] = self._shapes.stretched(self._q[1]) - self.start.stretched[some]
        return out

    @property
    def _middle(self) -> Array:
        """q in the middle of the step, at its end in statics, shape (some, m)."""
        return self._q[0] + self.step.share * self.dq[self._some]

    @cached_property
    def _stress(self) -> Array:
        """s = Ω e + C Δe with the mean of e, shape (some, m) [N].

        The energy grows by it times the change of e, which is that at the mean of q: e is of second
        order.
        """
        some, de = self._some, self.de[self._some]
        out = times(self._shapes.stiffness, self.start.stretched[some] + self.step.share * de)
        return out if self.step.damping is None else out + times(self.step.damping[some], de)

    # Nodes ----------------------------------------------------------------------------------------

    @cached_property
    def displacement(self) -> Array:
        """The matrices of the displacements, shape (bodies, n, 3) [m, 1]."""
        rigid, some, m = self._part("displacement"), self._some, self.dq.shape[1]
        both, turning = np.empty((some.size, m, 2)), np.empty((some.size, 2, 9))
        both[:, :, 0], both[:, :, 1] = self.dq[some], self._q[0]
        turning[:, 0] = self._R[1].swapaxes(1, 2).reshape(-1, 9)
        turning[:, 1] = rigid[some, 1:].reshape(-1, 9)  # R₁ᵀ - R₀ᵀ
        out = np.zeros((len(self), 4 + 3 * m, 3))
        out[:, :4] = rigid
        out[some, 4:] = (both @ turning).reshape(some.size, -1, 3)
        return out

    @cached_property
    def _turning(self) -> tuple[Array, Array]:
        """-v̂/ℓ of the columns of ½ (R₀ + R₁), and of R₁ times T, shape (bodies, 9, 3) [1/m]."""
        return self._levers(self.R_av), self._levers(self.R1) @ self.T

    @cached_property
    def _arms(self) -> tuple[Array, Array]:
        """The same of bodies with shapes, of R₀ and of R₁ without T, shape (some, 9, 3) [1/m]."""
        skews = self.start.of.skews[self._some]
        R0, R1 = ((R.swapaxes(1, 2) @ skews).reshape(-1, 9, 3) for R in self._R)
        return R0, R1

    def _on_the_way(self, end: bool) -> list[tuple[float, Array, Array]]:
        """Weights, q and arms of the ends of the step whose mean turns nodes of shapes."""
        (q0, q1), (before, after) = self._q, self._arms
        if end or self.step.share == 1.0:
            return [(1.0, q1, after)]
        return [(0.5, q0, before), (0.5, q1, after)]

    def _followed_by(self, end: bool) -> Array:
        """L, or P at the end of the step."""
        of, some, m, R = self.start.of, self._some, self.dq.shape[1], self._R[1] if end else self.S
        out = of.frames.copy()
        out[:, 3:12, 3:6] = self._turning[end]
        own = np.zeros((some.size, m, 9, 3))
        for weight, q, arms in self._on_the_way(end):
            own += weight * q[:, :, None, None] * arms[:, None]
        turned = own @ self.T[some, None] if end else own
        out[some, 12:, 3:6] = turned.reshape(some.size, 9 * m, 3)
        out[some, :3, 6:] = R @ self._drift.swapaxes(1, 2)
        blocks, each = np.zeros((some.size, m, 3, 3, m)), np.arange(m)
        known = self._shapes.known[some].T[:, :, None, None]
        blocks[:, each, :, :, each] = R.swapaxes(1, 2) * known
        out[some, 12:, 6:] = blocks.reshape(some.size, 9 * m, m)
        return out

    @cached_property
    def L(self) -> Array:
        """Of the displacements Δr + θ × (x½ - c½) + S Φ Δq, shape (bodies, 3 n, 6 + m)."""
        return self._followed_by(end=False)

    @cached_property
    def P(self) -> Array:
        """Derivative of `displacement`: δr + T δθ × v₁ + R₁ Φ δq, likewise."""
        return self._followed_by(end=True)

    def led(self, a: Array, of: Ints, end: bool = False) -> Array:
        """How places follow the unknowns of their bodies; arguments as for rigid ones."""
        own = np.flatnonzero(self._shapes.counts[of])
        some, m = np.searchsorted(self._some, of[own]), self.dq.shape[1]
        out = np.zeros((*a.shape[:2], 3, 6 + m))
        out[..., :3] = a[:, :, :1, None] * IDENTITY
        arms = self._turning[end][of].reshape(-1, 3, 9)
        out[..., 3:6] = (a[:, :, 1:4] @ arms).reshape(*a.shape[:2], 3, 3)
        shapes = a[own, :, 4:].reshape(own.size, a.shape[1], m, 3)
        turned = np.zeros((own.size, a.shape[1], 3, 3))
        for weight, q, at in self._on_the_way(end):
            y = weight * (q[some, None, None] @ shapes)[:, :, 0]
            turned += (y @ at[some].reshape(-1, 3, 9)).reshape(turned.shape)
        out[own, :, :, 3:6] += turned @ self.T[of[own], None] if end else turned
        R = (self._R[1] if end else self.S)[some]
        follow = R[:, None] @ shapes.swapaxes(2, 3)
        if self._held.size:
            drift = R @ self._drift[some].swapaxes(1, 2)
            follow = follow + a[own, :, :1, None] * drift[:, None]
        out[own, :, :, 6:] = follow
        return out

    @cached_property
    def _apart(self) -> Array:
        """Unknowns with Δr less its part that follows Δq, shape (bodies, 6 + m)."""
        if not self._held.size:
            return self.unknowns
        out, some = self.unknowns.copy(), self._some
        out[some, :3] -= times(self._drifts(self.S).swapaxes(1, 2), self.dq[some])
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

    def resultant(self, moments: Array) -> Array:
        """Lᵀ without L: torques Σ (x½ - c½) × f and Q = Σ Φᵀ Sᵀ f, shape (bodies, 6 + m) [N]."""
        some, m = self._some, self.dq.shape[1]
        out = np.zeros(self.unknowns.shape)
        out[:, :6] = super().resultant(moments[:, :4])
        flat = moments[some, 4:].reshape(some.size, m, 9)
        both = np.stack(self._q, axis=1)
        ends = (both @ flat).reshape(-1, 2, 3, 3)  # Σ (Φ q) fᵀ
        turned = self._R[1] @ ends[:, 1]
        if self.step.share != 1.0:
            turned = 0.5 * (turned + self._R[0] @ ends[:, 0])
        out[some, 3:6] += axial(turned) / self.start.of.length[some, None]
        own = times(flat, self.S.swapaxes(1, 2).reshape(-1, 9))
        if self._held.size:
            own += times(self._drifts(self.S), out[some, :3])
        out[some, 6:] = own
        return out

    def balance(self, moments: Array, torques: Array) -> Array:
        """Residual of the bodies with the rows of shapes, shape (bodies, 6 + m) [N]."""
        out = self.resultant(moments)
        out += self._inertia_force
        out[:, 3:6] -= torques / self.start.of.length[:, None]
        out[:, 6:] += self.elastic_force()
        return out

    # Derivatives ----------------------------------------------------------------------------------

    def blocks(self, moments: Array) -> Array:
        """Derivative of the residual that P does not carry, shape (bodies, 6 + m, 6 + m) [N/m]."""
        some, m, share = self._some, self.dq.shape[1], self.step.share
        length = self.start.of.length[some, None, None]
        M = moments[some, 4:].reshape(some.size, m, 3, 3)  # Σ Φ_k fᵀ
        every = moments[:, :4].copy()
        flat = self._q[1][:, None] @ M.reshape(some.size, m, 9)
        every[some, 1:] += flat.reshape(-1, 3, 3)  # Σ (V + Φ q) fᵀ
        G = np.zeros((len(self), *2 * self.unknowns.shape[1:]))
        G[:, :6, :6] = super().tangent(super().couples(every))
        torques = axial(self._R[1][:, None] @ M)  # Σ R₁ Φ_k × f
        by_q = share * torques.swapaxes(1, 2)
        middle = 0.5 * axial(self._R[0][:, None] @ M)
        by_turn = torques @ self.T[some] if share == 1.0 else middle
        own = share * self._shapes.stiffness
        if self.step.damping is not None:
            own = own + self.step.damping[some]
        own = self._shapes.on_coordinates_by(self._middle, self._q[1], own)
        own = own + share * self._shapes.turned(self._stress)
        if self.step.rate:
            turn, more = self._of_inertia()
            G[some, 3:6, 3:6] += turn[0] / length**2
            by_q, by_turn, own = by_q + turn[1], by_turn + turn[2], own + more
        G[some, 3:6, 6:], G[some, 6:, 3:6] = by_q / length, by_turn / length
        G[some, 6:, 6:] = own
        return G

    def _of_inertia(self) -> tuple[tuple[Array, Array, Array], Array]:
        """Inertia of shapes: rows of θ by θ and by q, rows of q by θ, and rows of q by q."""
        shapes, start, dt, (_, R1) = self._shapes, self.start, self.step.dt, self._R
        (W1, rates), (W0, before), back = self._rates, self._before, self._R[0].swapaxes(1, 2)
        rate, E, half, some = 2 / dt, self._weighted, self._half, self._some
        B = shapes.coupling(E)
        gained = start.of.inertia[some] - start.inertia[some]
        gained += shapes.added_inertia(self._q[1], E)
        by_q = rate * B + shapes.gained(E, W1) + shapes.twisting(rates)
        by_W = 0.5 * (shapes.gained(half, W0) + shapes.twisting(before))
        own = (rate * shapes.mass - shapes.twisted(W1 + W0)) / dt
        own -= 0.5 * shapes.curvature(contracted(W1, W0))
        if self._held.size:
            drifting = self._drifts(self.S) @ self._drifts(R1).swapaxes(1, 2)
            own += rate / dt * start.of.mass[some, None, None] * drifting
        turn = rate / dt * R1 @ gained @ back
        by_turn = rate * (B / dt - by_W).swapaxes(1, 2) @ back
        return (turn, np.asarray(R1 @ by_q / dt), by_turn), own
