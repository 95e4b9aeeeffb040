"""Solve the equations of one step (or of statics) with PETSc's SNES, one solve per step.

Where a Krylov solver gives up, the step is solved again by a factorisation, and so are all later
ones of this division. Where factors without pivots fail, it is solved again with pivots.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import (
    DIRECT_BELOW,
    PREFIX,
    QUICK_UP_TO,
    configure,
    default_options,
    forget_failed,
)
from rigidfx.step.linear.petsc_options import monitor_solves
from rigidfx.step.newton.border import BorderedFactors
from rigidfx.step.newton.chord import Chord, pays
from rigidfx.step.newton.first_guess import Guess
from rigidfx.step.newton.solution import Solution
from rigidfx.step.newton.stopping_test import (
    MAX_ITERATIONS,
    RELATIVE_TOLERANCE,
    ROUNDING,
    ChordTest,
    StoppingTest,
    judged,
    reason_name,
)

CONSERVED = 3e-3  # of the tolerance of residuals, what a step may take from energy and momenta
SLOW = 0.5  # factor by which what falls in an iteration is no rounding
GROWN = 2.0  # a residual that has grown by that belongs to no solution any more


class Conserving:
    """Follows the iterates of a step from the first one that is good enough as a solution.

    Newton's method often ends a step far below its tolerance. Iterations with a kept tangent end
    just below it. In long steps that remainder may change energy and momenta: they drifted by 2e-10
    in 300 steps of a bar of steel whose Δt changed from step to step. So the change by a solution
    is measured. If it is too large, the iteration continues while each iteration halves it. If a
    new tangent does not halve it either, it is rounding. The size of that rounding is kept, also
    through new divisions, and later steps need not be better. An iterate with a larger change than
    the one before is undone.

    Attributes:
        rounding: Rounding of each quantity, as far as it has been met, relative.
        best: Whether no iterate before the last one, of those that were followed, was better.
        doubtful: Whether the next iteration wants a new tangent, to tell rounding from a tangent
            that does not fit.
    """

    def __init__(self, tolerance: float) -> None:
        """Begin without a step.

        Args:
            tolerance: Permitted loss of energy and momenta in a step, relative.
        """
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
        self.best = residual <= GROWN * self._residual
        return not self.best

    def enough(self, residual: float, lost: Array, kept: bool = False) -> bool:
        """Whether an iterate is to be the last; another one is asked for if not.

        Args:
            residual: ‖R‖ there [N].
            lost: Loss of each quantity, relative.
            kept: Whether tangents are kept: that of the last iteration was an earlier one, unless
                this one was in doubt.
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


@contextmanager
def errors_of_callbacks() -> Iterator[None]:
    """Around a call of PETSc that calls back.

    Python raises a Ctrl-C mostly in a function that SNES has called. PETSc replaces any exception
    of such a function by an error of its own (number -1), with the exception as its cause.

    Raises:
        BaseException: The exception of a function called by PETSc.
    """
    try:
        yield
    except PETSc.Error as error:
        cause = error.__cause__ or error.__context__
        if cause is None:
            raise
        raise cause from None


def residual(snes: PETSc.SNES, y: PETSc.Vec, r: PETSc.Vec, newton: Newton) -> None:
    """SNES callback: R(y), unless the choice of a first guess has left it there."""
    if newton.known:
        newton.known = False
    else:
        newton.equilibrium.residual(y, r)


def tangent(snes: PETSc.SNES, y: PETSc.Vec, A: PETSc.Mat, B: PETSc.Mat, newton: Newton) -> None:
    """SNES callback: dR/dy at the iterate of the last residual, unless an older one is kept."""
    newton.renew_tangent()


def convergence(
    snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float], newton: Newton
) -> int:
    """SNES callback: the stopping test."""
    return newton.ended(iteration, norms[2])


