"""Joints of the twin: the difference of their forces on u + e and on u drives e.

    M ë + C ė + K e = r + Bᵀ μ ,     B e = b ,     B = D Q W

W gives the averages of which joints consist, Q rotates those of each part from the frame of the
shape into space. D has the derivatives of the joints' rows, and of angles and travels that motors
prescribe, at the averages of the run at the end of the step. b is zero but for motors of given
speed, and locks: these keep B e as it is when they begin, where impulses make B ė zero. For a
spring of a joint or between points, or a stop, μ is the difference of its forces at u + e and at u.

e of each part stays in that part's frame, and so does the step's inverse A⁻¹. With its columns
Y = A⁻¹ Wᵀ, found once for steps of one length, e = e₀ + Y Qᵀ Dᵀ μ. So a step takes one solution for
e₀, and one with the small matrix D Q (W Y) Qᵀ Dᵀ, the only part that depends on the pose.

Free rigid motions N of all parts, which neither supports, nor springs, nor joints resist, would
grow in e without limit. So NᵀM e = 0 are rows, too (`loose`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.linalg import null_space
from scipy.sparse import csr_array, vstack

from rigidfx.base.matrices import dense
from rigidfx.base.types import Array, Bools
from rigidfx.effects import Joint, JointSpring, Motor, SpringDamper, Stop
from rigidfx.effects.joints.joint import Between
from rigidfx.effects.joints.pieces import Terms
from rigidfx.effects.joints.vectors import Vectors
from rigidfx.error.contacts import Search, increments_of
from rigidfx.error.frames import Frames
from rigidfx.error.loose import Loose
from rigidfx.error.response import AllUnknowns
from rigidfx.mechanics.rigid_motions import RIGID
from rigidfx.scene.scene import Scene
from rigidfx.step.newton.parted import parted
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt

__all__ = ["Joints", "joined_parts"]


@dataclass(frozen=True)
class _Held:
    """Rows and laws of a step, on ports.

    Attributes:
        rows: Coordinates that are given at its end, shape (rows, ports).
        values: Their values, shape (rows,).
        along: Coordinates of laws, shape (laws, ports).
        laws: Force along each of them on u + e, less that on u.
    """

    rows: Array
    values: Array
    along: Array
    laws: Sequence[_Law]


class Joints:
    """The joints of the twin. Arrays are equal on all ranks but for those of nodes.

    Ports are what rows are made of: averages of e in each part, three each, and momenta of parts.
    """

    def __init__(
        self, stepper: Stepper, frames: Frames, loose: Loose, begun: dict[int, float]
    ) -> None:
        """Keep the averages. Collective.

        Args:
            stepper: Solves the steps.
            frames: The shape.
            loose: Motions that parts have as a whole which only joints hold.
            begun: B e that motors of given motion hold, by their number among all effects.
        """
        self._stepper, self._frames, self._search = stepper, frames, Search()
        self._loose = loose
        self._scene = scene = stepper.scene
        joints, springs = scene.named(Joint), scene.named(SpringDamper)
        vectors = [vector for own in (*joints, *springs) for vector in own.averages]
        firsts = [0, *accumulate(len(own.averages) for own in (*joints, *springs))]
        self._springs = list(zip(firsts[len(joints) :], springs, strict=False))
        self._terms = Terms([joint.pieces.rows for joint in joints], firsts, len(vectors))
        self._vectors = Vectors(vectors, {})
        averages = self._vectors.averages
        self._constant = np.reshape([a.constant for a in averages], (-1, 3))
        # Of each average, its share in each connected part, which alone has one frame.
        own = np.concatenate([np.empty(0), *(a.weights for a in averages)])
        nodes = np.concatenate([np.empty(0, np.int64), *(a.nodes for a in averages)])
        shares = np.repeat(np.arange(len(averages)), [a.nodes.size for a in averages])
        shares = shares * scene.parts.count + frames.part[nodes]
        counts = np.bincount(shares, minlength=len(averages) * scene.parts.count)
        known = np.flatnonzero(scene.sum(counts.astype(float)))
        self._average, self._part = np.divmod(known, scene.parts.count)
        at = np.searchsorted(known, shares), nodes
        self._W = csr_array((own, at), shape=(known.size, scene.owned_nodes))
        self._E = csr_array((0, 0))  # ports of e
        self._Y = csr_array((0, 0))  # e by unit forces at ports
        self._C: Array = np.empty((0, 0))  # E Y
        self._led: Array = np.empty((0, 0))  # averages by motions that parts have as a whole
        self._kind: tuple[float, ...] = ()
        self._step: tuple[Array, Array] = np.empty((0, 3, 3)), np.empty((0, 3))
        self._t = self._impact = np.nan  # start of this step, and of the last one after an impact
        self._begun = begun
        self._numbers = {id(effect): k for k, effect in enumerate(scene.effects)}
        # Motions of all parts that nothing holds, by columns, of those that parts have as a whole.
        self.free: Array = np.empty((loose.count, 0))

    def follow(self, attempt: Attempt) -> None:
        """Find parts and averages at the end of a step that has been solved. Collective."""
        state = self._stepper.state
        x = state.places
        x = x + increments_of(self._stepper, attempt)
        self._t = attempt.t
        means = self._constant.copy()
        np.add.at(means, self._average, np.asarray(self._scene.sum(self._W @ x)))
        self._step = self._frames.of_parts(x)[self._part], self._vectors.begin(means)

    def struck(self) -> None:
        """Record that ė has changed by an impact at the start of the next step."""
        self._impact = self._stepper.state.t

    def close(
        self,
        response: AllUnknowns,
        start: tuple[Array, Array],
        given: tuple[float, float, float],
    ) -> None:
        """Correct e at the end of a step without joints by theirs. Collective.

        Args:
            response: Has e.
            start: e [m] and ė [m/s] at the start of the step, shape (nodes, 3) each.
            given: Length of the step [s], and its damping.
        """
        self._have_columns(response, given)
        dt = given[0]
        held = self._held(self._ports(start[0]), dt)
        mu = self._multipliers(held, self._ports(response.fields()[0]))
        more = self._Y @ (mu @ np.concatenate([held.rows, held.along]))
        response.shift(more.reshape(-1, 3), dt)
        if self._impact == self._t:
            # Impulses at its start change no e at its end, as the joints' own forces make up.
            response.kick(self._stopped(response, held.rows, start[1]))

    def _stopped(self, response: AllUnknowns, rows: Array, rate: Array) -> Array:
        """Part of ė that impulses of the joints take at once, M⁻¹ Bᵀ (B M⁻¹ Bᵀ)⁻¹ B ė. Collective.

        Args:
            response: Has the mass.
            rows: B.
            rate: ė, shape (nodes, 3) [m/s].
        """
        by = response.by_impulses(self._E.toarray().reshape(-1, *rate.shape))
        by = by.reshape(self._E.shape)
        mobility = rows @ np.asarray(self._scene.sum(self._E @ by.T)) @ rows.T
        return np.reshape(_inverse(mobility) @ (rows @ self._ports(rate)) @ rows @ by, (-1, 3))

    def unheld(self) -> Bools:
        """Owned nodes of parts that joints leave free to move as a whole. Collective."""
        part = self._frames.part
        if not self.free.shape[1]:
            return np.zeros(part.size, dtype=bool)
        moved = np.abs(self._loose.motions @ self.free).max(axis=1).reshape(-1, 3).max(axis=1)
        of_parts = np.zeros(self._scene.parts.count)
        np.maximum.at(of_parts, part, moved)
        self._scene.comm.Allreduce(MPI.IN_PLACE, of_parts, op=MPI.MAX)
        return np.asarray((of_parts > RIGID * of_parts.max())[part])

    def _ports(self, e: Array) -> Array:
        """Ports of e, shape (ports,). Collective."""
        return np.asarray(self._scene.sum(self._E @ e.reshape(-1)))

    def _have_columns(self, response: AllUnknowns, given: tuple[float, float, float]) -> None:
        """Compute the response at all nodes to unit forces at ports. Collective."""
        if self._kind == given:
            return
        self._kind = given
        n = 3 * self._scene.owned_nodes
        W = self._W.tocoo()
        at = [(3 * k[:, None] + np.arange(3)).ravel() for k in W.coords]
        shape = 3 * W.shape[0], n
        averages = csr_array((np.repeat(W.data, 3), at), shape=shape)
        self._E = csr_array(vstack([averages, csr_array(self._loose.momenta.T)], format="csr"))
        self._led = np.asarray(self._scene.sum(averages @ self._loose.motions))
        kept = response.kept()
        response.rest()
        alone = response.kept()

        def solve(force: Array) -> Array:
            response.restore(alone)
            response.step(force.reshape(-1, 3), *given)
            return response.fields()[0].reshape(-1)

        self._Y = parted(response.operator(*given), csr_array(self._E.T)).responses(solve)
        response.restore(kept)
        self._C = np.asarray(self._scene.sum((self._E @ self._Y).toarray()))

    # Rows -----------------------------------------------------------------------------------------

    def _held(self, start: Array, dt: float) -> _Held:
        """Rows and laws of the step that is followed.

        Args:
            start: Ports of e at the start of the step.
            dt: Length of the step [s].
        """
        p, motions = self._step[1], self._loose.count
        linkage = self._stepper.system.linkage
        assert linkage is not None
        rows, motors, along, laws = [], list[Any](), [], list[Any]()
        for drive in linkage.drives.each:
            own = np.zeros_like(p)
            np.add.at(own, drive.averages, drive.coordinate.gradient(p[drive.averages]))
            if drive.effect.prescribes:
                rows.append(drive.size * own)
                motors.append(drive.effect)
            elif not drive.effect.is_windowed:
                along.append(own)
                laws.append((drive.effect, *linkage.drives.ends_of(drive)))
        told = linkage.points.told()
        for k, spring in self._springs:
            own, known = np.zeros_like(p), told[spring.title]
            own[k : k + 2] = spring.gradient(p[k : k + 2])
            along.append(own)
            laws.append((spring, known.length - known.rate * dt, known.length))
        of_joints = dense(self._terms.gradient(p))
        B = self._turned(np.concatenate([of_joints, np.reshape(rows, (len(rows), p.size))]))
        of_laws = self._turned(np.reshape(along, (len(laws), p.size)))
        stiff = [law[0].resists for law in laws]
        self.free = _kernel(np.concatenate([B, of_laws[stiff]]) @ self._led)
        none, lost = np.zeros((len(B), motions)), np.zeros((self.free.shape[1], B.shape[1]))
        values = np.zeros(len(B) + len(lost))
        first = len(B) - len(motors)
        values[first : len(B)] = self._kept(motors, B[first:] @ start[: B.shape[1]])
        B = np.block([[B, none], [lost, self.free.T]])
        of_laws = np.concatenate([of_laws, np.zeros((len(laws), motions))], axis=1)
        began = of_laws @ start
        pairs = zip(laws, began, strict=True)
        laws = [_Law(effect, q0, q1, q, dt) for (effect, q0, q1), q in pairs]
        return _Held(B, values, of_laws, laws)

    def _kept(self, motors: Sequence[Motor], now: Array) -> Array:
        """B e that motors hold: of a given speed as it is when they begin, else zero.

        Args:
            motors: Those that prescribe a motion.
            now: B e of each at the start of the step.
        """
        acting = [self._numbers[id(motor)] for motor in motors]
        for k in self._begun.keys() - set(acting):
            del self._begun[k]
        for k, motor, q in zip(acting, motors, now, strict=True):
            if k not in self._begun:
                self._begun[k] = float(q) if motor.by_speed else 0.0
                self._impact = self._t
        return np.array([self._begun[k] for k in acting])

    def _turned(self, rows: Array) -> Array:
        """Derivatives by vectors in space as those by shares of averages in frames of parts."""
        by_averages = dense(self._vectors.onto_averages(csr_array(rows), 0.0))
        by_averages = by_averages.reshape(len(rows), len(self._vectors.averages), 3)
        of_shares = np.einsum("rai,aij->raj", by_averages[:, self._average], self._step[0])
        return np.asarray(of_shares.reshape(len(rows), self._led.shape[0]))

    def _multipliers(self, held: _Held, e: Array) -> Array:
        """μ of the rows and of the laws.

        Args:
            held: Both.
            e: Ports of e without joints.
        """
        rows, along = held.rows, held.along
        inverse = _inverse(rows @ self._C @ rows.T)
        open_by, across = rows @ e - held.values, rows @ self._C @ along.T
        # Coordinates of laws where the rows are held: e without laws, and its derivative by these.
        alone = along @ e - across.T @ inverse @ open_by
        S = along @ self._C @ along.T - across.T @ inverse @ across
        mu: Array = np.zeros(len(held.laws))
        for _ in range(self._search.iterations if mu.size else 0):
            found = alone + S @ mu
            force, slope = np.array(
                [own.more(q) for own, q in zip(held.laws, found, strict=True)]
            ).T
            change = np.linalg.solve(np.eye(mu.size) - slope[:, None] * S, force - mu)
            mu = mu + change
            if np.abs(change).max() <= self._search.tolerance * np.abs(mu).max():
                break
        return np.concatenate([-inverse @ (open_by + across @ mu), mu])


@dataclass(frozen=True)
class _Law:
    """The law of a spring of a joint, or of a stop, on u + e.

    Attributes:
        effect: It, or a spring between two points.
        start: Angle, travel or length of u at the start of the step [rad or m].
        end: The same at its end.
        began: That of e at the start.
        dt: Length of the step [s].
    """

    effect: JointSpring | SpringDamper | Stop
    start: float
    end: float
    began: float
    dt: float

    def more(self, e: float) -> tuple[float, float]:
        """Force or torque on u + e less that on u, and its derivative by e at the end."""
        own, _ = self.effect.law(self.start, self.end, self.dt)
        force, slope = self.effect.law(self.start + self.began, self.end + e, self.dt)
        return force - own, slope


def joined_parts(scene: Scene) -> Bools:
    """Which connected parts joints and springs take hold of, shape (parts,). Collective."""
    on = np.zeros(len(scene.start_places), dtype=bool)
    for joint in scene.named(Between):
        for average in joint.averages:
            on[average.nodes] = True
    cells = on[scene.space.dofmap.list].any(axis=1)
    counts = np.bincount(scene.parts.of_cell[cells], minlength=scene.parts.count)
    return np.asarray(scene.sum(counts.astype(np.float64)) > 0)


def _inverse(S: Array) -> Array:
    """A pseudo-inverse: rows that others imply have no force of their own."""
    own = np.sqrt(np.diagonal(S))
    own = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0)
    values, vectors = np.linalg.eigh(own[:, None] * S * own)
    # Of solves with factors of parts a thousand times as stiff as others.
    seen = values > np.finfo(np.float64).eps ** (2 / 3) * values.max(initial=0.0)
    root = own[:, None] * vectors[:, seen]
    return np.asarray(root / values[seen] @ root.T)


def _kernel(rows: Array) -> Array:
    """Motions that no row resists, by columns."""
    if not rows.shape[1]:
        return np.empty((0, 0))
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.divide(rows, sizes, out=np.zeros_like(rows), where=sizes > 0)
    return np.asarray(null_space(rows, rcond=RIGID))
