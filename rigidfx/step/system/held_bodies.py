"""Bodies that supports hold or move: what their paths give frames and shapes in a step.

The frame of a body follows one support, or rests. Further places that supports hold are guides: the
first shapes are responses to unit motions of their nodes, so that q of these is how the nodes move
in the frame, and the rows of q are the forces of the guides.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.errors import together
from rigidfx.base.types import Array, Ints
from rigidfx.coupling.dof_layout import AtNodes
from rigidfx.coupling.ports import far_apart
from rigidfx.effects import Support
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rigid_motions import RIGID, independent, rigid_motions
from rigidfx.mechanics.rotation import IDENTITY, axial, skew
from rigidfx.mechanics.shaped_step import ShapedIncrements
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.division import Hold
from rigidfx.step.equations.supports import dofs_of

# Places of a support that count each for itself: with six motions of all but one a part has as many
# coordinates that are given as it may have shapes (`rigidfx.shapes.part`).
PLACES = 7


@dataclass(frozen=True)
class _Points:
    """Points of a body that a support holds."""

    body: int  # number among the bodies
    support: Support  # the support
    X: Array  # their reference positions, shape (points, 3) [m]
    # Their places in the body's frame at the freeze, from its centre of mass then [m]
    offsets: Array

    @property
    def moves(self) -> bool:
        """Whether the support moves them."""
        return self.support.moves or not self.support.uniform

    def places(self, bodies: Bodies) -> Array:
        """Where they are, shape (points, 3) [m]."""
        k = self.body
        return np.asarray(_origin(bodies, k) + self.offsets @ bodies.R[k].T)


@dataclass(frozen=True)
class _Guide(_Points):
    """Points that move in the frame, one for each coordinate that the support gives."""

    own: slice  # these coordinates among those of the body
    axes: Ints  # component of each point that tells of its motion, shape (points,)
    modes: Array  # all shapes of the body at the points, shape (m, points, 3)
    # Force and moment about the frame's origin, over ℓ, by the forces on the coordinates, shape (6,
    # points)
    resultant: Array

    def places(self, bodies: Bodies) -> Array:
        """See `_Points`."""
        moved = self.moved(bodies.q[self.body])
        return np.asarray(super().places(bodies) + moved @ bodies.R[self.body].T)

    def moved(self, q: Array) -> Array:
        """Displacements of the points in the frame by all coordinates, shape (points, 3) [m]."""
        return np.asarray(np.einsum("k,kna->na", q[: len(self.modes)], self.modes))

    def coordinates(self, moved: Array) -> Array:
        """Coordinates by displacements of the points in the frame, shape (points, 3) [m]."""
        n, axes = np.arange(self.axes.size), self.axes
        return np.asarray(np.linalg.solve(self.modes[self.own, n, axes].T, moved[n, axes]))


class HeldBodies:
    """The bodies of a division that supports hold; all ranks know the same."""

    def __init__(self, scene: Scene, held: Mapping[str, Hold], bodies: Bodies) -> None:
        """Find points that tell the motion of bodies with supports by their names. Collective."""
        self._scene = scene
        self._frames: dict[int, _Points | None] = {}
        self._guides: dict[int, list[_Guide]] = {}
        for k, data in enumerate(bodies.of.records):
            if (hold := held.get(data.name)) is not None and data.shapes is not None:
                self._frames[k] = None if hold.frame is None else self._frame(k, hold.frame, data)
                own = self._each_guide(k, hold, data) if data.shapes.given else ()
                self._guides[k] = list(own)
        guides: list[_Points] = [guide for own in self._guides.values() for guide in own]
        self._every = [*filter(None, self._frames.values()), *guides]

    def __len__(self) -> int:
        return len(self._frames)

    def _frame(self, k: int, support: Support, data: RigidBody) -> _Points:
        """Three nodes that a support holds, as the frame follows them. Collective."""
        scene = self._scene
        nodes = next(nodes for s, nodes in scene.supports if s is support)
        at = np.flatnonzero(np.isin(data.nodes, nodes))
        X = scene.space.tabulate_dof_coordinates()[data.nodes[at]]
        own = np.hstack([X, data.offsets[at]])[far_apart(X)]
        every = np.concatenate(scene.comm.allgather(own))
        chosen = every[far_apart(every[:, :3])]
        return _Points(k, support, chosen[:, :3], chosen[:, 3:])

    def _each_guide(self, k: int, hold: Hold, data: RigidBody) -> Iterator[_Guide]:
        """The guides in a body. Collective."""
        scene, first, shapes = self._scene, 0, data.shapes
        assert shapes is not None
        assert shapes.drift is not None
        X, offsets = scene.space.tabulate_dof_coordinates(), np.zeros((scene.owned_nodes, 3))
        offsets[data.nodes] = data.offsets
        for support, motions, rigid in guided(scene, hold, data, offsets):
            own = slice(first, first := first + rigid.shape[1])
            node, axis = np.nonzero(motions[data.nodes].any(axis=2))
            at = independent(motions[data.nodes[node], axis])
            node, axis = node[at], axis[at]
            modes, nodes = shapes.modes[node] + shapes.drift, data.nodes[node]
            told = axis, motions[nodes, axis], X[nodes], data.offsets[node], modes
            every = [np.concatenate(each) for each in zip(*scene.comm.allgather(told), strict=True)]
            axes, _, x, arms, modes = (each[independent(every[1])] for each in every)
            yield _Guide(k, support, x, arms, own, axes, modes.swapaxes(0, 1), rigid)

    def _asked(self, of: Callable[[_Points], Array]) -> dict[int, Array]:
        """Three numbers of each point by supports' paths, by the identity of points. Collective."""
        return together(
            self._scene.comm,
            "A support",
            lambda: {id(p): np.broadcast_to(of(p), p.X.shape) for p in self._every},
        )

    def given(self, t0: float, t1: float, bodies: Bodies) -> Array | None:
        """Δc₀, θ and Δq from t0 to t1, shape (bodies, 6 + m); None if all rest. Collective.

        A path that fails on any rank is a `SceneError` on all.
        """
        if not any(points.moves for points in self._every):
            return None
        ways = self._asked(lambda p: p.support.increments_of(t0, t1, p.X, p.places(bodies)))
        out = np.zeros((len(bodies), bodies.of.columns))
        for k, frame in self._frames.items():
            origin, turn = _origin(bodies, k), IDENTITY
            if frame is not None and frame.moves:
                x0, d = frame.places(bodies), ways[id(frame)]
                turn = IDENTITY if frame.support.uniform else _triad(x0 + d) @ _triad(x0).T
                out[k, :3] = d.mean(axis=0) + (turn - IDENTITY) @ (origin - x0.mean(axis=0))
                out[k, 3:6] = 2.0 * axial(turn.T) / (1.0 + np.trace(turn))  # Cayley's vector
            for guide in self._guides[k]:
                arms = guide.places(bodies) - origin
                moved = (ways[id(guide)] - out[k, :3]) @ turn + arms @ (turn - IDENTITY)
                out[k, 6:][guide.own] = guide.coordinates(moved @ bodies.R[k])
        return out

    def moving(self, t: float, dt: float, bodies: Bodies) -> Bodies:
        """The bodies, with frames and guides that move as supports do just after t. Collective.

        Supports exert impulses where shapes are zero, or on what they give, so that Σ m Φ̃·ẋ of
        others stays: nodes elsewhere keep their velocities, as far as shapes can tell them. Δt is
        the scale of difference quotients.
        """
        velocity, W = bodies.velocity.copy(), bodies.angular_velocity_body.copy()
        q_rate, blocks, shapes = bodies.q_rate.copy(), bodies.led_mass_blocks, bodies.of.shapes
        assert shapes is not None
        rates = self._asked(lambda p: p.support.velocities_at(t, dt, p.X, p.places(bodies)))
        for k, frame in self._frames.items():
            R, mass, origin = bodies.R[k], bodies.of.mass[k], _origin(bodies, k)
            none: Array = np.zeros(3)
            mean, omega, middle = none, none, origin
            if frame is not None:
                v, x = rates[id(frame)], frame.places(bodies)
                middle, mean = x.mean(axis=0), v.mean(axis=0)
                arms = -skew(x - middle).reshape(-1, 3)
                omega = np.asarray(np.linalg.lstsq(arms, (v - mean).reshape(-1))[0], np.float64)
            n, led = shapes.counts[k], mean + np.cross(omega, bodies.r[k] - middle)
            g, gained = int(shapes.given[k].sum()), np.zeros(n)
            for guide in self._guides[k]:
                x = guide.places(bodies)
                own = rates[id(guide)] - mean - np.cross(omega, x - middle)
                gained[guide.own] = guide.coordinates(own @ R) - q_rate[k, guide.own]
            drift = shapes.drift[k, :n] @ R.T
            B, A = (blocks[k, 6 : 6 + n, own] for own in (slice(3, 6), slice(6, 6 + n)))
            turning = bodies.of.length[k] * (omega - bodies.angular_velocity[k])
            impulse = B @ turning + A @ gained
            impulse += mass * drift @ (led + q_rate[k, :n] @ drift - velocity[k])
            gained[g:] -= np.linalg.solve(A[g:, g:], impulse[g:])
            q_rate[k, :n] += gained
            velocity[k] = led + q_rate[k, :n] @ drift
            W[k] = R.T @ omega
        return bodies.moving(velocity, W, q_rate)

    def reactions(
        self, increments: ShapedIncrements, rows: Array
    ) -> Iterator[tuple[str, Array, Array]]:
        """Force of each support on a body [N] and its moment about the origin [N m], by its set.

        The residual of the bodies in the step has the shape (bodies, 6 + m) [N].
        """
        start, share = increments.start, increments.step.share
        shapes, lengths = start.of.shapes, start.of.length
        assert shapes is not None
        q = start.q + share * increments.dq
        for k, frame in self._frames.items():
            middle, S = start.r[k] + share * increments.dr[k], increments.S[shapes.some == k][0]
            force, moment = rows[k, :3].copy(), lengths[k] * rows[k, 3:6]
            moment += np.cross(middle, force)
            for guide in self._guides[k]:
                own, couple = (guide.resultant @ rows[k, 6:][guide.own]).reshape(2, 3)
                moved = guide.moved(q[k]).mean(axis=0)
                # The row of q is Φᵀ Sᵀ f.
                own, couple = np.linalg.solve(S.T, np.c_[own, lengths[k] * couple]).T
                couple += np.cross(middle + S @ (moved - q[k] @ shapes.drift[k]), own)
                yield guide.support.where, own, couple
                force, moment = force - own, moment - couple
            if frame is not None:
                yield frame.support.where, force, moment


