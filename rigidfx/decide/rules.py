"""Rules say which cells are quiet enough to be rigid, and what bodies may withhold.

A rule knows neither earlier windows nor connected cells nor releases. `RateRule` judges cells by
one tolerance; by others in named sets, or by a part of the largest rate so far. A window is as long
as given, or a little longer than the longest period.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import ClassVar, Literal, Protocol

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.taken import take_fields
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.limits import Limits
from rigidfx.decide.memory import Memory
from rigidfx.effects import Reduced
from rigidfx.flexible.strain_rate import Indicator
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.report.ledger import Rigidity
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import fraction
from rigidfx.step.stepper import Stepper

MARGIN = 1.25  # an automatic window in longest periods, or in halves of them for a budget
FEWEST = 8  # steps of an automatic window


@dataclass(frozen=True)
class Observation:
    """The run around a step of dt [s], and the largest displacement that it lacks after it [m]."""

    stepper: Stepper
    dt: float
    error: float

    @property
    def t(self) -> float:
        """Time [s]."""
        return self.stepper.state.t

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
        return np.asarray(self.stepper.system.prescribed.mask.reshape(-1, 3).any(axis=1))

    @property
    def indicator(self) -> Indicator:
        """The measure of cells in the last step, zero in bodies."""
        assert self.stepper.indicator is not None  # a run that decides measures
        return self.stepper.indicator

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

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        ...

    def observe(self, seen: Observation) -> None:
        """Record a step that was accepted, once observation has begun. Collective."""
        ...

    @property
    def rigidity(self) -> Rigidity | None:
        """Error of the motion by bodies; None if that is not estimated."""
        return None

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Record a window's end, and owned cells that were flexible in all of it. Collective."""
        return


@dataclass(frozen=True)
class Relative:
    """A tolerance relative to the largest strain rate of any cell so far.

    It suits any structure, while strain rates in 1/s are rarely known in advance. Until a rate has
    exceeded what Newton's method may leave, all cells are at rest, and quiet.

    Attributes:
        part: Between 0 and 1.
    """

    part: float

    def __post_init__(self) -> None:
        """Check that it is a number between 0 and 1."""
        fraction("Relative", "part", self.part)
        take_fields(self)


class RateRule(Rule):
    """One tolerance for quiet cells, and for what bodies withhold."""

    remembered: ClassVar[Remembered] = same("_noise")

    def __init__(
        self,
        scene: Scene,
        memory: Memory,
        tol: float | Relative,
        window: float | Literal["auto"],
        tolerances: Mapping[str, float],
    ) -> None:
        """Find the cells that have a tolerance of their own. Collective.

        `rigidfx.decide.settings.StrainRate` describes the values.

        Raises:
            SceneError: If a name is unknown, or a `Reduced` part has all cells of it.
        """
        self._comm, self._memory, self._tol, self._window = scene.comm, memory, tol, window
        self._noise = 0.0  # strain rate that rounding may leave, in the last step [1/s]
        self._special = np.full(memory.window.worst.size, np.inf)
        for name, own in tolerances.items():
            cells = judged_cells(scene, name, "StrainRate (tolerances)")
            self._special[cells] = np.minimum(self._special[cells], own)

    @property
    def tol(self) -> Array:
        """Tolerance of each owned cell now [1/s]."""
        tol = self._tol
        if isinstance(tol, Relative):  # until a rate exceeds the noise all is at rest
            of_all = tol.part * self._memory.largest or self._noise
        else:
            of_all = float(tol)
        return np.where(np.isfinite(self._special), self._special, of_all)

    def limits(self) -> Limits:
        """Strain rates that bodies may withhold."""
        return Limits(np.maximum(self.tol, self._noise))

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        if not isinstance(self._window, str):
            return float(self._window)
        if self._memory.window.steps < FEWEST:
            return nan
        return MARGIN * self._memory.signals.period()

    def observe(self, seen: Observation) -> None:
        """Remember the largest strain rate, where tolerances are parts of it. Collective."""
        self._noise, memory, indicator = seen.noise, self._memory, seen.indicator
        if not isinstance(self._tol, Relative):
            return
        most = float(indicator.values[indicator.cells].max(initial=0.0))
        most = self._comm.allreduce(most, op=MPI.MAX)
        # What is at rest strains by noise, of which no part means anything.
        if memory.largest > 0 or most > self._noise:
            memory.largest = max(memory.largest, most)


def judged_cells(scene: Scene, name: str, wanted_by: str) -> Indices:
    """Owned cells of a set that a field of a criterion names, wanted_by in messages. Collective.

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
