"""Attributes of reports that nothing fills any more, for one release."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from rigidfx.base.named import Named
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.state import State


class Former:
    """Results of the error motion: bodies have shapes in its place, and act with them."""

    probes: Mapping[str, Array]
    _state: State

    @property
    def error_motion(self) -> Mapping[str, Array]:
        """Zero at each probe, shape (3,) [m]; with a warning."""
        return self._nothing("error_motion", "probes", self.probes)

    @property
    def error_reactions(self) -> Mapping[str, Array]:
        """Nothing, with a warning."""
        return self._nothing("error_reactions", "reactions")

    @property
    def error_reaction_moments(self) -> Mapping[str, Array]:
        """Nothing, with a warning."""
        return self._nothing("error_reaction_moments", "reaction_moments")

    @property
    def error_touches(self) -> Mapping[str, Array]:
        """Nothing, with a warning."""
        return self._nothing("error_touches", "touches")

    def _nothing(self, name: str, whole: str, keys: Iterable[str] = ()) -> Mapping[str, Array]:
        warn(
            self._state.u.function_space.mesh.comm,
            f"report.{name} is zero: bodies deform by shapes, and report.{whole} has all of it. "
            "Leave it out, as the next release does not have it.",
        )
        return Named(f"report.{name}", {key: np.zeros(3) for key in keys})
