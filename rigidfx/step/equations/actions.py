"""The actions of a scene's effects on one division, added up.

Only methods of its kind are called: actions that resist, stiffen or store energy are found once,
when effects begin or end. The stiffness of contacts may jump from one iterate to the next. It has
entries at few unknowns, is known apart from the rest of the tangent, and a tangent that is kept can
follow it (`rigidfx.step.newton.kept_tangent`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_array, csr_array

from rigidfx.base.errors import agree, by_name, together
from rigidfx.base.inputs import number, shown
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.base.uncaught import by_users
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Action, Effect, Structure, Touch
from rigidfx.effects.nodes import Forces, ForcesOfNodes, Instant, Motion, Tangent
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.scene import Scene

# Methods that a step calls.
METHODS = (
    *("load", "resist", "stiffen", "stored", "taken", "accept", "touch", "creep_for", "outdated"),
)
NUMBERS = ("taken", "stored")  # those that give a number, which is of an action's kind


def doing(actions: Sequence[Action], method: str) -> list[Any]:
    """Those actions that do something of their own by a method."""
    return [action for action in actions if action.does(method)]


class OwnMethods:
    """Methods of actions, any of which may be of a user's own."""

    def __init__(self, owners: Mapping[int, str], comm: MPI.Intracomm) -> None:
        """Keep the names of actions, by their identities, and the ranks that end together."""
        self._owners, self._comm = owners, comm

    def call(self, action: Action, method: str) -> Callable[..., Any]:
        """A method that fails by name; at an iterate that is not finite it may do nothing."""
        owner, function = self._owners[id(action)], getattr(action, method)

        def own(*given: Any) -> Any:
            try:
                found = function(*given)
            except Exception:
                if all(at.finite for at in given if isinstance(at, Motion)):
                    raise
                found = 0.0
            if method == "touch":
                return Touch(action.title) + found
            return number(owner, method, found) if method in NUMBERS else found

        return lambda *given: by_users(self._comm, owner, method, partial(own, *given))

    def calls(self, actions: Sequence[Action], method: str) -> list[Callable[..., Any]]:
        """The same of all that do something of their own by it."""
        return [self.call(action, method) for action in doing(actions, method)]


class _Entries:
    """Takes entries in place of a `CondensedMatrix`."""

    def __init__(self, prolongation: Prolongation) -> None:
        self._p = prolongation
        self._parts: list[tuple[Ints, Ints, Array]] = []

    def add_nodal(self, nodes: Indices, blocks: Array) -> None:
        """Add to the diagonal blocks of free nodes of this rank, shape (nodes, 3, 3)."""
        places = self._p.layout.rows.positions(nodes)
        self._add(self._p.numbers.reshape(-1, 3)[places], blocks)

    def add_coupling(self, entries: csr_array) -> None:
        """Add entries that are equal on all ranks."""
        if self._p.comm.rank == 0:
            own = coo_array(entries)
            self._parts.append((*own.coords, own.data))

    def add_bodies(self, blocks: Array) -> None:
        """Add this rank's part of the bodies' blocks, shape (bodies, 6 + m, 6 + m)."""
        self._add(self._p.body_columns, blocks)

    def _add(self, numbers: Ints, blocks: Array) -> None:
        rows, columns = np.broadcast_arrays(numbers[:, :, None], numbers[:, None, :])
        known = (rows >= 0) & (columns >= 0)
        self._parts.append((rows[known], columns[known], blocks[known]))

    def on_all_ranks(self) -> csr_array:
        """The sum of all. Collective."""
        none: Ints = np.empty(0, np.int64)
        parts = [(none, none, np.empty(0)), *self._parts]
        every = [part for of_rank in self._p.comm.allgather(parts) for part in of_rank]
        rows, columns, values = (np.concatenate(part) for part in zip(*every, strict=True))
        return csr_array((values, (rows, columns)), shape=(self._p.size,) * 2)


