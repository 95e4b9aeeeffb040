"""When parts of a structure become rigid, and when they are released: what the user states."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, Literal

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import at_least_zero, names, number, positive, shown, whole
from rigidfx.base.taken import take_fields, taken
from rigidfx.decide.memory import Memory
from rigidfx.decide.rules import RateRule, Relative, Rule
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.strain_rate import Indicator, StrainRates
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

CHANGE = 0.1  # part of its largest value so far by which a load has changed, by default
LEAST = 2  # cells of a body: one alone hardly saves anything
WORTH = 0.05  # of all cells: what is less saves less than its switches cost


@dataclass(frozen=True)
class Release:
    """Bodies become flexible again, at given times or on a condition.

    It is not needed for waking by forces, nor for changes of supports or (`wake="all"`) of loads.

    Attributes:
        at: Times [s] at which steps end and bodies are released.
        when: A function of the report of a step that says whether to release after it: True or
            False, or the names of bodies.
        repeat: If True, the step in which the condition becomes true is solved again with these
            cells flexible (Fig. 2). If False, they are released after that step. With True the
            condition is evaluated before and after each step is accepted; the report before it has
            no events, ledger and recovered stresses.
        where: Name of a set of cells to be released; the rest of their bodies stays rigid. All
            cells if None.
    """

    at: Sequence[float] | float = ()
    when: Callable[[Any], bool | Iterable[str]] | None = None
    where: str | None = None
    repeat: bool = False

    def __post_init__(self) -> None:
        """Check the record.

        Raises:
            SceneError: If there is neither a time nor a condition, or one cannot be used.
        """
        at: Any = taken(self.at)
        several = isinstance(at, Iterable) and not isinstance(at, (str, bytes, Mapping))
        times = tuple(at) if several else (at,)
        for t in times:
            if not number("Release", "at", t) > 0:
                raise SceneError(f"Release: at must be later than the start, got {shown(t)}.")
        object.__setattr__(self, "at", tuple(number("Release", "at", t) for t in times))
        if self.where is not None and not isinstance(self.where, str):
            raise SceneError(f"Release: where must be the name of a set, got {shown(self.where)}.")
        if self.when is not None and not callable(self.when):
            raise SceneError(
                f"Release: when must be a function of a report, got {shown(self.when)}."
            )
        if not isinstance(self.repeat, bool) or (self.repeat and self.when is None):
            raise SceneError(
                "Release: repeat must be True or False, and goes with a condition (when), got "
                f"{shown(self.repeat)}."
            )
        if not self.at and self.when is None:
            raise SceneError("Release: name a time (at) or a condition (when).")

    @property
    def times(self) -> tuple[float, ...]:
        """The times [s]."""
        return self.at  # type: ignore[return-value]


class Criterion:
    """Base of the records of criteria.

    `rigidfx.decide.settings.StrainRate` describes the attributes.
    """

    wake: Literal["all", "local", "none"] | None = "local"
    window: float | Literal["auto"] = "auto"
    never: Sequence[str] = ()
    min_cells: int | None = 2
    load_change: float | None = inf
    patience: float = 2.0
    since: float = 0.0
    until: float = inf
    release: Sequence[Release] | Release = ()

    @property
    def owner(self) -> str:
        """Its name in messages."""
        return type(self).__name__

    @property
    def releases(self) -> tuple[Release, ...]:
        """The releases that a user asks for, one or several."""
        return (self.release,) if isinstance(self.release, Release) else tuple(self.release)

    @property
    def remedy(self) -> str:
        """Advice against repeated releases of bodies."""
        return "Take fewer releases."

    @property
    def grows(self) -> bool:
        """Whether bodies get shapes, and forces wake single cells."""
        return self.wake == "local"

    @property
    def follows_loads(self) -> bool:
        """Whether changes of loads release all bodies, as in the paper."""
        return self.wake == "all"

    @property
    def change(self) -> float:
        """Change of a load, over its largest value so far, that releases bodies."""
        if not self.follows_loads:
            return inf
        return CHANGE if self.load_change is None else self.load_change

    def least_cells(self, scene: Scene) -> int:
        """Least number of cells of a new body. Collective."""
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


def without_effect(record: object) -> list[str]:
    """Fields of a user's record that are given and have no effect any more."""
    fields = ("kappa", "easing", "grow")
    return [name for name in fields if getattr(record, name, None) not in (None, name == "grow")]


@dataclass(frozen=True)
class StrainRate(Criterion):
    """Parts whose strain rate stays below a tolerance become rigid: equations (23), (24).

    The run is observed window by window. A cell qualifies if its strain rate, a mean over the cell,
    was at most `tol` in every step of a window; at the window's end connected cells that qualify
    become bodies. Bodies get shapes as forces call for them, and cells are released where shapes do
    not suffice; all cells are released when a support begins or ends, or a motor begins to lead.

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
        if not isinstance(self.tol, Relative):
            at_least_zero(owner, "tol", self.tol)
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
            at_least_zero(owner, f"the tolerance of '{name}'", tol)
        object.__setattr__(self, "never", names(owner, "never", self.never, "cell sets"))
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
            if not self.follows_loads:
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
    def remedy(self) -> str:
        """Advice against repeated releases of bodies."""
        helps = {"all": "a larger load_change", "local": "a larger tol"}
        helps_here = helps.get(self.wake or "", "fewer releases")
        return f"Take a longer window, {helps_here}, or look at the conditions of Release."

    def rule(self, scene: Scene, timeline: Timeline, memory: Memory) -> Rule:
        """One tolerance."""
        return RateRule(scene, memory, self.tol, self.window, self.tolerances)

    def indicator(self, scene: Scene, forces: InternalForces) -> Indicator:
        """Strain rates by `measure`."""
        return StrainRates(scene, forces, self.measure)
