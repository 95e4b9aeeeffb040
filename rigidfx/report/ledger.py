"""Errors and energies that a run has spent so far: accounts that are never added up.

Errors of displacements are relative to the largest displacement so far of the points watched,
energies to the largest energy of deformation so far: strain energy, energy of bodies, and the
kinetic energy relative to the rigid motion of each connected part that has its momenta. One per
cent of the energy with which a body flies would let all of its vibration freeze. Parts that
supports hold still have no rigid motion. The error of the mesh is not estimated.
"""

from dataclasses import dataclass
from math import isnan, nan
from typing import Any, ClassVar, Literal

import numpy as np
from mpi4py import MPI

from rigidfx.base.in_notebook import as_text
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.types import TINY, Array, Ints
from rigidfx.effects import NumericalDamping
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rotation import axial, cross
from rigidfx.scene.damped import holding
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.system import System

ACCOUNTS = "frozen", "time", "damping", "rigidity", "measured"
Sure = Literal["estimate", "unknown"]
OF_AMPLITUDE = 2.0  # parts of an energy that go with one of an amplitude
THIN = 1e-9  # of the largest moment of inertia or singular value: below it nodes lie on a line


class Deformation:
    """Measures the energy of deformation of a scene.

    Attributes:
        largest: The largest so far [J].
        kinetic: Kinetic energy beyond rigid motions at the last measure [J]; all of it where
            supports hold a structure still.
        strain: Strain energy, and energy of bodies, at the last measure [J].
    """

    remembered: ClassVar[Remembered] = same("largest", "kinetic", "strain")

    def __init__(self, scene: Scene) -> None:
        """Find the connected part of each node. Collective."""
        self._scene, self._parts = scene, scene.parts
        self._still = any(not support.moves for support in holding(scene))
        self._of_node = parts_of_nodes(scene)
        self._system: object = None
        self._bodies_alone = False
        self._of_body: Ints = np.empty(0, dtype=np.int64)
        self.largest = self.kinetic = self.strain = 0.0

    def measure(self, system: System, state: State, report: Any) -> float:
        """The energy of deformation now [J]. Collective."""
        self.kinetic = report.kinetic
        if not self._still:
            self.kinetic = max(report.kinetic - self._rigid(system, state, report.kinetic), 0.0)
        self.strain = report.strain + report.stored
        now = self.strain + self.kinetic
        self.largest = max(self.largest, now)
        return now

    def _rigid(self, system: System, state: State, kinetic: float) -> float:
        """Energy of the best rigid motions [J], of the kinetic energy that there is. Collective."""
        if system is not self._system:
            self._system, self._of_body = system, self._parts_of(state.bodies)
            rest = self._scene.comm.allreduce(system.layout.rows.nodes.size)
            self._bodies_alone = not rest and np.unique(self._of_body).size == len(state.bodies)
        if self._bodies_alone:  # each a part of its own: what they move by is rigid motion
            return kinetic
        return float(_rigid_energies(self._sums(system, state)).sum())

    def _parts_of(self, bodies: Bodies) -> Ints:
        """Connected part of each body. Collective."""
        found = [int(self._parts.of_cell[b.cells].max(initial=0)) for b in bodies.of.records]
        of = np.array(found, dtype=np.int64)
        self._scene.comm.Allreduce(MPI.IN_PLACE, of, op=MPI.MAX)
        return of

    def _sums(self, system: System, state: State) -> Array:
        """m, m x, p, m x xᵀ and x × p of each part, shape (parts, 19). Collective."""
        rows, mass = system.layout.rows, system.layout.masses
        v = state.v.x.array[rows.dofs].reshape(-1, 3)
        one_x_v = np.empty((len(v), 7))
        one_x_v[:, 0], one_x_v[:, 4:] = 1.0, v
        one_x_v[:, 1:4] = rows.X + state.u.x.array[rows.dofs].reshape(-1, 3)
        left = mass[:, None] * one_x_v[:, :4]
        of, count = self._of_node[rows.nodes], self._parts.count
        # Σ m (1, x) (1, x, v)ᵀ of each part.
        if count == 1:
            local = left.T @ one_x_v
        else:
            columns = (left[:, :, None] * one_x_v[:, None, :]).reshape(-1, 28).T
            local = np.array([np.bincount(of, c, count) for c in columns]).T
        sums = np.asarray(self._scene.sum(local)).reshape(-1, 4, 7)
        m_mx_p, spread, x_p = sums[:, 0], sums[:, 1:, 1:4].reshape(-1, 9), sums[:, 1:, 4:]
        total = np.hstack([m_mx_p, spread, axial(x_p)])
        bodies = state.bodies
        if len(bodies):
            m, r = bodies.of.mass, bodies.r
            turned = bodies.R @ bodies.rotated_inertia
            # Σ m y yᵀ = ½ tr J I - J about the centre.
            trace = np.trace(turned, axis1=1, axis2=2)[:, None, None]
            own = 0.5 * trace * np.eye(3) - turned + m[:, None, None] * r[:, :, None] * r[:, None]
            J = cross(r, bodies.momentum) + bodies.angular_momentum
            parts = [m[:, None], m[:, None] * r, bodies.momentum, own.reshape(-1, 9), J]
            np.add.at(total, self._of_body, np.hstack(parts))
        return total


