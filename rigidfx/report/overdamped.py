"""Does damping let a held structure vibrate at all?

The shape u of a structure on supports that stand still, with the energy W of strains and springs,
has

    ω² = 2 W / u·M u ≥ ω₁²

by Rayleigh's quotient, equal to it for the shape of the first vibration. So its damping ratio is at
least ½ (α/ω + β ω), α M + β K being below all damping (`scene/damped.py`). The smallest ω of some
steps is taken, in runs that last for its period.
"""

from __future__ import annotations

from math import inf, pi, sqrt
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Preload, Reduced, SpringDamper, Support
from rigidfx.effects.damping import warn_of_ratio
from rigidfx.report.report import Look, Report
from rigidfx.scene.damped import Damped
from rigidfx.scene.scene import Scene

__all__ = ["Overdamped"]

OTHERS = Preload, SpringDamper, Reduced  # tensions, and shapes that have masses of their own


class Overdamped(Look):
    """Looks at shapes in steps whose number is a power of two; warns at the end."""

    remembered: ClassVar[Remembered] = same("_square", "_t", "_dt")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report. Collective."""
        self._scene, self._square = scene, inf  # smallest ω² so far [1/s²]
        self._t = self._dt = 0.0
        self._damped: Damped | None = None
        at_rest = not any(s.moves for s in scene.named(Support))
        if at_rest and not any(scene.named(kind) for kind in OTHERS):
            damped = Damped(scene)
            self._damped = damped if damped.rates(np.ones(1), 1.0).any() else None

    def follow(self, report: Report) -> None:
        """See `Look`."""
        self._t, self._dt = report.t, report.dt
        energy = report.strain + report.springs
        if self._damped is None or report.step & (report.step - 1) or not energy > 0:
            return
        bodies, n = report.rigid, self._scene.owned_nodes
        mass = self._scene.averaging_mass[:n].copy()
        for body in bodies.of.records:
            mass[body.nodes] = 0.0
        u = report.state.u.x.array.reshape(-1, 3)[:n]
        moved = self._scene.sum(mass @ (u * u).sum(axis=1))
        way = bodies.r - bodies.of.frozen[:, 0]
        moved += bodies.of.mass @ (way * way).sum(axis=1)
        if moved > 0:
            self._square = min(self._square, 2 * energy / moved)

    def end(self) -> None:
        """See `Look`."""
        omega = sqrt(self._square)
        if self._damped is None or not self._t * omega >= 2 * pi or omega == inf:
            return
        ratio = float(self._damped.rates(np.array(omega), self._dt)) / omega
        warn_of_ratio(self._scene.comm, f"Vibrations of {omega / (2 * pi):.3g} Hz", ratio)
