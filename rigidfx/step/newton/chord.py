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

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import PREFIX
from rigidfx.step.newton.border import Border
from rigidfx.step.newton.factors import Factors, entries_of, price
from rigidfx.step.newton.frames import Frames
from rigidfx.step.newton.incomplete import IncompleteFactors
from rigidfx.step.newton.kept_tangent import KeptTangent
from rigidfx.step.newton.low_rank import LowRank
from rigidfx.step.newton.stopping_test import ChordTest
from rigidfx.step.newton.two_levels import TwoLevels

# Price of a tangent, with as many entries in factors as in itself, from which tangents are kept.
# Steps took .86 of the time by Newton's method at 1.5 (108 unknowns), .96 at 1.9 (135), .34 to .79
# from 2.5 on (189 to 486), 1.23 at 1.4 (144 of a slender bar), 1.2 to 1.3 below .5 (6 and 36). With
# a rigid body: 1.24 at 1.1, .93 at 2.2; with 8 shapes .81 at 1.5, .67 at 4; with 23 shapes .44.
DEAR = 1.45
# Unknowns up to which full factors are kept, as GMRES is no faster.
FULL_UP_TO = 500
# Unknowns up to which stiff parts keep full factors. At 97 470 of steel a step by Cholesky's takes
# .58 of one by incomplete factors and a coarse grid, .72 by LU; factors take 4 and 6 s to make
# against .44. What grows with the unknowns is in favour of the others: .68 at 174 570, 11 s and .8.
FACTORS_UP_TO = 100_000
# Of slender and thin ones, on one rank, whose full factors fill little: in a plate of one layer of
# second-order hexahedra (130 680, waves that pass 1800 cells) steps with them took .39 of the time.
SLENDER_UP_TO = 300_000
SLENDER = 25.0  # fill at most; that plate has 20, a bar five times as long as thick 31
# Soft parts whose factors have few entries keep full ones: a solve takes less than a handful of
# iterations by GMRES and leaves less. Steps took .36 to .79 of the time at a fill of 1.3 to 6.5, in
# bars, plates and blocks of 670 to 10 000 unknowns.
FEW = 6.5
FEW_UP_TO = 30_000  # unknowns; .25 and .51 from 17 000 on, with PETSc's factors
# Cells that a wave passes in a step, as the diagonals of stiffness and mass estimate them, from
# which a structure is stiff. Full factors took .53 to .67 of the time of incomplete ones at 9 to 14
# cells (steps of an L of 3969 to 26 871 unknowns). A coarse grid took .63, .36 and .24 of it at 12,
# 24 and 49 cells (solves of one of 196 875); 1.3 at 3 cells, 1 at 6 (steps of a block of 114 444).
STIFF_FROM = 9.0
# Beyond, solves with kept factors turn a slender part about its axis by rounding, for good: at
# 2·10⁵ a needle of 1107 unknowns lost 8e-4 of its energy in 500 steps.
STIFF_UP_TO = 5e3
# Iterations in which a tangent is not judged (docs/notes/solver_ablation.md).
OWN = 4
CLEAR = 10.0  # times what rounding may leave, of a residual that secants are learned from
OF_SOLVERS = "ksp_", "pc_", "mat_", "sub_", "mg_", "snes_lag_", "snes_ksp_ew"


