"""The one judge of a step: whether an attempt may become the state.

An attempt is looked at in a fixed order, and the first objection ends it: a new attempt begins with
a shorter step. Memories change when one is accepted; a solver keeps the factors that it has made
for one that is not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rigidfx.base.errors import InversionError, StepError
from rigidfx.flexible.inversion import Inversion
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.materials import StVenantKirchhoff
from rigidfx.scene.scene import Scene
from rigidfx.step.newton.solution import Solution
from rigidfx.step.watches.why import course, overload

__all__ = ["INVERTED", "Attempt", "Judge", "remedy"]

INVERTED = ". There det F ≤ 0 at an integration point, or a stretch is above 10⁶."


@dataclass(frozen=True)
class Attempt:
    """A step that has been solved.

    Attributes:
        t: Time at its start [s].
        dt: Its length [s].
        solution: How its equations were solved.
        end: Time at its end [s].
        increments: Those of the rigid bodies.
        cuts: How often the step was cut before.
        final: Whether its error in time is taken as it is: it cannot be cut any more, or repeats
            one that was accepted, with other bodies.
    """

    t: float
    dt: float
    solution: Solution
    end: float
    increments: Increments
    cuts: int = 0
    final: bool = False


Look = Callable[[Attempt], StepError | None]  # collective


class Judge:
    """Accepts attempts, or objects."""

    def __init__(self, scene: Scene, inversion: Inversion, inexact: Look | None = None) -> None:
        """Take over the problem, and the looks.

        Args:
            scene: The problem.
            inversion: Looks for cells turned inside out.
            inexact: Looks for an error in time, if anything does.
        """
        self._scene, self._inversion = scene, inversion
        more = () if inexact is None else (inexact,)
        self._looks: tuple[Look, ...] = (self._not_converged, self._inverted, *more)

    def objection(self, attempt: Attempt) -> StepError | None:
        """The error that ends the run if no shorter step helps; None to accept. Collective."""
        for look in self._looks:
            error = look(attempt)
            if error is not None:
                return error
        return None

    def _not_converged(self, attempt: Attempt) -> StepError | None:
        solution = attempt.solution
        if solution.converged:
            return None
        place, near = "", ""  # where nothing but bodies moves, no node has a residual
        if solution.place is not None:
            x, y, z = solution.place
            place = f" The largest residual is at the node X = ({x:.6g}, {y:.6g}, {z:.6g}) m."
            near = " near that place"
        return StepError(
            f"The step from t = {attempt.t:.9g} s did not converge, not even with "
            f"Δt = {attempt.dt:.3g} s ({solution.reason}: {course(solution)}; residuals "
            f"{', '.join(f'{r:.2e}' for r in solution.residuals[:6]) or 'not finite'} N).{place}",
            overload(self._scene, attempt.t + attempt.dt)
            or f"Try a smaller Δt, look at loads, motors, supports, contacts and stops{near}, or "
            "add NumericalDamping.",
        )

    def _inverted(self, attempt: Attempt) -> StepError | None:
        turned = self._inversion.find()
        if turned is None:
            return None
        return InversionError(
            f"The step from t = {attempt.t:.9g} s turns cells inside out, even with "
            f"Δt = {attempt.dt:.3g} s: {turned}{INVERTED}",
            f"{overload(self._scene, attempt.t + attempt.dt)} {remedy(self._scene)}".strip(),
        )


def remedy(scene: Scene) -> str:
    """Advice against cells that are turned inside out."""
    remedies = "smaller loads, larger cells or NumericalDamping"
    if any(isinstance(material, StVenantKirchhoff) for material, _ in scene.materials):
        return (
            "St.Venant-Kirchhoff material does not resist strong compression: take NeoHooke there, "
            f"{remedies}."
        )
    return f"Try {remedies}."
