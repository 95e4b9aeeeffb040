"""When a kept tangent is renewed, and when Newton's method takes over: decided by counts.

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

__all__ = ["Control", "ControlNumbers"]


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
        """Take note that the tangent serves no longer."""
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
        """Take note of a new tangent at the last iterate."""
        self.missing = False
        self._made += 1
        self._from = len(history) - 1

    def followed(self, history: Sequence[float]) -> None:
        """Take note that the tangent follows a jump of contacts since the last iterate.

        Args:
            history: ‖R‖ at each iterate of this step.
        """
        self._from = len(history) - 1

    def accepted(self, iterations: int, tangents: int) -> None:
        """Take note of a step with kept tangents.

        Args:
            iterations: How many it took.
            tangents: How many new ones it made.
        """
        self._pay(iterations, tangents)
        self._whole += self._of_newton

    def failed(self, iterations: int, tangents: int) -> None:
        """Take note of an attempt by kept tangents that has failed.

        Args:
            iterations: How many it took.
            tangents: How many new ones it made.
        """
        self.lose()
        self._debt += self._of_newton
        self._pay(iterations, tangents)

    def passed(self, iterations: int, whole: bool = True) -> None:
        """Take note of a step by Newton's method.

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
        """Take note of the cost of kept tangents in place of a step by Newton's method."""
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
