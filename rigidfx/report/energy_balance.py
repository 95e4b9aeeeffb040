"""Has a run kept its balance of energy?

The energy-momentum method keeps it to Newton's tolerance whatever happens, so a run that has lost
it has lost more than that: the rounding of parts that are stiff beyond measure, or a tolerance set
so loose that what is left of the residual does work. Nothing else in a report would tell.
"""

from __future__ import annotations

import numpy as np

from rigidfx.base.errors import StepError
from rigidfx.base.warning import warn
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["EnergyBalance"]

WORTH_A_WARNING = 1e-4  # of the largest energy; four orders above what Newton's tolerance leaves
LOST = 1.0  # of all that was ever accounted for: as much again has come from nowhere
ROUNDING = 1e3 * float(np.finfo(np.float64).eps)  # of numbers near one that energies are made of


class EnergyBalance:
    """Follows the energy of a run and what is supplied to it.

    It warns once where the balance is off, and once more where as much energy as was ever accounted
    for has come from nowhere.
    """

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report.

        Args:
            scene: The problem; schemes that do not conserve energy are not followed.
        """
        self._expected = self._scale = self._known = 0.0
        self._noise = _rounding(scene)
        self._comm = scene.comm
        self._follows = scene.scheme.conserving
        self._warned = False
        self._lost = ""  # when, and how much of it, once it is lost

    def follow(self, report: Report) -> None:
        """Take the next report into account.

        Args:
            report: Of the initial state first, then of every step.
        """
        if not self._follows or self._lost:
            return
        work = report.work_of_loads + report.work_of_supports
        taken = sum(report.dissipated.values())
        if report.step == 0:
            self._expected = report.energy
        else:
            self._expected += work - taken + (report.impact.energy if report.impact else 0.0)
        self._known = max(self._known, abs(self._expected), abs(work), taken)
        self._scale = max(self._scale, report.energy, abs(work), taken)
        off = abs(report.energy - self._expected)
        if off > WORTH_A_WARNING * self._scale + self._noise and not self._warned:
            self._warned = True
            warn(
                self._comm,
                f"At t = {report.t:.6g} s the balance of energy is off by {off / self._scale:.1e} "
                "of the largest energy. Rounding in parts that are very stiff or very light for "
                "their stiffness may be why: make these Rigid, or take less extreme numbers. If "
                "-rigidfx_snes_rtol is set, make it smaller.",
            )
        if off > LOST * self._known + self._noise:
            self._lost = (
                f"At t = {report.t:.6g} s the energy was {report.energy:.3g} J where "
                f"{self._expected:.3g} J are accounted for"
            )
            warn(
                self._comm,
                f"{self._lost}: the balance of energy is lost, and what follows is no motion of "
                "this scene. Look for the cause before anything else: a stored energy of one's own "
                "that is not smooth, or is called quadratic and is not; parts that are stiff "
                "beyond measure; a -rigidfx_snes_rtol that is too large.",
            )

    def explained(self, error: StepError) -> StepError:
        """The error with other advice, if the balance was lost before.

        Args:
            error: What ended the run.
        """
        if not self._lost:
            return error
        return type(error)(error.found, f"{self._lost}: look for the cause of that first.")


def _rounding(scene: Scene) -> float:
    """What rounding may leave in the strain energy of a scene whatever moves [J]. Collective.

    An energy like neo-Hooke's, tr C - 3 - ln det C, is the small difference of numbers near one, so
    that it is known to ε E V only; one that is quadratic in the strain, to ε² E V at least.
    """
    energies = [
        max(map(abs, material.parameters.values()), default=0.0)
        * cells.size
        * (ROUNDING**2 if material.quadratic else ROUNDING)
        for material, cells in scene.materials
    ]
    return float(scene.sum(sum(energies))) * scene.mean_cell_size**3