def _rigid_energies(sums: Array) -> Array:
    """½ p²/m + ½ Jc·Ic⁻¹ Jc of each part, shape (parts,) [J]."""
    m, mx, p = sums[:, :1], sums[:, 1:4], sums[:, 4:7]
    mass = np.where(m > 0, m, 1.0)
    c = mx / mass
    spread = sums[:, 7:16].reshape(-1, 3, 3) - mx[:, :, None] * c[:, None, :]
    moments, axes = np.linalg.eigh(spread)
    moments = moments.sum(axis=1, keepdims=True) - moments
    J = sums[:, 16:] - cross(c, p)
    along = np.einsum("ki,kij->kj", J, axes)
    known = moments > THIN * moments.max(axis=1, keepdims=True)
    turning = np.divide(along**2, moments, out=np.zeros_like(along), where=known).sum(axis=1)
    return np.asarray(0.5 * ((p**2 / mass).sum(axis=1) + turning))


@dataclass(frozen=True)
class Entry:
    """One account.

    Attributes:
        spent: The amount, in its unit; NaN where nothing estimates it.
        scale: Reference value, in the same unit.
        allowed: The allowed amount, in the same unit; NaN where nothing was asked.
        unit: "J" or "m".
    """

    spent: float
    scale: float
    allowed: float
    unit: str

    @property
    def relative(self) -> float:
        """The amount over the scale; zero where nothing has been spent."""
        return 0.0 if self.spent == 0 else self.spent / max(self.scale, TINY)

    @property
    def part(self) -> float:
        """The allowed amount over the scale."""
        return self.allowed / max(self.scale, TINY)

    def __str__(self) -> str:
        if isnan(self.spent):
            return "not estimated"
        allowed = "" if isnan(self.allowed) else f" of {self.allowed:.3g} {self.unit} allowed"
        return f"{self.spent:.3g} {self.unit}{allowed}, {self.relative:.2%}"


NOTHING = Entry(nan, nan, nan, "m")


@dataclass(frozen=True)
class Rigidity:
    """Error of the motion by rigid parts, as who decides about it estimates it."""

    motion: float  # its error so far, over the largest displacement
    allowed: float  # its bound at the end of the run
    rest: float  # the share of time integration
    # Energy that bodies may withhold now, or keep of vibrations, over the largest energy of
    # deformation
    withheld: float


