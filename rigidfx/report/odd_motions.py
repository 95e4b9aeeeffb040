"""Looks for motions that keep all balances and are not those that were meant."""

from math import inf, pi, sqrt
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Preload, Reduced, Spring, SpringDamper, Support
from rigidfx.effects.damping import warn_of_ratio
from rigidfx.report.advice import ADVICE, OF_ALL, Adviser
from rigidfx.report.ledger import THIN
from rigidfx.report.report import Look, Report
from rigidfx.scene.damped import Damped
from rigidfx.scene.scene import Scene
from rigidfx.step.equations.supports import Impact

NEGLIGIBLE = ADVICE["a load does nothing, nothing acts"].bound
OTHERS = Preload, SpringDamper, Reduced  # tensions, and shapes that have masses of their own
TURNED_OF_ALL = 1e-3  # of the largest energy: what springs have stored by a rotation that matters
EVERY = 8  # steps from look to look


class Jolts(Adviser):
    """Looks at supports and contacts that begin with much of the energy; advises once.

    A motion prescribed at full speed under a body at rest is an impact: held nodes have their
    velocity at once, and waves run from them. Its size is the larger one of its energy and of that
    with which the body would follow the support at once.
    """

    remembered: ClassVar[Remembered] = Adviser.remembered | same("_energy", "_most", "_found")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report. Collective."""
        super().__init__(scene)
        mass = scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())
        self._floor = 0.5 * mass * (NEGLIGIBLE * scene.mean_cell_size) ** 2  # [J s²]
        self._energy: float | None = None  # at the end of the last step [J]
        self._most = 0.0  # the largest so far [J]
        self._found: tuple[Impact, float] | None = None  # in the last report, and its part

    def follow(self, report: Report) -> None:
        """Look at a report."""
        if self.said:
            return
        impact, before = report.impact, self._energy
        self._energy, self._most = report.energy, max(self._most, report.energy)
        if self._found is not None:
            least = max(NEGLIGIBLE * self._most, self._floor / report.dt**2)
            if abs(self._found[0].energy) > least:
                self._say(*self._found)
                return
            self._found = None
        if impact is None:
            return
        if before is None:
            before = report.energy - impact.energy
        size = max(abs(impact.energy), impact.following)
        part = min(size / max(before, before + impact.energy, np.finfo(float).tiny), 1.0)
        if part > ADVICE["a support or contact acts with a jolt"].bound:
            self._found = impact, part

    def _say(self, impact: Impact, part: float) -> None:
        """Advise, and look no more."""
        names = ", ".join(f"'{name}'" for name in impact.supports)
        gives = "brings" if impact.energy > 0 else "takes"
        share, follows = f", {part:.0%} of the energy", ""
        if impact.following > abs(impact.energy):
            follows = f" To follow at once, all that it holds would take {impact.following:.3g} J"
            share, follows = "", f"{follows}{share}."
        known = {"t": impact.t, "energy": abs(impact.energy)}
        self.advise(
            "a support or contact acts with a jolt",
            names=names,
            gives=gives,
            share=share,
            follows=follows,
            **known,
        )


class Stillness(Adviser):
    """Looks for energies, work and reactions; advises at the end where there are none."""

    remembered: ClassVar[Remembered] = same("_still")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report. Collective."""
        super().__init__(scene)
        self._still, self._t = True, 0.0
        mass = scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())
        way = NEGLIGIBLE * scene.mean_cell_size
        self._impulse, self._floor = mass * way, 0.5 * mass * way**2  # [N s²], [J s²]

    def follow(self, report: Report) -> None:
        """Look at a report."""
        self._t = report.t
        per_step = 1 / report.dt**2 if report.dt else 0.0  # joints at rest move by rounding
        works = report.energy, abs(report.work_of_loads), abs(report.work_of_supports)
        held = any(force.any() for force in report.reactions.values())
        held |= report.joints.total > self._impulse * per_step
        self._still &= not (max(works) > self._floor * per_step or held)

    def end(self) -> None:
        """Advise if nothing has moved."""
        if self._still:
            self.advise("a load does nothing, nothing acts", t=self._t)


class LumpedInertia(Adviser):
    """Looks at the bodies of some reports; advises once.

    Masses at the corners of cells turn harder than the mass they represent, most of all about the
    axis of something one cell across. What counts is the share in the body's kinetic energy.
    """

    remembered: ClassVar[Remembered] = Adviser.remembered

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._lumped = scene.mass == "lumped"
        self._seen: object = None  # the bodies that were looked at last

    def follow(self, report: Report) -> None:
        """Look at the bodies of a report."""
        bodies = report.rigid
        if self.said or not self._lumped or not bodies.of.excessive:
            return
        if bodies.of is self._seen and report.step % EVERY:
            return
        self._seen = bodies.of
        excess, kinetic = bodies.kinetic_excess, bodies.kinetic_of_each
        if bodies.of.shapes is not None:  # their twins of cells have the same masses
            excess = np.where(bodies.of.shapes.counts > 0, 0.0, excess)
        shares = np.where(kinetic > 0, excess / np.where(kinetic > 0, kinetic, 1.0), 0.0)
        k = int(np.argmax(shares))
        bound = ADVICE["lumped masses of a thin body"].bound
        if shares[k] <= bound or excess[k] <= OF_ALL * report.kinetic:
            return
        worst = bodies.of.records[k]
        known = {"t": report.t, "ratio": worst.inertia_ratio}
        self.advise("lumped masses of a thin body", name=worst.name, number=shares[k], **known)


