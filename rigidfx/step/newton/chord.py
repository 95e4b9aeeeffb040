"""Newton's method with tangents that are kept over steps: the chord method.

Parts of metal need factors, since waves pass many cells in the time steps of their slow motions;
new factors cost more than some iterations with kept ones. In soft parts inertia dominates, and
GMRES with kept incomplete factors suffices, with a coarse grid in large systems in which waves get
far. Large strains make a kept tangent useless. So the cost of kept tangents is counted (`control`);
while it exceeds that of Newton's method, Newton's method serves.

How many entries the factors of a matrix will have, before anything is factored.

With the rows of a sparse matrix in the order of Cuthill and McKee, reversed (A. George and J. W. H.
Liu, Computer Solution of Large Sparse Positive Definite Systems, Prentice-Hall 1981), factors have
entries only between the first entry of a row and the diagonal. These are few in small structures,
and in long and thin ones of any size.

When a kept tangent is renewed, and when Newton's method takes over: decided by counts.

An iteration with a kept tangent reduces the residual by its contraction θ; a new tangent costs as
much as `price` such iterations (E. Hairer and G. Wanner, Solving Ordinary Differential Equations
II, IV.8; P. Deuflhard, Newton Methods for Nonlinear Problems, 2.1). The first iterations with a
tangent in a step tell nothing of it: a correction along a straight line stretches parts that turn
or bend, and the next ones take that back. So a tangent is judged after its `own` iterations, by the
mean θ of the last two. Then it is renewed

- if the residual has grown,
- if the remaining iterations, log(target/‖R‖)/log θ, cost more than a new tangent with its own
  iterations, or exceed the limit of iterations.

A solve that diverges with the tangent of an earlier step begins again with a new one. A solve that
has cost as much as a step by Newton's method ends, and Newton's method takes over, as in the ski
rental problem: nobody knows what the rest would cost, and so at most the same is lost.

The cost of steps beyond that of Newton's method is a debt; cheaper steps reduce it. If the debt
exceeds a small part of what all steps would have cost by Newton's method, this method serves until
its growing cost raises that limit. Savings count up to the same limit. So kept tangents cost at
most this part and one step more than Newton's method, and are rarely tried in motions that they do
not fit.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import PREFIX
from rigidfx.step.newton.border import Border
from rigidfx.step.newton.factors import Factors
from rigidfx.step.newton.frames import Frames
from rigidfx.step.newton.incomplete import IncompleteFactors
from rigidfx.step.newton.kept_tangent import KeptTangent
from rigidfx.step.newton.low_rank import LowRank
from rigidfx.step.newton.stopping_test import ChordTest, StoppingTest
from rigidfx.step.newton.two_levels import TwoLevels

__all__ = ["Chord", "Control", "pays"]

# Unknowns from which one rank keeps tangents: of 20 systems of 189 to 486 steps took .34 to .79 of
# those by Newton's method, in one soft system 1.07; of 132 unknowns 1.1, of 6 and 36 1.2 to 1.3.
# Beside bodies with shapes it keeps them from more dofs of flexible cells on, too, as each tangent
# condenses many columns: one of 23 shapes took .44, a rigid one 1.24 beside 150 dofs, .93 by 294.
SMALLEST = 150
# Unknowns up to which several ranks, whose factors MUMPS makes, keep none, and one rank keeps full
# ones, as GMRES is no faster.
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
CLEAR = 10.0  # times what rounding may leave, of a residual that secants are learned from
OF_SOLVERS = "ksp_", "pc_", "mat_", "sub_", "mg_", "snes_lag_", "snes_ksp_ew"


@dataclass(frozen=True)
class ControlNumbers:
    """The choice between an old tangent, a new one, and Newton's method.

    Attributes:
        own: Iterations that a new tangent needs as well, and that a tangent has in each step before
            it is judged (docs/notes/solver_ablation.md).
        debt: Largest debt, as a part of the whole cost of Newton's method, but at least the cost of
            one of its steps. Savings of cheaper steps count up to the same size: an arm whose steps
            cost 0.4 has single ones that cost 2.6 (docs/notes/solver_ablation.md).
        newton: Iterations that a step by Newton's method takes, before any has been counted; in
            twelve scenes it took 2.5 to 6.2.
    """

    own: int = 4
    debt: float = 0.05
    newton: float = 4.0


class Control:
    """Counts the cost of steps.

    Attributes:
        price: Cost of a new tangent, in iterations with a kept one.
        missing: Whether there is no tangent that could serve.
    """

    def __init__(self, numbers: ControlNumbers = ControlNumbers()) -> None:
        """Begin without a tangent."""
        self._numbers = numbers
        self.price, self.missing = 0.0, True
        self._from = 0  # iterate of this step since which the tangent is the same
        self._made = 0  # tangents in this step
        self._newton, self._passed = numbers.newton, 0
        self._debt = self._whole = 0.0  # beyond Newton's cost, and all of that, in iterations

    def begin(self) -> None:
        """Begin a step, or an attempt at it."""
        self._from = self._made = 0

    def lose(self) -> None:
        """Drop the tangent, which serves no longer."""
        self.missing = True

    def exhausted(self, iterations: int) -> bool:
        """Whether the present solve has cost as much as a step by Newton's method.

        Args:
            iterations: How many it has taken.
        """
        return iterations + self.price * self._made >= self._of_newton

    def wanted(self, history: Sequence[float], target: float, limit: int) -> bool:
        """Whether a new tangent is to be made at the last iterate.

        Args:
            history: ‖R‖ at each iterate of this step.
            target: ‖R‖ that ends the step.
            limit: Iterations after which it fails.
        """
        taken = len(history) - 1
        since, norm = taken - self._from, history[-1]
        if self.missing:
            return True
        if since <= self._numbers.own or norm <= target:
            return False
        if not norm < min(history[-3:-1]):
            return True
        contraction = math.sqrt(norm / history[-3])
        left = math.log(max(target, sys.float_info.min) / norm) / math.log(contraction)
        return left > self.price + self._numbers.own or taken + left > limit

    def renewed(self, history: Sequence[float]) -> None:
        """Record a new tangent at the last iterate."""
        self.missing = False
        self._made += 1
        self._from = len(history) - 1

    def followed(self, history: Sequence[float]) -> None:
        """Record that the tangent follows a jump of contacts since the last iterate.

        Args:
            history: ‖R‖ at each iterate of this step.
        """
        self._from = len(history) - 1

    def accepted(self, iterations: int, tangents: int) -> None:
        """Record a step with kept tangents.

        Args:
            iterations: How many it took.
            tangents: How many new ones it made.
        """
        self._pay(iterations, tangents)
        self._whole += self._of_newton

    def failed(self, iterations: int, tangents: int) -> None:
        """Record an attempt by kept tangents that has failed.

        Args:
            iterations: How many it took.
            tangents: How many new ones it made.
        """
        self.lose()
        self._debt += self._of_newton
        self._pay(iterations, tangents)

    def passed(self, iterations: int, whole: bool = True) -> None:
        """Record a step by Newton's method.

        Args:
            iterations: How many it took.
            whole: Whether from a first guess, not from an iterate of kept tangents.
        """
        self.lose()
        if whole:
            self._passed += 1
            self._newton += (iterations - self._newton) / (1 + self._passed)
        self._whole += self._of_newton

    def _pay(self, iterations: int, tangents: int) -> None:
        """Record the cost of kept tangents in place of a step by Newton's method."""
        cost = iterations + self.price * tangents
        self._debt = max(-self._lent, self._debt + cost - self._of_newton)

    @property
    def _lent(self) -> float:
        """Limit of the debt and of savings, in iterations."""
        return max(self._numbers.debt * self._whole, self._of_newton)

    @property
    def _of_newton(self) -> float:
        """Cost of a step by Newton's method, in iterations with a kept tangent."""
        return self._newton * (1 + self.price)

    @property
    def indebted(self) -> bool:
        """Whether Newton's method serves, as kept tangents have cost more than it."""
        return self._debt > self._lent


