"""A structure that is run again and again, and the settings with which it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import rigidfx as rf


@dataclass(frozen=True)
class Setting:
    """The choices of a run.

    Attributes:
        dt: Δt, or the longest one with a budget [s].
        tol: Strain rate below which cells become rigid [1/s]; nothing does if 0.
        window: How long it is observed [s].
        budget: Of `Accuracy`, which chooses Δt and rigid parts; neither is chosen if 0.
        newton: Reduction of the residual at which Newton's iteration ends.
        wake: How bodies are released.
        reduced: Whether the structure's parts are reduced.
    """

    dt: float
    tol: float = 0.0
    window: float = 0.0
    budget: float = 0.0
    newton: float = 1e-12
    wake: str = "local"
    reduced: bool = False


@dataclass(frozen=True)
class Structure:
    """A structure, and its runs.

    Attributes:
        name: Its name.
        scene: Makes the problem, of parts that are reduced.
        at: The probe that is compared.
        of: Length that errors are parts of [m].
        t_end: End of its runs [s].
        min_cells: Least size of a body.
        reference: The setting that errors are against.
        ways: Name of a curve → the settings along it, the fastest first.
        knobs: Name → setting, beside the last of those by hand.
        parts: The parts that may be reduced.
    """

    name: str
    scene: Callable[..., rf.Scene]
    at: str
    of: float
    t_end: float
    min_cells: int
    reference: Setting
    ways: dict[str, list[Setting]]
    knobs: dict[str, Setting] = field(default_factory=dict)
    parts: tuple[rf.Reduced, ...] = ()
