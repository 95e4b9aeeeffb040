"""Accuracy as a user states it: one per cent of the motion of a probe."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from math import ceil, floor, log1p, log10
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import names, positive, shown, truth, whole
from rigidfx.base.log import tell
from rigidfx.base.taken import take_fields
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.decide.budget import BudgetRule
from rigidfx.decide.memory import Memory
from rigidfx.decide.rules import judged_cells
from rigidfx.decide.settings import Criterion
from rigidfx.effects import InitialDisplacement, NumericalDamping, Rigid
from rigidfx.report.ledger import Entry, Ledger, Rigidity
from rigidfx.report.report import Report
from rigidfx.scene.points import check_probes, probe_names
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import StepControl, Timeline, fraction

FINER = 4  # a twin's Δt
OF_XI = 0.3  # of the ξ with which damping would take as much as it may, were it to go on as it does
ALL = 0.95  # of the energy: what damping takes more than that does not tell how fast it does
# Unknowns of a body, from which it may save what e and Python cost: steps took 3.5 ms at
# 1000 unknowns all flexible, and 2 ms more beside bodies that took 19 % of these.
WORTH = 600
# Unknowns of a structure, from which it is looked at: with bodies, three scenes of 1722 to 2700
# took 1.2 to 1.6 of the time without (a body in flight, a bar and a cantilever that strike).
WATCHED = 3000
KNOWN = 8  # steps of the finer run that are remembered
AHEAD = 2  # of them past the time that is asked, as slopes are taken from neighbours


def beside(
    reports: Iterator[Report], finer: Iterator[Report], names: Sequence[str], budget: float
) -> Iterator[Report]:
    """Reports with the largest distance of probes from where they are in a finer run. Collective.

    The finer run goes along, and ends with them. The run has ledgers; probes of some names count,
    and their permitted distance over the largest displacement is the budget.
    """
    known: deque[tuple[float, Array]] = deque(maxlen=KNOWN)
    worst = 0.0
    try:
        for report in reports:
            while sum(t >= report.t for t, _ in known) < AHEAD:
                other = next(finer, None)
                if other is None:
                    break
                known.append((other.t, np.array([other.probes[name] for name in names])))
            now = np.array([report.probes[name] for name in names])
            worst = max(worst, float(np.linalg.norm(now - _at(report.t, known), axis=1).max()))
            assert report.ledger is not None
            scale = report.ledger.time.scale
            measured = Entry(worst, scale, budget * scale, "m")
            yield replace(report, ledger=replace(report.ledger, measured=measured))
    finally:
        for run in (reports, finer):
            run.close()  # type: ignore[attr-defined]


def _at(t: float, known: deque[tuple[float, Array]]) -> Array:
    """Displacements at t [s], by a cubic of the steps around."""
    times, u = np.array([s for s, _ in known]), np.array([place for _, place in known])
    if len(times) < 3:
        return np.asarray(u[int(np.argmin(np.abs(times - t)))])
    from scipy.interpolate import CubicHermiteSpline  # takes 0.1 s to import

    return np.asarray(CubicHermiteSpline(times, u, np.gradient(u, times, axis=0))(t))


@dataclass(frozen=True)
class Budgeted(Criterion):
    """Parts become rigid as far as that keeps a budget."""

    budget: float  # error of the displacement over the largest one so far
    never: Sequence[str]  # names of sets of cells that stay flexible
    min_cells: int | None  # least number of cells of a new body; see `Accuracy`
    patience: float = 1.0  # see `Criterion`

    @property
    def owner(self) -> str:
        """The name of the user's record."""
        return "Accuracy"

    def least_cells(self, scene: Scene) -> int:
        """Least cells of a body; more than there are in a structure too small for bodies to pay."""
        least, cells = super().least_cells(scene), scene.mesh.topology.index_map(3).size_global
        if self.min_cells is not None:
            return least
        unknowns = 3 * scene.space.dofmap.index_map.size_global
        return max(least, ceil(WORTH * cells / unknowns)) if unknowns >= WATCHED else cells + 1

    def rule(self, scene: Scene, timeline: Timeline, memory: Memory) -> BudgetRule:
        """The rule of the budget."""
        return BudgetRule(scene, timeline, memory, self.budget)

    @property
    def remedy(self) -> str:
        """Advice against repeated releases of bodies."""
        return "Take a larger budget, or name their cells `never`."


