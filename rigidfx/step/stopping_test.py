"""When Newton stops: at a relative tolerance, or where only rounding is left.

‖R‖ ≤ 1e-12 ‖R_first‖ ends a step as a rule (-rigidfx_snes_rtol is another factor); of a motion
that needs next to no force (rest, free flight of a stiff body) that is below what rounding in the
strains leaves, whose size is estimated.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

__all__ = ["MAX_ITERATIONS", "RELATIVE_TOLERANCE", "StoppingTest", "judged", "reason_name"]

RELATIVE_TOLERANCE = 1e-12
ROUNDING = 2.0  # safety on the estimated rounding level
STALL = 0.2  # Newton has met rounding where it reduces the residual by less than this ...
MARGIN = 100.0  # ... and the residual is within this factor of the estimate
MAX_ITERATIONS = 25
NOT_FINITE = -4  # DIVERGED_FNORM_NAN, or DIVERGED_FUNCTION_NANORINF, as its name is in PETSc 3.25
DIVERGENCE = 1e6  # growth of the residual at which Newton gives up


class StoppingTest:
    """The stopping test of one solve.

    Attributes:
        history: ‖R‖ [N] at each iterate so far.
        rtol: Reduction of ‖R‖ that ends a step.
        max_it: Iterations after which Newton gives up.
    """

    def __init__(self, rtol: float = RELATIVE_TOLERANCE, max_it: int = MAX_ITERATIONS) -> None:
        """Begin with no iterate and no rounding."""
        self.history: list[float] = []
        self.rtol, self.max_it = rtol, max_it
        self._rounding = 0.0

    def restart(self) -> None:
        """Forget the iterates; the rounding level stays until it is estimated anew."""
        self.history = []

    def expect_rounding(self, noise: float) -> None:
        """Take over the size of what R is the small difference of [N]."""
        self._rounding = ROUNDING * float(np.finfo(np.float64).eps) * noise

    def __call__(self, iteration: int, norm: float) -> int:
        """SNES's reason to stop, or 0 to go on.

        Args:
            iteration: Number of the iterate.
            norm: ‖R‖ there [N].
        """
        Reason = PETSc.SNES.ConvergedReason
        self.history.append(norm)
        first = self.history[0]
        if not np.isfinite(norm) or norm > DIVERGENCE * first:
            return int(Reason.DIVERGED_DTOL)
        if norm == 0.0:
            return int(Reason.CONVERGED_FNORM_ABS)
        if iteration > 0 and norm <= self.rtol * first:
            return int(Reason.CONVERGED_FNORM_RELATIVE)
        if iteration > 0 and self._at_rounding():
            return int(Reason.CONVERGED_FNORM_ABS)
        if iteration >= self.max_it:
            return int(Reason.DIVERGED_MAX_IT)
        return 0

    def _at_rounding(self) -> bool:
        """Whether all that is left of the residual is rounding.

        To be below the estimated level is not enough: in a stiff body that level is far above the
        forces that move it as a whole, and momenta would drift. Either Newton no longer gets
        anywhere, or what its quadratic convergence must have left is negligible.
        """
        *earlier, last, norm = self.history
        if norm > STALL * last:
            return norm <= MARGIN * self._rounding
        truncation = last * (last / earlier[-1]) ** 2 if earlier else last
        return norm <= self._rounding and truncation <= self.rtol * self.history[0]


def judged(reason: int) -> int:
    """SNES's reason, or that the residual is not finite where it has not stopped by the test above.

    Where the residual is not finite, PETSc 3.25 takes the step for a vanishing one and calls that
    convergence (CONVERGED_SNORM_RELATIVE), at the first guess.
    """
    Reason = PETSc.SNES.ConvergedReason
    own = reason in (int(Reason.CONVERGED_FNORM_ABS), int(Reason.CONVERGED_FNORM_RELATIVE))
    return reason if own or reason < 0 else NOT_FINITE


def reason_name(reason: int) -> str:
    """SNES's reason in words."""
    for name, value in vars(PETSc.SNES.ConvergedReason).items():
        if value == reason and not name.startswith("_"):
            return name.lower()
    return f"reason {reason}"
