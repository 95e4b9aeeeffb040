"""Contacts of the twin: the difference of their forces on u + e and on u drives e.

    M ë + C ė + K e = r + λ ,     λ = F(u) - F(u + e)

F is the resistance of contacts, bound to all nodes, and ρ in r contains -F(u), their forces in the
run. Contacts of the twin open and close by u + e, with a state of their own. A step of e is linear
in λ, by columns of the inverse at the nodes that contacts press, each of which is computed once.
Newton's method finds λ at these nodes alone, so a step takes two solutions with the kept factor of
K.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.base.remembered import ON_NODES, PART, ByObject, Remembered, same
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Contact, Structure
from rigidfx.effects.action import Touch
from rigidfx.effects.motion import Forces, Motion, Tangent
from rigidfx.error.frames import to_shape, to_space
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.actions import Actions
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt

__all__ = ["Contacts", "Search", "increments_of"]

Step = Callable[[Array], Array]


@dataclass
class _Entries:
    """Takes the place of a tangent, and of a map to its unknowns, which are the dofs.

    Attributes:
        first: Number of this rank's first dof.
        count: How many it has.
        size: How many there are on all ranks.
        increments: Those of bodies.
        own: Rows, columns and values from this rank.
    """

    first: int
    count: int
    size: int
    increments: Any
    own: list[tuple[Ints, Ints, Array]] = field(default_factory=list)

    @property
    def numbers(self) -> Ints:
        """Of this rank's dofs."""
        return np.asarray(self.first + np.arange(self.count))

    def add_nodal(self, nodes: Indices, blocks: Array) -> None:
        """Blocks of owned nodes."""
        at = self.numbers.reshape(-1, 3)[nodes]
        row, column = (np.broadcast_to(a, blocks.shape) for a in (at[:, :, None], at[:, None]))
        self.own.append((row.reshape(-1), column.reshape(-1), blocks.reshape(-1)))

    def add_coupling(self, entries: csr_array) -> None:
        """Entries that are equal on all ranks."""
        own = entries[self.first : self.first + self.count].tocoo()
        row, column = (np.asarray(a, dtype=np.int64) for a in (own.row, own.col))
        self.own.append((row + self.first, column, own.data))


class BoundContacts:
    """The contacts of a scene bound to all nodes; `destroy` frees their PETSc objects.

    Attributes:
        notes: Their memory, by their identity.
    """

    remembered: ClassVar[Remembered] = {"notes": ByObject()}

    def __init__(self, stepper: Stepper, rows: Rows, notes: dict[int, Any]) -> None:
        """Bind them. Collective.

        Args:
            stepper: Solves the steps.
            rows: Rows of all nodes.
            notes: Their memory.
        """
        scene = stepper.scene
        self._stepper, self._rows, self.notes = stepper, rows, notes
        self._start: Array = np.zeros(3 * len(scene.start_places))
        structure = Structure(
            scene=scene,
            rows=rows,
            own=np.ones(rows.nodes.size, dtype=bool),
            bodies=Bodies.of_each(()),
            mass=None,
            u=self._start,
            surface=stepper.forces.surface,
            notes=notes,
        )
        self._acting: object = None  # nothing is selected yet; those that begin later are bound
        self._actions = Actions(structure, scene.named(Contact), scene.named(Contact))
        self._moved, self._f = rows.vector(), rows.vector()

    def force(self, attempt: Attempt, start: Array, moved: Array) -> Array:
        """Their resistance in a step, shape (nodes, 3) [N]. Collective.

        Args:
            attempt: The step.
            start: Displacements at its start, shape (nodes, 3) [m].
            moved: Their increments, likewise.
        """
        actions, acting, dt = self._actions, self._stepper.system.acting, attempt.dt
        if acting is not self._acting:
            self._acting = acting
            actions.select(acting)
        self._start[: start.size] = start.reshape(-1)
        self._moved.array[:] = moved.reshape(-1)
        self._f.set(0.0)
        actions.set_time(attempt.t + dt / 2, dt)
        actions.resist(Motion(self._moved, attempt.increments, dt), Forces.none(self._f))
        return self._f.array_r.reshape(start.shape).copy()

    def stiffness(self, attempt: Attempt) -> tuple[Ints, Ints, Array]:
        """Rows, columns and values of the derivative of the last force by `moved`. Collective.

        Numbers are those of global dofs; equal on all ranks.
        """
        comm, n = self._rows.comm, 3 * self._rows.nodes.size
        entries = _Entries(self._rows.first, n, comm.allreduce(n), attempt.increments)
        motion = Motion(self._moved, attempt.increments, attempt.dt)
        self._actions.stiffen(motion, Tangent(entries, entries))
        every = [part for parts in comm.allgather(entries.own) for part in parts]
        none = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
        rows, columns, values = zip(none, *every, strict=True)
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)

    def touches(self) -> Mapping[str, Touch]:
        """Touches in the step of the last force, by the contacts' titles. Collective."""
        return self._actions.touches()

    def have(self, notes: Mapping[int, Any]) -> None:
        """Copy the memory that others have; of contacts that are over there is none."""
        keys = {id(contact) for contact in self._stepper.scene.named(Contact)} & notes.keys()
        self.notes.update({key: notes[key] for key in keys})

    def accept(self) -> None:
        """Let contacts remember the step."""
        self._actions.accept()

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._actions.destroy()
        for vector in (self._moved, self._f):
            vector.destroy()


