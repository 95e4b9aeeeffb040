"""One time step: state in, result out. A step that does not converge is cut and tried again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from types import TracebackType
from typing import Literal

import numpy as np
import numpy.typing as npt

from rigidfx import effects as fx
from rigidfx.base.errors import InversionError, StepError
from rigidfx.decide.decision import Part
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.inversion import Inversion
from rigidfx.flexible.strain_rate import StrainRates
from rigidfx.mechanics.materials import StVenantKirchhoff
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.report.events import BodyChange, Event
from rigidfx.scene.scene import Scene
from rigidfx.state import State, initial_velocity
from rigidfx.step.energies import Measures
from rigidfx.step.equations import Solution
from rigidfx.step.preload import apply_preload
from rigidfx.step.supports import Impact, PrescribedDofs, impose_velocity, supports_of
from rigidfx.step.system import System
from rigidfx.switch.consistent_exchange import ConsistentExchange
from rigidfx.switch.exchange import Exchange, LumpedExchange, Selection
from rigidfx.switch.inventory import Parts, check_clamps, named_parts

__all__ = ["Integrator", "StepResult"]

MAX_CUTS = 8  # a step is cut to at least 1/256 before it is given up
INVERTED = ". There det F ≤ 0 at an integration point, or a stretch is above 10⁶."


@dataclass(frozen=True)
class StepResult:
    """What one accepted step did.

    Attributes:
        dt: Its length [s].
        solution: How its equations were solved.
        cuts: How often it was cut before it converged.
        work_of_loads: f_ext·Δu [J].
        work_of_supports: Work of the reactions [J].
        dissipated: Energy taken by each kind of damping [J].
        reactions: Force each support exerts on the structure at the midpoint, shape (3,) [N].
        reaction_moments: Its moment about the origin, shape (3,) [N m].
        impact: Velocity taken over from a support that began at the start of the step.
        strain_rates: Flexible owned cells and their strain rates [1/s], if they are measured.
    """

    dt: float
    solution: Solution
    cuts: int
    work_of_loads: float
    work_of_supports: float
    dissipated: Mapping[str, float]
    reactions: Mapping[str, npt.NDArray[np.float64]]
    reaction_moments: Mapping[str, npt.NDArray[np.float64]]
    impact: Impact | None
    strain_rates: tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]] | None


class Integrator:
    """Advances a state in time; a context manager that frees its PETSc objects.

    Attributes:
        scene: The problem.
        state: The state, changed by `step` only.
    """

    def __init__(
        self, scene: Scene, dt: float, measure: Literal["rms", "printed"] | None = None
    ) -> None:
        """Compile the forms, assemble mass and loads, set the initial state. Collective.

        Args:
            scene: The problem.
            dt: Nominal Δt [s].
            measure: How strain rates are measured, if at all.

        Raises:
            SceneError: If the initial velocity contradicts a support, or a preload is not held.
            StepError: If the static preload does not converge.
        """
        self.scene, self.state = scene, State(scene)
        velocity = initial_velocity(scene, dt)
        self._resolution = 1e-9 * dt
        check_clamps(scene, self._resolution)
        self._trial = np.inf  # length of the next attempt after a cut ...
        self._whole = dt  # ... of a step of this length
        self._forces = InternalForces(scene, self.state.u, self._resolution)
        self._rates = StrainRates(scene, self._forces, measure) if measure else None
        self._inversion = Inversion(scene, self._forces)
        kind = LumpedExchange if scene.mass == "lumped" else ConsistentExchange
        self._exchange: Exchange = kind(scene, self._forces)
        self._acting = scene.acting(0.0, self._resolution)
        self._pending = self._breakpoints_after(0.0)
        apply_preload(scene, self._forces, self.state, PrescribedDofs(scene, self._supports))
        self.state.v.x.array[:] = velocity.reshape(-1)
        self._system = self._bind(named_parts(scene, self._forces, self.state, self._supports))
        self._impact = self._begin(self._supports, dt, self.measure())
        if scene.named(fx.Preload) and (turned := self._inversion.find()) is not None:
            self.close()
            found = f"The static preload turns cells inside out: {turned}{INVERTED}"
            raise InversionError(found, _remedy(scene))

    @property
    def _supports(self) -> tuple[fx.Support, ...]:
        return supports_of(self._acting)

    def _breakpoints_after(self, t: float) -> tuple[float, ...]:
        """Breakpoints of the effects later than t [s], and infinity, sorted."""
        later = (b for b in self.scene.breakpoints if b > t + self._resolution)
        return (*later, np.inf)

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the current layout."""
        return self._system.equilibrium.prolongation.size

    @property
    def flexible(self) -> npt.NDArray[np.bool_]:
        """For each owned cell, whether it is flexible."""
        mask = np.zeros(self.scene.mesh.topology.index_map(3).size_local, dtype=bool)
        for cells in self._flexible.values():
            mask[cells] = True
        return mask

    @property
    def supported_nodes(self) -> npt.NDArray[np.bool_]:
        """For each owned node, whether a support holds any of its components."""
        return np.asarray(self._prescribed.mask.reshape(-1, 3).any(axis=1))

    @property
    def strain_rate(self) -> npt.NDArray[np.float64] | None:
        """Strain rate of each owned cell in the last step [1/s], if it is measured."""
        return self._rates.values if self._rates is not None else None

    @property
    def strain_error(self) -> float:
        """Strain that the end of Newton's iteration may leave in a cell."""
        return self._system.equilibrium.strain_error

    def measure(self) -> Measures:
        """Energies and momenta of the current state. Collective."""
        return self._system.energies.measure(self.state)

    def step(self, target: float) -> StepResult:
        """Advance to the target time, or as far towards it as a cut step gets. Collective.

        Args:
            target: Time at which the step is to end [s].

        Raises:
            SceneError: If a load takes a value that is not finite.
            StepError: If the step does not converge after all cuts.
            InversionError: If it turns cells inside out after all cuts.
        """
        left = target - self.state.t
        self._follow_effects(left)
        cuts, solution, turned = 0, None, None
        if self._trial == np.inf:
            self._whole = left
        dt = np.inf
        while dt > self._whole / 2**MAX_CUTS * (1 + 1e-9):
            dt = left if self._trial >= left * (1 - 1e-9) else self._trial
            solution = self._system.solve(self.state, dt)
            turned = self._inversion.find() if solution.converged else None
            if solution.converged and turned is None:
                self._trial = np.inf if dt == left and cuts == 0 else 2 * dt
                return self._accept(dt, target if dt == left else self.state.t + dt, solution, cuts)
            cuts += 1
            self._trial = dt / 2
        assert solution is not None
        if turned is not None:
            raise InversionError(
                f"The step from t = {self.state.t:.9g} s turns cells inside out, even with "
                f"Δt = {dt:.3g} s: {turned}{INVERTED}",
                _remedy(self.scene),
            )
        x, y, z = solution.place if solution.place is not None else (np.nan,) * 3
        raise StepError(
            f"The step from t = {self.state.t:.9g} s did not converge, not even with "
            f"Δt = {dt:.3g} s ({solution.reason}; residuals "
            f"{', '.join(f'{r:.2e}' for r in solution.residuals[:6]) or 'not finite'} N). "
            f"The largest residual is at the node X = ({x:.6g}, {y:.6g}, {z:.6g}) m.",
            "Try a smaller Δt, look at loads and supports near that place, or add "
            "NumericalDamping.",
        )

    def _accept(self, dt: float, t: float, solution: Solution, cuts: int) -> StepResult:
        rates = None
        if self._rates is not None:  # before u₀ becomes u₁
            rates = self._rates.cells, self._rates.measure(dt)
        work = self._system.accept(self.state, dt, t)
        return StepResult(
            dt=dt,
            solution=solution,
            cuts=cuts,
            work_of_loads=work.loads,
            work_of_supports=work.supports,
            dissipated=work.dissipated,
            reactions=work.reactions,
            reaction_moments=work.reaction_moments,
            impact=self.take_impact(),
            strain_rates=rates,
        )

    def take_impact(self) -> Impact | None:
        """What the start of a support did since this was last asked."""
        impact, self._impact = self._impact, None
        return impact

    # DofLayout ----------------------------------------------------------------------------------

    def _bind(self, parts: Parts) -> System:
        self.state.bodies, self.state.motions = parts.bodies, parts.motions
        self.state.clamped = parts.clamped
        prescribed = PrescribedDofs(self.scene, self._supports, parts.carried_nodes)
        self._prescribed, self._flexible = prescribed, parts.flexible
        if self._rates is not None:
            self._rates.bind(parts.flexible)
        self._inversion.bind(parts.flexible)
        return System(
            self.scene,
            self._forces,
            self.state,
            self._acting,
            parts.flexible,
            prescribed,
            parts.carried_cells,
        )

    def regroup(
        self,
        parts: Sequence[Part],
        apart: Set[str],
        kind: Literal["freeze", "release"],
        reason: str,
    ) -> Event | None:
        """Release and freeze, so that the given parts are the bodies from now on. Collective.

        Args:
            parts: The bodies.
            apart: Names of bodies that are to stay as they are, whether among the parts or not.
            kind: What is reported.
            reason: What is reported.

        Returns:
            What happened; None if nothing did.
        """
        state, scene = self.state, self.scene
        old = {body.number: body for body in state.bodies if body.name not in apart}
        kept = {part.number for part in parts if part.kept}
        if len(kept) == len(parts) == len(old):
            return None
        before, unknowns, prescribed = self.measure(), self.unknowns, self._prescribed.mask
        self._exchange.release(state, old.keys() - kept, prescribed)
        for part in parts:
            if not part.kept:
                cells, nodes = part.region.cells, part.region.nodes
                what = Selection(cells, nodes, part.name, part.number, part.named)
                self._exchange.freeze(state, what, prescribed)
        found = [
            (body, motion)
            for body, motion in zip(state.bodies, state.motions, strict=True)
            if body.name not in apart
        ]
        self._system.destroy()
        self._system = self._bind(named_parts(scene, self._forces, state, self._supports, found))
        new = {body.number: body for body, _ in found}
        changes = _changes(old, new)
        if not changes:  # what was to freeze could not be a body
            return None
        after = self.measure()
        linear = after.linear_momentum - before.linear_momentum
        angular = after.angular_momentum - before.angular_momentum
        return Event(
            t=state.t,
            kind=kind,
            reason=reason,
            changes=changes,
            unknowns_before=unknowns,
            unknowns_after=self.unknowns,
            energy_frozen=max(after.stored - before.stored, 0.0),
            energy_released=max(before.stored - after.stored, 0.0),
            energy_lost=before.energy - after.energy,
            linear_momentum_error=float(np.linalg.norm(linear)),
            angular_momentum_error=float(np.linalg.norm(angular)),
        )

    def _follow_effects(self, dt: float) -> None:
        """Bind anew where an effect begins or ends; meet jumps of prescribed motion."""
        t, before = self.state.t, self._acting
        if t < self._pending[0] - self._resolution:
            return
        self._pending = self._breakpoints_after(t)
        now = self.scene.acting(t, self._resolution)
        known = {id(effect) for effect in before}
        jumping = tuple(
            s
            for s in supports_of(now)
            if id(s) not in known or any(abs(t - b) <= self._resolution for b in s.breakpoints)
        )
        # A body that a support takes over must count as the body here: interface nodes of the
        # flexible side have velocities of their own.
        measures = self.measure() if jumping else None
        self._acting = now
        if not self._system.follow(now):
            self.state.rebuild()
            self._system.destroy()
            # A support may take named bodies over, and others do not outlast its start and end.
            same = supports_of(now) == supports_of(before)
            pairs = zip(self.state.bodies, self.state.motions, strict=True)
            found = list(pairs) if same else []
            parts = named_parts(self.scene, self._forces, self.state, self._supports, found)
            self._system = self._bind(parts)
        if measures is not None:
            self._impact = self._begin(jumping, dt, measures) or self._impact

    def _begin(
        self, supports: tuple[fx.Support, ...], dt: float, before: Measures
    ) -> Impact | None:
        """Meet the velocity of supports that begin; the difference goes to the ledger."""
        if not supports:
            return None
        velocities = self._prescribed.velocities(self.state.t, dt)
        layout, mass = self._system.layout, self._system.mass
        if not impose_velocity(self.scene, self.state, mass, layout, velocities):
            return None
        after = self.measure()
        return Impact(
            self.state.t,
            tuple(s.where for s in supports),
            after.kinetic - before.kinetic,
            after.linear_momentum - before.linear_momentum,
            after.angular_momentum - before.angular_momentum,
        )

    # Life ---------------------------------------------------------------------------------------

    def close(self) -> None:
        """Free all PETSc objects. Collective."""
        self._system.destroy()

    def __enter__(self) -> Integrator:
        """Nothing to do: all is made at construction."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Free all PETSc objects."""
        self.close()


def _remedy(scene: Scene) -> str:
    """What may help against cells that are turned inside out."""
    remedies = "smaller loads, larger cells or NumericalDamping"
    if any(isinstance(material, StVenantKirchhoff) for material, _ in scene.materials):
        return (
            "St.Venant-Kirchhoff material does not resist strong compression: take NeoHooke there, "
            f"{remedies}."
        )
    return f"Try {remedies}."


def _changes(old: Mapping[int, RigidBody], new: Mapping[int, RigidBody]) -> tuple[BodyChange, ...]:
    """How bodies before and after an event differ, by number."""
    changes = []
    for number in sorted(old.keys() | new.keys()):
        before, after = old.get(number), new.get(number)
        if before is after:
            continue
        changes.append(
            BodyChange(
                name=(after or before).name,  # type: ignore[union-attr]
                number=number,
                cells_before=before.size if before else 0,
                cells_after=after.size if after else 0,
                stored_before=before.frozen.energy if before else 0.0,
                stored_after=after.frozen.energy if after else 0.0,
            )
        )
    return tuple(changes)
