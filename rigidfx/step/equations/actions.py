"""The actions of a scene's effects on one division, added up.

Only methods of its kind are called: actions that resist, stiffen or store energy are found once,
when effects begin or end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.errors import by_name, together
from rigidfx.base.inputs import shown
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects import Action, Effect, Touch, Windowed
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments
from rigidfx.step.equations.eased_forces import EasedForces
from rigidfx.step.equations.heeded import Heeded, doing
from rigidfx.step.equations.jumping import Jumping
from rigidfx.step.equations.structure import BoundStructure

__all__ = ["Actions"]

Array = npt.NDArray[np.float64]


class Actions:
    """Sum of the actions of the effects that act; `destroy` frees them.

    Attributes:
        external: Dead loads on the nodes of the rows in the present step [N].
        moments: Σ f and Σ V fᵀ of dead loads on each body, V in its frame, shape (bodies, 4, 3)
            [N, N m].
        torques: Torques in space on the bodies as such, shape (bodies, 3) [N m].
        kinds: Names of the kinds of effects that act.
        stiffen: Whether any of them changes the tangent.
        elastic: Kinds of these that store energy, on which loads may rest.
        rounding: Size of a force that the machine precision is to be multiplied with [N].
        dead: Whether none depends on the motion.
        easing: Stresses that releases have let down.
        jumping: Those whose derivatives may jump.
        failures: Keeps their exceptions until all ranks are told.
    """

    def __init__(
        self,
        structure: BoundStructure,
        effects: Sequence[Effect],
        acting: Sequence[Effect],
        easing: Sequence[EasedForces] = (),
    ) -> None:
        """Bind effects. Collective.

        Args:
            structure: The structure that they are bound to.
            effects: All effects; those that act now, or are dead loads and may act later, are
                bound.
            acting: The effects with a time window that act now.
            easing: Stresses that releases have let down, bound already; freed with the rest.

        Raises:
            SceneError: On every rank, if an effect cannot be bound on any.
        """
        self._comm, self.failures = structure.scene.comm, structure.failures
        self.easing, here = list(easing), {id(effect) for effect in acting}
        wanted = (e for e in effects if e.is_dead or not isinstance(e, Windowed) or id(e) in here)
        pairs = [(effect, self._bound(effect, structure)) for effect in wanted]
        self.failures.settle()  # all ranks go on with the same actions
        self._every = [(effect, action) for effect, action in pairs if action is not None]
        self._owners = {id(action): effect.owner for effect, action in self._every}
        self._owners |= {id(action): "What a release lets down" for action in easing}
        self._heeded = Heeded(self._owners, self.failures)
        bodies = len(structure.bodies)
        self._forces: Array = np.zeros((structure.rows.nodes.size, 3))
        self.external = structure.rows.vector()
        self.moments, self.torques = np.zeros((bodies, 4, 3)), np.zeros((bodies, 3))
        self._with_bodies = bodies > 0
        self._touches: Mapping[str, Touch] | None = None  # of the present step, once asked for
        self.select(acting)

    def _bound(self, effect: Effect, structure: BoundStructure) -> Action | None:
        """The action of an effect; none if that fails, of which all ranks are told. Collective."""

        def bind(structure: BoundStructure) -> Action | None:
            action = effect.bind(structure)
            if not isinstance(action, Action | None):
                raise TypeError(f"{shown(action)} is no Action")
            return action

        return self.failures.heeded(effect.owner, "bind", bind, lambda structure: None)(structure)

    def select(self, acting: Iterable[Effect]) -> None:
        """From now on let those act that are among the given effects, or have no time window."""
        self._select({id(effect) for effect in acting})

    def _select(self, here: set[int]) -> None:
        self._here = here
        own = [a for e, a in self._every if id(e) in here or not isinstance(e, Windowed)]
        every = [*own, *self.easing]
        on_bodies = every if self._with_bodies else []
        self._acting, self._acting_on_bodies = every, on_bodies
        self._timed, self._contacts = doing(every, "set_time"), doing(every, "touch")
        heeded = self._heeded
        self._load = heeded.does(every, "load")
        self._look = heeded.does(every, "look")
        self._accept = heeded.does(every, "accept")
        self._creep_for = heeded.does(every, "creep_for")
        self._resistance_at = heeded.adds(every, "resistance_at")
        self._resist_nodes = heeded.does(every, "resist_nodes")
        self._stiffen_nodes = heeded.does(every, "stiffen_nodes")
        self.jumping = Jumping(every, self._with_bodies, heeded, self._comm)
        springs = [action for action in every if action not in self._contacts]
        self._springs = heeded.tells(springs, "stored")
        self._dissipated = _by_kind(every, "dissipated", heeded)
        self._touch = heeded.touches(self._contacts)
        self._pressed = heeded.tells(self._contacts, "stored")
        self._resist_bodies = heeded.adds(on_bodies, "resist_bodies")
        self._stiffen_bodies = heeded.adds(on_bodies, "stiffen_bodies")
        self._work_on_bodies = heeded.tells(on_bodies, "work_on_bodies")
        # What fades is for solvers no more than the stress of cells.
        stiffening, resisting = (doing(own, what) for what in ("stiffen_nodes", "resist_nodes"))
        self.stiffen = bool(stiffening or self._stiffen_bodies or self._look)
        self.elastic = _resting(every)
        self.kinds = tuple(dict.fromkeys(action.kind for action in every))
        self.rounding = sum(action.rounding for action in every)
        self.dead = not (resisting or self._resistance_at or self._resist_bodies)

    def creep_for(self, time: float, u: Array, bodies: Bodies) -> None:
        """Have friction be that of a longer motion; see `Action`."""
        for creep in self._creep_for:
            creep(time, u, bodies)

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time, and dead loads, for a step. Collective.

        Args:
            t: Midpoint of the step [s].
            dt: Its length [s].

        Raises:
            SceneError: On every rank, if a user's function fails on any.
        """
        self._touches = None
        if self._timed:

            def evaluate() -> None:
                for action in self._timed:
                    by_name(self._owners[id(action)], t, partial(action.set_time, t, dt))

            together(self._comm, "A load", evaluate)
        self._forces[:] = self.moments[:] = self.torques[:] = 0.0
        for load in self._load:
            load(self._forces, self.moments, self.torques)
        self.external.array[:] = self._forces.reshape(-1)

    # In each iteration --------------------------------------------------------------------------

    def look(self, d: PETSc.Vec, increments: Increments) -> None:
        """Have those see an iterate that look at nodes and bodies together. Collective."""
        for look in self._look:
            look(d, increments)

    def resist_nodes(self, d: PETSc.Vec, dt: float, f: PETSc.Vec) -> None:
        """Add the resistance of nodes that are no body's to f, for increments d. Collective."""
        for resist in self._resist_nodes:
            resist(d, dt, f)

    def stiffen_nodes(
        self, tangent: CondensedMatrix, dt: float, prolongation: Prolongation
    ) -> None:
        """Add its derivative to an assembled tangent that is not finished yet. Collective."""
        for stiffen in self._stiffen_nodes:
            stiffen(tangent, dt, prolongation)

    def resist_bodies(self, increments: Increments, moments: Array) -> None:
        """Add Σ f and Σ V fᵀ of resistance less loads to those of nodal forces."""
        if self._load:
            moments -= self.moments
        for resist in self._resist_bodies:
            resist(moments, increments)

    def stiffen_bodies(self, increments: Increments, blocks: Array) -> None:
        """Add the derivative of their resultants to the bodies' blocks."""
        for stiffen in self._stiffen_bodies:
            stiffen(blocks, increments)

    # After a step -------------------------------------------------------------------------------

    def work_on_bodies(self, increments: Increments) -> float:
        """Work of loads on the bodies in a step [J]."""
        if not self._with_bodies:
            return 0.0
        dead = increments.work(increments.resultant(self.moments))
        dead += float(np.vdot(self.torques, increments.theta))
        return dead + sum(work(increments) for work in self._work_on_bodies)

    def dissipated(
        self, d: PETSc.Vec, dt: float, increments: Increments
    ) -> list[tuple[str, float]]:
        """Energy that kinds of effects take in a step; those of ranks add up [J]."""
        return [(kind, dissipated(d, dt, increments)) for kind, dissipated in self._dissipated]

    def stored(self, u: Array, bodies: Bodies, t: float) -> tuple[float, float]:
        """Energies of springs and of contacts; those of ranks add up [J]. Collective."""
        springs, pressed = (
            sum(stored(u, bodies, t) for stored in every)
            for every in (self._springs, self._pressed)
        )
        return springs, pressed

    def accept(self) -> None:
        """Take note that the last iterate has become a step. Collective where something fades."""
        for accept in self._accept:
            accept()
        if over := [e for e in self.easing if e.over]:  # an attempt may be cut, a step is not
            self.easing = [e for e in self.easing if not e.over]
            self._select(self._here)
            for action in over:
                action.destroy()

    def resist_at(self, nodes: npt.NDArray[np.int32], forces: Array) -> None:
        """Add the resistance of owned nodes by actions that are not bound to bodies' nodes [N]."""
        for resist in self._resistance_at:
            resist(forces, nodes)

    def explain(self, d: PETSc.Vec, dt: float, increments: Increments) -> None:
        """Find whose forces are no numbers, at increments that are, if anybody's. Collective.

        Args:
            d: Increments of the rows' nodes [m].
            dt: Δt [s].
            increments: Those of the bodies.
        """
        if not self._comm.allreduce(bool(np.isfinite(d.array_r).all()), op=MPI.LAND):
            return
        f = d.duplicate()

        def resistance(action: Action) -> Array:
            f.set(0.0)
            action.resist_nodes(d, dt, f)
            return np.array(f.array_r)

        def loads(action: Action) -> Array:
            forces = [np.zeros_like(a) for a in (self._forces, self.moments, self.torques)]
            action.load(*forces)
            return np.concatenate([part.reshape(-1) for part in forces])

        self._heeded.blame(self._acting, "load", loads)
        self._heeded.blame(self._acting, "resist_nodes", resistance)

        def resistance_of_bodies(action: Action) -> Array:
            return action.resist_bodies(increments)

        self._heeded.blame(self._acting_on_bodies, "resist_bodies", resistance_of_bodies)
        f.destroy()

    # Contacts -----------------------------------------------------------------------------------

    def touches(self) -> Mapping[str, Touch]:
        """Touches of contacts in the step that has been solved, by their titles. Collective."""
        if self._touches is None:
            local = [touch() for touch in self._touch]
            every = self._comm.allgather(local) if local and self._comm.size > 1 else [local]
            self._touches = {
                touch.name: sum(parts, Touch(touch.name))
                for touch, parts in zip(local, zip(*every, strict=True), strict=True)
            }
        return self._touches

    def closing(self, v: Array, t: float, dt: float, bodies: Bodies) -> dict[str, float]:
        """Time until each contact closes at constant velocities, by titles [s]. Collective.

        It is infinite where none does, and negative where it is closed already.

        Args:
            v: Velocities of the rows [m/s].
            t: Time [s].
            dt: Length of the next step [s].
            bodies: The bodies at t.

        Raises:
            SceneError: On every rank, if the path of an obstacle fails on any.
        """
        if not self._contacts:
            return {}

        def closing() -> Array:  # asks users' paths, which may fail on some ranks
            return np.array([a.closes_after(v, t, dt, bodies) for a in self._contacts])

        times = together(self._comm, "A contact", closing)
        self._comm.Allreduce(MPI.IN_PLACE, times, op=MPI.MIN)
        pairs = zip(self._contacts, times, strict=True)
        return {action.title: float(time) for action, time in pairs}

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self.external.destroy()
        for action in (*(action for _, action in self._every), *self.easing):
            action.destroy()


def _resting(actions: Sequence[Action]) -> set[str]:
    """Kinds of actions that stiffen nodes or bodies, and store energy."""

    def able(*methods: str) -> set[str]:
        return {action.kind for method in methods for action in doing(actions, method)}

    stores = able("stored")
    return able("stiffen_nodes", "stiffen_bodies") & stores


def _by_kind(
    actions: Sequence[Action], method: str, heeded: Heeded
) -> list[tuple[str, Callable[..., float]]]:
    """Results of a method of actions, each with the kind of its effect."""
    kinds = [action.kind for action in doing(actions, method)]
    return list(zip(kinds, heeded.tells(actions, method), strict=True))