def increments_of(stepper: Stepper, attempt: Attempt) -> Array:
    """Increments of the owned nodes in an attempt, shape (nodes, 3) [m].

    Args:
        stepper: Has made the attempt, and none since.
        attempt: The attempt.
    """
    system = stepper.system
    layout, equilibrium = system.layout, system.equilibrium
    out: Array = np.zeros((stepper.scene.owned_nodes, 3))
    out[layout.rows.nodes] = equilibrium.d.array_r.reshape(-1, 3)
    moves: Any = attempt.increments.displacement
    for body, matrix in zip(layout.bodies, moves, strict=True):
        out[body.nodes] = matrix[0] + body.offsets @ matrix[1:]
    return out


class Columns:
    """Changes of e at the end of a step by unit forces; columns are made as they are asked for.

    Nodes have global numbers; values of all ranks are equal on all.

    Attributes:
        nodes: Nodes that have columns, three each, in the order in which they were asked for.
        inside: G, the changes at these nodes, shape (3 nodes, 3 nodes) [m/N].
    """

    def __init__(self, scene: Scene, wanted: Ints) -> None:
        """Begin without columns.

        Args:
            scene: The problem.
            wanted: Owned nodes at which changes are wanted.
        """
        self._scene, self._wanted = scene, wanted
        self._first = scene.space.dofmap.index_map.local_range[0]
        self.nodes: Ints = np.empty(0, np.int64)
        self.inside: Array = np.empty((0, 0))
        self._at: Array = np.empty((3 * wanted.size, 0))

    def have(self, nodes: Ints, step: Callable[[Array], Array]) -> None:
        """Make columns of some nodes. Collective.

        Args:
            nodes: Equal on all ranks, sorted.
            step: Takes the step under forces of the owned nodes, shape (nodes, 3) [N], and returns
                e at its end.
        """
        new = np.setdiff1d(nodes, self.nodes)
        if not new.size:
            return
        n = self._scene.owned_nodes
        force: Array = np.zeros((n, 3))
        rest, columns = step(force), []
        for node in new - self._first:
            for axis in range(3):
                mine = 0 <= node < n
                if mine:
                    force[node, axis] = 1.0
                columns.append((step(force) - rest).reshape(-1))
                if mine:
                    force[node, axis] = 0.0
        every, known = np.array(columns).T, self.nodes.size
        self.nodes = np.concatenate([self.nodes, new])
        rows = (3 * self._wanted[:, None] + np.arange(3)).reshape(-1)
        self._at = np.hstack([self._at, every[rows]])
        own, here = self._own()
        more: Array = np.zeros((self.nodes.size, 3, every.shape[1]))
        more[here] = every.reshape(n, 3, -1)[own[here]]
        more = np.asarray(self._scene.sum(more)).reshape(3 * self.nodes.size, -1)
        inside: Array = np.zeros((3 * self.nodes.size,) * 2)
        inside[: 3 * known, : 3 * known] = self.inside
        inside[:, 3 * known :] = more
        inside[3 * known :, : 3 * known] = more[: 3 * known].T  # by symmetry
        self.inside = inside

    def numbers(self, owned: npt.NDArray[np.integer]) -> Ints:
        """Global numbers of nodes that ranks own, sorted, equal on all. Collective."""
        every = self._scene.comm.allgather(self._first + np.asarray(owned, dtype=np.int64))
        return np.sort(np.concatenate(every))

    def places(self, nodes: Ints) -> Ints:
        """Rows of G of some nodes that have columns, shape (3 nodes,)."""
        order = np.argsort(self.nodes)
        at = order[np.searchsorted(self.nodes, nodes, sorter=order)]
        return np.asarray(3 * at[:, None] + np.arange(3)).reshape(-1)

    def padded(self, vector: Array) -> Array:
        """A vector of fewer columns, with zeros for those that came since, shape (3 nodes,)."""
        return np.concatenate([vector, np.zeros(3 * self.nodes.size - vector.size)])

    def of_nodes(self, vectors: Array) -> Array:
        """Vectors of owned nodes at those that have columns, one after the other. Collective."""
        out: Array = np.zeros((self.nodes.size, vectors.shape[1]))
        own, here = self._own()
        out[here] = vectors[own[here]]
        return np.asarray(self._scene.sum(out)).reshape(-1)

    def at_nodes(self, forces: Array) -> Array:
        """Forces at the nodes that have columns, of the owned nodes, shape (nodes, 3)."""
        out: Array = np.zeros((self._scene.owned_nodes, 3))
        own, here = self._own()
        out[own[here]] = forces.reshape(-1, 3)[here]
        return out

    def moved(self, end: Array, forces: Array) -> Array:
        """e where it is wanted, as forces change it from that without them, shape (nodes, 3) [m].

        Args:
            end: e without them, of the owned nodes, likewise.
            forces: At the nodes that have columns, shape (3 nodes,) [N].
        """
        out = end.copy()
        out[self._wanted] += (self._at @ forces).reshape(-1, 3)
        return out

    def _own(self) -> tuple[Ints, Bools]:
        """Owned numbers of the nodes that have columns, and which of them this rank owns."""
        own = self.nodes - self._first
        return own, (own >= 0) & (own < self._scene.owned_nodes)


