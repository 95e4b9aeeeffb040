"""Looks at the error motion before a step is accepted: which cells it strains too fast."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Contact, Joint, Rigid, Spring
from rigidfx.error.error_motion import ErrorMotion
from rigidfx.error.frames import Frames
from rigidfx.error.loose import unresisted
from rigidfx.error.pace import Pace
from rigidfx.error.shared_strains import SharedStrains
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import Cells
from rigidfx.scene.scene import Scene
from rigidfx.shadow.body_forces import BodyForces
from rigidfx.shadow.ground import ground_of
from rigidfx.shadow.motion import Limits, Strained, part_of
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import PrescribedDofs
from rigidfx.step.watches.judge import Attempt
from rigidfx.step.watches.watch import Watch

__all__ = ["Looks", "can_be_followed", "can_decide"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


def can_be_followed(scene: Scene) -> bool:
    """Whether e may be known in a scene."""
    given = any(rigid.given for rigid in scene.named(Rigid))
    return not given and not scene.named(Joint)


def can_decide(scene: Scene) -> bool:
    """Whether e is known and shown all through a run: of what is held, and touches nothing.

    Of parts named rigid shadows tell what they withhold. Collective.
    """
    if scene.named(Contact) or scene.named(Rigid) or not can_be_followed(scene):
        return False
    holds = [*(support for support, _ in scene.supports), *scene.named(Spring)]
    if any(getattr(one, "since", 0.0) > 0 or getattr(one, "until", inf) < inf for one in holds):
        return False
    supports = tuple(support for support, _ in scene.supports)
    nodes = np.arange(scene.owned_nodes, dtype=np.int32)
    held, rows = PrescribedDofs(scene, supports).mask[: 3 * nodes.size], Rows(scene.space, nodes)
    springs = ground_of(scene, rows)
    frames = Frames(scene, scene.space.tabulate_dof_coordinates()[: nodes.size])
    _, motions = unresisted(scene, frames, held, None if springs is None else springs.K)
    return motions.shape[1] == 0


class Looks(Watch):
    """Asks e which rigid cells it strains too fast, and what flexible ones strain in u + e.

    Attributes:
        withheld: Strain energy that bodies withhold, at the last look [J].
    """

    remembered: ClassVar[Remembered] = same("withheld", "_since") | {"_pace": PART, "_shared": PART}

    def __init__(
        self, stepper: Stepper, forces: BodyForces, error: ErrorMotion, indicator: Indicator
    ) -> None:
        """Look at nothing yet.

        Args:
            stepper: Solves the steps.
            forces: Knows ρ.
            error: The error motion.
            indicator: A measure of its own for flexible cells.
        """
        self._stepper, self._forces, self._error = stepper, forces, error
        self._shared = SharedStrains(stepper.scene.space, indicator)
        self._owned = indicator.values.size
        self._rigid: Ints = np.empty(0, np.int32)
        self._pace = Pace(forces)
        self.withheld = 0.0
        self._since = 0.0  # time since the last measure of u + e [s]
        self._rates: Array | None = None  # of u + e, then

    def bind(self, flexible: Cells) -> None:
        """See `Watch`."""
        every = np.arange(self._owned, dtype=np.int32)
        self._rigid = np.setdiff1d(every, np.concatenate([every[:0], *flexible.values()]))
        self._shared.bind(flexible)
        self._rates = None

    def refresh(self) -> None:
        """See `Watch`."""
        self._pace.refresh()

    def look(self, attempt: Attempt, limits: Callable[[], Limits] | None = None) -> Strained | None:
        """What e strains in rigid cells in a step that has been solved. Collective.

        Args:
            attempt: The step.
            limits: Says what wakes cells; None where none may wake any more in this step.

        Returns:
            Over what wakes cells; None where none does.
        """
        self._forces.bear(attempt.t, attempt.dt)
        self._pace.follow()
        stepped = self._error.look(attempt)
        if not stepped or limits is None or self._forces.borne is None or not self._pace.due():
            return None
        known = limits()
        assert known.rates is not None
        rate = self._of_all(self._error.rates(self._rigid), known.rates)
        here = float(rate.max(initial=0.0))
        self._pace.ratio = self._stepper.scene.comm.allreduce(here, op=MPI.MAX)
        if not self._pace.ratio > 1:
            return None
        spring = self._of_all(self._error.strains(self._rigid), attempt.dt * known.rates)
        return Strained(rate, np.zeros_like(rate), spring, window=known.window)

    def _of_all(self, strains: Array, limits: Array) -> Array:
        """Strains of rigid cells over limits of all owned cells, zero in flexible ones."""
        out = np.zeros(self._owned)
        out[self._rigid] = strains
        return part_of(out, limits)

    def shared(self, dt: float) -> Array | None:
        """Strain rate of u + e since the last look, of each owned cell [1/s]. Collective.

        Args:
            dt: Length of the step of the run [s].

        Returns:
            None where e is zero or not known, or was so then.
        """
        self._since += dt
        if self._rates is not None and not self._pace.looked:
            return self._rates
        shown, state = self._error.shown(), self._stepper.state
        moved = None
        if shown is not None:
            nodes = np.arange(len(shown.displacement))
            moved = state.positions(nodes) - state.X[nodes] + shown.displacement
        self._rates, self._since = self._shared.step(moved, self._since), 0.0
        self.withheld = self._error.withheld()
        return self._rates
