"""Newton's method with tangents that are kept over steps: the chord method.

Parts of metal need factors, since waves pass many cells in the time steps of their slow motions;
new factors cost more than some iterations with kept ones. In soft parts inertia dominates, and
GMRES with kept incomplete factors suffices, with a coarse grid in large systems in which waves get
far. Large strains make a kept tangent useless. So the cost of kept tangents is counted (`control`);
while it exceeds that of Newton's method, Newton's method serves.
"""

from __future__ import annotations

from functools import cached_property

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.equations.joined import JoinedEquilibrium
from rigidfx.step.linear.linear_solver import PREFIX
from rigidfx.step.newton.band import fill
from rigidfx.step.newton.border import Border
from rigidfx.step.newton.chord_test import ChordTest
from rigidfx.step.newton.control import Control
from rigidfx.step.newton.factors import Factors
from rigidfx.step.newton.frames import Frames
from rigidfx.step.newton.incomplete import IncompleteFactors
from rigidfx.step.newton.kept_tangent import KeptTangent
from rigidfx.step.newton.low_rank import LowRank
from rigidfx.step.newton.stopping_test import StoppingTest
from rigidfx.step.newton.two_levels import TwoLevels

__all__ = ["Chord", "pays"]

# Unknowns from which one rank keeps tangents: of 20 systems of 189 to 486 steps took .34 to .79 of
# those by Newton's method, in one soft system 1.07; of 132 unknowns 1.1, of 6 and 36 1.2 to 1.3.
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
        border = Border(equilibrium) if isinstance(equilibrium, JoinedEquilibrium) else None
        frames = Frames(p)
        contacts = LowRank(p, frames)
        inverse = self._suited(0.0)(equilibrium)
        self._kept = KeptTangent(inverse, frames, contacts, like, border)
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
        """Take over findings of the division before, which may have been freed."""
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
        """Take note of the last iterate: its rounding tells nothing of the tangent."""
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
        """Have contacts as they are now in the kept tangent, if that is worth it. Collective."""
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
        """Take note that Newton's method takes over, and makes tangents of its own."""
        self._control.failed(len(self.stop.history) - 1, self.tangents)

    def accept(self) -> None:
        """Take note that the last solve has become a step."""
        self._control.accepted(len(self.stop.history) - 1, self.tangents)

    def accept_newton(self, stop: StoppingTest) -> None:
        """Take note that a solve by Newton's method, with this test, has become a step."""
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
    least = SMALLEST if p.comm.size == 1 else FULL_UP_TO
    return equilibrium.inertial and p.size >= least and not told
