"""Solve the equations of one step (or of statics) with PETSc's SNES, one solve per step.

Where a Krylov solver gives up, the step is solved again by a factorisation, and so are all later
ones of this division. Where factors without pivots fail, it is solved again with pivots.
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from petsc4py import PETSc

from rigidfx.base.matrices import free
from rigidfx.base.types import Array
from rigidfx.linear import linear_solver
from rigidfx.linear.petsc_options import monitor_solves
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton import stopping_test as stopping
from rigidfx.step.newton.border import BorderedFactors
from rigidfx.step.newton.chord import Chord, pays
from rigidfx.step.newton.first_guess import Guess

# Fall of ‖R‖ in an iteration after which a tangent with joints serves the next one: machines of
# rigid bars take 1 to 13 % less time, a slider-crank of reduced ones 7 %.
SERVES = 1e-3


@dataclass(frozen=True)
class Solution:
    """How the equations of a step were solved."""

    converged: bool  # whether Newton met its tolerance
    reason: str  # SNES's reason in words
    residuals: tuple[float, ...]  # ‖R‖ [N] at each iterate
    tangents: int  # tangents assembled; fewer than iterations where one is kept
    linear_iterations: int  # Krylov iterations in total; factorisations count one
    solver: str  # linear solver used, with a remark where it is a fall-back
    # Reference position of the largest residual [m], shape (3,), if not converged
    place: Array | None
    moved: float  # largest increment of an unknown [m]
    # Largest displacement of an unknown by the rest of the residual against its own stiffness and
    # inertia [m]; 0 if Newton has met its relative tolerance
    left: float
    rounding: float  # size of ‖R‖ below which rounding may be all of it [N]
    # Iterations of a solve with a kept tangent that came to nothing before; its tangents and Krylov
    # iterations are among those above
    given_up: int = 0

    @property
    def iterations(self) -> int:
        """Newton iterations."""
        return max(len(self.residuals) - 1, 0) + self.given_up

    @property
    def course(self) -> str:
        """How it failed, by its residuals."""
        residuals = self.residuals
        if not residuals or not np.isfinite(residuals).all():
            return "a force is not finite"
        if residuals[-1] <= stopping.MARGIN * self.rounding:
            return (
                f"all that is left is rounding: forces are known to {self.rounding:.1e} N at best, "
                "as stiff parts are strained so little. A larger Δt, Rigid parts where they are "
                "stiffest, or lengths of the order of a metre help"
            )
        return "residuals grow" if residuals[-1] > residuals[0] else "residuals no longer fall"

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


class Newton:
    """Newton's method for the equations of one division; `destroy` frees its PETSc objects.

    Attributes:
        equations: The equations.
        stop: The stopping test, with the history of the last solve.
        conserving: Whether the last iterate is enough for energy and momenta.
    """

    def __init__(self, equations: Equations) -> None:
        """Create the SNES. Collective."""
        self.equations = equations
        self._y = equations.unknowns()
        self._r, self._saved = self._y.duplicate(), self._y.duplicate()
        self._bordered: BorderedFactors | None = None
        if equations.constraints is not None:
            self._bordered = BorderedFactors(equations)
        direct = (
            equations.prolongation.size < linear_solver.DIRECT_BELOW or self._bordered is not None
        )
        self._krylov = equations.inertial and not direct
        self._pivots = True  # whether factors need them
        self._snes = self._create_snes()
        self._configure()
        rtol, _, _, max_it = self._snes.getTolerances()
        self.stop = stopping.StoppingTest(rtol, max_it)
        self.conserving = stopping.Conserving(stopping.CONSERVED * rtol)
        self._chord: Chord | None = None
        if pays(equations):
            self._chord = Chord(equations, stopping.ChordTest(rtol, max_it))
        # What keeps tangents, here or in the last division that was large enough for it.
        self._experience = self._chord
        self._keeping = False  # whether the present solve is by the chord method
        self._offered, self._best = 0, 0  # first guesses of the last choice, and what it was
        self._other = 0.0  # ‖R‖ at the better one of the others [N]
        self._known = False  # whether the residual at the first guess has been evaluated already
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
        snes = PETSc.SNES().create(self.equations.prolongation.comm)
        snes.setOptionsPrefix(linear_solver.PREFIX)
        snes.setType(PETSc.SNES.Type.NEWTONLS)
        snes.setFunction(self._evaluate, self._r)
        A = self.equations.tangent_matrix
        snes.setJacobian(self._renew_tangent, A if joined is None else joined.operator)
        snes.setConvergenceTest(self._ended)
        snes.setTolerances(rtol=stopping.RELATIVE_TOLERANCE, max_it=stopping.MAX_ITERATIONS)
        with linear_solver.default_options(linear_solver.PREFIX, snes_linesearch_type="basic"):
            snes.setFromOptions()
        monitor_solves(snes)
        return snes

    def _configure(self) -> None:
        """Set the linear solver of new tangents up. Collective."""
        p, ksp = self.equations.prolongation, self._snes.getKSP()
        if self._bordered is not None:
            ksp = self._bordered.within(ksp)
        quick = not self._pivots and p.size <= linear_solver.QUICK_UP_TO
        linear_solver.configure(ksp, not self._krylov, p.size, len(p.layout.bodies) > 0, quick)

    @np.errstate(all="ignore")  # an iterate may leave the numbers: a residual says so
    def solve(self, guesses: Sequence[Guess]) -> Solution:
        """Find the increment of the step that has begun, from the best guess. Collective."""
        failed = None
        if self._chord is not None:
            if self._chord.serves(self.equations.dt):
                failed = self._solve_by_chord(self._chord, guesses)
                if failed.converged:
                    return failed
            self._chord.missing = True  # Newton's method makes others
        return self._solve_by_newton(guesses).after(failed)

    def _solve_by_chord(self, chord: Chord, guesses: Sequence[Guess]) -> Solution:
        """Solve with a tangent that is kept."""
        own = self._snes.getKSP(), self.stop
        chord.begin(self.equations.dt)
        self._snes.setKSP(chord.ksp)
        self.stop, self._keeping = chord.stop, True
        reason = self._iterate(guesses)
        solver = f"kept {chord.kept.inverse.name}"
        found = self._solution(reason, chord.tangents, chord.kept.iterations, solver)
        self._snes.setKSP(own[0])
        self.stop, self._keeping = own[1], False
        return found

    def _solve_by_newton(self, guesses: Sequence[Guess]) -> Solution:
        """Solve with a new tangent in each iteration."""
        if not self._krylov and self._pivots == self.equations.well_conditioned:
            self._pivots = not self._pivots
            self._configure()
        self._tangents = 0
        reason, remark = self._iterate(guesses), ""
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE and self._krylov:
            self._krylov, remark = False, " (fall-back from Krylov)"
        elif reason < 0 and not self._krylov and not self._pivots:
            self._pivots, remark = True, " (with pivots)"  # whatever it was: these are sure
        if remark:
            self._configure()
            reason = self._iterate(guesses)
        ksp, linear = self._snes.getKSP(), self._snes.getLinearSolveIterations()
        solver = f"{ksp.getType()}+{ksp.getPC().getType()}{remark}"
        return self._solution(reason, self._tangents, linear, solver)

    def _solution(self, reason: int, tangents: int, linear: int, solver: str) -> Solution:
        """The findings. Collective."""
        self.equations.return_to(self._y, self._r)
        rounded = reason == int(PETSc.SNES.ConvergedReason.CONVERGED_FNORM_ABS)
        return Solution(
            reason > 0,
            stopping.reason_name(reason),
            tuple(self.stop.history),
            tangents,
            linear,
            solver,
            None if reason > 0 else self.equations.worst_place(),
            self.equations.largest(self._y),
            self.equations.left(self._r) if rounded else 0.0,
            self.stop.rounding,
        )

    def _iterate(self, guesses: Sequence[Guess]) -> int:
        """Solve from the best guess by the present linear solver; SNES's reason to stop."""
        if self._failed and not self._keeping and self._bordered is None:
            linear_solver.forget_failed(self._snes.getKSP())
        self.stop.restart()
        self.conserving.restart()
        self._choose(guesses)
        self.stop.expect_rounding(self.equations.noise())
        # While PETSc passes an error of a callback on, nothing of PETSc may be freed: processes
        # with many failed runs have crashed there.
        collects = gc.isenabled()
        gc.disable()
        try:
            self._snes.solve(None, self._y)
        except PETSc.Error as error:
            # Python raises a Ctrl-C mostly in a function that SNES has called. PETSc replaces any
            # exception there by an error of its own (number -1), with the exception as its cause.
            raise (error.__cause__ or error.__context__ or error) from None
        finally:
            if collects:
                gc.enable()
        reason = stopping.judged(int(self._snes.getConvergedReason()))
        self._failed = reason < 0
        self._left = self.stop.history[-1] if self.stop.history else np.inf
        if self.conserving.following and (reason < 0 or not self.conserving.best):
            self._saved.copy(self._y)
            self._left = self._saved_norm
            return self._ending
        return reason

    def _choose(self, guesses: Sequence[Guess]) -> None:
        """Begin at the guess with the smallest residual, which is kept for SNES. Collective.

        One that was better stays so until its residual exceeds that which the other had then.
        """
        known = self._offered == len(guesses) and not self._failed
        if not known or not self._norm_at(guesses[self._best]) <= self._other:
            # The likely one comes last, so that its residual need not be evaluated again.
            order = sorted(range(len(guesses)), key=lambda k: k == self._best)
            norms = [self._norm_at(guesses[k]) for k in order]
            least, *others = sorted(range(len(norms)), key=lambda k: (np.isnan(norms[k]), norms[k]))
            if least < len(norms) - 1:
                self._norm_at(guesses[order[least]])
            self._offered, self._best = len(norms), order[least]
            self._other = norms[others[0]] if others else np.inf
        self._known = True

    def _norm_at(self, guess: Guess) -> float:
        self.equations.guess(guess.increment, guess.bodies, self._y)
        self.equations.residual(self._y, self._r)
        return float(self._r.norm())

    def _evaluate(self, snes: PETSc.SNES, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """SNES's call: R(y), unless the choice of a first guess has left it there."""
        if not self._known:
            self.equations.residual(y, r)
        self._known = False

    def _renew_tangent(self, snes: PETSc.SNES, y: PETSc.Vec, A: PETSc.Mat, B: PETSc.Mat) -> None:
        """SNES's call: dR/dy at the iterate of the last residual, unless an older one serves."""
        if self._keeping and self._chord is not None:
            self._chord.look()
            if not self.conserving.following:
                self._chord.renew()
            elif self.conserving.doubtful:
                self._chord.make()
        elif self._bordered is None or not self.stop.fell(SERVES):
            self.equations.tangent()
            if self._bordered is not None:
                self._bordered.renew()
            self._tangents += 1

    def _ended(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        """SNES's call: its reason to stop, or 0 to go on. Collective."""
        norm, conserving = norms[2], self.conserving
        reason = self.stop(iteration, norm)
        if conserving.following:
            if conserving.grown(norm):
                return self._ending
        elif reason <= 0 or not 0 < iteration < self.stop.max_it:
            return reason
        else:
            self._ending = reason
        lost = self.equations.lost(self._y, self._r)
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
        return self.equations.rounding.in_strain(self._left, self.equations.trial.bodies.start)

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        free(self._snes, self._chord, self._y, self._r, self._saved)