class Actions:
    """Sum of the actions of the effects that act; `destroy` frees them.

    Attributes:
        loads: Dead loads of the present step; those on bodies are equal on all ranks.
        contacts: Contacts that act.
        stiffens: Whether any of them changes the tangent.
        elastic: Kinds of these that store energy, on which loads may rest.
        rounding: Size of a force that the machine precision is to be multiplied with [N].
        dead: Whether none depends on the motion.
    """

    def __init__(
        self, structure: Structure, effects: Sequence[Effect], acting: Sequence[Effect]
    ) -> None:
        """Bind effects that act now, or are dead loads and may act later. Collective.

        It is a `SceneError` on every rank if one cannot be bound on any.
        """
        self._comm = structure.scene.comm
        here = {id(effect) for effect in acting}
        wanted = (e for e in effects if e.is_dead or not e.is_windowed or id(e) in here)
        pairs = [(effect, bound(effect, structure, "bind")) for effect in wanted]
        self._every = [(effect, action) for effect, action in pairs if action is not None]
        self._owners = {id(action): effect.owner for effect, action in self._every}
        self._own = OwnMethods(self._owners, self._comm)
        self.loads = Forces.none(structure.rows.vector(), structure.bodies.pose)
        self._touches: Mapping[str, Touch] | None = None  # of the present step, once asked for
        self.select(acting)

    def select(self, acting: Iterable[Effect]) -> None:
        """From now on let those act that are among the given effects, or have no time window."""
        here = {id(effect) for effect in acting}
        every = self._acting = [a for e, a in self._every if id(e) in here or not e.is_windowed]
        self.contacts: list[Any] = [action for action in every if action.presses]
        self._calls = {name: self._own.calls(every, name) for name in METHODS}
        self._taking, self._storing = (
            list(zip(doing(every, name), self._calls[name], strict=True)) for name in NUMBERS
        )
        if not self._calls["load"]:
            self.loads.scale(0.0)
        self.stiffens = bool(doing(every, "stiffen"))
        resting = doing(doing(every, "stiffen"), "stored")
        self.elastic = {action.kind for action in resting}
        self.rounding = sum(action.rounding for action in every)
        self.dead = not doing(every, "resist")

    def creep_for(self, time: float, began: Instant) -> None:
        """Compute friction for a longer motion; see `ContactForces`."""
        for creep in self._calls["creep_for"]:
            creep(time, began)

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time, and dead loads, in the middle t of a step of Δt [s].

        A user's function that fails on any rank is a `SceneError` on all. Collective.
        """
        self._touches = None
        if timed := doing(self._acting, "set_time"):

            def evaluate() -> None:
                for action in timed:
                    by_name(self._owners[id(action)], t, partial(action.set_time, t, dt))

            together(self._comm, "A load", evaluate)
        if self._calls["load"]:
            self.loads.scale(0.0)
            for load in self._calls["load"]:
                load(self.loads)
            self.sum(self.loads.moments, self.loads.torques)

    def sum(self, *of_bodies: Array) -> None:
        """Sum numbers of bodies over the ranks, in place. Collective."""
        for values in of_bodies if self._comm.size > 1 else ():
            self._comm.Allreduce(MPI.IN_PLACE, values)

    # In each iteration --------------------------------------------------------------------------

    def resist(self, motion: Motion, forces: Forces) -> None:
        """Add the resistance at an iterate to that of nodes, and to this rank's. Collective."""
        for resist in self._calls["resist"]:
            resist(motion, forces)

    def resist_at_nodes(self, motion: Motion, forces: ForcesOfNodes) -> None:
        """Add the resistance of those that couple nodes, also in bodies. Collective."""
        for action in self._acting:
            if action.couples:
                self._own.call(action, "resist")(motion, forces)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add its derivative to an assembled tangent that is not finished yet. Collective."""
        for stiffen in self._calls["stiffen"]:
            stiffen(motion, tangent)

    def outdated(self) -> bool:
        """Whether the stiffness of contacts has jumped since it was taken last. Collective."""
        here = any(outdated() for outdated in self._calls["outdated"])
        return bool(self.contacts) and bool(self._comm.allreduce(here, op=MPI.LOR))

    def jumping(self, motion: Motion, prolongation: Prolongation) -> csr_array | None:
        """Contacts' stiffness at an iterate, by all unknowns [N/m]; None without. Collective."""
        if not self.contacts:
            return None
        found = _Entries(prolongation)
        tangent = Tangent(found, prolongation)
        for stiffen in self._own.calls(self.contacts, "stiffen"):
            stiffen(motion, tangent)
        found.add_bodies(tangent.blocks)
        return found.on_all_ranks()

    # After a step -------------------------------------------------------------------------------

    def work(self, motion: Motion) -> float:
        """Work of loads in a step; that of ranks adds up [J]."""
        done, increments = 0.0, motion.increments
        if self._calls["load"]:
            done += float(self.loads.vector.array_r @ motion.array_r)
            if self._comm.rank == 0 and len(increments):
                done += increments.work(increments.resultant(self.loads.moments))
                done += float(np.vdot(self.loads.torques, increments.theta))
        taken = (take(motion) for action, take in self._taking if not action.dissipates)
        return done - sum(taken)

    def dissipated(self, motion: Motion) -> list[tuple[str, float]]:
        """Energy that kinds of effects take in a step; those of ranks add up [J]."""
        return [(action.kind, take(motion)) for action, take in self._taking if action.dissipates]

    def stored(self, at: Instant) -> tuple[float, float]:
        """Energies of springs and of contacts; those of ranks add up [J]. Collective."""
        energies = [0.0, 0.0]
        for action, stored in self._storing:
            energies[action.presses] += stored(at)
        return energies[0], energies[1]

    def accept(self) -> None:
        """Accept the last iterate as a step."""
        for accept in self._calls["accept"]:
            accept()

    def explain(self, motion: Motion) -> None:
        """Find whose forces are no numbers, at increments that are, if anybody's. Collective."""
        if not self._comm.allreduce(bool(np.isfinite(motion.array_r).all()), op=MPI.LAND):
            return
        vector = self.loads.vector.duplicate()
        each = [(m, action) for m in ("load", "resist") for action in doing(self._acting, m)]
        for method, action in each:
            vector.set(0.0)
            asked, fault = Forces.none(vector, self.loads.moments), None
            getattr(action, method)(*((motion,) if method == "resist" else ()), asked)
            forces = np.concatenate([np.ravel(part) for part in asked.parts])
            if not np.isfinite(forces).all():
                worst = shown(forces[np.argmin(np.isfinite(forces))])
                fault = f"{self._owners[id(action)]}: its {method} gave a force of {worst} N."
            agree(self._comm, fault)
        vector.destroy()

    # Contacts -----------------------------------------------------------------------------------

    def touches(self) -> Mapping[str, Touch]:
        """Touches of contacts in the step that has been solved, by their titles. Collective."""
        if self._touches is None:
            local = [touch() for touch in self._calls["touch"]]
            every = self._comm.allgather(local) if local and self._comm.size > 1 else [local]
            self._touches = {
                touch.name: sum(parts, Touch(touch.name))
                for touch, parts in zip(local, zip(*every, strict=True), strict=True)
            }
        return self._touches

    def pressing(self) -> tuple[Ints, Array]:
        """Owned nodes that contacts press, and how: see `ContactForces`."""
        each = [contact.pressing() for contact in self.contacts]
        nodes = np.concatenate([np.empty(0, np.int64), *(own for own, _ in each)])
        return nodes, np.concatenate([np.empty((0, 3, 3)), *(how for _, how in each)])

    def closing(self, v: Array, dt: float, at: Instant) -> dict[str, float]:
        """Time until each contact closes at velocities v of the rows, by titles [s, m/s].

        It is infinite where none does, and negative where it is closed already. A path that fails
        is a `SceneError` on every rank. Δt is that of the next step. Collective.
        """
        if not self.contacts:
            return {}

        def closing() -> Array:  # asks users' paths, which may fail on some ranks
            return np.array([a.closes_after(v, dt, at) for a in self.contacts])

        times = together(self._comm, "A contact", closing)
        self._comm.Allreduce(MPI.IN_PLACE, times, op=MPI.MIN)
        pairs = zip(self.contacts, times, strict=True)
        return {action.title: float(time) for action, time in pairs}

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self.loads.vector.destroy()
        for _, action in self._every:
            action.destroy()


def apart(
    scene: Scene, rows: Rows, u: Array, surface: Any, acting: Sequence[Effect], mass: Any = None
) -> Actions:
    """Actions of a scene's effects on the nodes of rows, as if none were in a body. Collective.

    All nodes have displacements u, see `Structure`.
    """
    own, none = np.ones(rows.nodes.size, dtype=bool), Bodies.of_each(())
    structure = Structure(
        scene=scene, rows=rows, own=own, bodies=none, mass=mass, u=u, surface=surface
    )
    return Actions(structure, scene.effects, acting)


def bound(effect: Effect, structure: Structure, method: str) -> Action | None:
    """The action of an effect by its method `bind` or `bind_points`, if it has one. Collective.

    A method that fails on any rank is a `SceneError` on all.
    """

    def bind() -> Action | None:
        action = getattr(effect, method)(structure)
        if not isinstance(action, Action | None):
            raise TypeError(f"{shown(action)} is no Action")
        return action

    return together(structure.scene.comm, f"{effect.owner}: its {method}", bind)
