"""The largest displacement, stress and reactions of a run, and its energy that damping takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.command.pair import SAME
from rigidfx.report.peaks import Peak, Peaks
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["Largest"]


class Largest:
    """Follows the reports of a run, or of a path of static equilibria.

    Displacements and reactions are looked at in all steps. Stress costs more than they do: it is
    looked at once in each interval, and at the end.
    """

    def __init__(self, scene: Scene, t_end: float, interval: float) -> None:
        """Find cells, and compile stresses. Collective.

        Args:
            scene: The problem.
            t_end: End of the run [s].
            interval: Time after which stress is looked at again [s].
        """
        names = sorted(name for name, dim in scene.domain.sets if dim == 3)
        self._scene, self._peaks = scene, Peaks(scene, names, "rigidfx")
        self._interval, self._next, self._end = interval, 0.0, t_end
        self._u: tuple[float, float, npt.NDArray[np.float64]] = (
            0.0,
            0.0,
            np.zeros(3),
        )  # size [m], time [s], place [m]
        self._stress = (Peak(0.0, np.zeros(3)), 0.0)
        self._reactions: dict[str, tuple[float, float]] = {}  # size [N], time [s]
        self._energy = self._damped = 0.0  # largest and dissipated [J]

    def add(self, report: Report) -> None:
        """Take note of a report. Collective."""
        scene, t = self._scene, report.t
        moved = report.shown()[0].x.array.reshape(-1, 3)[: scene.owned_nodes]
        size, place = self._peaks.largest(np.linalg.norm(moved, axis=1)[None])
        if size > self._u[0]:
            self._u = size, t, place
        for name, force in report.reactions.items():
            found = float(np.linalg.norm(force))
            if found > self._reactions.get(name, (-1.0, 0.0))[0]:
                self._reactions[name] = found, t
        self._energy = max(self._energy, report.energy)
        self._damped += report.dissipated.get("NumericalDamping", 0.0)
        if t >= min(self._next, self._end) * (1 - SAME):
            self._next = t + self._interval
            peak = max(self._peaks.measure(report).values(), key=lambda found: found.von_mises)
            if peak.von_mises > self._stress[0].von_mises:
                self._stress = peak, t

    def lines(self) -> list[str]:
        """The largest values in words, with their places in the reference shape and times."""
        (size, t, place), (peak, t_peak) = self._u, self._stress
        lines = [
            f"largest displacement: {size:.4g} m at {_at(place)}, t = {t:.4g} s",
            f"largest von Mises stress: {peak.von_mises:.4g} Pa at {_at(peak.place)}, "
            f"t = {t_peak:.4g} s",
        ]
        for name, (force, when) in self._reactions.items():
            lines.append(f"largest reaction of {name}: {force:.4g} N, t = {when:.4g} s")
        if self._damped and self._energy:
            lines.append(
                f"numerical damping took {self._damped:.3g} J, {self._damped / self._energy:.0%} "
                "of the largest energy; --damping 0 has none"
            )
        return lines

    def numbers(self) -> dict[str, Any]:
        """The same for `summary.json`."""
        return {
            "largest_displacement": self._u[0],
            "largest_displacement_at": self._u[2].tolist(),
            "largest_von_mises": self._stress[0].von_mises,
            "largest_von_mises_at": self._stress[0].place.tolist(),
            "numerically_damped": self._damped,
        }


def _at(place: np.ndarray) -> str:
    """A place in metres, without the rounding of coordinates that are zero."""
    return f"({', '.join(f'{x:.4g}' for x in place.round(9) + 0.0)}) m"
