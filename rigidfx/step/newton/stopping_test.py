"""When Newton stops: at a relative tolerance, or where only rounding is left.

‖R‖ ≤ 1e-12 ‖R_first‖ ends a step as a rule (-rigidfx_snes_rtol changes the factor). In a motion
that needs hardly any force (rest, free flight of a stiff body) this is below the rounding of
strains, whose size is estimated. Then a residual that falls slowly and is close to rounding is a
stall. A residual that grows is a stall only if it is itself rounding.
"""

from itertools import pairwise

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array

RELATIVE_TOLERANCE = 1e-12
ROUNDING = 2.0  # safety on an estimated, or met, level of rounding
STALL = 0.2  # Newton has met rounding where it reduces the residual by less than this ...
MARGIN = 100.0  # ... and the residual, if it has not grown, is within this factor of the estimate
HIDDEN = 0.1  # of the tolerance: an older tangent, unlike a new one, does not square the error
MAX_ITERATIONS = 25
CONSERVED = 3e-3  # of the tolerance of residuals, what a step may take from energy and momenta
# A residual that falls by this factor in an iteration is no rounding, one that has grown by it is
# that of no solution.
SLOW = 0.5
NOT_FINITE = -4  # DIVERGED_FNORM_NAN, or DIVERGED_FUNCTION_NANORINF, as its name is in PETSc 3.25
DIVERGENCE = 1e6  # growth of the residual at which Newton gives up ...
# ... if it is also above all that it is the difference of: what moves a stiff part at its ease may
# strain it by more than that in the first iterate.


class StoppingTest:
    """The stopping test of one solve: norms in, reasons out.

    Attributes:
        history: ‖R‖ [N] at each iterate so far.
        rounding: Size of ‖R‖ below which rounding may be all of it [N].
        rtol: Reduction of ‖R‖ that ends a step.
        max_it: Iterations after which Newton gives up.
    """

    def __init__(self, rtol: float = RELATIVE_TOLERANCE, max_it: int = MAX_ITERATIONS) -> None:
        self.history: list[float] = []
        self.rounding = self._noise = 0.0
        self.rtol, self.max_it = rtol, max_it

    def restart(self) -> None:
        """Forget the iterates; the rounding level stays until it is estimated anew."""
        self.history = []

    def expect_rounding(self, noise: float) -> None:
        """Set the size of the terms whose difference R is [N]."""
        self._noise = noise
        self.rounding = ROUNDING * float(np.finfo(np.float64).eps) * noise

    def __call__(self, iteration: int, norm: float) -> int:
        """SNES's reason to stop, or 0 to go on."""
        Reason = PETSc.SNES.ConvergedReason
        self.history.append(norm)
        first = self.history[0]
        if not np.isfinite(norm) or norm > max(DIVERGENCE * first, self._noise):
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

    def fell(self, factor: float) -> bool:
        """Whether the last iteration took the residual down by a factor or more."""
        return len(self.history) > 1 and self.history[-1] <= factor * self.history[-2]

    def _at_rounding(self) -> bool:
        """Whether all that is left of the residual is rounding.

        To be below the estimated level is not enough: in a stiff body that level is far above the
        forces that move it as a whole, and momenta would drift. Either Newton no longer gets
        anywhere, now or when it was there before, or the rest after its quadratic
        convergence is negligible.
        """
        *earlier, last, norm = self.history
        stalled = norm > STALL * last
        if norm > self.rounding:
            return stalled and norm <= last and norm <= MARGIN * self.rounding
        truncation = last * (last / earlier[-1]) ** 2 if earlier else last
        if stalled or truncation <= self.rtol * self.history[0]:
            return True
        # Newton has been at rounding before, and its next iterate was no better.
        pairs = pairwise(self.history[1:-1])
        return any(norm <= self.rounding and then > STALL * norm for norm, then in pairs)


