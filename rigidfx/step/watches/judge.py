"""Attempts at a step: why one is cut, how, and observers of those that are accepted.

An attempt that is not accepted leaves no trace, but for the factors that a solver has made.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import ClassVar, TypeVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import InversionError, StepError
from rigidfx.base.instants import longer
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.inversion import Inversion
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.materials import StVenantKirchhoff
from rigidfx.scene.scene import Scene
from rigidfx.step.newton.newton import Solution

T = TypeVar("T")
MAX_CUTS = 8  # a step is cut to at least 1/256 before it is given up
INVERTED = ". There det F ≤ 0 at an integration point, or a stretch is above 10⁶."


def overload(scene: Scene, t: float) -> str:
    """A load at t [s] on the surface that the material does not bear, or "". Collective."""
    for effect in scene.acting(t):
        pushed = effect.pushes(t)
        if pushed is None:
            continue
        where, size = pushed
        cells = scene.boundary(where, effect.kind)[:, 0]
        own = [m.stiffness for m, of in scene.materials if np.isin(of, cells).any()]
        softest = scene.comm.allreduce(min(own, default=np.inf), op=MPI.MIN)
        # E/√27 per undeformed area is the most that St.Venant-Kirchhoff's material bears in
        # compression: λE(λ² - 1)/2 at the stretch λ = 1/√3.
        if size > softest / (3 * 3**0.5):
            return (
                f"{effect.owner} has {size:.3g} Pa at t = {t:.6g} s, {size / softest:.2g} of the "
                f"stiffness of the material there, {softest:.3g} Pa: more than it bears. Are both "
                "in pascals (1 MPa is 1e6)? A load that grows slowly shows how far it goes."
            )
    return ""


@dataclass(frozen=True)
class Attempt:
    """A step that has been solved."""

    t: float  # time at its start [s]
    dt: float  # its length [s]
    solution: Solution  # how its equations were solved
    end: float  # time at its end [s]
    increments: Increments  # those of the rigid bodies
    cuts: int = 0  # how often the step was cut before
    # Whether its error in time is taken as it is: it cannot be cut any more, or repeats one that
    # was accepted, with other bodies
    final: bool = False


def not_converged(scene: Scene, attempt: Attempt) -> StepError | None:
    """The error of an attempt that Newton's method has not solved. Collective."""
    solution = attempt.solution
    if solution.converged:
        return None
    place, near = "", ""  # where nothing but bodies moves, no node has a residual
    if solution.place is not None:
        x, y, z = solution.place
        place = f" The largest residual is at the node X = ({x:.6g}, {y:.6g}, {z:.6g}) m."
        near = " near that place"
    return StepError(
        f"The step from t = {attempt.t:.9g} s did not converge, not even with "
        f"Δt = {attempt.dt:.3g} s ({solution.reason}: {solution.course}; residuals "
        f"{', '.join(f'{r:.2e}' for r in solution.residuals[:6]) or 'not finite'} N).{place}",
        overload(scene, attempt.t + attempt.dt)
        or f"Try a smaller Δt, look at loads, motors, supports, contacts and stops{near}, or "
        "add NumericalDamping.",
    )


def inverted(
    scene: Scene, inversion: Inversion, step: str, cut: str, end: float
) -> InversionError | None:
    """The error of a step, up to its end [s], that turns cells inside out. Collective."""
    turned = inversion.find()
    if turned is None:
        return None
    found = f"{step} turns cells inside out{cut}: {turned}{INVERTED}"
    return InversionError(found, f"{overload(scene, end)} {remedy(scene)}".strip())


class Cuts:
    """Cuts of steps, or load steps, that are objected to."""

    remembered: ClassVar[Remembered] = same("_trial", "_whole")

    def __init__(self) -> None:
        self._trial = np.inf  # length of the next attempt after a cut ...
        self._whole = np.inf  # ... of a step of this length

    def taken(
        self,
        t: float,
        target: float,
        solved: Callable[[float, float, int, bool], tuple[T, StepError | None]],
    ) -> T:
        """The first attempt at a step to the target, or towards it, without objection. Collective.

        The step begins at t [s]. A function gives an attempt and an objection to it, by its length
        and end [s], the number of cuts before it, and whether it is the last one, whose `StepError`
        is raised.
        """
        left = target - t
        if self._trial == np.inf:
            self._whole = left
        for cuts in count():
            dt = self._trial if longer(left, self._trial) else left
            last = not longer(dt, self._whole / 2**MAX_CUTS)
            found, objection = solved(dt, target if dt == left else t + dt, cuts, last)
            if objection is None:
                self._trial = np.inf if dt == left and cuts == 0 else 2 * dt
                return found
            if last:
                raise objection
            self._trial = dt / 2**objection.halvings
        raise AssertionError


def remedy(scene: Scene) -> str:
    """Advice against cells that are turned inside out."""
    remedies = "smaller loads, larger cells or NumericalDamping"
    if any(isinstance(material, StVenantKirchhoff) for material, _ in scene.materials):
        return (
            "St.Venant-Kirchhoff material does not resist strong compression: take NeoHooke there, "
            f"{remedies}."
        )
    return f"Try {remedies}."


class Watch:
    """Looks at each attempt that becomes a step."""

    def bind(self, flexible: Cells) -> None:
        """Look at these flexible cells from now on."""

    def refresh(self) -> None:
        """Be as one that a checkpoint has brought back: forget all but `remembered`."""

    def accept(self, attempt: Attempt) -> None:
        """Accept an attempt as a step; the state is that at its start. Collective."""


class WarnsOnce(Watch):
    """Looks for something that a user should know, and says it once.

    Attributes:
        waits: Whether nothing has been found yet.
    """

    remembered: ClassVar[Remembered] = same("waits")

    def __init__(self, comm: MPI.Intracomm) -> None:
        self._comm = comm
        self.waits = True

    def say(self, message: str) -> None:
        """Warn on rank 0, and look no more."""
        self.waits = False
        warn(self._comm, message)