class TurnedSprings(Adviser):
    """Looks at the sets of springs in some reports; advises once.

    A spring pulls each node back to where it began: a set of some radius is a torsional spring too,
    which a shaft on bearings has not. Nodes on the axis do not turn.
    """

    remembered: ClassVar[Remembered] = Adviser.remembered | same("_most")

    def __init__(self, scene: Scene) -> None:
        """Find the nodes of springs. Collective."""
        super().__init__(scene)
        self._most = 0.0
        n, places = scene.owned_nodes, scene.space.tabulate_dof_coordinates()
        self._springs = []
        for spring in (s for s in scene.named(Spring) if s.face is None):
            weights = scene.shares(spring.where, spring.kind)[:n]
            on = np.flatnonzero(weights)
            rest = scene.start_places[on] if spring.relaxed == "start" else places[on]
            arms = rest - scene.sum(weights[on] @ rest)
            square = scene.sum(weights[on] @ (arms**2).sum(axis=1))
            if square > 0 and (K := spring.K).any():
                self._springs.append((spring.where, K, on, weights[on], arms))

    def follow(self, report: Report) -> None:
        """Look at the next report, of which nothing has gone on. Collective."""
        if self.said or not self._springs:
            return
        self._most = max(self._most, report.energy)
        if report.step % EVERY:
            return
        for where, K, on, w, X in self._springs:
            x = report.state.positions(on)
            x = x - self._scene.sum(w @ x)
            moved = x - X
            found = self._scene.sum(
                np.append((w[:, None] * x).T @ X, 0.5 * np.vdot(w[:, None] * moved, moved @ K))
            )
            angle = _angle(found[:9].reshape(3, 3))
            bound = ADVICE["nodes of a spring rotate"].bound
            if angle > bound and found[9] > TURNED_OF_ALL * self._most:
                known = {"t": report.t, "number": angle, "energy": found[9]}
                self.advise("nodes of a spring rotate", where=where, **known)
                return


class Overdamped(Look):
    """Looks at shapes in steps whose number is a power of two; warns at the end.

    On supports that stand still, a shape u with the energy W of strains and springs has
    ω² = 2 W / u·M u ≥ ω₁² by Rayleigh's quotient, equal to it for the first vibration, and at least
    the damping ratio ½ (α/ω + β ω), α M + β K being below all damping (`Damped`). The smallest ω
    counts, in runs that last for its period.
    """

    remembered: ClassVar[Remembered] = same("_square", "_t", "_dt")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report. Collective."""
        self._scene, self._square = scene, inf  # smallest ω² so far [1/s²]
        self._t = self._dt = 0.0
        self._damped: Damped | None = None
        at_rest = not any(s.moves for s in scene.named(Support))
        if at_rest and not any(scene.named(kind) for kind in OTHERS):
            damped = Damped(scene)
            self._damped = damped if damped.rates(np.ones(1), 1.0).any() else None

    def follow(self, report: Report) -> None:
        """Take the frequency of the shape. Collective."""
        self._t, self._dt = report.t, report.dt
        energy = report.strain + report.springs
        if self._damped is None or report.step & (report.step - 1) or not energy > 0:
            return
        bodies, n = report.rigid, self._scene.owned_nodes
        mass = self._scene.averaging_mass[:n].copy()
        for body in bodies.of.records:
            mass[body.nodes] = 0.0
        u = report.state.u.x.array.reshape(-1, 3)[:n]
        moved = self._scene.sum(mass @ (u * u).sum(axis=1))
        way = bodies.r - bodies.of.frozen[:, 0]
        moved += bodies.of.mass @ (way * way).sum(axis=1)
        if moved > 0:
            self._square = min(self._square, 2 * energy / moved)

    def end(self) -> None:
        """Advise on a damping ratio above the critical one."""
        omega = sqrt(self._square)
        if self._damped is None or not self._t * omega >= 2 * pi or omega == inf:
            return
        ratio = float(self._damped.rates(np.array(omega), self._dt)) / omega
        warn_of_ratio(self._scene.comm, f"Vibrations of {omega / (2 * pi):.3g} Hz", ratio)


def _angle(M: Array) -> float:
    """Angle of the rotation that fits Σ w x Xᵀ best [rad]; the least one of nodes on a line."""
    U, size, V = np.linalg.svd(M)
    if size[1] <= THIN * size[0]:
        return float(np.arccos(np.clip(U[:, 0] @ V[0], -1.0, 1.0)))
    U[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(V))
    return float(np.arccos(np.clip((np.trace(U @ V) - 1) / 2, -1.0, 1.0)))
