"""A trial step of bodies that deform by shapes: what Δq changes in the step of rigid bodies.

With w = (W, q̇), w₁ = 2 (R₀ᵀθ, Δq)/Δt - w₀, (Z, p) = A(q) w, q½ = q₀ + ½ Δq and S = (1 + ½θ̂) R₀, the
rows of a body are, Q = Σ Φᵀ Sᵀ f the forces on its nodes,

    (R₁ Z₁ - R₀ Z₀)/Δt = Σ (x½ - c½) × f,
    (p₁ - p₀)/Δt - ½ w₁·∂A/∂q(q½) w₀ + f₀ + Ω q½ + C Δq = Q.

A is of second order in q, so that A₁ - A₀ = ∂A/∂q(q½) Δq; the rows times θ and Δq then add up to
the gain of kinetic energy and of U(q), as nodes move by exactly

    Δx = Δc + θ × (x½ - c½) + S Φ Δq.

The frame of a body that a support holds is given: Δr follows Δq by Δc₀ and the drift, and the rows
of Δr and θ are the force and the moment of the support.

The derivative is complete, forces on nodes included: with v₁ = R₁ (V + Φ q₁), moments change by
½ (T dθ × v₁ + R₁ Φ dq) × f, and Q_k by ½ dθ · (R₀ Φ_k × f).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step
from rigidfx.mechanics.rotation import IDENTITY, axial, cayley, skew
from rigidfx.mechanics.shapes import ShapesOfBodies, contracted, times

__all__ = ["increments_of"]

Array = npt.NDArray[np.float64]


def increments_of(step: Step, unknowns: Array) -> Increments:
    """A trial step.

    Args:
        step: The step.
        unknowns: Δr, ℓθ and Δq, shape (bodies, 6 + m) [m], from then on not to be changed.
    """
    kind = Increments if step.start.of.shapes is None else ShapedIncrements
    return kind(step, unknowns)


class ShapedIncrements(Increments):
    """A trial step of bodies some of which have shapes."""

    def __init__(self, step: Step, unknowns: Array) -> None:
        """See `Increments`; Δr and ℓθ of bodies that are held are of no meaning."""
        shapes, start = step.start.of.shapes, step.start
        assert shapes is not None
        self._held = np.flatnonzero(shapes.held)
        if self._held.size:
            unknowns, held = unknowns.copy(), self._held
            given = np.zeros((len(start), 6)) if step.given is None else step.given
            # Increments by themselves: differences of places would lose digits.
            turn = np.array([cayley(theta) - IDENTITY for theta in given[held, 3:]])
            gained = np.einsum("bkc,bk->bc", shapes.drift[held], unknowns[held, 6:])
            gained = times(start.R[held], gained)
            before = times(start.R[held], start.drifted[held])
            unknowns[held, :3] = given[held, :3] + gained + times(turn, before + gained)
            unknowns[held, 3:6] = given[held, 3:] * start.of.length[held, None]
        super().__init__(step, unknowns)

    @property
    def _shapes(self) -> ShapesOfBodies:
        shapes = self.start.of.shapes
        assert shapes is not None
        return shapes

    @property
    def dq(self) -> Array:
        """Δq, shape (bodies, m) [m]."""
        return self.unknowns[:, 6:]

    @cached_property
    def _q1(self) -> Array:
        return np.asarray(self.start.q + self.dq)

    @cached_property
    def _rates(self) -> tuple[Array, Array]:
        """W and q̇ at the end of the step."""
        W = self.step.rate * (self.theta[:, None] @ self.start.R)[:, 0]
        rates = self.step.rate * self.dq - self.start.q_rate
        return W - self.start.angular_velocity_body, rates

    @cached_property
    def _S(self) -> Array:
        """S, with which nodes follow Δq; R₁ in statics, shape (bodies, 3, 3)."""
        if self.step.share == 1.0:
            return self.R1
        R0 = self.start.R
        return np.asarray(R0 + 0.5 * skew(self.theta) @ R0)

    # Inertia and elastic energy -------------------------------------------------------------------

    @cached_property
    def _weighted(self) -> Array:
        """E of the shapes at the end of the step: see `ShapesOfBodies.weighted`."""
        return self._shapes.weighted(self._q1)

    @cached_property
    def _half(self) -> Array:
        """The same in the middle: it is linear in q."""
        return np.asarray(0.5 * (self.start.weighted + self._weighted))

    @cached_property
    def _momenta(self) -> tuple[Array, Array]:
        """Z and p at the end of the step, shapes (bodies, 3) and (bodies, m)."""
        W, rates = self._rates
        turning, own = self._shapes.momenta(self._q1, W, rates, self._weighted)
        return times(self.start.of.inertia, W) + turning, own

    @property
    def pi1(self) -> Array:
        """See `Increments`."""
        if self.step.rate == 0.0:
            return np.zeros((len(self), 3))
        return times(self.R1, self._momenta[0])

    @cached_property
    def end(self) -> Bodies:
        """See `Increments`."""
        rigid, (_, rates) = super().end, self._rates
        velocities = rigid.velocity, rigid.angular_velocity_body
        return Bodies(self.start.of, rigid.frame, *velocities, self._q1, rates)

    def inertia_force(self) -> Array:
        """See `Increments`, with (p₁ - p₀)/Δt - ½ w₁·∂A/∂q w₀; shape (bodies, 6 + m) [N]."""
        return self._inertia_force.copy()

    @cached_property
    def _inertia_force(self) -> Array:
        out = np.zeros(self.unknowns.shape)
        out[:, :3] = self._part("force")[:, :3]
        if self.step.rate == 0.0:
            return out
        dt, start = self.step.dt, self.start
        turned = self.pi1 - start.angular_momentum
        out[:, 3:6] = turned / (dt * start.of.length)[:, None]
        rates = start.angular_velocity_body, start.q_rate
        own = (self._momenta[1] - start.momenta_of_shapes[1]) / dt
        out[:, 6:] = own - self._shapes.gradient(self._half, self._rates, rates)
        if self._held.size:
            out[:, 6:] += times(self._drifts(self._S), out[:, :3])
        return out

    def _drifts(self, R: Array) -> Array:
        """How centres of mass follow shapes in frames that are held, shape (bodies, m, 3)."""
        return self._shapes.drift @ R.swapaxes(1, 2)

    def elastic_force(self) -> Array:
        """f₀ + Ω q½ + C Δq, shape (bodies, m) [N]; at the end of a step of statics."""
        share, shapes = self.step.share, self._shapes
        out = shapes.force + times(shapes.stiffness, self.start.q + share * self.dq)
        return out if self.step.damping is None else out + times(self.step.damping, self.dq)

    # Nodes ----------------------------------------------------------------------------------------

    @cached_property
    def displacement(self) -> Array:
        """See `Increments`."""
        rigid, m = self._part("displacement"), self.dq.shape[1]
        both, turning = np.empty((len(self), m, 2)), np.empty((len(self), 2, 9))
        both[:, :, 0], both[:, :, 1] = self.dq, self.start.q
        turning[:, 0] = self.R1.swapaxes(1, 2).reshape(-1, 9)
        turning[:, 1] = rigid[:, 1:].reshape(-1, 9)  # R₁ᵀ - R₀ᵀ
        return np.concatenate([rigid, (both @ turning).reshape(len(self), -1, 3)], axis=1)

    def _arms(self, q: Array, R: Array) -> Array:
        """-v̂/ℓ of the columns of R and of all q_k R, shape (bodies, 3 (n - 1), 3)."""
        own = self._levers(R).reshape(len(self), 1, 9, 3)
        return np.concatenate([own, q[:, :, None, None] * own], axis=1).reshape(len(self), -1, 3)

    def _followed_by(self, arms: Array, R: Array) -> Array:
        """Derivatives of nodes' increments, by arms of rotations and R Φ of shapes."""
        out = self.start.of.frames.copy()
        out[:, 3:, 3:6] = arms
        out[:, :3, 6:] = R @ self._shapes.drift.swapaxes(1, 2)
        m = self.start.of.columns - 6
        own = out[:, 12:, 6:].reshape(len(self), m, 3, 3, m)  # a view: out is changed
        each = np.arange(m)
        own[:, each, :, :, each] = R.swapaxes(1, 2) * self._shapes.known.T[:, :, None, None]
        return out

    @cached_property
    def L(self) -> Array:
        """See `Increments`: Δr + θ × (x½ - c½) + S Φ Δq."""
        if self.step.share == 1.0:
            return self._followed_by(self._arms(self._q1, self.R1), self.R1)
        both = self._arms(self.start.q, self.start.R) + self._arms(self._q1, self.R1)
        return self._followed_by(0.5 * both, self._S)

    @cached_property
    def P(self) -> Array:
        """See `Increments`: δr + T δθ × v₁ + R₁ Φ δq."""
        return self._followed_by(self._arms(self._q1, self.R1) @ self.T, self.R1)

    @cached_property
    def _apart(self) -> Array:
        """Unknowns with Δr less its part that follows Δq, shape (bodies, 6 + m)."""
        out = self.unknowns.copy()
        out[:, :3] -= times(self._drifts(self._S).swapaxes(1, 2), self.dq)
        return out

    def work(self, forces: Array) -> float:
        """See `Increments`."""
        return float(np.vdot(forces, self._apart))

    def work_of_supports(self, rows: Array) -> float:
        """Work of supports on the frames that they hold [J].

        Args:
            rows: Residual of the bodies, as `balance` gives it; its rows of Δr and θ are what the
                supports exert.
        """
        held = self._held
        return float(np.vdot(rows[held, :6], self._apart[held, :6]))

    def resultant(self, moments: Array) -> Array:
        """See `Increments`; Lᵀ without L, as torques Σ (x½ - c½) × f and Q = Σ Φᵀ Sᵀ f."""
        flat = moments[:, 1:].reshape(len(self), -1, 9)
        both = np.empty((len(self), 2, self.dq.shape[1]))
        both[:, 0], both[:, 1] = self.start.q, self._q1
        ends = (both @ flat[:, 1:] + flat[:, :1]).reshape(-1, 2, 3, 3)  # Σ y fᵀ
        turned = self.R1 @ ends[:, 1]
        if self.step.share != 1.0:
            turned = 0.5 * (turned + self.start.R @ ends[:, 0])
        out = np.empty(self.unknowns.shape)
        out[:, :3] = moments[:, 0]
        out[:, 3:6] = axial(turned) / self.start.of.length[:, None]
        out[:, 6:] = times(flat[:, 1:], self._S.swapaxes(1, 2).reshape(-1, 9))
        if self._held.size:
            out[:, 6:] += times(self._drifts(self._S), out[:, :3])
        return out

    def balance(self, moments: Array, torques: Array) -> Array:
        """See `Increments`."""
        out = self.resultant(moments)
        out += self._inertia_force
        out[:, 3:6] -= torques / self.start.of.length[:, None]
        out[:, 6:] += self.elastic_force()
        return out

    # Derivatives ----------------------------------------------------------------------------------

    def blocks(self, moments: Array) -> Array:
        """See `Increments`."""
        share, shapes, length = self.step.share, self._shapes, self.start.of.length
        M = moments[:, 1:].reshape(len(self), -1, 3, 3)  # Σ V fᵀ and Σ Φ_k fᵀ
        flat = M.reshape(len(self), -1, 9)
        every = moments[:, :4].copy()
        every[:, 1:] += (self._q1[:, None] @ flat[:, 1:]).reshape(-1, 3, 3)
        G = np.zeros((len(self), *2 * self.unknowns.shape[1:]))
        G[:, :6, :6] = super().tangent(super().couples(every))
        torques = axial(self.R1[:, None] @ M[:, 1:])  # Σ R₁ Φ_k × f
        G[:, 3:6, 6:] = share * torques.swapaxes(1, 2)
        if share == 1.0:
            G[:, 6:, 3:6] = torques @ self.T
        else:
            G[:, 6:, 3:6] = 0.5 * axial(self.start.R[:, None] @ M[:, 1:])
        G[:, 6:, 6:] = share * shapes.stiffness
        if self.step.damping is not None:
            G[:, 6:, 6:] += self.step.damping
        if self.step.rate:
            self._add_inertia(G)
        G[:, 3:6, 6:] /= length[:, None, None]
        G[:, 6:, 3:6] /= length[:, None, None]
        return G

    def _add_inertia(self, G: Array) -> None:
        """Add the inertia of shapes to G, whose rotations are not scaled yet."""
        shapes, start, dt = self._shapes, self.start, self.step.dt
        (W1, rates), W0 = self._rates, start.angular_velocity_body
        back, rate, E, half = start.R.swapaxes(1, 2), 2 / dt, self._weighted, self._half
        B = shapes.coupling(E)
        inertia = start.of.inertia + shapes.added_inertia(self._q1, E)
        gained = self.R1 @ (inertia - start.inertia) @ back
        G[:, 3:6, 3:6] += rate / dt * gained / start.of.square_length
        by_q = shapes.gained(E, W1) + shapes.twisting(rates)
        G[:, 3:6, 6:] += self.R1 @ (rate * B + by_q) / dt
        by_W = 0.5 * (shapes.gained(half, W0) + shapes.twisting(start.q_rate))
        G[:, 6:, 3:6] += rate * (B / dt - by_W).swapaxes(1, 2) @ back
        own = (rate * shapes.mass - shapes.twisted(W1 + W0)) / dt
        own -= 0.5 * shapes.curvature(contracted(W1, W0))
        G[:, 6:, 6:] += own
        if self._held.size:
            drifting = self._drifts(self._S) @ self._drifts(self.R1).swapaxes(1, 2)
            G[:, 6:, 6:] += rate / dt * start.of.mass[:, None, None] * drifting
