"""When parts of a structure become rigid, and when they are released: what the user states.

`StrainRate` judges cells by one tolerance; by others in named sets, or by a part of the largest
rate so far. Cells are quiet up to a strain rate, their tolerance, and bodies may withhold as much.
A window is as long as given, or a little longer than the longest period.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, nan
from typing import ClassVar, Literal

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown, whole
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.taken import take_fields
from rigidfx.base.types import Array, Bools
from rigidfx.decide.criteria.judging import (
    Criterion,
    Observation,
    Rule,
    judged_cells,
    never_rigid,
)
from rigidfx.decide.criteria.release import Release
from rigidfx.decide.limits import Limits
from rigidfx.decide.memory.memory import Memory
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.strain_rate import Indicator, StrainRates
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline, fraction

ENCLOSED = 1.5  # tolerances, up to which a cell may strain that others enclose
MARGIN = 1.25  # an automatic window in longest periods
FEWEST = 8  # steps of an automatic window


@dataclass(frozen=True)
class Relative:
    """A tolerance relative to the largest strain rate of any cell so far.

    It suits any structure, while strain rates in 1/s are rarely known in advance. Until a rate has
    exceeded the noise of Newton's method, only cells without any strain qualify.

    Attributes:
        part: Between 0 and 1.
    """

    part: float

    def __post_init__(self) -> None:
        """Check the number.

        Raises:
            SceneError: If it is none between 0 and 1.
        """
        fraction("Relative", "part", self.part)
        take_fields(self)


class Tolerances:
    """Strain rate up to which each owned cell is quiet.

    Attributes:
        comm: Communicator of the mesh.
    """

    def __init__(
        self,
        scene: Scene,
        memory: Memory,
        tol: float | Relative,
        of_sets: Mapping[str, float],
    ) -> None:
        """Find the cells that have a tolerance of their own. Collective.

        Args:
            scene: The problem.
            memory: Memory of the policy.
            tol: As of `rigidfx.decide.criteria.criterion.StrainRate`.
            of_sets: Tolerances of named sets of cells [1/s].

        Raises:
            SceneError: If a name is unknown, or a `Reduced` part has all cells of it.
        """
        self.comm, self._memory, self._tol = scene.comm, memory, tol
        self._special = np.full(memory.window.worst.size, np.inf)
        for name, own in of_sets.items():
            cells = judged_cells(scene, name, "StrainRate (tolerances)")
            self._special[cells] = np.minimum(self._special[cells], own)

    def now(self) -> Array:
        """Tolerance of each owned cell now [1/s]."""
        tol = self._tol
        of_all = tol.part * self._memory.largest if isinstance(tol, Relative) else float(tol)
        return np.where(np.isfinite(self._special), self._special, of_all)

    def observe(self, seen: Observation) -> None:
        """Remember the largest strain rate, where tolerances are parts of it. Collective.

        Args:
            seen: The run after a step.
        """
        if not isinstance(self._tol, Relative):
            return
        memory, indicator = self._memory, seen.indicator
        most = float(indicator.values[indicator.cells].max(initial=0.0))
        most = self.comm.allreduce(most, op=MPI.MAX)
        # What is at rest strains by noise, of which no part means anything.
        if memory.largest > 0 or most > seen.noise:
            memory.largest = max(memory.largest, most)


def window_length(given: float | Literal["auto"], memory: Memory) -> float:
    """How long a window is to be [s]; NaN while that is not known. Collective.

    Args:
        given: Length [s], or "auto".
        memory: Memory of the policy.
    """
    if not isinstance(given, str):
        return float(given)
    if memory.window.steps < FEWEST:
        return nan
    return MARGIN * memory.signals.period()


class RateRule:
    """One tolerance for quiet cells, and for what bodies withhold."""

    remembered: ClassVar[Remembered] = same("_noise")

    def __init__(
        self,
        memory: Memory,
        tolerances: Tolerances,
        window: float | Literal["auto"],
    ) -> None:
        """Nothing has been observed.

        Args:
            memory: Memory of the policy.
            tolerances: Of each owned cell.
            window: Length of a window [s].
        """
        self._memory, self._tolerances, self._window = memory, tolerances, window
        self._noise = 0.0  # strain rate that rounding may leave, in the last step [1/s]

    @property
    def tol(self) -> Array:
        """Tolerance of each owned cell now [1/s]."""
        return self._tolerances.now()

    def limits(self) -> Limits:
        """Strain rates that bodies may withhold."""
        return Limits(np.maximum(self.tol, self._noise))

    @property
    def rigidity(self) -> None:
        """Not estimated: tolerances are the user's."""
        return None

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        return window_length(self._window, self._memory)

    def observe(self, seen: Observation) -> None:
        """Remember the largest strain rate, where tolerances are parts of it. Collective."""
        self._noise = seen.noise
        self._tolerances.observe(seen)

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Nothing more is asked of a window than its rates."""

    def told(self) -> str:
        """Nothing that the user has not set."""
        return ""


@dataclass(frozen=True)
class StrainRate(Criterion):
    """Parts whose strain rate stays below a tolerance become rigid: equations (23), (24).

    The run is observed window by window. A cell qualifies if its strain rate, a mean over the cell,
    was at most `tol` in every step of a window; at the window's end connected cells that qualify
    become bodies. Bodies get shapes as forces call for them, and cells are released where shapes do
    not suffice; all cells are released when a support begins or ends.

    Cells named by a `Rigid` effect are rigid always. With wake="all" or "none" bodies that are
    found grow together with them unless the effect gives their mass or inertia or a `Resultant`
    acts on them.

    Attributes:
        tol: Largest strain rate of a cell that counts as rigid [1/s]; with measure="paper"
            [m^-1.5/s]. `Relative(0.02)` is that part of the largest strain rate so far.
        window: Length of a window T_red [s]; "auto" takes it from the longest period that is
            seen in the motion and in the loads.
        measure: "rms", sqrt(∫ ΔE:ΔE dV0 / V0)/Δt, which does not depend on the mesh, or
            "paper", sqrt(∫ ΔE:ΔE dV0)/(Δt V0), the paper's (24), which grows as cells shrink.
        tolerances: Tolerance of named sets of cells in place of `tol`; the least where they
            overlap.
        never: Names of sets of cells that stay flexible.
        min_cells: Least number of cells of a new body; a single cell hardly saves time.
        release: Releases at given times or on the user's conditions.
        load_change: For wake="all" only. A load, the velocity of a support or the force of a
            contact has changed if it differs from its value at the last freeze by more than this
            fraction of its largest value so far. 0.1 if None; with infinity only jumps, kinks
            and windows are changes.
        wake: The rule that releases bodies. "local": a body gets a shape where the forces that it
            withholds would strain a cell faster than its tolerance, and the step is solved again;
            cells that its shapes do not follow are released with a ring of cells round them (see
            docs/rigid_parts.md). "all", the paper's rule: bodies have six unknowns each, and any
            change of a load or of a support releases all of them. "none": they have six unknowns,
            and only `release` releases them. With each rule a support that begins or ends releases
            all bodies. "local" if None, or "all" if load_change is given.
        kappa: Without effect, for one release: bodies get shapes before cells would wake by κ tol.
        patience: Factor γ ≥ 1. A release is hasty if a cell was rigid for less time than it was
            observed. After n hasty releases in a row it has to qualify in γⁿ⁻¹ windows in a row.
            Planned releases (`Release(at=…)`) do not count. With "local" cells also wait until
            their computation while quiet has cost as much as a freeze and a release, some seven
            flexible steps of the whole structure. With 1 cells wait for neither.
        easing: Without effect, for one release: bodies with shapes withhold no stress that fades.
        grow: Without effect, for one release: bodies get shapes with wake="local", and no others.
        since: Time [s] at which observation begins.
        until: Time [s] from which on no more bodies are formed.
    """

    tol: float | Relative
    window: float | Literal["auto"]
    measure: Literal["rms", "paper"] = field(default="rms", kw_only=True)
    tolerances: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    never: Sequence[str] = field(default=(), kw_only=True)
    min_cells: int = field(default=2, kw_only=True)
    release: Sequence[Release] | Release = field(default=(), kw_only=True)
    load_change: float | None = field(default=None, kw_only=True)
    wake: Literal["all", "local", "none"] | None = field(default=None, kw_only=True)
    kappa: float | None = field(default=None, kw_only=True)
    patience: float = field(default=2.0, kw_only=True)
    easing: float | None = field(default=None, kw_only=True)
    grow: bool | None = field(default=None, kw_only=True)
    since: float = field(default=0.0, kw_only=True)
    until: float = field(default=inf, kw_only=True)

    def __post_init__(self) -> None:
        """Check all values, and take them.

        Raises:
            SceneError: If a number or a name cannot be used.
        """
        owner = "StrainRate"
        if not isinstance(self.tol, Relative) and not number(owner, "tol", self.tol) >= 0:
            raise SceneError(f"StrainRate: tol must be ≥ 0, got {shown(self.tol)}.")
        if not isinstance(self.window, str) or self.window != "auto":
            if isinstance(self.window, str):
                raise SceneError(
                    f"StrainRate: window must be a time in s or 'auto', got {shown(self.window)}."
                )
            positive(owner, "window", self.window)
        if self.measure not in ("rms", "paper"):
            raise SceneError(
                f"StrainRate: measure must be 'rms' or 'paper', got {shown(self.measure)}."
            )
        named = isinstance(self.tolerances, Mapping)
        if not named or not all(isinstance(name, str) for name in self.tolerances):
            raise SceneError(
                "StrainRate: tolerances must be a dict of cell-set names to numbers, got "
                f"{self.tolerances!r}."
            )
        for name, tol in self.tolerances.items():
            if not number(owner, f"the tolerance of '{name}'", tol) >= 0:
                raise SceneError(
                    f"StrainRate: the tolerance of '{name}' must be ≥ 0, got {shown(tol)}."
                )
        object.__setattr__(self, "never", never_rigid(owner, self.never))
        whole(owner, "min_cells", self.min_cells, least=1)
        listed = isinstance(self.release, (Release, Sequence))
        if not listed or not all(isinstance(release, Release) for release in self.releases):
            raise SceneError(
                f"StrainRate: release must be Release records, got {shown(self.release)}."
            )
        if self.wake is None:
            object.__setattr__(self, "wake", "local" if self.load_change is None else "all")
        if self.wake not in ("all", "local", "none"):
            raise SceneError(
                f"StrainRate: wake must be 'all', 'local' or 'none', got {shown(self.wake)}."
            )
        if self.load_change is not None:
            positive(owner, "load_change", self.load_change, infinite=True)
            if self.wake != "all":
                raise SceneError(
                    "StrainRate: load_change says which changes of loads release all bodies, and "
                    f"with wake='{self.wake}' none does. Take wake='all', or leave it out."
                )
        if not number(owner, "patience", self.patience) >= 1:
            raise SceneError(f"StrainRate: patience must be ≥ 1, got {shown(self.patience)}.")
        since = number(owner, "since", self.since)
        if not max(since, 0.0) < number(owner, "until", self.until, infinite=True):
            raise SceneError(
                f"StrainRate: needs since < until, got {shown(self.since)} … {self.until!r}."
            )
        # In one order on all ranks, as the sets are looked up on all at a time.
        object.__setattr__(self, "tolerances", dict(sorted(self.tolerances.items())))
        take_fields(self)  # at last, so that messages show what was given

    @property
    def releases(self) -> tuple[Release, ...]:
        """The releases, one or several."""
        return (self.release,) if isinstance(self.release, Release) else tuple(self.release)

    @property
    def relative(self) -> bool:
        """Whether tolerances are relative to the largest rate so far."""
        return isinstance(self.tol, Relative)

    @property
    def remedy(self) -> str:
        """Advice against repeated releases of bodies."""
        helps = {"all": "a larger load_change", "local": "a larger tol"}
        helps_here = helps.get(self.wake or "", "fewer releases")
        return f"Take a longer window, {helps_here}, or look at the conditions of Release."

    @property
    def enclosing(self) -> float:
        """As a multiple of tolerances, so that such a cell does not call for a shape at once."""
        return ENCLOSED

    @property
    def former(self) -> tuple[str, ...]:
        """Fields given that have no effect any more."""
        names = ("kappa", "easing", "grow")
        return tuple(k for k in names if getattr(self, k) not in (None, k == "grow"))

    def rule(self, scene: Scene, timeline: Timeline, memory: Memory) -> Rule:
        """One tolerance."""
        tolerances = Tolerances(scene, memory, self.tol, self.tolerances)
        return RateRule(memory, tolerances, self.window)

    def indicator(self, scene: Scene, forces: InternalForces) -> Indicator:
        """Strain rates by `measure`."""
        return StrainRates(scene, forces, self.measure)
