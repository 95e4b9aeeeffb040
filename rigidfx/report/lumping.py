"""Does the inertia of lumped masses spoil the motion of a body?

Masses at the corners of cells turn harder than the mass they represent, most of all about the axis
of something one cell across. As long as a body hardly turns about such an axis that does no harm;
so the share of this error in the kinetic energy of a body counts.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.report.report import Look, Report
from rigidfx.scene.scene import Scene

__all__ = ["LumpedInertia"]

WORTH_A_WARNING = 0.05  # of the kinetic energy of a body, and ...
OF_ALL = 0.01  # ... of all kinetic energy
EVERY = 8  # steps from look to look at the same bodies


class LumpedInertia(Look):
    """Looks at the bodies of some reports; warns once."""

    remembered: ClassVar[Remembered] = same("_waits")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
        """
        self._comm, self._waits = scene.comm, scene.mass == "lumped"
        self._seen: object = None  # the bodies that were looked at last

    def follow(self, report: Report) -> None:
        """Look at the bodies of a report.

        Args:
            report: The next one.
        """
        bodies = report.rigid
        if not self._waits or not bodies.of.excessive:
            return
        if bodies.of is self._seen and report.step % EVERY:
            return
        self._seen = bodies.of
        excess, kinetic = bodies.kinetic_excess, bodies.kinetic_of_each
        if bodies.of.shapes is not None:  # their twins of cells have the same masses
            excess = np.where(bodies.of.shapes.counts > 0, 0.0, excess)
        shares = np.where(kinetic > 0, excess / np.where(kinetic > 0, kinetic, 1.0), 0.0)
        k = int(np.argmax(shares))
        if shares[k] <= WORTH_A_WARNING or excess[k] <= OF_ALL * report.kinetic:
            return
        self._waits = False
        worst = bodies.of.records[k]
        warn(
            self._comm,
            f"Body '{worst.name}': {shares[k]:.0%} of its kinetic energy at "
            f"t = {report.t:.6g} s is an error of its lumped masses, which give it up to "
            f"{worst.inertia_ratio:.3g} times the moment of inertia of its cells (about the axis "
            "it is thinnest around). Energies and angular momenta are conserved all "
            "the same. Take more cells across it, mass='consistent', or order=2 with hexahedra; or "
            "give the inertia of a named body (Rigid).",
        )
