"""An adaptive run beside its flexible twin: how far a probe may be off."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import rigidfx as rf

from .case import History, Run

PROMISED = 2.4  # the error, over its largest way, that tol / peak strain rate brings at most


def beside_its_twin(
    name: str,
    scene: Callable[[], rf.Scene],
    dt: float,
    t_end: float,
    rule: rf.StrainRate,
    bound: float,
) -> Iterator[Run]:
    """The flexible run, then the adaptive one.

    Args:
        name: What tells the two from others.
        scene: Makes the scene, with a probe "tip".
        dt: Δt [s].
        t_end: End of the runs [s].
        rule: What makes parts rigid.
        bound: What the tip may be off by, of its largest way.
    """
    tips: list[np.ndarray] = []

    def near(history: History) -> str:
        """Of the flexible run first, then of the other."""
        tips.append(history.probe("tip"))
        off = np.abs(tips[-1] - tips[0]).max() / np.abs(tips[0]).max()
        return "" if off <= bound else f"the tip is off by {off:.1%}, the bound is {bound:.1%}"

    yield Run(f"flexible, {name}", scene(), dt, t_end, momentum=None, check=near)
    yield Run(f"adaptive, {name}", scene(), dt, t_end, rule, momentum=None, check=near)