def worn(history: Sequence[float], since: int, target: float, limit: int) -> bool:
    """Whether a tangent does not fit the last iterate of a step.

    An iteration with a kept tangent reduces the residual by its contraction θ (E. Hairer and G.
    Wanner, Solving Ordinary Differential Equations II, IV.8; P. Deuflhard, Newton Methods for
    Nonlinear Problems, 2.1). The first iterations with a tangent in a step tell nothing of it: a
    correction along a straight line stretches parts that turn or bend, and the next ones take that
    back. So a tangent is judged after its first `OWN` iterations, by the mean θ of the last two. It
    is renewed if the residual has grown, or if the remaining iterations, log(target/‖R‖)/log θ,
    exceed the limit of iterations. Newton's method takes over where that does not help.

    Args:
        history: ‖R‖ at each iterate of the step [N].
        since: Iterate since which the tangent is the same.
        target: ‖R‖ that ends the step [N].
        limit: Iterations after which the step fails.
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
    small structures, and in long and thin ones of any size.

    Args:
        A: A matrix whose pattern of entries is symmetric, and complete. Rows alike count as one.
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
        ksp: Linear solver for SNES.
        tangents: How many have been made in the last solve.
    """

    def __init__(self, equilibrium: Equilibrium, stop: ChordTest) -> None:
        """Create the solver. Collective."""
        self.stop = stop
        self.tangents = 0
        self._equilibrium, p = equilibrium, equilibrium.prolongation
        self._missing, self._since = True, 0  # whether none serves; iterate that it is of
        self._once_stiff = False  # whether waves have got so far in a step
        like = equilibrium.unknowns()
        frames = Frames(p)
        contacts = LowRank(p, frames)
        inverse = self._suited(0.0)(equilibrium)
        self._kept = KeptTangent(inverse, frames, contacts, like, Border(equilibrium))
        like.destroy()
        self.ksp = PETSc.KSP().create(p.comm)
        self.ksp.setType(PETSc.KSP.Type.PREONLY)
        self.ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        self.ksp.getPC().setPythonContext(self._kept)

    @property
    def solver(self) -> str:
        """Linear solver, in words."""
        return f"kept {self._kept.inverse.name}"

    @property
    def linear_iterations(self) -> int:
        """Linear iterations that the last solve took; with factors, one in each of Newton's."""
        return self._kept.iterations

    def _suited(self, dt: float) -> type[Factors | IncompleteFactors | TwoLevels]:
        """The solver for the tangents of steps of Δt [s].

        Once waves get far in a step, a structure counts as stiff, also in shorter steps and after
        parts have become rigid. With GMRES a frame of 4914 unknowns took 60 to 120 iterations a
        step at 3 to 13 cells, 130 ms; with full factors 13 ms. A plate in springs whose body came
        and went took .6 of the time.
        """
        size = self._equilibrium.prolongation.size
        self._once_stiff |= self._equilibrium.waves(dt) >= STIFF_FROM
        if self._once_stiff:
            full = size <= FACTORS_UP_TO or (size <= SLENDER_UP_TO and self._fill <= SLENDER)
        else:
            few = size <= FEW_UP_TO and self._equilibrium.calm and self._fill <= FEW
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
        return fill(self._equilibrium.tangent_matrix)

    def begin(self, dt: float) -> None:
        """Begin a step, or an attempt at it. Collective."""
        suited = self._suited(dt)
        if type(self._kept.inverse) is not suited:
            self._kept.replace(suited(self._equilibrium))
        self._missing |= not self._kept.fits(dt)
        self._kept.begin(self._equilibrium.displacement, dt)
        self._since = self.tangents = 0

    def look(self) -> None:
        """Record the last iterate: its rounding tells nothing of the tangent."""
        self._kept.learning = self.stop.history[-1] > CLEAR * self.stop.target

    def renew(self) -> None:
        """Assemble the tangent at the last iterate, if that is worth it. Collective."""
        history, stop = self.stop.history, self.stop
        jumped = self._equilibrium.outdated()
        if jumped and self._follow():
            return
        known = history, self._since, stop.target, stop.max_it
        if jumped or self._missing or worn(*known):
            self.make()

    def _follow(self) -> bool:
        """Update contacts in the kept tangent, if that is worth it. Collective."""
        entries = self._equilibrium.jumping()
        if self._missing or entries is None or not self._kept.follow(entries):
            return False
        self._since = len(self.stop.history) - 1
        return True

    def make(self) -> None:
        """Assemble the tangent at the last iterate. Collective."""
        self._equilibrium.tangent()
        self._kept.renewed(self._equilibrium.jumping())
        self.stop.renewed()
        self._missing, self._since = False, len(self.stop.history) - 1
        self.tangents += 1

    @property
    def serving(self) -> bool:
        """Whether the last step made no tangent and the next one is to make none."""
        return not self.tangents and not self._missing

    def lose(self) -> None:
        """Drop the tangent: Newton's method makes others."""
        self._missing = True

    def serves(self, dt: float) -> bool:
        """Whether tangents are worth keeping in steps of Δt [s]."""
        return self._equilibrium.waves(dt) <= STIFF_UP_TO

    def destroy(self) -> None:
        """Free the solvers. Collective."""
        self.ksp.destroy()  # and with it what has been kept


def pays(equilibrium: Equilibrium) -> bool:
    """Whether tangents are worth keeping, and PETSc's options leave it so. Collective."""
    given = PETSc.Options(PREFIX).getAll()
    told = any(name.startswith(OF_SOLVERS) for name in given)
    if not equilibrium.inertial or told:
        return False
    return price(equilibrium, entries_of(equilibrium.tangent_matrix)) >= DEAR
