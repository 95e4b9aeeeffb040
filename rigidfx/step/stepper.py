"""One time step: state in, result out. A step that is objected to is cut and tried again."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import StepError
from rigidfx.base.remembered import PART, Remembered
from rigidfx.base.types import Bools
from rigidfx.coupling.dealt_rows import Dealing
from rigidfx.effects import Contact, Support, Touch, Windowed
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.inversion import Inversion, InvertedCells
from rigidfx.flexible.strain_rate import Indicator
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.step.equations.energies import Measures
from rigidfx.step.equations.supports import Impact, impose_velocity
from rigidfx.step.length.time_control import TimeControl
from rigidfx.step.system.rigid_motion import following_energy
from rigidfx.step.system.system import StepResult, System, Work
from rigidfx.step.watches.alternation import Alternation, Unresolved
from rigidfx.step.watches.cells import Compression, RotationPerStep
from rigidfx.step.watches.judge import Attempt, Cuts, Watch, inverted, not_converged
from rigidfx.step.watches.jumps import JumpingObstacles, Jumps


class Stepper:
    """Advances a state in time; a context manager that frees its PETSc objects.

    Before the first step it is bound to a division of the cells, and anew whenever that changes.

    Attributes:
        scene: The problem.
        state: The state, changed by `accept`.
        forces: Internal forces of the scene's cells.
        indicator: Indicator of flexible cells in each step; None if there is none.
        control: Chooses Δt by its error; None if nothing does.
        system: Everything that is bound to that division.
        watches: Observers of attempts that become steps; more may be added.
        cuts: Cuts steps.
    """

    remembered: ClassVar[Remembered] = {"cuts": PART, "watches": PART}

    def __init__(
        self,
        scene: Scene,
        state: State,
        forces: InternalForces,
        indicator: Indicator | None = None,
        control: TimeControl | None = None,
    ) -> None:
        """Compile the look for inverted cells; the state is u₀ of the forces. Collective."""
        self.scene, self.state, self.forces, self.indicator = scene, state, forces, indicator
        self._inversion = Inversion(scene, forces)
        self.control = control
        self.jumps = Jumps(scene, lambda: self.system.prescribed)
        obstacles = JumpingObstacles(scene, self.touches)
        self.alternation = Alternation(scene, forces)
        turning = RotationPerStep(scene, forces)
        others = Unresolved(scene), turning, self.alternation, self.jumps, obstacles
        squeezed = (Compression(scene, forces),) if scene.element.buckles else ()
        controls = () if control is None else (control,)
        self.watches: list[Watch] = [*others, *squeezed, *controls]
        self.cuts = Cuts()
        self._dealing = Dealing()
        self.system: System
        self._bound = False

    # What it is bound to ------------------------------------------------------------------------

    def bind(self, division: Division, acting: Sequence[Windowed]) -> None:
        """Bind a division of the cells and the effects that act from now on. Collective."""
        before = self.system if self._bound else None
        self._unbind()
        self._division = division
        self._inversion.bind(division.flexible)
        self.show()
        known = self.scene, self.forces, self.state, self.scene.effects, acting, division
        self.system = System("step", *known, dealing=self._dealing)
        if before is not None:
            self.system.newton.go_on(before.newton)
        if self.control is not None:
            self.control.follow(self.system, self.state)
        self._bound = True

    def renew(self) -> None:
        """Let the next division know nothing of the equations before it. Collective."""
        self._unbind()
        for watch in self.watches:
            watch.refresh()
        self.forces.u1.x.array[:] = self.state.u.x.array  # what rounding is estimated by

    def show(self) -> None:
        """Show watches the present division, those too that came after it. Collective."""
        if self.indicator is not None:
            self.indicator.bind(self._division.flexible)
        for watch in self.watches:
            watch.bind(self._division.flexible)

    def _unbind(self) -> None:
        """Free the equations, if there are any. Collective."""
        if self._bound:
            self.system.destroy()
            self._bound = False

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the current division."""
        return self.system.prolongation.size

    @property
    def flexible(self) -> Bools:
        """For each owned cell, whether it is flexible."""
        mask = np.zeros(self.scene.mesh.topology.index_map(3).size_local, dtype=bool)
        for cells in self._division.flexible.values():
            mask[cells] = True
        return mask

    def measure(self) -> Measures:
        """Energies and momenta of the current state. Collective."""
        return self.system.energies.measure(self.state)

    def inverted(self) -> InvertedCells | None:
        """Cells that the last solution has turned inside out. Collective."""
        return self._inversion.find()

    def touches(self) -> Mapping[str, Touch]:
        """Touches of contacts in the last attempt, by their titles. Collective."""
        return self.system.actions.touches()

    # Steps --------------------------------------------------------------------------------------

    def attempt(self, target: float, again: bool = False) -> Attempt:
        """Solve a step to the target time [s], or as far towards it as a cut one gets. Collective.

        The state stays as it is until `accept`. If one to there has been accepted, with other
        bodies, an attempt comes again, and its error in time is not objected to.

        Raises:
            SceneError: On every rank, if a user's function fails on any, or gives no numbers.
            StepError: If the step does not converge after all cuts.
            InversionError: If it turns cells inside out after all cuts.
        """
        t, system = self.state.t, self.system

        def solved(
            dt: float, end: float, cuts: int, last: bool
        ) -> tuple[Attempt, StepError | None]:
            solution = system.solve(self.state, dt)
            attempt = Attempt(t, dt, solution, end, system.increments, cuts, again or last)
            objection = self.objection(attempt)
            if objection is not None:
                system.explain(solution)
            return attempt, objection

        return self.cuts.taken(t, target, solved)

    def objection(self, attempt: Attempt) -> StepError | None:
        """The error that ends the run if no shorter step helps; None to accept. Collective."""
        step = f"The step from t = {attempt.t:.9g} s", f", even with Δt = {attempt.dt:.3g} s"
        return (
            not_converged(self.scene, attempt)
            or inverted(self.scene, self._inversion, *step, attempt.t + attempt.dt)
            or (None if self.control is None else self.control.objection(attempt))
        )

    def accept(self, attempt: Attempt) -> StepResult:
        """Let the state, and all else that remembers, take an attempt over. Collective."""
        if self.indicator is not None:
            self.indicator.measure(attempt.dt)
        for watch in self.watches:  # before u₀ becomes u₁
            watch.accept(attempt)
        return _result(attempt, self.system.accept_step(self.state, attempt.dt, attempt.end))

    def end(self) -> None:
        """Judge the motion of a run that is over. Collective."""
        self.alternation.end()

    @contextmanager
    def foreseen(self, attempt: Attempt) -> Iterator[StepResult]:
        """The result of the step; the state is that after it, in the context alone. Collective.

        The memory of two surfaces of their contact is that of before.
        """
        if self.indicator is not None:
            self.indicator.measure(attempt.dt)
        kept = self.state.snapshot()
        try:
            yield _result(attempt, self.system.foresee(self.state, attempt.dt, attempt.end))
        finally:
            self.state.restore(kept)

    def meet(self, supports: Sequence[Support], dt: float, before: Measures) -> Impact | None:
        """Give nodes the velocity of supports that begin, or jump; None if nothing changed.

        Energies and momenta were measured before. Δt is that of the next step, the scale of
        difference quotients [s]. Collective.
        """
        if not supports:
            return None
        self.state.forget_paths()  # the rate that an impact gives is the one just after it
        velocities = self.system.prescribed.velocities(self.state.t, dt, self.state.u.x.array)
        system = self.system
        jump = impose_velocity(self.scene, self.state, system.mass, system.layout, velocities)
        followed = system.lead_frames(self.state, dt)
        # A body that a support takes over loses what it has kept to the same impact.
        kept = self.state.stored - before.stored
        if jump is None and kept == 0.0 and not followed:
            return None
        u, names = self.state.u.x.array, (support.where for support in supports)
        following = 0.0 if jump is None else following_energy(self.scene, *jump, u)
        after = self.measure()
        energy, gained = after.kinetic - before.kinetic + kept, after.momenta_since(before)
        return Impact(self.state.t, tuple(names), energy, *gained, following)

    def press(self, contacts: Sequence[Contact], before: Measures) -> Impact | None:
        """The energy that contacts which begin or end bring in, if any. Collective."""
        gained = self.measure().contact - before.contact if contacts else 0.0
        if gained == 0.0:
            return None
        titles = tuple(contact.title for contact in contacts)
        return Impact(self.state.t, titles, gained, np.zeros(3), np.zeros(3), 0.0)

    # Life ---------------------------------------------------------------------------------------

    def close(self) -> None:
        """Free all PETSc objects. Collective."""
        self._unbind()
        self._dealing.destroy()


def _result(attempt: Attempt, work: Work) -> StepResult:
    return StepResult(**vars(work), dt=attempt.dt, solution=attempt.solution, cuts=attempt.cuts)
