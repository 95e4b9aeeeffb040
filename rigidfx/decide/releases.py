"""Releases that a user asks for: at given times, on a condition, of a set of cells."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import shown
from rigidfx.base.types import Bools
from rigidfx.decide.settings import Release
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

PLANNED = "planned"  # reason of a release at a given time


class Releases:
    """The releases that a criterion records."""

    def __init__(self, scene: Scene, releases: Sequence[Release], timeline: Timeline) -> None:
        """Look the sets of cells up. Collective.

        Raises:
            SceneError: If the name of a set is unknown.
        """
        self._comm, self._timeline = scene.comm, timeline
        owned = scene.owned_cells(None, "Release").size
        self._pairs: list[tuple[Release, Bools]] = []
        for release in releases:
            cells = np.zeros(owned, dtype=bool)
            cells[scene.owned_cells(release.where, "Release")] = True
            self._pairs.append((release, cells))

    @property
    def repeat(self) -> bool:
        """Whether there is a condition that has steps solved again."""
        return any(release.repeat for release, _ in self._pairs)

    def asked(
        self, t: float, report: Report, bodies: Sequence[RigidBody], before: bool = False
    ) -> tuple[list[str], Bools | None]:
        """Why cells are released at t [s], and which owned ones; None if none are. Collective.

        A user's condition gets the report, before the step is accepted if so. One that fails, or
        names a body that there is not, is a SceneError.
        """
        reasons: list[str] = []
        released: Bools | None = None
        for release, cells in self._pairs:
            asked = cells
            if before and not release.repeat:
                continue
            if not before and any(self._timeline.same(t, planned) for planned in release.times):
                reason = PLANNED
            elif release.when is None:
                continue
            else:
                asking = partial(_answer, release.when, report)
                own = together(self._comm, "Release: its condition", asking)
                if not (answer := self._comm.bcast(own)):  # that of rank 0
                    continue
                reason = "condition"
                if answer is not True:
                    asked = cells & _cells_of(answer, bodies, cells.size)
            reasons += [reason] if reason not in reasons else []
            released = asked if released is None else released | asked
        return reasons, released


def _cells_of(names: Iterable[str], bodies: Sequence[RigidBody], count: int) -> Bools:
    """Owned cells of named bodies.

    Raises:
        SceneError: If there is no such body.
    """
    known = {body.name: body for body in bodies}
    cells = np.zeros(count, dtype=bool)
    for name in names:
        if name not in known:
            raise SceneError(
                f"Release: its condition names the body '{name}'; there are "
                f"{sorted(known) or 'none'}."
            )
        cells[known[name].cells] = True
    return cells


def _answer(condition: Any, report: Report) -> bool | list[str]:
    """The answer of a user's condition: True, False or names of bodies."""
    answer = condition(report)
    if isinstance(answer, (bool, np.bool_)):
        return bool(answer)
    if isinstance(answer, str):
        return [answer]
    if isinstance(answer, Iterable):
        names = list(answer)
        if all(isinstance(name, str) for name in names):
            return names
    raise SceneError(
        f"Release: its condition must give True, False or names of bodies, got {shown(answer)}."
    )
