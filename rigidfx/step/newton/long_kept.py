"""Which soft parts are worth full factors, as their tangents serve long: a rule in counts.

Full factors of a compact part take as long to make as many iterations of GMRES, and one solve with
them replaces some of these. So they pay where a tangent serves long, which only the motion tells: a
cantilever that swings keeps one for all its steps, what turns and bends wide needs another one
every few steps. While incomplete factors serve, iterations of GMRES with the present tangent are
counted, as of a skier who rents before he buys. Once there have been many times as many as full
factors cost, these are made for the next tangent. If that serves too short a time to repay them,
incomplete factors return, and have to serve twice as long before the next trial.

All costs are in iterations of GMRES with incomplete factors, so that runs can be repeated and ranks
agree.
"""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["LongKept"]

# Of 8 systems of 4·10³ to 2.7·10⁴ unknowns, first and second order, hexahedra and tetrahedra, full
# factors of MUMPS's took 29 to 96 iterations to make, 5.2 to 13 for each unit of fill; a solve with
# them .2 to .41 for each.
MAKING, SOLVING = 8.0, 0.3
# How many times the cost of factors has to be spent. The L that turns and bends spends three times
# that with one tangent, at 4·10³ to 1.2·10⁴ unknowns.
OFTEN = 4.0
ENOUGH = 0.7  # of what GMRES takes, that solves with full factors may; the L takes .73 and more
FEWER = 0.75  # Newton's iterations with full factors to those with incomplete ones, in such parts


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
        self._without = 0.0  # iterations of GMRES in one of Newton's, without full factors
        self._price = 1.0  # of the present full factors
        self._newton, self._linear = 0, 0  # iterations with the present tangent

    def served(self, newton: int, linear: int, renewed: bool, price: float = 1.0) -> None:
        """Take note of a step with a kept tangent.

        Args:
            newton: Its iterations of Newton's method.
            linear: Its linear ones.
            renewed: Whether it has made a new tangent.
            price: What its full factors cost, if it has any, relative to those of LU.
        """
        if renewed:
            self._ended()
        self._price = price
        self._newton += newton
        self._linear += linear
        if not self.full:
            self._try()

    def _try(self) -> None:
        """Take full factors if the present tangent has served long enough without them."""
        per_iteration = self._linear / max(self._newton, 1)
        # A solve with factors that have none but the matrix's own entries is the cheapest.
        if self._linear < self._often * MAKING or ENOUGH * per_iteration < FEWER * SOLVING:
            return
        self._fill = self._fill or self._fill_of()
        solving = FEWER * SOLVING * self._fill
        long = self._linear >= self._often * MAKING * self._fill
        if not long or solving > ENOUGH * per_iteration:
            return
        self.full, self._without = True, per_iteration
        self._newton = self._linear = 0

    def _ended(self) -> None:
        """Take note that another tangent takes the present one's place."""
        if self.full and self._newton > 0:
            cost = self._price * self._fill
            gained = self._without / FEWER - SOLVING * cost  # by one of Newton's iterations
            if self._newton * gained < MAKING * cost:
                self.full = False
                self._often *= 2
        self._newton = self._linear = 0
