"""The questions of a policy to any criterion and its rule, and the run as both see it.

A rule says which cells are quiet enough to be rigid, and which rigid cells wake. It knows neither
earlier windows nor connected cells nor releases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Literal, Protocol

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import names
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.criteria.release import Release
from rigidfx.decide.limits import Limits
from rigidfx.decide.memory.memory import Memory
from rigidfx.effects import Reduced
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.strain_rate import Indicator, StrainRates
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.report.ledger import Rigidity
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.state import State
from rigidfx.step.stepper import Stepper

CHANGE = 0.1  # part of its largest value so far by which a load has changed, by default
LEAST = 2  # cells of a body: one alone hardly saves anything
WORTH = 0.05  # of all cells: what is less saves less than its switches cost


class Lacking(Protocol):
    """What the motion of a run lacks beside that of its flexible twin."""

    def size(self) -> float:
        """Its largest displacement of any node [m]. Collective."""
        ...


@dataclass(frozen=True)
class Observation:
    """The run around a step.

    Attributes:
        stepper: The stepper.
        dt: Length of the step [s].
        motion: What the motion lacks; None if that is not followed.
    """

    stepper: Stepper
    dt: float
    motion: Lacking | None = None

    @property
    def error(self) -> float:
        """Largest displacement that the motion lacks, of any node [m]. Collective."""
        return 0.0 if self.motion is None else self.motion.size()

    @property
    def t(self) -> float:
        """Time [s]."""
        return self.stepper.state.t

    @property
    def state(self) -> State:
        """The state."""
        return self.stepper.state

    @property
    def bodies(self) -> tuple[RigidBody, ...]:
        """Data of the rigid bodies."""
        return self.stepper.state.bodies.of.records

    @property
    def flexible(self) -> Bools:
        """For each owned cell, whether it is flexible."""
        return self.stepper.flexible

    @property
    def supported(self) -> Bools:
        """For each owned node, whether a support holds any of its components."""
        return np.asarray(self.held.reshape(-1, 3).any(axis=1))

    @property
    def held(self) -> Bools:
        """For each owned dof, whether a support prescribes it."""
        return self.stepper.system.prescribed.mask

    @property
    def indicator(self) -> Indicator:
        """The measure of cells in the last step."""
        assert self.stepper.indicator is not None  # a run that decides measures
        return self.stepper.indicator

    @property
    def rates(self) -> Array:
        """Strain rate of each owned cell, zero in bodies [1/s]."""
        return self.indicator.values

    @property
    def strains(self) -> Array:
        """Strain of each owned cell, zero in bodies."""
        return self.indicator.strains()

    @property
    def noise(self) -> float:
        """Strain rate that the end of Newton's iteration may leave in a cell [1/s]. Collective."""
        return self.stepper.system.newton.strain_error / self.dt


class Rule(Protocol):
    """The measure by which a criterion judges cells."""

    @property
    def tol(self) -> Array:
        """Strain rate up to which each owned cell is quiet now [1/s]."""
        ...

    def limits(self) -> Limits:
        """What bodies may withhold in the next step. Collective."""
        ...

    @property
    def rigidity(self) -> Rigidity | None:
        """Error of the motion by bodies; None if that is not estimated."""
        ...

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        ...

    def observe(self, seen: Observation) -> None:
        """Record a step that was accepted, once observation has begun. Collective."""
        ...

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Record the end of a window, before `tol` is asked. Collective.

        Args:
            seen: The state at that time.
            flexible: Owned cells that were flexible in all of the window.
        """
        ...

    def told(self) -> str:
        """The settings by hand with the same result. Collective."""
        ...


class Criterion:
    """Base of the records of criteria.

    `rigidfx.decide.criteria.criterion.StrainRate` describes the attributes.
    """

    wake: Literal["all", "local", "none"] | None = "local"
    window: float | Literal["auto"] = "auto"
    never: Sequence[str] = ()
    min_cells: int | None = 2
    load_change: float | None = inf
    patience: float = 2.0
    since: float = 0.0
    until: float = inf

    @property
    def owner(self) -> str:
        """Its name in messages."""
        return type(self).__name__

    @property
    def releases(self) -> tuple[Release, ...]:
        """Releases that are asked for."""
        return ()

    @property
    def former(self) -> tuple[str, ...]:
        """Fields given that have no effect any more."""
        return ()

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times of planned releases [s], at which steps end."""
        return tuple(sorted({t for release in self.releases for t in release.times}))

    @property
    def remedy(self) -> str:
        """Advice against repeated releases of bodies."""
        return "Take fewer releases."

    @property
    def relative(self) -> bool:
        """Whether tolerances are relative to the largest rate so far."""
        return False

    @property
    def contact_change(self) -> float:
        """Change of a contact's force, over its largest so far, that releases bodies.

        With wake="all" all of them; else those that it meets.
        """
        if self.wake != "all":
            return inf
        return CHANGE if self.load_change is None else self.load_change

    @property
    def enclosing(self) -> float:
        """Rate over their tolerances up to which enclosed cells may strain.

        Infinite where forces wake no single cells.
        """
        return inf

    def least_cells(self, scene: Scene) -> int:
        """Least number of cells of a new body. Collective.

        Args:
            scene: The problem.
        """
        if self.min_cells is not None:
            return int(self.min_cells)
        every = scene.comm.allreduce(scene.owned_cells(None, "").size)
        return max(LEAST, round(WORTH * every))

    def rule(self, scene: Scene, timeline: Timeline, memory: Memory) -> Rule:
        """The rule that judges cells. Collective.

        Args:
            scene: The problem.
            timeline: Where steps end.
            memory: Memory of the policy.

        Raises:
            SceneError: If a name of its own is unknown.
        """
        raise NotImplementedError

    def indicator(self, scene: Scene, forces: InternalForces) -> Indicator:
        """The indicator that measures the cells. Collective.

        Args:
            scene: The problem.
            forces: Internal forces, whose u₀ and u₁ hold the ends of a step.
        """
        return StrainRates(scene, forces, "rms")


def never_rigid(owner: str, never: Any) -> tuple[str, ...]:
    """Names of sets of cells that a criterion leaves flexible.

    Args:
        owner: Whose names these are, for the message.
        never: The given value.

    Raises:
        SceneError: If it is anything else.
    """
    return names(owner, "never", never, "cell sets")


def judged_cells(scene: Scene, name: str, wanted_by: str) -> Indices:
    """Owned cells of a set that a criterion names. Collective.

    Args:
        scene: The problem.
        name: Name of the set.
        wanted_by: The criterion and its field, for messages.

    Raises:
        SceneError: On every rank, if there is no such set, or a `Reduced` part has all of it.
    """
    cells = scene.owned_cells(name, wanted_by)
    for part in scene.named(Reduced):
        if not scene.sum(np.setdiff1d(cells, scene.owned_cells(part.where, part.owner)).size):
            raise SceneError(
                f"{wanted_by}: '{name}' lies in {part.owner}, which stays as it is, whatever it "
                "strains. Take the set out of one of them."
            )
    return cells
