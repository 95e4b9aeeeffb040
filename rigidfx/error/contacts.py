"""Contacts of the twin: the difference of their forces on u + e and on u drives e.

    M ë + C ė + K e = r + λ ,     λ = F(u) - F(u + e)

F is the resistance of contacts, and ρ in r contains -F(u), their forces in the run. Contacts of the
twin open and close by u + e, with a state of their own. A step of e is linear in λ, by columns at
the nodes that contacts press (`columns`). Newton's method finds λ at these nodes alone, so a step
takes two solutions with the kept factor of K.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.base.mesh_order import MeshOrder
from rigidfx.base.remembered import ON_NODES, PART, ByObject, Remembered, same
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Contact
from rigidfx.error.columns import Columns
from rigidfx.error.frames import to_shape, to_space
from rigidfx.error.increments import increments_of
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.equations.actions import Actions
from rigidfx.step.equations.structure import BoundStructure
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt

__all__ = ["Contacts", "Search"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Step = Callable[[Array], Array]


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

    def add_nodal(self, nodes: npt.NDArray[np.int32], blocks: Array) -> None:
        """Blocks of owned nodes."""
        at = self.numbers.reshape(-1, 3)[nodes]
        row, column = (np.broadcast_to(a, blocks.shape) for a in (at[:, :, None], at[:, None]))
        self.own.append((row.reshape(-1), column.reshape(-1), blocks.reshape(-1)))

    def add_coupling(self, entries: csr_array) -> None:
        """Entries that are equal on all ranks."""
        own = entries[self.first : self.first + self.count].tocoo()
        row, column = (np.asarray(a, dtype=np.int64) for a in (own.row, own.col))
        self.own.append((row + self.first, column, own.data))


class _Notes(ByObject):
    """Memory that bound contacts hold, and that stays the same object."""

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        """See `Kind`. Collective."""
        known = getattr(owner, name)
        for key, note in self.own(whole, order).items():
            vars(known[key]).update(vars(note.memory(known[key].surface)))


class Bound:
    """The contacts of a scene bound to all nodes; `destroy` frees their PETSc objects.

    Attributes:
        notes: Their memory, by their identity.
    """

    remembered: ClassVar[Remembered] = {"notes": _Notes()}

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
        structure = BoundStructure(
            scene=scene,
            rows=rows,
            own=np.ones(rows.nodes.size, dtype=bool),
            bodies=Bodies.of_each(()),
            mass=None,
            u=self._start,
            surface=stepper.forces.surface,
            failures=stepper.failures,
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
        actions.look(self._moved, attempt.increments)
        actions.resist_nodes(self._moved, dt, self._f)
        return self._f.array_r.reshape(start.shape).copy()

    def stiffness(self, attempt: Attempt) -> tuple[Ints, Ints, Array]:
        """Rows, columns and values of the derivative of the last force by `moved`. Collective.

        Numbers are those of global dofs; equal on all ranks.
        """
        comm, n = self._rows.comm, 3 * self._rows.nodes.size
        entries = _Entries(self._rows.first, n, comm.allreduce(n), attempt.increments)
        self._actions.stiffen_nodes(entries, attempt.dt, entries)  # type: ignore[arg-type]
        every = [part for parts in comm.allgather(entries.own) for part in parts]
        none = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
        rows, columns, values = zip(none, *every, strict=True)
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)

    def have(self, notes: Mapping[int, Any]) -> None:
        """Have the memory that others have; of contacts that are over there is none."""
        for key in self.notes.keys() & notes.keys():
            vars(self.notes[key]).update(vars(copy(notes[key])))

    def accept(self) -> None:
        """See `Action`."""
        self._actions.accept()

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._actions.destroy()
        for vector in (self._moved, self._f):
            vector.destroy()


class Contacts:
    """The contacts of the run and of its twin; `destroy` frees their PETSc objects."""

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
        self._own, self._twin = (Bound(stepper, rows, {}) for _ in range(2))
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

    def refresh(self) -> None:
        """See `Watch`: columns lie in the order in which they were asked for."""
        self._columns = None, self._columns[1]

    def follow(self, attempt: Attempt) -> None:
        """Have the forces of the run in a step that has been solved. Collective."""
        self._attempt = attempt
        state = self._stepper.state
        self._own.have(state.notes)
        self._start = state.positions(self._nodes) - state.X[: self._nodes.size]
        self._moved = increments_of(self._stepper, attempt)
        self._force = self._own.force(attempt, self._start, self._moved)

    def solved(self, start: Array, step: Step, kind: object, Q: Array) -> None:
        """Take a step of e with λ. Collective.

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
        """The derivative of the last of these by `end`: see `Bound`. Collective."""
        assert self._attempt is not None
        return self._twin.stiffness(self._attempt)

    def rest(self) -> None:
        """Take note that e is zero all through a step: the twin is the run."""
        self._lambda, self._as_run = np.zeros_like(self._lambda), True

    def accept(self) -> None:
        """Take note that the last step of e holds. Collective."""
        if not self._as_run:
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
        """Take the step without λ; arguments as of `Contacts.solved`. Collective."""
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
