"""Whether a report is of this scene, and of its last step."""

from __future__ import annotations

from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["check_about", "check_report", "check_scene"]


def check_scene(owner: str, scene: Any) -> None:
    """Check that a scene is one.

    Args:
        owner: Who asks for it, for the message.
        scene: The given value.

    Raises:
        SceneError: If it is anything else.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"{owner}: scene must be a Scene, got {type(scene).__name__}.")


def check_report(owner: str, scene: Scene, report: Any) -> None:
    """Check that a report's state can be used.

    Args:
        owner: Who uses it, for the message.
        scene: The problem that is run.
        report: The given value.

    Raises:
        SceneError: If it is no report, of another scene, or the run has gone on since.
    """
    if not isinstance(report, Report):
        raise SceneError(f"{owner}: report must be a Report, got {type(report).__name__}.")
    if not report.current:
        raise SceneError(
            f"{owner}: the report is of t = {report.t:g} s, and the run has gone on. Use each "
            "report before the next step."
        )
    if report.state.u.function_space is not scene.space:
        raise SceneError(f"{owner}: the report is of another scene.")


def check_about(owner: str, scene: Scene, report: Any) -> None:
    """Check that a report's state is one that a scene can have.

    Args:
        owner: Who uses it, for the message.
        scene: The problem.
        report: The given value: a report of this scene, or of another one on the same mesh.

    Raises:
        SceneError: If it is no report, of another mesh or order, or its run has gone on since.
    """
    if not isinstance(report, Report):
        raise SceneError(f"{owner}: a Report is expected, got {type(report).__name__}.")
    state = report.state
    space = state.u.function_space
    if space.mesh is not scene.mesh or state.u.x.array.size != 3 * scene.nodal_mass.size:
        raise SceneError(
            f"{owner}: the report is of a scene with another mesh or order. Make both scenes from "
            "one domain, with the same order."
        )
