"""Steps as long as an error lets them be: the record of a user."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import names, number, positive, shown
from rigidfx.base.taken import take_fields
from rigidfx.scene.scene import Scene

LEAST = 1e-3  # of the largest step: the smallest one, unless told otherwise
FINEST = 1e-12  # part of a displacement that rounding leaves something of


def fraction(owner: str, name: str, value: Any) -> float:
    """A user's number between zero, or what rounding leaves of one, and one as a float."""
    result = number(owner, name, value)
    if FINEST <= result < 1:
        return result
    if 0 < result < 1:
        raise SceneError(
            f"{owner}: {name} must be {FINEST:g} or more, as rounding errs by some of that, got "
            f"{shown(value)}."
        )
    raise SceneError(
        f"{owner}: {name} must be a number between 0 and 1, such as 0.01 for one per cent, got "
        f"{shown(value)}."
    )


@dataclass(frozen=True)
class StepControl:
    """Δt by a permitted error of displacements.

    The sum of the errors of all steps is kept below `tol` times the largest displacement so far;
    see `rigidfx.step.length.time_error` for the estimate and `rigidfx.step.length.controller` for
    the rule.

    Attributes:
        tol: Error of a run over the largest displacement so far, such as 0.01.
        at: Names of the probes whose displacements count, at each time the one with the largest
            error; some nodes far from each other if None. Other nodes of the connected part count
            by their mean square, since their errors travel to the probes.
        largest: Largest Δt [s]; required. A shorter load may be missed, unless it has a time
            window, a `Table` or `breakpoints`.
        smallest: Smallest Δt [s]; a thousandth of the largest if None.
        of: Displacement to which `tol` is relative [m]; the largest so far if None.
    """

    tol: float
    at: str | Sequence[str] | None = None
    largest: float | None = field(default=None, kw_only=True)
    smallest: float | None = field(default=None, kw_only=True)
    of: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check all values, and take them; `SceneError` if one cannot be used."""
        owner = "StepControl"
        fraction(owner, "tol", self.tol)
        if self.largest is None:
            raise SceneError(
                "StepControl: needs largest, the longest step in s that may be taken, such as "
                "StepControl(0.01, largest=0.05): what is over in less may be stepped over."
            )
        largest = positive(owner, "largest", self.largest)
        if self.smallest is not None and positive(owner, "smallest", self.smallest) > largest:
            raise SceneError(
                f"StepControl: needs smallest ≤ largest, got {shown(self.smallest)} and "
                f"{shown(self.largest)} s."
            )
        if self.of is not None:
            positive(owner, "of", self.of)
        object.__setattr__(self, "at", probe_names(owner, self.at))
        take_fields(self)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the probes that count; none if nodes of its own choice do."""
        return () if self.at is None else tuple(self.at)

    @property
    def most(self) -> float:
        """The largest Δt [s]."""
        assert self.largest is not None  # it would have been refused
        return float(self.largest)

    @property
    def least(self) -> float:
        """The smallest Δt [s]."""
        return LEAST * self.most if self.smallest is None else float(self.smallest)

    def check(self, scene: Scene) -> None:
        """Look its probes up."""
        check_probes("StepControl", self.names, scene)


def probe_names(owner: str, at: Any) -> tuple[str, ...] | None:
    """Names of probes that a user gives, sorted; None if none are given."""
    if at is None:
        return None
    given = names(owner, "at", at, "probes")
    if not given:
        raise SceneError(f"{owner}: at must be names of probes, got {shown(at)}.")
    return tuple(sorted(set(given)))


def check_probes(owner: str, names: Sequence[str], scene: Scene) -> None:
    """Refuse names of probes that the scene does not have."""
    for name in names:
        if name not in scene.probes:
            raise SceneError(
                f"{owner}: at names the probe '{name}'; the scene has "
                f"{sorted(scene.probes) or 'none'}. Name one of these, or give it to the Scene."
            )
