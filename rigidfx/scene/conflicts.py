"""Which effects contradict each other, or the scheme, whatever the mesh."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import combinations
from typing import Any

from rigidfx import effects as fx
from rigidfx.base.errors import SceneError
from rigidfx.mechanics.schemes import Scheme

__all__ = ["check_together", "overlap"]


def check_together(effects: Sequence[fx.Effect], scheme: Scheme) -> None:
    """Check effects as far as possible without the mesh: which go together, and with the scheme.

    Args:
        effects: All effects of a scene.
        scheme: Its time integration scheme.

    Raises:
        SceneError: If one is no effect, or some contradict each other or the scheme.
    """

    def named(kind: type[fx.Effect]) -> list[Any]:
        return [e for e in effects if isinstance(e, kind)]

    for effect in effects:
        if not isinstance(effect, fx.Effect):
            raise SceneError(f"Scene: {effect!r} is not an effect. See rigidfx.effects.")
    if len(named(fx.Preload)) > 1:
        raise SceneError("Scene: only one Preload makes sense; give it all static loads.")
    if named(fx.InitialDisplacement) and (named(fx.Preload) or named(fx.Rigid)):
        raise SceneError(
            "Scene: an InitialDisplacement goes neither with a Preload, which finds a displacement "
            "of its own, nor with parts that are Rigid or Reduced from the start."
        )
    damping = named(fx.NumericalDamping)
    if damping and not scheme.damps:
        raise SceneError(
            f"Scene: numerical damping (22) goes with EnergyMomentum, not with "
            f"{type(scheme).__name__}."
        )
    parts = named(fx.Rigid)
    bodies = [part.where for part in parts]
    for k, part in enumerate(parts):
        for other in parts[:k]:
            if part.where == other.where or None in (part.where, other.where):
                raise SceneError(
                    f"Scene: a cell can be in one Rigid body only, and {other.owner} and "
                    f"{part.owner} hold the same ones. Leave one of the two out, or name sets that "
                    "have no node in common."
                )
    for name in bodies:
        if name is not None and re.fullmatch(r"part \d+", name):
            raise SceneError(
                f"Scene: '{name}' is what a part that is found is called in reports; give the set "
                "of this Rigid body another name."
            )
    if bodies and not scheme.couples:
        raise SceneError(
            f"Scene: {type(scheme).__name__} does not couple to rigid bodies; take "
            "EnergyMomentum or Midpoint."
        )
    for a, b in combinations(damping, 2):
        if overlap(a, b):
            raise SceneError("Scene: two NumericalDamping effects overlap in time.")


def overlap(a: fx.Windowed, b: fx.Windowed) -> bool:
    """Whether two time windows have more than an instant in common."""
    return max(a.since, b.since) < min(a.until, b.until)