class Newton:
    """Newton's method for the equations of one division; `destroy` frees its PETSc objects.

    Attributes:
        equilibrium: The equations.
        stop: The stopping test, with the history of the last solve.
        conserving: Whether the last iterate is enough for energy and momenta.
        known: Whether the residual at the first guess has been evaluated already.
    """

    def __init__(self, equilibrium: Equilibrium, scene: Scene) -> None:
        """Create the SNES. Collective."""
        self.equilibrium = equilibrium
        self._y = equilibrium.unknowns()
        self._r, self._saved = self._y.duplicate(), self._y.duplicate()
        self._bordered: BorderedFactors | None = None
        if equilibrium.constraints is not None:
            self._bordered = BorderedFactors(equilibrium)
        direct = equilibrium.prolongation.size < DIRECT_BELOW or self._bordered is not None
        self._krylov = equilibrium.inertial and not direct
        self._pivots = True  # whether factors need them
        self._snes = self._create_snes()
        rtol, _, _, max_it = self._snes.getTolerances()
        self.stop = StoppingTest(rtol, max_it)
        self.conserving = Conserving(CONSERVED * rtol)
        self._chord: Chord | None = None
        if pays(equilibrium):
            self._chord = Chord(equilibrium, ChordTest(rtol, max_it))
        # What keeps tangents, here or in the last division that was large enough for it.
        self._experience = self._chord
        self._keeping = False  # whether the present solve is by the chord method
        self._offered, self._best = 0, 0  # first guesses of the last choice, and what it was
        self.known = False
        self._tangents, self._failed = 0, False  # and whether the last iteration has failed
        self._ending, self._saved_norm = 0, 0.0  # reason to stop at a solution, and its ‖R‖ [N]
        self._left = 0.0  # ‖R‖ of the last solution [N]

    def go_on(self, before: Newton) -> None:
        """Keep findings of the division before, which may have been freed."""
        self.conserving.rounding = before.conserving.rounding
        if self._chord is None:
            self._experience = before._experience
        elif before._experience is not None:
            self._chord.go_on(before._experience)

    def _create_snes(self) -> PETSc.SNES:
        joined = self._bordered
        snes = PETSc.SNES().create(self.equilibrium.prolongation.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setType(PETSc.SNES.Type.NEWTONLS)
        snes.setFunction(residual, self._r, args=(self,))
        A = self.equilibrium.tangent_matrix
        snes.setJacobian(tangent, A if joined is None else joined.operator, args=(self,))
        snes.setConvergenceTest(convergence, args=(self,))
        snes.setTolerances(rtol=RELATIVE_TOLERANCE, max_it=MAX_ITERATIONS)
        with default_options(PREFIX, snes_linesearch_type="basic"):
            snes.setFromOptions()
        monitor_solves(snes)
        self._configure(snes.getKSP(), not self._krylov)
        return snes

    def _configure(self, ksp: PETSc.KSP, direct: bool) -> None:
        p = self.equilibrium.prolongation
        if self._bordered is not None:
            ksp = self._bordered.within(ksp)
        quick = not self._pivots and p.size <= QUICK_UP_TO
        configure(ksp, direct, p.size, len(p.layout.bodies) > 0, quick)

    @np.errstate(all="ignore")  # an iterate may leave the numbers: a residual says so
    def solve(self, guesses: Sequence[Guess]) -> Solution:
        """Find the increment of the step that the equations have begun. Collective.

        Args:
            guesses: First guesses; the one with the smallest residual is taken.
        """
        failed = None
        if self._chord is not None:
            if self._chord.serves(self.equilibrium.dt):
                failed = self._solve_by_chord(self._chord, guesses)
                if failed.converged:
                    return failed
            self._chord.lose()
        return self._solve_by_newton(guesses).after(failed)

    def _solve_by_chord(self, chord: Chord, guesses: Sequence[Guess]) -> Solution:
        """Solve with a tangent that is kept."""
        own = self._snes.getKSP(), self.stop
        if len(guesses) == self._offered and chord.serving:  # the better one costs two residuals
            guesses = [guesses[self._best]]
        chord.begin(self.equilibrium.dt)
        self._snes.setKSP(chord.ksp)
        self.stop, self._keeping = chord.stop, True
        reason = self._iterate(guesses)
        found = self._solution(reason, chord.tangents, chord.linear_iterations, chord.solver)
        self._snes.setKSP(own[0])
        self.stop, self._keeping = own[1], False
        return found

    def _solve_by_newton(self, guesses: Sequence[Guess]) -> Solution:
        """Solve with a new tangent in each iteration."""
        self._take_pivots(not self.equilibrium.well_conditioned)
        self._tangents = 0
        reason, remark = self._iterate(guesses), ""
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE and self._krylov:
            self._krylov = False
            self._configure(self._snes.getKSP(), True)
            reason, remark = self._iterate(guesses), " (fall-back from Krylov)"
        elif reason < 0 and not self._krylov and not self._pivots:
            # Whatever it was: factors with pivots are sure.
            self._take_pivots(True)
            reason, remark = self._iterate(guesses), " (with pivots)"
        ksp, linear = self._snes.getKSP(), self._snes.getLinearSolveIterations()
        solver = f"{ksp.getType()}+{ksp.getPC().getType()}{remark}"
        return self._solution(reason, self._tangents, linear, solver)

    def _take_pivots(self, pivots: bool) -> None:
        """Choose factors of Newton's own solver with pivots, or without."""
        if not self._krylov and pivots != self._pivots:
            self._pivots = pivots
            self._configure(self._snes.getKSP(), True)

    def _solution(self, reason: int, tangents: int, linear: int, solver: str) -> Solution:
        """The findings. Collective."""
        self.equilibrium.return_to(self._y, self._r)
        return Solution(
            reason > 0,
            reason_name(reason),
            tuple(self.stop.history),
            tangents,
            linear,
            solver,
            None if reason > 0 else self.equilibrium.worst_place(),
            self.equilibrium.largest(self._y),
            self.equilibrium.left(self._r) if self.stop.at_rounding(reason) else 0.0,
            self.stop.rounding,
        )

    def renew_tangent(self) -> None:
        """Assemble the tangent of the next linear system. Collective."""
        if self._keeping and self._chord is not None:
            self._chord.look()
            if not self.conserving.following:
                self._chord.renew()
            elif self.conserving.doubtful:
                self._chord.make()
        else:
            self.equilibrium.tangent()
            if self._bordered is not None:
                self._bordered.renew()
            self._tangents += 1

    def _iterate(self, guesses: Sequence[Guess]) -> int:
        if self._failed and not self._keeping and self._bordered is None:
            forget_failed(self._snes.getKSP())
        self.stop.restart()
        self.conserving.restart()
        self.known = False
        if len(guesses) > 1:
            # The likely one comes last, so that SNES finds its residual.
            order = sorted(range(len(guesses)), key=lambda k: k == self._best)
            norms = [self._norm_at(guesses[k]) for k in order]
            last = int(np.argmin(np.nan_to_num(norms, nan=np.inf)))
            self._offered, self._best = len(norms), order[last]
            self.known = last == len(norms) - 1
            guesses = [guesses[self._best]]
        if not self.known:  # rounding is that of the guess, not of a failed iterate
            self._norm_at(guesses[0])
            self.known = True
        self.stop.expect_rounding(self.equilibrium.noise())
        with errors_of_callbacks():
            self._snes.solve(None, self._y)
        reason = judged(int(self._snes.getConvergedReason()))
        self._failed = reason < 0
        self._left = self.stop.history[-1] if self.stop.history else np.inf
        if self.conserving.following and (reason < 0 or not self.conserving.best):
            self._saved.copy(self._y)
            self._left = self._saved_norm
            return self._ending
        return reason

    def _norm_at(self, guess: Guess) -> float:
        self.equilibrium.guess(guess.increment, guess.bodies, self._y)
        self.equilibrium.residual(self._y, self._r)
        return float(self._r.norm())

    def ended(self, iteration: int, norm: float) -> int:
        """SNES's reason to stop, or 0 to go on. Collective."""
        reason, conserving = self.stop(iteration, norm), self.conserving
        if conserving.following:
            if conserving.grown(norm):
                return self._ending
        elif reason <= 0 or not 0 < iteration < self.stop.max_it:
            return reason
        else:
            self._ending = reason
        lost = self.equilibrium.lost(self._y, self._r)
        enough = conserving.enough(norm, lost, self._keeping)
        if enough or iteration == self.stop.max_it:
            return self._ending
        if conserving.best:
            self._y.copy(self._saved)
            self._saved_norm = norm
        return 0

    @property
    def unknowns(self) -> PETSc.Vec:
        """Unknowns y of the last solve [m]; not to be changed."""
        return self._y

    @property
    def strain_error(self) -> float:
        """Strain that the last solve and rounding may leave in a cell. Collective."""
        return self.equilibrium.strain_error(self._left)

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        for item in (self._snes, self._chord, self._y, self._r, self._saved):
            if item is not None:
                item.destroy()