@dataclass(frozen=True)
class Accuracy:
    """Permitted error of a motion; a run chooses Δt and its rigid parts by it.

    A run begins reduced: from the second step on all cells are in bodies, unless the scene has an
    `InitialDisplacement`. A body gets shapes where what it withholds would move a node by more than
    its share of the budget, and where contacts press it, and loses cells where shapes do not
    suffice. Bodies may use half of the budget that time integration
    (`rigidfx.scene.timeline.StepControl`) has left (`rigidfx.decide.budget`). The ledger of each
    report has the spent amounts of both. Neither strains are bounded nor the error of the mesh is
    estimated.

    Attributes:
        budget: Error of the displacement over the largest one so far, such as 0.01.
        at: Names of the probes whose displacements count; some nodes far from each other if None.
        of: Displacement to which the budget is relative [m]; the largest so far if None.
        smallest: Smallest Δt [s]; a thousandth of the largest if None.
        never: Names of sets of cells that stay flexible.
        min_cells: Least number of cells of a new body. If None: a twentieth of all cells, and
            cells of 600 unknowns at least, since smaller bodies save no time; a structure below
            3000 unknowns then has no bodies.
        check: Whether the flexible twin is computed, too, with steps about a quarter as long: then
            ledgers have the measured error.
        grow: Without effect, for one release: every run begins reduced.
    """

    budget: float
    at: str | Sequence[str] | None = None
    of: float | None = field(default=None, kw_only=True)
    smallest: float | None = field(default=None, kw_only=True)
    never: Sequence[str] = field(default=(), kw_only=True)
    min_cells: int | None = field(default=None, kw_only=True)
    check: bool = field(default=False, kw_only=True)
    grow: bool | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check all values, and take them.

        Raises:
            SceneError: If one cannot be used.
        """
        owner = "Accuracy"
        fraction(owner, "budget", self.budget)
        object.__setattr__(self, "at", probe_names(owner, self.at))
        for name in ("of", "smallest"):
            if getattr(self, name) is not None:
                positive(owner, name, getattr(self, name))
        truth(owner, "check", self.check)
        object.__setattr__(self, "never", names(owner, "never", self.never, "cell sets"))
        if self.min_cells is not None:
            whole(owner, "min_cells", self.min_cells, least=1)
        take_fields(self)

    def finer(self, control: StepControl) -> StepControl:
        """How Δt of the flexible twin is chosen: a quarter as long as that of the run, or so."""
        tol, largest = float(control.tol) / FINER**2, control.most / FINER
        return StepControl(
            tol, control.at, largest=largest, smallest=control.least / FINER, of=control.of
        )

    def followed(
        self,
        reports: Iterator[Report],
        scene: Scene,
        rigid: bool,
        twin: Callable[..., Iterator[Report]],
    ) -> Iterator[Report]:
        """The reports of a run; at its end it is said whether it has kept the budget. Collective.

        Cells may become `rigid`, and `twin` begins the twin.
        """
        if self.check:
            names, finer = tuple(self.at or scene.probes), twin(progress=False, verbose=False)
            reports = beside(reports, finer, names, float(self.budget))
        last = None
        with closing(reports):  # type: ignore[type-var]
            for report in reports:
                last = report
                yield report
        if last is None or last.ledger is None:
            return
        ledger, budget = last.ledger, float(self.budget)
        tell(scene.comm, f"{budget:.3g} of the largest displacement was asked:\n{ledger}")
        if rigid and not scene.named(InitialDisplacement):
            tell(scene.comm, "all cells that may be in bodies were so from the second step on")
        if ledger.struck and not self.check:
            warn(
                scene.comm,
                f"Accuracy: whether the budget of {budget:.3g} was kept is unknown, as a contact "
                "has closed: no estimate follows what a blow does. check=True measures it.",
            )
        over = []
        spent = ledger.time.relative + ledger.rigidity.relative
        if spent > budget * (1 + 1e-9):
            over.append(
                f"time integration errs by {ledger.time.relative:.3g} and what is rigid by "
                f"{ledger.rigidity.relative:.3g} (estimated), together {spent:.3g}"
            )
        if ledger.measured.relative > budget:
            measured = f"the run errs by {ledger.measured.relative:.3g}"
            over.append(f"{measured} (measured against a finer flexible run)")
        if ledger.damping.spent > ledger.damping.allowed:
            taken = f"numerical damping takes {ledger.damping.relative:.3g} of the energy"
            over.append(f"{taken}, and half of that of amplitudes: {_less(ledger, scene, budget)}")
        if over:
            warn(
                scene.comm,
                f"Accuracy: the budget of {budget:.3g} was not met: {'; '.join(over)}. Take a "
                "larger budget, a smaller `smallest`, or a smaller dt where loads are over in less "
                "and are no time windows.",
            )

    def criterion(self, scene: Scene) -> Budgeted | None:
        """What judges cells; None if nothing is worth to be rigid, or named so. Collective."""
        cells = scene.mesh.topology.index_map(3).size_global
        found = Budgeted(float(self.budget), self.never, self.min_cells)
        return found if found.least_cells(scene) <= cells or scene.named(Rigid) else None

    @property
    def idle(self) -> Rigidity:
        """Error of a motion by rigidity where nothing becomes rigid."""
        return Rigidity(0.0, 0.0, float(self.budget), 0.0)


def _less(ledger: Ledger, scene: Scene, budget: float) -> str:
    """The ξ of numerical damping that would keep a budget with the same steps.

    A free vibration loses 1 - exp(-c ξ) of its energy. A driven one may lose more than its energy,
    in proportion to ξ. The losses of amplitude add up, so less is allowed.
    """
    xi = sum(effect.numerical_damping for effect in scene.named(NumericalDamping))
    part = ledger.damping.relative
    gone = -log1p(-part) if part < ALL else max(-log1p(-ALL), part)
    kept = -log1p(-2 * budget) if budget < ALL / 2 else gone
    enough = xi * OF_XI * min(kept / gone, 1.0)
    digit = 10 ** floor(log10(enough))  # one digit of it, rounded down
    return f"xi = {floor(enough / digit) * digit:.1g} in place of {xi:g} would do"


def controlled(accuracy: Any, scene: Scene, dt: Any, rigidify: Any) -> StepControl:
    """How Δt is chosen in a run with an `Accuracy`.

    Raises:
        SceneError: If accuracy is none, there is such a criterion, dt is no length, a probe is
            unknown, or there is none to check.
    """
    if not isinstance(accuracy, Accuracy):
        raise SceneError(f"simulate: accuracy must be an Accuracy, got {shown(accuracy)}.")
    if rigidify is not None:
        raise SceneError(
            "simulate: accuracy chooses what becomes rigid, and so does rigidify: give one of them."
        )
    if isinstance(dt, (StepControl, Mapping)):
        what = "a StepControl" if isinstance(dt, StepControl) else "several values of dt"
        raise SceneError(
            f"simulate: accuracy chooses Δt, and so would {what}: give the largest Δt in s, such "
            "as dt=0.05, with it."
        )
    largest = positive("simulate", "dt", dt)
    if accuracy.smallest is not None and accuracy.smallest > largest:
        raise SceneError(
            f"Accuracy: needs smallest ≤ dt, the largest Δt, got {shown(accuracy.smallest)} and "
            f"{shown(largest)} s."
        )
    names: Any = accuracy.at
    check_probes("Accuracy", names or (), scene)
    for name in accuracy.never:
        judged_cells(scene, name, "Accuracy (never)")
    if accuracy.check and not scene.probes:
        raise SceneError(
            "Accuracy: check compares displacements of probes, and the scene has none: give one."
        )
    return StepControl(
        float(accuracy.budget), names, largest=largest, smallest=accuracy.smallest, of=accuracy.of
    )