def judged(reason: int) -> int:
    """SNES's reason, or that the residual is not finite.

    At a first guess whose residual is not finite PETSc 3.25 reports convergence by a vanishing step
    (CONVERGED_SNORM_RELATIVE).
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


class ChordTest(StoppingTest):
    """The stopping test of solves with tangents that are kept.

    With a kept tangent the residual falls by one factor in each iteration. A factor near one need
    not be a stall, since the tangent may not fit: docs/theory/step.md#kept-tangents has the end of
    the iteration.
    """

    def __init__(self, rtol: float = RELATIVE_TOLERANCE, max_it: int = MAX_ITERATIONS) -> None:
        super().__init__(HIDDEN * rtol, max_it)
        self._floor = 0.0  # ‖R‖ at which a new tangent did no better, as a part of what R is of
        self._renewed_at = -1  # iterate of the tangent; -1 if that is of an earlier solve

    def restart(self) -> None:
        """See `StoppingTest`; the tangent is of an earlier solve."""
        super().restart()
        self._renewed_at = -1

    def renewed(self) -> None:
        """Record a new tangent at the last iterate."""
        self._renewed_at = len(self.history) - 1

    @property
    def target(self) -> float:
        """‖R‖ that ends the step [N]."""
        return max(self.rtol * self.history[0], ROUNDING * self._floor * self._noise)

    def _at_rounding(self) -> bool:
        last, norm = self.history[-2:]
        if norm <= ROUNDING * self._floor * self._noise:
            # Less is learned, more is not: else it would double from step to step.
            self._floor = max(min(norm / self._noise, self._floor), self._floor / ROUNDING)
            return True
        if self._renewed_at < 0 or not STALL * last < norm <= max(ROUNDING * last, self.rounding):
            return False
        newest = self._renewed_at == len(self.history) - 2
        if norm <= (MARGIN if newest else 1) * self.rounding:
            self._floor = norm / self._noise
            return True
        return False


class Conserving:
    """Follows the iterates of a step from the first one that is good enough as a solution.

    docs/theory/step.md#where-the-iteration-ends has the rule. Newton's method often ends a step far
    below its tolerance, iterations with a kept tangent just below it: energy and momenta drifted by
    2e-10 in 300 steps of a bar of steel whose Δt changed from step to step. The size of rounding is
    kept also through new divisions.

    Attributes:
        rounding: Rounding of each quantity, as far as it has been met, relative.
        best: Whether no iterate before the last one, of those that were followed, was better.
        doubtful: Whether the next iteration wants a new tangent, to tell rounding from a tangent
            that does not fit.
    """

    def __init__(self, tolerance: float) -> None:
        """Begin without a step, with the relative loss of energy and momenta that it may take."""
        self._tolerance = tolerance
        self.rounding: float | Array = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin a step, or an attempt at it."""
        self._lost: list[Array] = []
        self._residual = self._least = np.inf
        self.best, self.doubtful = True, False

    @property
    def following(self) -> bool:
        """Whether there has been a solution already, which takes too much."""
        return bool(self._lost)

    def grown(self, residual: float) -> bool:
        """Whether an iterate is none to go on from. True ends the step."""
        self.best = SLOW * residual <= self._residual
        return not self.best

    def enough(self, residual: float, lost: Array, kept: bool = False) -> bool:
        """Whether an iterate is to be the last; another one is asked for if not.

        It has ‖R‖ [N], and relative losses of each quantity. The last iteration may have kept an
        earlier tangent, unless this was in doubt.
        """
        self._lost.append(lost)
        if np.shape(self.rounding) not in ((), lost.shape):
            self.rounding = 0.0  # it was met while other quantities were looked at
        self._residual = min(self._residual, residual)
        allowed = np.maximum(self._tolerance, ROUNDING * self.rounding)
        worst = float((lost / allowed).max(initial=0.0))
        self.best, self._least = worst <= self._least, min(worst, self._least)
        much = lost > allowed
        if len(self._lost) > 1:
            before, older = self._lost[-2], kept and not self.doubtful
            stays = much & (lost > SLOW * before)
            self.doubtful = older and bool(stays.any())
            if self.doubtful:
                return False
            met = np.where(stays, np.minimum(lost, before), 0.0)
            self.rounding = np.maximum(self.rounding, met)
            much &= ~stays
        return not much.any()