@dataclass(frozen=True)
class Search:
    """How λ is found.

    Attributes:
        tolerance: Residual over λ, at most: at 1e-2 a block that sticks to a floor crept.
        iterations: Of Newton's method, at most.
        parts: Of its change, that are tried until the residual falls; the last is taken if none.
    """

    tolerance: float = 1e-3
    iterations: int = 20
    parts: tuple[float, ...] = (1.0, 0.5, 0.25, 0.125)


class Contacts:
    """The contacts of the run and of its twin; `destroy` frees their PETSc objects.

    Attributes:
        apart: Forces on the twin less those on the run in the last step, by the contacts' titles,
            shape (3,) each [N].
    """

    remembered: ClassVar[Remembered] = same("_as_run") | {"_lambda": ON_NODES, "_twin": PART}

    def __init__(self, stepper: Stepper, search: Search | None = None) -> None:
        """Bind the contacts to all nodes. Collective.

        Args:
            stepper: Solves the steps.
            search: How λ is found.
        """
        scene = stepper.scene
        self._stepper, self._search = stepper, Search() if search is None else search
        self._nodes = np.arange(scene.owned_nodes)
        rows = Rows(scene.space, self._nodes.astype(np.int32))
        self._own, self._twin = (BoundContacts(stepper, rows, {}) for _ in range(2))
        names = {(n, c.owner) for c in scene.named(Contact) for n in (c.where, *c.keeps_apart)}
        on: Array = np.zeros(len(scene.start_places))
        for name, owner in sorted(names):
            on[scene.nodes(name, owner, (2,))] = 1.0
        self._on = np.flatnonzero(on[: scene.owned_nodes])
        self._columns: tuple[object, Columns] = None, Columns(scene, self._on)
        self._lambda: Array = np.zeros((self._nodes.size, 3))
        self._attempt: Attempt | None = None
        self._start = self._moved = self._force = self._lambda  # of u, in the attempt
        self._as_run = False  # whether the twin has what the run remembers
        self.apart: Mapping[str, Array] = {}

    def refresh(self) -> None:
        """Forget columns, which lie in the order in which they were asked for."""
        self._columns = None, self._columns[1]

    def follow(self, attempt: Attempt) -> None:
        """Record the forces of the run in a step that has been solved. Collective."""
        self._attempt = attempt
        state = self._stepper.state
        self._own.have(state.notes)
        self._start = state.places - state.X[: self._nodes.size]
        self._moved = increments_of(self._stepper, attempt)
        self._force = self._own.force(attempt, self._start, self._moved)

    def solved(self, start: Array, step: Step, kind: object, Q: Array) -> None:
        """Advance e by a step with λ. Collective.

        Args:
            start: e at its start, in the frame of the shape, shape (nodes, 3) [m].
            step: Takes the step with λ, shape (nodes, 3) [N], and returns e at its end; the last
                one holds.
            kind: Equal for steps with the same columns.
            Q: Rotation of each node's part, shape (nodes, 3, 3).
        """
        if self._as_run:
            self._twin.have(self._own.notes)
            self._as_run = False
        if self._columns[0] != kind:
            self._columns = kind, Columns(self._stepper.scene, self._on)
        columns, search = self._columns[1], self._search
        known = columns.nodes.size
        trial = _Trial(self, columns, step, start, Q)
        forces, residual = trial.at(columns.of_nodes(self._lambda))
        for _ in range(search.iterations):
            left = np.linalg.norm(residual)
            if left <= search.tolerance * np.linalg.norm(forces):
                break
            change = trial.correction(residual)
            for part in search.parts:
                found = trial.at(columns.padded(forces) + part * columns.padded(change))
                if np.linalg.norm(found[1]) < left:
                    break
            forces, residual = found
        self._lambda = columns.at_nodes(forces)
        if forces.any() or columns.nodes.size > known:  # else the step without λ was the last one
            step(self._lambda)

    def more(self, start: Array, end: Array) -> Array:
        """F(u + e) - F(u) in space, of e in space [m], shape (nodes, 3) [N]. Collective."""
        assert self._attempt is not None
        force = self._twin.force(self._attempt, self._start + start, self._moved + end - start)
        return force - self._force

    def stiffness(self) -> tuple[Ints, Ints, Array]:
        """The derivative of the last of these by `end`: see `BoundContacts`. Collective."""
        assert self._attempt is not None
        return self._twin.stiffness(self._attempt)

    def rest(self) -> None:
        """Record that e is zero all through a step: the twin is the run."""
        self._lambda, self._as_run = np.zeros_like(self._lambda), True

    def accept(self) -> None:
        """Accept the last step of e. Collective."""
        self.apart = {}
        if not self._as_run:
            own, twin = self._own.touches(), self._twin.touches()
            self.apart = {title: twin[title].force - own[title].force for title in twin}
            self._twin.accept()

    def kept(self) -> object:
        """The data of `restore`."""
        return self._lambda, self._as_run

    def restore(self, kept: Any) -> None:
        """Be as at `kept`."""
        self._lambda, self._as_run = kept

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._own.destroy()
        self._twin.destroy()


