"""Which soft parts are worth full factors, as their tangents serve long: a rule in counts.

Full factors of a compact part take as long to make as many iterations of GMRES, and one solve with
them replaces some of these. So they pay where a tangent serves long, which only the motion tells: a
cantilever that swings keeps one for all its steps, what turns and bends wide needs another one
every few steps. And they pay where what GMRES leaves, a hundredth, takes iterations of Newton's
method, which full factors spare. While incomplete factors serve,
iterations of GMRES with the present tangent are counted, as of a skier who rents before he buys.
Once there have been more than full factors cost, these are made for the next tangent. If the steps
that it serves do not repay them, incomplete factors return, and have to serve twice as long
before the next trial. LU by MUMPS hardly ever pays: where the tangent is too far from symmetric for
Cholesky's factors, incomplete ones return for good.

How long tangents serve, and how well they fit, is the motion's doing, not that of which parts are
rigid. So a division goes on where the one before it was: had it to find out anew each time, a run
whose bodies come and go would pay for GMRES with what a flexible one has done with long ago.

All costs are in iterations of GMRES with incomplete factors, so that runs can be repeated and ranks
agree. What these take depends on the machine: first-order matrices of 3·10⁴ unknowns may stay in a
large cache, where GMRES is twice as fast and factors are not. The rule is one that holds there, and
elsewhere gains more. What a step gains is counted on both sides, Newton's iterations among it: in
some parts full factors halve them, in others they spare none.
"""

from __future__ import annotations

import math
from collections.abc import Callable

__all__ = ["LongKept"]

# For each unit of fill φ. Of 12 systems of 4·10³ to 3·10⁴ unknowns, first and second order,
# hexahedra and tetrahedra, Cholesky's factors took 17 to 36 iterations to make, a solve with them
# .27 to .87 with a cache of 32 MB; LU by MUMPS 19 to 48, and .5 to 1.7, elsewhere 5 to 13, and .2
# to .41. With .3 in place of .4 a wave in a bar, whose GMRES takes .38 φ, took 1.2 times as long.
MAKING, SOLVING = 20.0, 0.4
OFTEN = 1.5  # how many times the cost of factors has to be spent
RESIDUAL = 2.0  # iterations of GMRES that the rest of one of Newton's takes; 1.3 to 2.6


class LongKept:
    """Counts what tangents have served for.

    Attributes:
        full: Whether full factors are to be made of the next tangent.
    """

    def __init__(self, fill: Callable[[], float]) -> None:
        """Begin with incomplete factors.

        Args:
            fill: Estimates the entries of full factors relative to the tangent's; asked once, and
                only if counts are such that it matters.
        """
        self.full = False
        self._fill_of, self._fill = fill, 0.0
        self._often = OFTEN
        self._before = 0.0  # what a step costs without full factors
        self._steps, self._newton, self._linear = 0, 0, 0  # and iterations with the present tangent

    def go_on(self, before: LongKept) -> None:
        """Take over what has been found of another division.

        That its last tangent served no longer is not the motion's doing.

        Args:
            before: That of the division.
        """
        if math.isfinite(before._often):  # what was too far from symmetric may be rigid now, or not
            self.full, self._often = before.full, before._often
            self._before = before._before

    def served(self, newton: int, linear: int, renewed: bool, dear: bool = False) -> None:
        """Take note of a step with a kept tangent.

        Args:
            newton: Its iterations of Newton's method.
            linear: Its linear ones.
            renewed: Whether it has made a new tangent.
            dear: Whether its full factors, if it has any, are LU by MUMPS.
        """
        if renewed:
            self._ended()
        self._steps += 1
        self._newton += newton
        self._linear += linear
        if self.full and dear:
            self.full, self._often = False, math.inf
        elif self.full:
            self._fill = self._fill or self._fill_of()
        else:
            self._try()

    def _try(self) -> None:
        """Take full factors if the present tangent has served long enough without them."""
        per_iteration = self._linear / max(self._newton, 1)
        # A solve with factors that have none but the matrix's own entries is the cheapest.
        if self._linear < self._often * MAKING or per_iteration < SOLVING:
            return
        self._fill = self._fill or self._fill_of()
        long = self._linear >= self._often * MAKING * self._fill
        if not long or per_iteration < SOLVING * self._fill:
            return
        self.full, self._before = True, self._step(per_iteration)
        self._begin()

    def _ended(self) -> None:
        """Take note that another tangent takes the present one's place."""
        if self.full and self._newton > 0:
            gained = self._before - self._step(SOLVING * self._fill)
            if self._steps * gained < MAKING * self._fill:
                self.full = False
                self._often *= 2
        self._begin()

    def _step(self, solving: float) -> float:
        """What a step with the present tangent costs, by what a solve does."""
        return self._newton / self._steps * (RESIDUAL + solving)

    def _begin(self) -> None:
        self._steps, self._newton, self._linear = 0, 0, 0
