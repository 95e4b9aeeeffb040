"""Contacts bound to all nodes: their forces in a motion that is not the run's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.remembered import ByObject, Remembered
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Contact, Structure
from rigidfx.effects.action import Touch
from rigidfx.effects.motion import Forces, Motion, Tangent
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.equations.actions import Actions
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt

__all__ = ["BoundContacts"]


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
