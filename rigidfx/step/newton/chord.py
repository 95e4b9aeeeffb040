"""Newton's method with tangents that are kept over steps: the chord method.

Parts of metal need factors, since waves pass many cells in the time steps of their slow motions;
new factors cost more than some iterations with kept ones. In soft parts inertia dominates, and
GMRES with kept incomplete factors suffices, with a coarse grid in large systems in which waves get
far.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from rigidfx.linear.linear_solver import PREFIX
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.factors import Factors, IncompleteFactors, entries_of, price
from rigidfx.step.newton.kept_tangent import KeptTangent
from rigidfx.step.newton.stopping_test import ChordTest
from rigidfx.step.newton.two_levels import TwoLevels

# Measurements behind these numbers are in docs/notes/solver_ablation.md.
DEAR = 1.45  # price of a tangent from which it is kept, with as many entries in factors as in it
FULL_UP_TO = 500  # unknowns up to which full factors are kept, as GMRES is no faster
FACTORS_UP_TO = 100_000  # unknowns up to which stiff parts keep full factors ...
SLENDER_UP_TO = 300_000  # ... on one rank also slender and thin ones, whose factors fill little ...
SLENDER = 25.0  # ... at most: entries of factors over the tangent's
FEW_UP_TO = 30_000  # unknowns up to which soft parts keep full factors of few entries ...
FEW = 6.5  # ... over the tangent's: a solve takes less than some iterations and leaves less
STIFF_FROM = 9.0  # cells that a wave passes in a step, from which a structure is stiff
STIFF_UP_TO = 5e3  # beyond, rounding of kept factors turns a slender part about its axis, for good
OWN = 4  # iterations in which a tangent is not judged
CLEAR = 10.0  # times what rounding may leave, of a residual that secants are learned from
OF_SOLVERS = "ksp_", "pc_", "mat_", "sub_", "mg_", "snes_lag_", "snes_ksp_ew"


def worn(history: Sequence[float], since: int, target: float, limit: int) -> bool:
    """Whether a tangent does not fit the last iterate of a step.

    docs/theory/step.md#kept-tangents has the rule, by the contraction θ of an iteration (E. Hairer
    and G. Wanner, Solving Ordinary Differential Equations II, IV.8; P. Deuflhard, Newton Methods
    for Nonlinear Problems, 2.1). The tangent is the same since an iterate, and ‖R‖ [N] at the
    target ends the step.
    """
    taken, norm = len(history) - 1, history[-1]
    if taken - since <= OWN or norm <= target:
        return False
    if not norm < min(history[-3:-1]):
        return True
    contraction = math.sqrt(norm / history[-3])
    left = math.log(max(target, sys.float_info.min) / norm) / math.log(contraction)
    return taken + left > limit


def fill(A: PETSc.Mat) -> float:
    """Entries of factors relative to the matrix' own, at most; infinite on several ranks.

    With the rows of a sparse matrix in the order of Cuthill and McKee, reversed (A. George and J.
    W. H. Liu, Computer Solution of Large Sparse Positive Definite Systems, Prentice-Hall 1981),
    factors have entries only between the first entry of a row and the diagonal. These are few in
    small structures, and in long and thin ones of any size. The pattern of the matrix is symmetric
    and complete; rows alike count as one.
    """
    if A.comm.size > 1:
        return np.inf
    start, column = A.getRowIJ(compressed=True)
    rows = len(start) - 1
    if not rows or not np.diff(start).all():
        return np.inf
    pattern = csr_array((np.ones(len(column), np.int8), column, start), shape=(rows, rows))
    place = np.empty(rows, dtype=np.int64)
    place[reverse_cuthill_mckee(pattern, symmetric_mode=True)] = np.arange(rows)
    first = np.minimum.reduceat(place[column], start[:-1])
    return float((2 * (place - first).sum() + rows) / len(column))


class Chord:
    """Keeps the tangent of the equations of one division; `destroy` frees its PETSc objects.

    Attributes:
        stop: Stopping test.
        ksp: Linear solver for SNES ...
        kept: ... which is all of it.
        tangents: How many have been made in the last solve.
        missing: Whether no tangent serves.
    """

    def __init__(self, equations: Equations, stop: ChordTest) -> None:
        """Create the solver. Collective."""
        self.stop, self.tangents = stop, 0
        self._equations = equations
        self.missing, self._since = True, 0  # and the iterate that it is of
        self._once_stiff = False  # whether waves have got so far in a step
        self.kept = KeptTangent(equations, self._suited(0.0)(equations))
        self.ksp = PETSc.KSP().create(equations.prolongation.comm)
        self.ksp.setType(PETSc.KSP.Type.PREONLY)
        self.ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        self.ksp.getPC().setPythonContext(self.kept)

    def _suited(self, dt: float) -> type[Factors | IncompleteFactors | TwoLevels]:
        """The solver for the tangents of steps of Δt [s].

        Once waves get far in a step, a structure counts as stiff, also in shorter steps and after
        parts have become rigid.
        """
        size = self._equations.prolongation.size
        self._once_stiff |= self._equations.rounding.waves(dt) >= STIFF_FROM
        if self._once_stiff:
            full = size <= FACTORS_UP_TO or (size <= SLENDER_UP_TO and self._fill <= SLENDER)
        else:
            few = size <= FEW_UP_TO and not self._equations.actions.stiffens and self._fill <= FEW
            full = size < FULL_UP_TO or few
        if full:
            return Factors
        return TwoLevels if self._once_stiff else IncompleteFactors

    def go_on(self, before: Chord) -> None:
        """Keep findings of the division before, which may have been freed."""
        self._once_stiff = before._once_stiff

    @cached_property
    def _fill(self) -> float:
        """Entries of full factors relative to those of a tangent, at most."""
        return fill(self._equations.tangent_matrix)

    def begin(self, dt: float) -> None:
        """Begin a step, or an attempt at it. Collective."""
        suited = self._suited(dt)
        if type(self.kept.inverse) is not suited:
            self.kept.replace(suited(self._equations))
        self.missing |= not self.kept.fits(dt)
        self.kept.begin(self._equations.structure.u, dt)
        self._since = self.tangents = 0

    def look(self) -> None:
        """Record the last iterate: its rounding tells nothing of the tangent."""
        self.kept.learning = self.stop.history[-1] > CLEAR * self.stop.target

    def renew(self) -> None:
        """Assemble the tangent at the last iterate, if that is worth it. Collective."""
        history, stop, jumped = self.stop.history, self.stop, self._equations.actions.outdated()
        if jumped and not self.missing:
            entries = self._equations.jumping()
            if entries is not None and self.kept.follow(entries):
                self._since = len(history) - 1
                return
        if jumped or self.missing or worn(history, self._since, stop.target, stop.max_it):
            self.make()

    def make(self) -> None:
        """Assemble the tangent at the last iterate. Collective."""
        self._equations.tangent()
        self.kept.renewed(self._equations.jumping())
        self.stop.renewed()
        self.missing, self._since = False, len(self.stop.history) - 1
        self.tangents += 1

    def serves(self, dt: float) -> bool:
        """Whether tangents are worth keeping in steps of Δt [s]."""
        return self._equations.rounding.waves(dt) <= STIFF_UP_TO

    def destroy(self) -> None:
        """Free the solvers. Collective."""
        self.ksp.destroy()  # and with it what has been kept


def pays(equations: Equations) -> bool:
    """Whether tangents are worth keeping, and PETSc's options leave it so. Collective."""
    given = PETSc.Options(PREFIX).getAll()
    if not equations.inertial or any(name.startswith(OF_SOLVERS) for name in given):
        return False
    return price(equations, entries_of(equations.tangent_matrix)) >= DEAR