class _Trial:
    """A step of e under trial forces λ at the nodes that have columns."""

    def __init__(
        self, contacts: Contacts, columns: Columns, step: Step, start: Array, Q: Array
    ) -> None:
        """Keep the step without λ; arguments as of `Contacts.solved`. Collective."""
        self._contacts, self._columns, self._step, self._Q = contacts, columns, step, Q
        self._start = to_space(start, Q)
        self._alone = step(np.zeros_like(start))

    def at(self, forces: Array) -> tuple[Array, Array]:
        """λ at the nodes that have columns, more of which may come, and its residual. Collective.

        Args:
            forces: λ, shape (3 nodes,) [N].

        Returns:
            Both of shape (3 nodes,) [N].
        """
        columns = self._columns
        end = columns.moved(self._alone, forces)
        more = to_shape(self._contacts.more(self._start, to_space(end, self._Q)), self._Q)
        columns.have(columns.numbers(np.flatnonzero(more.any(axis=1))), self._step)
        forces = columns.padded(forces)
        return forces, forces + columns.of_nodes(more)

    def correction(self, residual: Array) -> Array:
        """Newton's change of λ from the last residual, shape (3 nodes,) [N]. Collective."""
        columns = self._columns
        row, column, value = self._contacts.stiffness()
        columns.have(np.unique(np.concatenate([row, column]) // 3), self._step)
        residual = columns.padded(residual)
        of_residual = columns.nodes[residual.reshape(-1, 3).any(axis=1)]
        nodes = np.union1d(of_residual, np.concatenate([row, column]) // 3)
        at, m = columns.places(nodes), nodes.size
        N: Array = np.zeros((m, 3, m, 3))
        i, j = np.searchsorted(nodes, row // 3), np.searchsorted(nodes, column // 3)
        np.add.at(N, (i, row % 3, j, column % 3), value)
        Q = columns.of_nodes(self._Q.reshape(-1, 9)).reshape(-1, 3, 3)[at[::3] // 3]
        N = np.einsum("aki,akbl,blj->aibj", Q, N, Q)
        J = np.eye(3 * m) + N.reshape(3 * m, 3 * m) @ columns.inside[np.ix_(at, at)]
        out = np.zeros_like(residual)
        out[at] = np.linalg.solve(J, -residual[at])
        return out
