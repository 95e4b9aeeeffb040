"""The largest displacement, stress and reactions of a run, and its energy that damping takes."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array
from rigidfx.plot import Shapes
from rigidfx.report.peaks import Peak, Peaks
from rigidfx.report.report import Report
from rigidfx.report.resolved_forces import resolved
from rigidfx.scene.scene import Scene


class Largest:
    """Follows all reports of a run, or of a path of static equilibria.

    Attributes:
        shapes: The body at some times and where stress is largest, coloured by it.
    """

    def __init__(self, scene: Scene, times: Iterable[float]) -> None:
        """Find cells, and compile stresses; shapes are kept at these times [s]. Collective."""
        names = sorted(name for name, dim in scene.domain.sets if dim == 3)
        self._scene, self._peaks = scene, Peaks(scene, names, "rigidfx")
        self.shapes = Shapes(scene, times, colour="von_mises")
        origin = np.zeros(3)
        self._u: tuple[float, float, Array] = 0.0, 0.0, origin  # [m], [s], [m]
        self._stress = (Peak(0.0, origin), 0.0)
        self._reactions: dict[str, list[tuple[float, ...]]] = {}  # t, dt [s], cut, force [N]
        self._energy = self._damped = 0.0  # largest and dissipated [J]

    def add(self, report: Report) -> None:
        """Record a report. Collective."""
        scene, t = self._scene, report.t
        moved = report.shown()[0].x.array.reshape(-1, 3)[: scene.owned_nodes]
        size, place = self._peaks.largest(np.linalg.norm(moved, axis=1)[None])
        if size > self._u[0]:
            self._u = size, t, place
        for name, force in report.reactions.items():
            cut = float(bool(report.events or report.impact))
            self._reactions.setdefault(name, []).append((t, report.dt, cut, *force))
        self._energy = max(self._energy, report.energy)
        self._damped += report.dissipated.get("NumericalDamping", 0.0)
        self.shapes.add(report)
        peak = max(self._peaks.measure(report).values(), key=lambda found: found.von_mises)
        if peak.von_mises > self._stress[0].von_mises:
            self._stress = peak, t
            self.shapes.keep(report, "largest")

    def lines(self, timed: bool = True) -> list[str]:
        """The largest values of all steps in words, with places in the reference shape. Collective.

        They have no times in statics, where these are parts of the loads.
        """
        (size, t, place), (peak, t_peak) = self._u, self._stress
        lines = [
            f"largest displacement: {size:.4g} m at {_at(place)}{_when(t, timed)}",
            f"largest von Mises stress: {peak.von_mises:.4g} Pa at {_at(peak.place)}"
            f"{_when(t_peak, timed)}{self._held_there(peak)}",
        ]
        for name, rows in self._reactions.items():
            times, dt, cut, *force = np.array(rows).T
            sizes = np.linalg.norm(resolved(np.transpose(force), dt, cut > 0), axis=1)
            k = int(sizes.argmax())
            lines.append(f"largest reaction of {name}: {sizes[k]:.4g} N{_when(times[k], timed)}")
        if self._damped and self._energy:
            lines.append(
                f"numerical damping took {self._damped:.3g} J, {self._damped / self._energy:.0%} "
                "of the largest energy; --damping 0 has none"
            )
        return lines

    def _held_there(self, peak: Peak) -> str:
        """A remark on a stress at a support, where it may be infinite. Collective."""
        X = self._scene.space.tabulate_dof_coordinates()
        for name in self._reactions:
            near = np.isclose(X[self._scene.nodes(name, "rigidfx")], peak.place)
            if self._scene.comm.allreduce(bool(near.all(axis=1).any()), op=MPI.LOR):
                return f", at the support {name}: at its edge the exact one may be infinite"
        return ""

    def numbers(self) -> dict[str, Any]:
        """The same for `summary.json`."""
        return {
            "largest_displacement": self._u[0],
            "largest_displacement_at": self._u[2].tolist(),
            "largest_von_mises": self._stress[0].von_mises,
            "largest_von_mises_at": self._stress[0].place.tolist(),
            "numerically_damped": self._damped,
        }


def _when(t: float, timed: bool) -> str:
    """The time of a value, where there are times."""
    return f", t = {t:.4g} s" if timed else ""


def _at(place: np.ndarray) -> str:
    """A place in metres, without the rounding of coordinates that are zero."""
    return f"({', '.join(f'{x:.4g}' for x in place.round(9) + 0.0)}) m"