def fill(A: PETSc.Mat) -> float:
    """Entries of factors relative to the matrix' own, at most; infinite on several ranks.

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
        """Create the solver. Collective.

        Args:
            equilibrium: The equations.
            stop: Stopping test.
        """
        self.stop = stop
        self.tangents = 0
        self._equilibrium, p = equilibrium, equilibrium.prolongation
        self._control = Control()
        self._once_stiff = False  # whether waves have got so far in a step
        like = equilibrium.unknowns()
        frames = Frames(p)
        contacts = LowRank(p, frames)
        inverse = self._suited(0.0)(equilibrium)
        self._kept = KeptTangent(inverse, frames, contacts, like, Border(equilibrium))
        like.destroy()
        self._control.price = self._kept.renewal
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
        """Begin a step, or an attempt at it. Collective.

        Args:
            dt: Δt [s].
        """
        suited = self._suited(dt)
        if type(self._kept.inverse) is not suited:
            self._kept.replace(suited(self._equilibrium))
            self._control.price = self._kept.renewal
        if not self._kept.fits(dt):
            self._control.lose()
        self._kept.begin(self._equilibrium.displacement, dt)
        self._control.begin()
        self.tangents = 0

    def look(self) -> None:
        """Record the last iterate: its rounding tells nothing of the tangent."""
        self._kept.learning = self.stop.history[-1] > CLEAR * self.stop.target

    def renew(self) -> None:
        """Assemble the tangent at the last iterate, if that is worth it. Collective."""
        history, stop = self.stop.history, self.stop
        jumped = self._equilibrium.outdated()
        if jumped and self._follow():
            return
        if jumped or self._control.wanted(history, stop.target, stop.max_it):
            self.make()

    def _follow(self) -> bool:
        """Update contacts in the kept tangent, if that is worth it. Collective."""
        entries = self._equilibrium.jumping()
        if self._control.missing or entries is None:
            return False
        followed = self._kept.follow(entries)
        if followed:
            self._control.followed(self.stop.history)
        return followed

    def make(self) -> None:
        """Assemble the tangent at the last iterate. Collective."""
        self._equilibrium.tangent()
        self._kept.renewed(self._equilibrium.jumping())
        self._control.price = self._kept.renewal
        self.stop.renewed()
        self._control.renewed(self.stop.history)
        self.tangents += 1

    @property
    def serving(self) -> bool:
        """Whether the last step made no tangent and the next one is to make none."""
        return not self.tangents and not self._control.missing

    @property
    def exhausted(self) -> bool:
        """Whether the present solve has cost as much as a step by Newton's method."""
        return self._control.exhausted(len(self.stop.history) - 1)

    def fail(self) -> None:
        """Record that Newton's method goes on, with tangents of its own."""
        self._control.failed(len(self.stop.history) - 1, self.tangents)

    def accept(self) -> None:
        """Accept the last solve as a step."""
        self._control.accepted(len(self.stop.history) - 1, self.tangents)

    def accept_newton(self, stop: StoppingTest) -> None:
        """Accept a solve by Newton's method, with this test, as a step."""
        self._control.passed(len(stop.history) - 1, not stop.continued)

    def serves(self, dt: float) -> bool:
        """Whether tangents are worth keeping in steps of Δt [s]."""
        return not self._control.indebted and self._equilibrium.waves(dt) <= STIFF_UP_TO

    def destroy(self) -> None:
        """Free the solvers. Collective."""
        self.ksp.destroy()  # and with it what has been kept


def pays(equilibrium: Equilibrium) -> bool:
    """Whether tangents may be worth keeping, and PETSc's options leave it so."""
    given = PETSc.Options(PREFIX).getAll()
    told = any(name.startswith(OF_SOLVERS) for name in given)
    p = equilibrium.prolongation
    alone = p.comm.size == 1
    large = p.size >= (SMALLEST if alone else FULL_UP_TO)
    deforms = p.layout.ensemble.shapes is not None
    large |= alone and deforms and p.layout.rows.dofs.size > SMALLEST
    return equilibrium.inertial and large and not told
