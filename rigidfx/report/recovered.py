"""Stresses that rigid parts carry, recovered from the forces on them.

A rigid part keeps the stress that it was frozen with. What the forces on it would add, were it
flexible, is that of E⁰ + ε(K⁺ρ) (docs/theory/waking.md): right for loads slower than the part.
Where a run shows its error motion, all cells but those of parts named rigid have its strain and
stress besides their own, whatever moves the part: it is right at resonance, too.
That is what all stresses are which are shown, of cells, at nodes, at probes and at integration
points; each is evaluated from one displacement in rigid cells and another in flexible ones, for
they share nodes, and a node takes the mean of what both say.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.flexible.stress import CauchyStress
from rigidfx.report.report import Report

__all__ = ["recovered_stress"]

Array = npt.NDArray[np.float64]


def recovered_stress(report: Report, stress: CauchyStress) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Cauchy stress of all cells at a report, recovered in rigid parts. Collective.

    Args:
        report: The last one of its run.
        stress: Measures the stresses of the run's scene.

    Returns:
        Stress of each owned cell, shape (cells, 3, 3) [Pa], and whether it was recovered: in rigid
        parts of a run with `wake="local"`, from the first step after the freeze on.

    Raises:
        SceneError: If the run has gone on, or one of them is anything else.
    """
    if not isinstance(report, Report):
        raise SceneError(f"recovered_stress: report must be a Report, got {type(report).__name__}.")
    if not isinstance(stress, CauchyStress):
        raise SceneError(
            f"recovered_stress: stress must be CauchyStress(scene), made once, got {shown(stress)}."
        )
    state = report.state
    if stress.mesh is not state.u.function_space.mesh:
        raise SceneError("recovered_stress: stress is that of a scene on another mesh.")
    state.rebuild()
    recovered = report.recovered()
    return stress.measure(state.u, recovered), recovered.cells
