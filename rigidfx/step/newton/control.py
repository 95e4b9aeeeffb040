"""When a kept tangent is made anew, and when Newton's method takes over: all of it by counts.

An iteration with a kept tangent reduces the residual by its contraction θ; a new tangent costs as
much as `price` such iterations (E. Hairer and G. Wanner, Solving Ordinary Differential Equations
II, IV.8; P. Deuflhard, Newton Methods for Nonlinear Problems, 2.1). Within a step there is a new
tangent

- where the residual grows,
- where the iterations that are left, log(target/‖R‖)/log θ, cost more than a new tangent and what
  it needs itself, or are more than the limit of iterations allows.

A residual that grows twice in a step by tangents of this step ends the chord method for it: each
iteration then has a tangent of its own, all of it and not its symmetric part.

Between steps a tangent is due when a step took more iterations than the mean step since the last
renewal, that included: from then on each further step would only raise the mean. It is made at the
step's first iterate. The first guess lies on a straight line, which stretches parts that bend; the
tangent there has the stress of that stretch.

Where steps cost more in the mean than by Newton's method, or fail one after another, Newton's
method has its turn for some steps, for twice as many as the last time if kept tangents have not
served for as long as that: in a motion that they never fit, trials of them become rare.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Control", "ControlNumbers"]


@dataclass(frozen=True)
class ControlNumbers:
    """The choice between an old tangent, a new one, and Newton's method.

    Attributes:
        own: Iterations that a new tangent needs as well (docs/notes/solver_ablation.md).
        growths: Growths of the residual by tangents of the same step that end the method for it.
        failures: Steps in a row that kept tangents fail, or are given up in, after which Newton's
            method has its turn.
        turn: Steps that such a turn lasts, unless it comes soon after another one.
        trial: Steps that the first turn lasts, in which iterations of Newton's method are counted.
        newton: Iterations that a step by Newton's method takes, before any has been counted.
        memory: Steps that the mean cost of a step goes over.
    """

    own: int = 3
    growths: int = 2
    failures: int = 2
    turn: int = 30
    trial: int = 3
    newton: float = 4.0
    memory: float = 10.0


class Control:
    """Counts the cost of steps.

    Attributes:
        price: Cost of a new tangent, in iterations with a kept one.
        due: Whether the next step makes a new tangent.
    """

    def __init__(self, numbers: ControlNumbers = ControlNumbers()) -> None:
        """Begin without a tangent."""
        self._numbers = numbers
        self.price, self.due = 0.0, True
        self._missing = True  # whether there is no tangent that could serve meanwhile
        self._spent, self._steps, self._since, self._growths = 0.0, 0, 0, 0
        self._mean, self._left, self._failures = 0.0, 0, 0
        self._newton, self._turn = numbers.newton, numbers.trial
        self._last_turn = self._served = 0  # steps of Newton's last turn, and by kept ones since

    def begin(self) -> None:
        """Begin a step, or an attempt at it."""
        self._since, self._growths = 0, 0

    def lose(self) -> None:
        """Take note that the tangent serves no longer."""
        self.due = self._missing = True

    def wanted(self, history: Sequence[float], target: float, limit: int) -> bool:
        """Whether a new tangent is to be made at the last iterate.

        Args:
            history: ‖R‖ at each iterate of this step.
            target: ‖R‖ that ends the step.
            limit: Iterations after which it fails.
        """
        taken = len(history) - 1
        since = taken - self._since
        if self._missing or self.ended:
            return True
        if since < 1 or history[-1] <= target:
            return self.due and since > 0
        last, norm = history[-2:]
        if norm >= last:
            self._growths += self._since > 0  # by a tangent of this step
            return True
        if since < 2:
            return self.due
        # Over two iterations, as what is left of strains and of rotations may take turns.
        contraction = math.sqrt(norm / history[-3])
        if not contraction < 1:
            return True
        left = math.log(max(target, 1e-300) / norm) / math.log(contraction)
        return self.due or left > self.price + self._numbers.own or taken + left > limit

    def renewed(self, history: Sequence[float]) -> None:
        """Take note of a new tangent at the last iterate."""
        self.due = self._missing = False
        self._since = len(history) - 1
        self._spent, self._steps = self.price - self._since, 0

    def accepted(self, iterations: int, asked: int, tangents: int) -> None:
        """Take note of a step with kept tangents.

        Args:
            iterations: How many it took.
            asked: How many of them energy and momenta asked for, which tell nothing of the tangent.
            tangents: How many new ones it made.
        """
        self._failures = self._failures + 1 if self.ended else 0
        self._spent += iterations - asked
        self._steps += 1
        self.due = iterations - asked - self._since > self._spent / self._steps
        cost = (iterations + self.price * tangents) / (self._newton * (1 + self.price))
        self._mean += (cost - self._mean) / self._numbers.memory
        self._served += 1
        if self._mean > 1.0 or self._failures >= self._numbers.failures:
            self._failures = 0
            self._rest(self._turn)

    def failed(self) -> None:
        """Take note of a step in which kept tangents have failed."""
        self.lose()
        self._failures += 1
        if self._failures >= self._numbers.failures:
            self._rest(self._numbers.turn)

    def _rest(self, steps: int) -> None:
        """Let Newton's method have its turn, for so many steps at least."""
        again = self._served < self._last_turn
        self._left = self._last_turn = max(steps, 2 * self._last_turn if again else 0)
        self._mean, self._served = 0.0, 0

    def passed(self, iterations: int) -> None:
        """Take note of a step by Newton's method.

        Args:
            iterations: How many it took.
        """
        self.lose()
        self._newton += (iterations - self._newton) / self._numbers.trial
        self._turn = self._numbers.turn
        self._left = max(0, self._left - 1)

    @property
    def ended(self) -> bool:
        """Whether each further iteration of the step has a tangent of its own."""
        return self._growths >= self._numbers.growths

    @property
    def pausing(self) -> bool:
        """Whether Newton's method has its turn."""
        return self._left > 0