def guided(
    scene: Scene, hold: Hold, data: RigidBody, offsets: Array
) -> Iterator[tuple[Support, Array, Array]]:
    """Unit motions of the guides in a body, of all their nodes. Collective.

    Each place that a support holds counts for itself, as bends pull at it, but the largest of the
    frame's. A dof that several supports hold counts for the first of them, that of the frame before
    others.
    Offsets are places of the owned nodes in the body's frame, shape (owned nodes, 3) [m]. Of each
    guide come motions of the owned nodes, zero at dofs that it does not hold, shape
    (owned nodes, 3, n), and the rigid motions that these are, shape (6, n).
    """
    V, taken = rigid_motions(offsets, data.length), np.zeros(offsets.size, dtype=bool)
    for support in (*([] if hold.frame is None else [hold.frame]), *hold.guides):
        dofs = dofs_of(scene, support)
        dofs = dofs[~taken[dofs]]
        taken[dofs], found = True, []
        for some in _places(scene, dofs, data):
            moved = np.zeros((*offsets.shape, 6))
            moved.reshape(-1, 6)[some] = V.reshape(-1, 6)[some]
            own = moved[data.nodes].reshape(-1, 6)
            values, motions = scene.comm.bcast(np.linalg.eigh(scene.sum(own.T @ own)))
            motions = motions[:, values > RIGID**2 * values[-1]]
            found.append((support, moved @ motions, motions))
        yield from found[support is hold.frame :]


