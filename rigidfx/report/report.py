"""The report of a step and of its bodies, and the base of those who read reports of a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import nan
from typing import Any

import numpy as np
from dolfinx import fem

from rigidfx.base.errors import SceneError
from rigidfx.base.in_notebook import as_table, in_short
from rigidfx.base.inputs import shown
from rigidfx.base.named import Named
from rigidfx.base.sealed import read_only
from rigidfx.base.types import Array, Bools
from rigidfx.base.warning import warn
from rigidfx.flexible.strain_rate import Indicator
from rigidfx.flexible.stress import Added, CauchyStress, Recovered
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.rotation import skew
from rigidfx.report.events import Event
from rigidfx.report.ledger import Ledger
from rigidfx.report.probe_stress import Probes, StressAt
from rigidfx.report.writers import Writers
from rigidfx.shapes.bends import BOUND, off_by
from rigidfx.shapes.shortening import Shortening
from rigidfx.state import State
from rigidfx.step.equations.energies import Measures
from rigidfx.step.equations.supports import Impact
from rigidfx.step.system.system import StepResult
from rigidfx.withheld.recovery import Recovery


@dataclass(frozen=True)
class BodyReport:
    """A body at one time, rigid or with shapes.

    Attributes:
        name: Name of its set of cells, or "part" and its number.
        number: Its number ≥ 1, by which fields show it.
        cells: Number of its cells.
        mass: m [kg].
        centre: Position of the centre of mass, shape (3,) [m].
        orientation: Rotation R since it became rigid, shape (3, 3).
        velocity: Velocity of the centre of mass, shape (3,) [m/s].
        angular_velocity: ω in space, shape (3,) [rad/s].
        linear_momentum: m ṙ, shape (3,) [kg m/s].
        angular_momentum_about_centre: J ω, shape (3,) [kg m²/s].
        angular_momentum: Angular momentum about the origin, shape (3,) [kg m²/s].
        kinetic: Kinetic energy [J].
        stored: Energy that it keeps for its release; none if it has shapes [J].
        strain: Strain energy of a body with shapes [J].
        q: Coordinates of its shapes, shape (shapes,) [m].
        q_rate: Their rates, likewise [m/s].
        nu: ν, by which part of its strain energy that of its cells has differed from it, or half of
            its displacement by their forces of second order, at most so far, of a body with shapes.
        inertia_ratio: Largest ratio, about any axis, of its moment of inertia to the exact one of
            its cells: above 1 where masses are lumped.
        kinetic_excess: Kinetic energy that it has for this reason only [J].
    """

    name: str
    number: int
    cells: int
    mass: float
    centre: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array
    linear_momentum: Array
    angular_momentum_about_centre: Array
    angular_momentum: Array
    kinetic: float
    stored: float
    strain: float
    q: Array
    q_rate: Array
    nu: float
    inertia_ratio: float
    kinetic_excess: float

    @property
    def shapes(self) -> int:
        """Number of its shapes."""
        return len(self.q)


def _body_report(body: Body, own: Array, kinetic: float, strain: float, nu: float) -> BodyReport:
    """Report of a body with angular momentum [kg m²/s], kinetic and strain energy [J], and ν."""
    data, motion = body.data, body.motion
    W, momentum = motion.angular_velocity_body, data.mass * motion.velocity
    return BodyReport(
        name=data.name,
        number=data.number,
        cells=data.size,
        mass=data.mass,
        centre=motion.r,
        orientation=motion.R,
        velocity=motion.velocity,
        angular_velocity=motion.angular_velocity,
        linear_momentum=momentum,
        angular_momentum_about_centre=own,
        angular_momentum=skew(motion.r) @ momentum + own,
        kinetic=kinetic,
        stored=data.frozen.energy if data.shapes is None else 0.0,
        strain=strain,
        q=motion.q,
        q_rate=motion.q_rate,
        nu=nu,
        inertia_ratio=data.inertia_ratio,
        kinetic_excess=float(0.5 * W @ data.excess @ W),
    )


@dataclass(frozen=True)
class Source:
    """What a report computes further values from, as long as the run has not gone on."""

    state: State  # the state of the run
    changes: int  # the number of its changes at the report
    indicator: Indicator | None  # measures strain rates, if any are
    probes: Probes  # points that are reported
    # Displacements of second order of bodies with shapes; not shown if None
    shortening: Shortening | None
    recovery: Recovery | None  # strains withheld from rigid parts, if known


# Results of the error motion, for one release: bodies have shapes in its place.
FORMER = {
    "error_motion": "probes",
    "error_reactions": "reactions",
    "error_reaction_moments": "reaction_moments",
    "error_touches": "touches",
}


@dataclass(frozen=True, kw_only=True)
class Report:
    """One accepted step, a value that may be kept; numbers are equal on all ranks.

    The first report of a run is that of the initial state, t = 0. A wrong name, as in
    `report.joints["pivto"]`, raises a KeyError that lists the names.

    Attributes of its records are the report's, too, as `report.kinetic`: of `energies` `kinetic`,
    `strain`, `stored`, `springs`, `contact`, `energy`, `linear_momentum`, `angular_momentum` and
    `momentum_scale`; of `result` `dt` (0 for the initial state), `cuts`, `work_of_loads`,
    `work_of_supports`, `dissipated`, `reactions`, `reaction_moments`, `alternating_impulse`,
    `touches`, `joints` and `spring_dampers`; and of its solution `iterations`, `residuals`,
    `tangents`, `linear_iterations` and `solver`. In the initial state reactions are those of a
    static preload, touches are zero, and joints and springs tell nothing.

    Arrays as large as the mesh, `state` and `strain_rate`, are not copied: they can be read until
    the run goes on.

    Attributes:
        step: Number of the step; 0 is the initial state.
        t: Time at its end [s].
        unknowns: Number of unknowns of the step.
        energies: Energies and momenta at its end: `rigidfx.step.equations.energies.Measures`.
        result: Work, forces and solution: `rigidfx.step.system.system.StepResult`. Works contain
            those at events.
        impact: Impact of a support that starts, or jumps in velocity, at the step's start; at t = 0
            in the report of the initial state.
        rigid: The bodies at its end, rigid or with shapes, as arrays.
        clamped: Names of `Rigid` parts that a support holds: they follow the support, have
            no unknowns, and are not among the bodies.
        events: Freezes and releases since the last report: before the step, and at its end.
            Energies, momenta and bodies of the report are those after these events.
        closeness: Least |ε/tol - 1| of all cells at the end of a window, ε their strain rate:
            how close the decision was. NaN if no window ended in the step.
        probes: Displacement of each probe, shape (3,) [m]: that of `state`, and how bending
            shortens bodies with shapes: see `rigidfx.shapes.shortening`.
        velocities: Velocity of each probe, shape (3,) [m/s]; in a rigid part that of the part.
        ledger: Errors and energies so far; None in a run with given Δt.
        wall: Wall time of the step [s].
        nu: How far each body with shapes was from small, by its name: see `BodyReport.nu`.
    """

    step: int
    t: float
    unknowns: int
    energies: Measures
    result: StepResult
    impact: Impact | None
    rigid: Bodies
    clamped: tuple[str, ...]
    events: tuple[Event, ...] = ()
    closeness: float = nan
    probes: Mapping[str, Array]
    velocities: Mapping[str, Array]
    ledger: Ledger | None = None
    wall: float = 0.0
    nu: Mapping[str, float] = field(default_factory=dict)
    _source: Source
    _writers: Writers = field(default_factory=Writers, repr=False, compare=False)

    def __getattr__(self, name: str) -> Any:
        """An attribute of the records of a step."""
        if name in FORMER:
            return self._former(name)
        result = vars(self).get("result")
        for record in (vars(self).get("energies"), result, getattr(result, "solution", None)):
            if not name.startswith("_") and hasattr(record, name):
                return getattr(record, name)
        raise AttributeError(f"'Report' object has no attribute '{name}'")

    def __dir__(self) -> list[str]:
        """Attributes of the report and of its records."""
        return [*super().__dir__(), *dir(self.energies), *dir(self.result), *dir(self.solution)]

    def _former(self, name: str) -> Mapping[str, Array]:
        whole = FORMER[name]
        warn(
            self._source.state.u.function_space.mesh.comm,
            f"report.{name} is zero: bodies deform by shapes, and report.{whole} has all of it. "
            "Leave it out, as the next release does not have it.",
        )
        keys = self.probes if whole == "probes" else ()
        return Named(f"report.{name}", {key: np.zeros(3) for key in keys})

    def __repr__(self) -> str:
        """Step, time, size and energy, in a line."""
        return (
            f"<Report: step {self.step}, t = {self.t:.6g} s, {self.unknowns} unknowns, "
            f"{self.iterations} iterations, {self.energy:.4g} J>"
        )

    def _repr_html_(self) -> str:
        """The step in a notebook: sizes, energies, probes and reactions."""
        rows = {
            "unknowns": f"{self.unknowns}, {len(self.bodies)} rigid bodies",
            "solver": f"{self.iterations} iterations, {self.solver}",
            "energy [J]": f"{self.energy:.6g} = kinetic {self.kinetic:.4g} + strain "
            f"{self.strain:.4g} + stored {self.stored:.4g} + springs {self.springs:.4g} "
            f"+ contact {self.contact:.4g}",
        }
        rows |= {f"u of {name} [m]": in_short(u) for name, u in self.probes.items()}
        rows |= {f"reaction of {name} [N]": in_short(f) for name, f in self.reactions.items()}
        return as_table(f"step {self.step}, t = {self.t:.6g} s", rows)

    @property
    def supplied(self) -> float:
        """Energy that loads, supports and impacts give, less the energy dissipated [J]."""
        given = self.work_of_loads + self.work_of_supports - sum(self.dissipated.values())
        return given + (self.impact.energy if self.impact else 0.0)

    @property
    def impulse(self) -> Array:
        """Impulse of supports on the structure besides their reactions, shape (3,) [N s].

        By the impact at the step's start, by the events, and on velocities that alternate. With Δt
        times reactions and loads it is the change of the linear momentum.
        """
        return self._at_instants("impulse") + self.alternating_impulse[0]

    @property
    def angular_impulse(self) -> Array:
        """Its moment about the origin, shape (3,) [N m s]."""
        return self._at_instants("angular_impulse") + self.alternating_impulse[1]

    def _at_instants(self, name: str) -> Array:
        instants = (*self.events, *([self.impact] if self.impact else []))
        return np.asarray(sum((getattr(instant, name) for instant in instants), np.zeros(3)))

    @cached_property
    def bodies(self) -> tuple[BodyReport, ...]:
        """The bodies, rigid or with shapes."""
        rigid = self.rigid
        own = rigid.angular_momentum, rigid.kinetic_of_each, rigid.strain_of_each
        every = [self.nu.get(data.name, 0.0) for data in rigid.of.records]
        return tuple(
            _body_report(body, np.asarray(J), float(kinetic), float(strain), nu)
            for body, J, kinetic, strain, nu in zip(rigid, *own, every, strict=True)
        )

    @property
    def current(self) -> bool:
        """Whether the run has not gone on since."""
        return self._source.state.changes == self._source.changes

    @property
    def state(self) -> State:
        """Displacement and velocity; read, do not change.

        `state.rebuild()` brings nodes inside bodies up to date.

        Raises:
            SceneError: If the run has gone on.
        """
        self._check("state")
        return self._source.state

    @property
    def strain_rate(self) -> Array | None:
        """Strain rate of each owned cell of this rank in the step [1/s], zero in bodies.

        None where it is not measured.

        Raises:
            SceneError: If it is measured and the run has gone on.
        """
        if self._source.indicator is None:
            return None
        self._check("strain_rate")
        return read_only(self._source.indicator.values)

    @cached_property
    def stresses(self) -> Mapping[str, StressAt]:
        """Stress and strain at each probe, by its name. Collective.

        They are those at nodes, extrapolated and averaged within the material of the probe's cell
        (`rigidfx.flexible.nodal_stress`). Computed when read, from the cells around the probes
        only; the first time compiles its forms. Those of parts named rigid are recovered, if that
        is known: see `recovered_stress`.

        Raises:
            SceneError: If they have not been asked for yet and the run has gone on.
        """
        self._check("stresses")
        strained = None if self._source.recovery is None else self._source.recovery.recovered
        found = self._source.probes.stresses(self._source.state, strained)
        return Named("report.stresses", found)

    @property
    def interface_mismatch(self) -> float:
        """Largest difference of velocities where flexible cells meet bodies [m/s]. Collective.

        With a consistent mass the two sides of an interface have velocities of their own; as
        displacements are the same, these differ by second order in Δt. Computed when it is asked
        for; zero with a lumped mass.

        Raises:
            SceneError: If the run has gone on.
        """
        self._check("interface_mismatch")
        return self._source.state.interface_mismatch()

    @property
    def recovers(self) -> bool:
        """Whether the withheld strain of rigid parts is known: where forces wake cells."""
        return self._source.recovery is not None

    def strains(self) -> Recovered | None:
        """Strains of cells whose displacement alone does not tell them; None if none. Collective.

        Raises:
            SceneError: If the run has gone on.
        """
        deforms = self.rigid.of.shapes is not None
        return self.recovered() if self.recovers or deforms else None

    def recovered(self) -> Recovered:
        """The displacement with the strain that loads would give rigid parts. Collective.

        No part of the motion or of its energy has that. Computed when it is asked for, by one
        solve; see `recovered_stress`.

        Returns:
            The displacement, right inside these parts [m], which owned cells they are, and where
            it is a linear response.

        Raises:
            SceneError: If the run has gone on.
        """
        self._check("recovered")
        self._source.state.rebuild()
        u = self._source.state.u.copy()
        count = u.function_space.mesh.topology.index_map(3).size_local
        if self._source.recovery is None:
            none = np.zeros(count, dtype=bool)
            return Recovered(u, none, none, self._added())
        added = self._added()
        carried = self._source.recovery.recovered()
        u.x.array[: carried.u.size] += carried.u.reshape(-1)
        u.x.scatter_forward()
        return Recovered(u, *carried.among(count), added)

    def _added(self) -> Added | None:
        """Strains of parts with shapes; None if there are none. Collective."""
        return None if self.rigid.of.shapes is None else Added(*self._source.state.bent())

    def shown(self) -> tuple[fem.Function, fem.Function]:
        """Displacement [m] and velocity [m/s], as of `probes`, also inside bodies. Collective.

        Raises:
            SceneError: If the run has gone on.
        """
        self._check("shown")
        self._source.state.rebuild()
        shortening, bodies = self._source.shortening, self._source.state.bodies
        more = None if shortening is None else shortening.field(bodies)
        u, v = self._source.state.u, self._source.state.v
        return (u, v) if more is None else (_with(u, more[0]), _with(v, more[1]))

    def to_start_from(self) -> fem.Function:
        """Displacement [m] as `shown`, in which bodies with shapes are not too long by any bend.

        A warning tells of bodies whose cells are strained otherwise there. Collective.
        """
        self._source.state.rebuild()
        u, bodies, shortening = self._source.state.u, self.rigid, self._source.shortening
        if shortening is None:
            return u
        more = shortening.field(bodies, every=True)
        moved = None if more is None else more[0]
        for name, excess in shortening.excess(bodies, moved).items():
            if abs(excess) > off_by(BOUND):
                warn(
                    u.function_space.mesh.comm,
                    f"'{name}': what begins at t = {self.t:.4g} s begins where its cells "
                    f"have {excess:+.1%} of strain energy beside that of its shapes, as shapes do "
                    "not tell how a bend shortens it between joints or round a Rigid part. "
                    "Frequencies err by as much, or more. Leave it flexible.",
                )
        return u if moved is None else _with(u, moved)

    @property
    def finds_bodies(self) -> bool:
        """Whether the run looks for parts that become rigid."""
        return self._source.indicator is not None

    def _check(self, name: str) -> None:
        if not self.current:
            now = self._source.state.t
            raise SceneError(
                f"Report.{name}: the report is of t = {self.t:g} s, and the run has gone on to "
                f"{now:g} s. Ask before the next step, and keep a copy of what you need."
            )


def _with(field: fem.Function, more: Array) -> fem.Function:
    """A field with more at owned nodes, shape (nodes, 3). Collective."""
    out = field.copy()
    out.x.array[: more.size] += more.reshape(-1)
    out.x.scatter_forward()
    return out


def recovered_stress(report: Report, stress: CauchyStress) -> tuple[Array, Bools]:
    """Cauchy stress of all cells at a report, recovered in rigid parts. Collective.

    A rigid part keeps the stress that it was frozen with. In parts named rigid the forces on their
    nodes add that of a static response, K⁺ρ (docs/theory/shapes.md). All stresses shown contain
    this: of cells, at nodes, at probes and at integration points. Each is evaluated from one
    displacement in rigid cells and another in flexible ones, as they share nodes; a node takes the
    mean of both.

    Args:
        report: The newest report of its run.
        stress: The stress measure of the run's scene.

    Returns:
        Stress of each owned cell, shape (cells, 3, 3) [Pa], and whether it was recovered: in
        parts named `Rigid` of a run with `wake="local"`, from the first step on.

    Raises:
        SceneError: If the run has gone on, or one of them is anything else.
    """
    if not isinstance(report, Report):
        raise SceneError(f"recovered_stress: report must be a Report, got {type(report).__name__}.")
    if not isinstance(stress, CauchyStress):
        raise SceneError(
            f"recovered_stress: stress must be CauchyStress(scene), made once, got {shown(stress)}."
        )
    state = report.state
    if stress.mesh is not state.u.function_space.mesh:
        raise SceneError("recovered_stress: stress is that of a scene on another mesh.")
    state.rebuild()
    recovered = report.recovered()
    return stress.measure(state.u, recovered), recovered.cells


class Look:
    """Looks at each report for something that a user should know."""

    def follow(self, report: Report) -> None:
        """Look at the next report, that of the initial state first. Collective."""
        raise NotImplementedError

    def end(self) -> None:
        """End with the run. Collective."""
