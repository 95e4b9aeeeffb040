"""How the equations of a step were solved."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rigidfx.base.types import Array


@dataclass(frozen=True)
class Solution:
    """How the equations of a step were solved.

    Attributes:
        converged: Whether Newton met its tolerance.
        reason: SNES's reason in words.
        residuals: ‖R‖ [N] at each iterate.
        tangents: Tangents assembled; fewer than iterations where one is kept.
        linear_iterations: Krylov iterations in total; factorisations count one.
        solver: Linear solver used, with a remark where it is a fall-back.
        place: Reference position of the largest residual [m], shape (3,), if not converged.
        moved: Largest increment of an unknown [m].
        left: Largest displacement of an unknown by the rest of the residual against its own
            stiffness and inertia [m]; 0 if Newton has met its relative tolerance.
        rounding: Size of ‖R‖ below which rounding may be all of it [N].
        given_up: Iterations of a solve with a kept tangent that came to nothing before; its
            tangents and Krylov iterations are among those above.
    """

    converged: bool
    reason: str
    residuals: tuple[float, ...]
    tangents: int
    linear_iterations: int
    solver: str
    place: Array | None
    moved: float
    left: float
    rounding: float
    given_up: int = 0

    @property
    def iterations(self) -> int:
        """Newton iterations."""
        return len(self.residuals) - 1 + self.given_up

    def after(self, failed: Solution | None) -> Solution:
        """The same, with the cost of an earlier solve of the step, if there was one."""
        if failed is None:
            return self
        return replace(
            self,
            tangents=self.tangents + failed.tangents,
            linear_iterations=self.linear_iterations + failed.linear_iterations,
            given_up=failed.iterations,
        )