def _places(scene: Scene, dofs: Ints, data: RigidBody) -> list[Ints]:
    """Owned dofs of a support at each place where it holds a body, the largest first. Collective.

    Nodes that share cells are in one place; all dofs are where there are more than `PLACES`.
    """
    nodes, number = np.unique(dofs // 3, return_inverse=True)
    marks = np.zeros(scene.owned_nodes)
    marks[nodes] = 1.0
    at, owned = AtNodes(scene).of_owners(marks) > 0, scene.mesh.topology.index_map(3).size_local
    cells = scene.space.dofmap.list[:owned]
    row, column = np.nonzero(at[cells])
    first = np.r_[True, np.diff(row) > 0] if row.size else np.empty(0, dtype=bool)
    ends = cells[row, column], cells[row, column][first][np.cumsum(first) - 1]
    known = scene.space.dofmap.index_map.local_to_global
    pairs = np.stack([known(end.astype(np.int32)) for end in ends])
    every = np.concatenate(scene.comm.allgather(pairs), axis=1)
    ids, pairs = np.unique(every, return_inverse=True)
    pairs = pairs.reshape(2, -1)
    graph = coo_array((np.ones(pairs.shape[1]), pairs), shape=(ids.size,) * 2)
    count, place = connected_components(graph, directed=False)
    place = place[np.searchsorted(ids, known(nodes.astype(np.int32)))]
    x = scene.space.tabulate_dof_coordinates()[nodes]
    sums = np.zeros((count, 5))
    np.add.at(sums, place, np.c_[np.isin(nodes, data.nodes), np.ones(nodes.size), x])
    sums = np.asarray(scene.sum(sums))
    here = np.flatnonzero(sums[:, 0])
    if here.size > PLACES:
        return [dofs]
    middle = sums[here, 2:] / (scene.mean_cell_size * sums[here, 1:2])
    order = here[np.lexsort(np.c_[middle.round(3), -sums[here, 0]].T)]
    return [dofs[place[number] == k] for k in order]


def _origin(bodies: Bodies, k: int) -> Array:
    """Origin of the frame of a body: its centre of mass, where shapes do not move it [m]."""
    return np.asarray(bodies.r[k] - bodies.R[k] @ bodies.drifted[k])


def _triad(x: Array) -> Array:
    """An orthonormal basis that three points define, by columns."""
    a, b = x[1] - x[0], x[2] - x[0]
    e = a / np.linalg.norm(a)
    n = np.cross(a, b)
    n /= np.linalg.norm(n)
    return np.stack([e, np.cross(n, e), n], axis=1)
