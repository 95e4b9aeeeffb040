"""When loads and supports change so that bodies found before may be none any more (3.3).

A change is a declared breakpoint (a jump, a kink, the end of a time window), at which steps end, or
a load, or the velocity of a support, that differs from what it was when the present bodies were
frozen by more than a given fraction of its largest value so far. Both are functions of time, so
that is seen before the step in which it happens.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx import effects as fx
from rigidfx.base.errors import together
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

__all__ = ["Changes"]

Array = npt.NDArray[np.float64]


class Changes:
    """Watches loads and supports of a scene."""

    def __init__(self, scene: Scene, fraction: float, timeline: Timeline) -> None:
        """Collect breakpoints and loads.

        Args:
            scene: The problem.
            fraction: Change of a load that counts, relative to its largest value so far.
            timeline: Where steps end.
        """
        self._comm, self._fraction = scene.comm, fraction
        self._resolution, self._dt = timeline.resolution, timeline.dt
        self._loads = [
            *scene.named(fx.DeadLoad),
            *scene.named(fx.Resultant),
            *scene.named(fx.Pressure),
            *scene.named(fx.PrescribedMotion),
        ]
        # Damping in a time window changes no load: its ends release nothing.
        effects = [e for e in scene.named(fx.Windowed) if not isinstance(e, fx.Damping)]
        self._breakpoints = np.unique([t for e in effects for t in e.breakpoints])
        self._reference = self._intensities(0.0)
        self._largest = [float(np.linalg.norm(q)) for q in self._reference]

    def declared(self, t: float) -> bool:
        """Whether a load or a support has a breakpoint at t [s]."""
        return bool((np.abs(self._breakpoints - t) <= self._resolution).any())

    def remember(self, t: float) -> None:
        """Take the loads at t [s] as those of the present bodies. Collective."""
        self._reference = self._intensities(t)

    def ahead(self, t: float) -> str:
        """The first load that at t [s] differs too much, "" if none does. Collective."""
        if not np.isfinite(self._fraction):
            return ""
        for load, q, reference, size in zip(
            self._loads, self._intensities(t), self._reference, self._largest, strict=True
        ):
            if np.linalg.norm(q - reference) > self._fraction * size:
                return f"{type(load).__name__} on '{getattr(load, 'where', None) or 'all cells'}'"
        return ""

    def observe(self, t: float) -> Array:
        """Components of all loads at t [s], each in its own unit. Collective."""
        values = self._intensities(t)
        sizes = [float(np.linalg.norm(q)) for q in values]
        self._largest = [max(pair) for pair in zip(sizes, self._largest, strict=True)]
        return np.concatenate([np.empty(0), *values])

    def _intensities(self, t: float) -> list[Array]:
        dt = self._dt
        values = together(
            self._comm, "A load", lambda: [_intensity(load, t, dt) for load in self._loads]
        )
        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        return list(self._comm.bcast(values))


def _intensity(
    load: fx.DeadLoad | fx.Resultant | fx.Pressure | fx.PrescribedMotion, t: float, dt: float
) -> Array:
    """Force or pressure of a load, or velocity of a support, at t [s]."""
    if isinstance(load, fx.PrescribedMotion):
        return np.asarray(load.velocity_at(t, dt)) if load.active(t) else np.zeros(3)
    if isinstance(load, fx.Resultant):
        return np.concatenate([load.force_at(t), load.torque_at(t)])
    return np.atleast_1d(load.intensity(t))
