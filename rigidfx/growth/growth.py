"""Bodies that were found and get shapes as forces call for them: docs/theory/waking.md, rule 4.

Where a displacement is bounded in place of a strain rate, (4), accuracy is relative to the largest
one up to the end of the step, or to the largest e that is now a shape: where a load begins, that is
the motion to come.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isclose
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.log import tell
from rigidfx.base.remembered import PART, Each, Record, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.limits import Limits, part_of
from rigidfx.flexible.strain_rate import CellStrains, Indicator
from rigidfx.growth.found_bodies import FoundBodies, Looked
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.shapes.bends import SHARE, at_cells
from rigidfx.shapes.ritz import DEPTH, RESOLVED, ritz
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.fields import Fields, Force, dots
from rigidfx.withheld.fields import size as size_of

OUTGROWN = "forces strain them otherwise than their shapes can"
RESONANT = "motions that their shapes lack may be in resonance"

# Numbers of the loop, from runs of demos/benchmarks/waking.py beside flexible twins.
GATE = 0.5  # part of the tolerance up to which no response is solved for, by the last ratio
EVERY = 20  # steps after which one is solved for in any case, and over which Ω is a mean
WAKES = 3.0  # tolerances above which cells wake, if two more shapes in a step have not halved it
GROWN = 24  # shapes beside the modes with which a body is full
WOKEN = 0.5  # tolerances above which a cell wakes then
# Periods in which a vibration falls to 1/e, as with 1.6 % of critical damping: what is in tune, or
# out of phase, adds up for as long.
PERIODS = 10.0
# ΩΔt that rounding may make of none.
LEAST = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True)
class Tuned:
    """What a body may have built up, and what tells the frequency of its forces."""

    origin: Array  # the body's; if it loses cells it is another one
    momenta: Force  # s [kg m/s]
    off: Force  # w [kg m/s]
    last: Force  # ρ⊥ of the last step [N]
    change: Force  # its change in that step
    before: Force  # that in the step before
    square: float  # sums of products of changes
    product: float  # likewise
    steps: int  # how many there were in steps of one length ...
    dt: float  # ... which this is [s]
    frequency: float  # Ω, 0 while unknown [1/s]

    @classmethod
    def begun(cls, origin: Array, none: Force) -> "Tuned":
        """Nothing has built up."""
        return cls(origin, none, none, none, none, none, 0.0, 0.0, 0, 0.0, 0.0)

    def followed(self, fields: Fields) -> "Tuned":
        """The same with the fields that the body has now. Collective."""
        names = ("momenta", "off", "last", "change", "before")
        forces: dict[str, Any] = {name: fields.followed(getattr(self, name)) for name in names}
        return replace(self, **forces)


_FORCE = Record(Force, "beside")


class Resonance:
    """Momenta that withheld forces may have built up in modes which bodies lack.

    In the worst case all that is withheld is in tune with a mode that is not known, and has gained
    by now the momenta s of one oscillator at each node,

        ṡ = -Ω w ,  ẇ = Ω s - ρ̇⊥/Ω ,    cos ΩΔt = Σ d₁·(d₀ + d₂) / (2 Σ d₁·d₁) ,

    with w how far it is off its balance, times its mass and Ω, and with Ω by three changes d of ρ⊥
    from step to step, in steps of one length. Ω is a mean over some steps.
    """

    remembered: ClassVar[Remembered] = {
        "_of": Each(Tuned, momenta=_FORCE, off=_FORCE, last=_FORCE, change=_FORCE, before=_FORCE)
    }

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._of: dict[int, Tuned] = {}  # by number

    def lasting(self, fields: Fields) -> tuple[float, Force] | None:
        """Ω [1/s], and the forces 2 Ω s on a body; None while Ω is not known. Collective."""
        known = self._known(fields)
        if known is None or not known.frequency > 0:
            return None
        return known.frequency, 2 * known.frequency * fields.followed(known.momenta)

    def _known(self, fields: Fields) -> Tuned | None:
        known = self._of.get(fields.data.number)
        same = known is not None and np.array_equal(known.origin, fields.data.origin)
        return known if same else None

    def advance(
        self, forces: Sequence[tuple[Fields, Force]], lacking: Mapping[int, float], dt: float
    ) -> None:
        """Advance by Δt with ρ⊥ of bodies and the lowest ω that each lacks [1/s]. Collective."""
        known, pairs, out = [], [], {}
        for fields, force in forces:
            before = self._known(fields) or Tuned.begun(fields.data.origin, 0.0 * force)
            own = before.followed(fields)
            change = force - own.last
            known.append((fields.data.number, force, own, change))
            pairs += [(fields, 2.0 * own.change, own.change)]
            pairs += [(fields, change + own.before, own.change)]
        products = dots(self._scene, pairs).reshape(-1, 2)
        for (number, force, own, change), new in zip(known, products, strict=True):
            even = isclose(dt, own.dt)
            kept = np.array([own.square, own.product]) * (1 - 1 / EVERY) * even
            square, product = kept + new * (even and own.steps > 2)
            omega = own.frequency
            if square > 0:
                angle = float(np.arccos(np.clip(product / square, -1.0, 1.0)))
                omega = max(angle, LEAST) / dt
            momenta, off = self._built_up(own, float(omega > lacking[number]) * change, omega, dt)
            out[number] = Tuned(
                own.origin,
                momenta,
                off,
                last=force,
                change=change,
                before=own.change,
                square=float(square),
                product=float(product),
                steps=1 + own.steps * int(even),
                dt=dt,
                frequency=omega,
            )
        self._of = out

    def _built_up(self, own: Tuned, change: Force, omega: float, dt: float) -> tuple[Force, Force]:
        """s and w of a body after a step in which its force has changed at its start."""
        if not omega > 0:
            return own.momenta, own.off
        s, w = own.momenta, own.off - (1 / omega) * change
        c, sine = np.cos(omega * dt), np.sin(omega * dt)
        left = np.exp(-omega * dt / 2 / np.pi / PERIODS)
        return left * (c * s - sine * w), left * (c * w + sine * s)


class Growth(Watch):
    """Lets bodies that were found grow shapes; `destroy` frees the PETSc objects of these.

    Attributes:
        found: The bodies that were found, with their shapes.
    """

    remembered: ClassVar[Remembered] = same(
        "_ratio", "_asked", "_since", "_swing", "_foreseen", "_lacks"
    ) | {"found": PART, "_resonance": PART}

    def __init__(
        self, stepper: Stepper, forces: BodyForces, indicator: Indicator, dt: float
    ) -> None:
        """Nothing has grown: see `FoundBodies`. An indicator of its own measures strains."""
        self._stepper, self._forces, self._scene = stepper, forces, stepper.scene
        self.found = FoundBodies(stepper, forces, dt)
        self._strains = CellStrains(self._scene, stepper.forces, indicator)
        self._cells = self._scene.mesh.topology.index_map(3).size_local  # owned ones
        self._resonance = Resonance(self._scene)
        self._swing = np.inf
        self._withheld: list[tuple[Fields, Force]] = []  # ρ⊥ as last seen
        self._ratio, self._since = np.inf, 0
        self._asked = np.inf  # size of the forces of that ratio
        self._foreseen = 0.0  # largest static response that has become a shape [m]
        self._lacks = 0.0  # largest 2 |e| so far [m]
        self._added: dict[int, tuple[float, ...]] = {}  # what called for shapes in this step

    def look(self, attempt: Attempt, limits: Callable[[], Limits] | None = None) -> Looked:
        """What an attempt that was solved calls for. Collective.

        Limits are those that wake cells; without them nodes that press alone call for shapes.
        """
        self._forces.bear(attempt.t, attempt.dt)
        if not self._forces.borne:
            return Looked()
        own = [each for each in self._forces.borne.values() if self.found.grows(each[0].data)]
        self._withheld = [(fields, fields.outside(force)) for fields, force in own]
        size = size_of(self._scene, self._withheld)
        pressing, now = self._stepper.system.actions.pressing(), limits and limits()
        wakes = now is not None and now.rates is None
        found = self.found.pressed(self._stepper.state.bodies, pressing, attempt.dt, wakes)
        if found is None and now is not None:
            bodies = attempt.increments.end
            if now.rates is not None:
                found = self.found.bent(bodies, None, None, 0.0)
            else:
                allowed = self._allowed(now)
                found = self.found.bent(bodies, allowed, self._withheld, size)
        if found is not None:
            return found
        known = self._since + 1 < EVERY and not self._added
        grown = max(1.0, size / self._asked)  # other forces: so may the ratio have
        quiet = known and size * self._ratio * grown < GATE
        if limits is None or not size > 0:
            return Looked()
        if (resonant := self._resonant(limits)) is not None:
            return resonant
        if quiet:
            return Looked()
        return self._judged(attempt.dt, self.found.at_start(self._withheld), size, limits())

    def _resonant(self, limits: Callable[[], Limits]) -> Looked | None:
        """Shapes, or cells that wake, for modes that bodies lack and may swing in. Collective."""
        known = [(fields, self._resonance.lasting(fields)) for fields, _ in self._lacks_modes()]
        lasting = [(fields, *own) for fields, own in known if own is not None]
        size = size_of(self._scene, [(fields, force) for fields, _, force in lasting])
        if not size * min(self._ratio, self._swing) > GATE:
            return None
        swings: list[Array] = [np.zeros((self._scene.owned_nodes, 3, 0))]
        frequency = np.zeros(self._cells)
        for fields, omega, force in lasting:
            F = self.found.at_start([(fields, fields.outside(force))])
            swings.append(self.found.linear().swing(F[:, :, None], omega))
            frequency[fields.data.cells] = omega
        each, now = np.concatenate(swings, axis=2), limits()
        cells = np.concatenate([fields.data.cells for fields, *_ in lasting])
        rates = self._part(each.sum(axis=2), frequency, cells, now)
        wanted = self._largest([fields.data for fields, *_ in lasting], rates)
        most = max(wanted.values())
        self._swing = most / size
        if not most > 1:
            return None
        grown, ended = self._grown(wanted, lambda: each, each.shape[2], now)
        if grown is None and not (ended and most > WAKES):
            return None
        tell(self._scene.comm, f"modes that bodies lack may be in resonance: {most:.3g} tol")
        woken: Bools = rates > WOKEN
        return Looked(None, woken, RESONANT) if grown is None else Looked(grown)

    def _largest(self, of: Sequence[RigidBody], rates: Array) -> dict[int, float]:
        """The largest rate of each body, by its number. Collective."""
        above = np.array([rates[data.cells].max(initial=0.0) for data in of])
        self._scene.comm.Allreduce(MPI.IN_PLACE, above, op=MPI.MAX)
        return {data.number: float(own) for data, own in zip(of, above, strict=True)}

    def _lacks_modes(self) -> list[tuple[Fields, Force]]:
        """ρ⊥ of the bodies that lack modes which Δt resolves."""
        own = self._withheld
        return [each for each in own if np.isfinite(self.found.known[each[0].data.number].lacking)]

    def _judged(self, dt: float, F: Array, size: float, limits: Limits) -> Looked:
        """Compare responses with limits. Collective."""
        comm, bodies = self._scene.comm, self._stepper.state.bodies
        growing = {b.data.number: b.data for b in bodies if self.found.grows(b.data)}
        cells = np.concatenate([data.cells for data in growing.values()])
        e = self.found.responses.solve(F[:, :, None])
        omega = np.zeros(self._cells)
        for data in growing.values() if limits.rates is not None else ():
            omega[data.cells] = min(self.found.frequency(data, e), 2 / dt)
        rates = self._part(e[:, :, 0], omega, cells, limits)
        wanted = self._largest(list(growing.values()), rates)
        most = max(wanted.values(), default=0.0)
        self._ratio, self._asked, self._swing, self._since = most / size, size, np.inf, 0
        if not most > 1:
            return self._left(most, limits)
        grown, ended = self._grown(wanted, partial(self._followed, F, dt, limits), 1, limits)
        if ended:
            cells = np.concatenate([data.cells for data in ended])
            return Looked(None, self._strained_most(e[:, :, 0], rates, cells, limits), OUTGROWN)
        if grown is None:
            return self._left(most, limits)
        size = float(np.linalg.norm(e, axis=1).max(initial=0.0))
        self._foreseen = max(self._foreseen, comm.allreduce(size, op=MPI.MAX))
        return Looked(grown)

    def _grown(
        self, wanted: Mapping[int, float], found: Callable[[], Array], loads: int, limits: Limits
    ) -> tuple[Bodies | None, list[RigidBody]]:
        """Bodies with further shapes, None if there are none, and those that need other ones.

        `wanted` has how many times each body exceeds its limit, by its number. Where one has room
        vectors are found: those of loads, then their followers. Collective.
        """
        out, ended, grown = list(self._stepper.state.bodies), list[RigidBody](), False
        new: Array | None = None
        for k, body in enumerate(out):
            want = wanted.get(body.data.number, 0.0)
            if not want > 1:
                continue
            count = self.found.grown(body.data)
            before = self._added.get(body.data.number, ())
            if limits.begins and before:  # what is left is for the next step to tell
                continue
            stalls, more = len(before) > 1 and want > max(WAKES, 0.5 * before[-2]), None
            if not (stalls or count >= GROWN):
                new = found() if new is None else new
                more = self.found.more(body, new, loads)
            if more is None or new is None:
                if not limits.begins and (want > WAKES or count >= GROWN):
                    ended.append(body.data)
                continue
            out[k], grown = more, True
            self._added[body.data.number] = (*before, want)
            self.found.keep(new[:, :, :loads])
            text = f"{more.data.name} has {more.data.deforms_by} shapes: {want:.3g} tol"
            tell(self._scene.comm, text)
        return Bodies.of_each(out) if grown else None, ended

    def _left(self, most: float, limits: Limits) -> Looked:
        """Keep what bodies lack in a step that calls for nothing, over that allowed."""
        if limits.rates is None:
            self._lacks = max(self._lacks, most * self._allowed(limits))
        return Looked()

    def _part(self, motion: Array, omega: Array, cells: Indices, limits: Limits) -> Array:
        """Strain rates, or displacements, by a vibration over those allowed, by owned cells.

        Its amplitude is at the owned nodes [m], its frequency in owned cells [1/s]. Cells that are
        not asked for have zero.
        """
        out = np.zeros(omega.size)
        if limits.rates is None:
            size = np.linalg.norm(self.found.kept(motion), axis=1)
            out[cells] = 2 * at_cells(self._scene, size, cells)
            return part_of(out, np.full(out.size, self._allowed(limits)))
        shape = self.found.responses.stiffness.linear.shape
        out[cells] = omega[cells] * self._strains.of(motion, 1.0, shape, cells)
        return part_of(out, limits.rates)

    def _strained_most(self, e: Array, rates: Array, cells: Indices, limits: Limits) -> Bools:
        """Those of some owned cells that wake: above a limit, or strained most. Collective."""
        woken: Bools = np.zeros(rates.size, dtype=bool)
        if limits.rates is not None:
            woken[cells] = rates[cells] > WOKEN
            return woken
        shape = self.found.responses.stiffness.linear.shape
        strains = self._strains.of(e, 1.0, shape, cells)
        most = self._scene.comm.allreduce(float(strains.max(initial=0.0)), op=MPI.MAX)
        woken[cells] = strains > SHARE * most
        return woken

    def _allowed(self, limits: Limits) -> float:
        """Displacement that bodies may lack, of the largest up to the end of a step [m]."""
        control = self._stepper.control
        assert control is not None  # an `Accuracy` has one
        return limits.part * control.reach(self._foreseen)

    def _followed(self, F: Array, dt: float, limits: Limits) -> Array:
        """The static response to forces, and its followers where e is bounded. Collective."""
        resolved, depth = dt / RESOLVED, DEPTH if limits.rates is None else 1
        known = self.found.responses, (F[:, :, None], depth)
        vectors, count = ritz(*known, resolved=resolved, clean=True, known=self.found.vectors)
        return vectors[:, :, :count]

    # What is left --------------------------------------------------------------------------------

    def size(self) -> float:
        """Largest displacement that bodies have lacked so far, but in cells that wake [m]."""
        return self._lacks + self.found.bends

    def accept(self, attempt: Attempt) -> None:
        """See `Watch`."""
        lacking = {number: own.lacking for number, own in self.found.known.items()}
        self._resonance.advance(self._lacks_modes(), lacking, attempt.dt)
        self.found.accept()
        self._added = {}
        self._since += 1

    def bind(self, flexible: object) -> None:
        """See `Watch`; forgets bodies that are no more."""
        self.found.bind()
        known = self.found.known
        self._withheld = [own for own in self._withheld if own[0].data.number in known]

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self.found.destroy()
