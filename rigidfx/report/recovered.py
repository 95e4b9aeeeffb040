"""Stresses that rigid parts carry.

A rigid part keeps the stress that it was frozen with. In parts named rigid the forces on their
nodes add that of a static response, K⁺ρ (docs/theory/shapes.md). All stresses shown contain this:
of cells, at nodes, at probes and at integration points. Each is evaluated from one displacement in
rigid cells and another in flexible ones, as they share nodes; a node takes the mean of both.
"""

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array, Bools
from rigidfx.flexible.stress import CauchyStress
from rigidfx.report.report import Report


def recovered_stress(report: Report, stress: CauchyStress) -> tuple[Array, Bools]:
    """Cauchy stress of all cells at a report, recovered in rigid parts. Collective.

    Args:
        report: The newest report of its run.
        stress: The stress measure of the run's scene.

    Returns:
        Stress of each owned cell, shape (cells, 3, 3) [Pa], and whether it was recovered: in
        parts named `Rigid` of a run with `wake="local"`, from the first step on.

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