@dataclass(frozen=True)
class Ledger:
    """The accounts of a run at the end of a step; equal on all ranks.

    Attributes:
        frozen: Kinetic energy of vibration that bodies keep now.
        time: Error of displacements by time integration so far, an estimate.
        damping: Energy taken by numerical damping so far; half of that is missing of amplitudes,
            so that twice the budget of `Accuracy` is allowed.
        periods: Periods N that the motion has gone through so far, as far as can be told.
        rejected: Steps that were repeated so far, as they erred by too much in time.
        rigidity: Error of displacements by rigid parts so far, an estimate; of `Accuracy` only.
        sure: Its meaning now: an "estimate"; "unknown" from the first contact on.
        struck: Whether a contact has closed: the error of time integration is unknown from then on,
            too, as small errors of a blow grow on the flight after it.
        measured: Largest distance from a finer flexible twin so far, of `Accuracy(check=True)`.
    """

    MESH: ClassVar[str] = "not estimated: compare with a finer mesh"

    frozen: Entry
    time: Entry
    damping: Entry
    periods: float
    rejected: int
    rigidity: Entry = NOTHING
    sure: Sure = "estimate"
    struck: bool = False
    measured: Entry = NOTHING

    @property
    def unsure(self) -> int:
        """0 where all are estimates, 2 where `rigidity` and `time` are unknown after a contact."""
        return 2 if self.struck else 0

    @property
    def motion(self) -> float:
        """Relative error of the motion that rigidity makes, an estimate; NaN if there is none."""
        return self.rigidity.relative

    def __str__(self) -> str:
        """All accounts, one per line."""
        names = {
            "frozen": "frozen vibration",
            "time": "time integration",
            "damping": "numerical damping",
        }
        if self.struck:
            names["time"] += " (unknown)"
        if not isnan(self.rigidity.spent):
            names["rigidity"] = f"motion, rigid parts ({self.sure})"
        if not isnan(self.measured.spent):
            names["measured"] = "motion, against a twin"
        width = max(map(len, names.values()))
        lines = [f"{words:{width}s} {getattr(self, name)}" for name, words in names.items()]
        return "\n".join([*lines, f"{'mesh':{width}s} {self.MESH}"])

    def __repr__(self) -> str:
        """The accounts that have been spent from, in a line."""
        entries = {name: getattr(self, name) for name in ACCOUNTS}
        told = [f"{k} {e.relative:.2%}" for k, e in entries.items() if not isnan(e.spent)]
        return f"<Ledger: {', '.join(told)}>"

    def _repr_html_(self) -> str:
        """All accounts in a notebook."""
        return as_text(str(self))


class Ledgers:
    """Keeps the accounts of a run."""

    remembered: ClassVar[Remembered] = same("_damped", "_struck") | {"_deformation": PART}

    def __init__(self, stepper: Stepper) -> None:
        """Nothing has been spent. Collective."""
        self._stepper = stepper
        self._deformation = Deformation(stepper.scene)
        self._damped = 0.0
        self._struck = False

    def follow(self, report: Any, periods: float, rigidity: Rigidity | None) -> Ledger:
        """The ledger after a step, with periods so far and the error by rigid parts. Collective."""
        stepper = self._stepper
        self._deformation.measure(stepper.system, stepper.state, report)
        self._struck |= report.contact > 0
        self._damped += report.dissipated.get(NumericalDamping.__name__, 0.0)
        H = self._deformation.largest
        frozen = sum(max(b.frozen.vibration, 0.0) for b in stepper.state.bodies.of.records)
        allowed = budget = nan
        time, of_rigidity, U, rejected = NOTHING, NOTHING, nan, 0
        if stepper.control is not None:
            length, rejected = stepper.control.length, stepper.control.rejected
            U = length.displacement
            time = Entry(length.spent, U, length.tol * U, "m")
        if rigidity is not None:
            allowed, budget = rigidity.withheld, rigidity.allowed + rigidity.rest
            of_rigidity = Entry(rigidity.motion * U, U, rigidity.allowed * U, "m")
        return Ledger(
            frozen=Entry(frozen, H, allowed * H, "J"),
            time=time,
            damping=Entry(self._damped, H, OF_AMPLITUDE * budget * H, "J"),
            periods=periods,
            rejected=rejected,
            rigidity=of_rigidity,
            sure="unknown" if self._struck else "estimate",
            struck=self._struck,
        )
