"""Do forces of motors, joints and supports go back and forth from step to step?

A force λ of steps of one length is split into its mean of neighbouring steps and the rest,

    λₙ = ¼ (λₙ₋₁ + 2 λₙ + λₙ₊₁) - ¼ (λₙ₋₁ - 2 λₙ + λₙ₊₁) .

It counts as alternating where the rest changes its sign in two of three steps, which it does at
three steps a period and less. One event in between leaves no trace in the median. The peak of the
motion that Δt resolves is that of `rigidfx.report.resolved_forces`.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.effects import Joint, ResolvedForces, Rigid
from rigidfx.effects.joints.elements import titles_of
from rigidfx.report.lumping import OF_ALL, WORTH_A_WARNING
from rigidfx.report.report import Look, Report
from rigidfx.report.resolved_forces import resolved_part
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.alternation import FIRST, Alternation
from rigidfx.step.watches.alternation import WORTH_A_WARNING as NOTHING

__all__ = ["AlternatingForces"]


class AlternatingForces(Look):
    """Looks at the forces of constraints; warns after half of a run, or at its end."""

    remembered: ClassVar[Remembered] = same(
        "_waits", "_t", "_dt", "_inertia", "_last", "_goes_on", "_most", "_resolved", "_swings"
    )

    def __init__(self, scene: Scene, motion: Alternation, t_end: float) -> None:
        """Begin before the first report. Collective.

        Args:
            scene: The problem.
            motion: Tells where the motion itself goes back and forth.
            t_end: End of the run [s].
        """
        self._comm, self._motion, self._half = scene.comm, motion, 0.5 * t_end
        rigid = [scene.owned_cells(r.where, r.owner) for r in scene.named(Rigid) if not r.deforms]
        held = np.unique(np.concatenate([np.empty(0, np.int32), *rigid])).size
        flexible = scene.sum(float(scene.mesh.topology.index_map(3).size_local - held)) > 0
        self._joints = [joint.title for joint in scene.named(Joint)]
        motors = [found for found in titles_of(scene) if found[0].is_load]
        self._motors = [(motor.joint, title) for motor, title in motors]
        self._supports = list(dict.fromkeys(support.where for support, _ in scene.supports))
        of = *(joint.owner for joint in scene.named(Joint)), *(f"'{w}'" for w in self._supports)
        self._idle = dict.fromkeys(self._supports, np.full(3, np.nan))
        self._names = [title for _, title in self._motors]
        self._names += [f"{kind} of {name}" for kind in ("force", "moment") for name in of]
        turns = [motor.acts_along == "angle" for motor, _ in motors]
        turns += [kind for kind in (False, True) for _ in of]
        self._units = np.where(turns, "N m", "N")
        self._waits = bool(flexible and self._names and not scene.named(ResolvedForces))
        X = scene.start_places
        ends = np.r_[X.max(axis=0, initial=-np.inf), -X.min(axis=0, initial=np.inf)]
        scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        self._scales = np.where(turns, np.max(ends[:3] + ends[3:]), 1.0)  # of moments [m]
        self._t = self._dt = self._inertia = 0.0  # largest Σ m|v| over a step [N]
        self._last: list[Array] = []  # forces of steps of one length
        self._goes_on = False  # whether steps of that length came before
        self._most, self._resolved, self._swings = np.zeros((3, len(self._names)))

    def follow(self, report: Report) -> None:
        """See `Look`."""
        if not self._waits or not report.step:
            return
        if abs(report.dt - self._dt) > NOTHING * self._dt or report.events or report.impact:
            self._judge()
        self._t, self._dt = report.t, report.dt
        self._inertia = max(self._inertia, report.momentum_scale / report.dt)
        self._last.append(self._forces_in(report))
        if len(self._last) == 4 * FIRST:
            self._judge(goes_on=True)
            if report.t > self._half:
                self._tell()

    def end(self) -> None:
        """See `Look`."""
        self._judge()
        self._tell()

    def _forces_in(self, report: Report) -> Array:
        """Forces of constraints in a step, NaN of those that do not act, shape (names, 3)."""
        joints, reactions = report.joints, (report.reactions, report.reaction_moments)
        efforts = [joints[name].efforts.get(title, np.nan) for name, title in self._motors]
        out = [np.array([effort, 0.0, 0.0]) for effort in efforts]
        for kind, held in zip(("force", "moment"), reactions, strict=True):
            out += [getattr(joints[name], kind) for name in self._joints]
            known = {**self._idle, **held}
            out += [known[name] for name in self._supports]
        return np.array(out)

    def _judge(self, goes_on: bool = False) -> None:
        """Keep peaks, and how far forces go back and forth, in a window.

        Args:
            goes_on: Whether steps of this length follow, which the last four are kept for.
        """
        if not (self._waits and self._last):
            return
        own = slice(2 * self._goes_on, -2 if goes_on else None)
        now = np.array(self._last).reshape(len(self._last), 3 * self._most.size)
        for kept, forces in ((self._most, now), (self._resolved, resolved_part(now))):
            sizes = np.linalg.norm(forces[own].reshape(-1, kept.size, 3), axis=2)
            np.fmax(kept, np.nanmax(sizes, axis=0, initial=0.0), out=kept)
        rests = np.diff(now, 2, axis=0) / 2**2
        for k in range(0, len(rests) - FIRST + 1, 2 * FIRST):
            some = rests[k : k + 2 * FIRST]
            turns = (some[1:] * some[:-1] < 0).sum(axis=0)
            swings = np.median(np.abs(some), axis=0) * (3 * turns >= 2 * (len(some) - 1))
            self._swings = np.fmax(self._swings, np.linalg.norm(swings.reshape(-1, 3), axis=1))
        self._last, self._goes_on = self._last[-4:] if goes_on else [], goes_on

    def _tell(self) -> None:
        """Warn of forces of which a twentieth goes back and forth.

        A hundredth of the largest force matters nowhere, but for motors, which are sized by theirs;
        neither does what is next to nothing beside that, or beside Σ m|v| in a step.
        """
        largest = (self._resolved / self._scales).max(initial=0.0)
        driven = np.arange(len(self._names)) < len(self._motors)
        least = np.where(driven, OF_ALL**2, OF_ALL) * largest
        least = np.maximum(least, NOTHING * self._inertia)
        found = np.flatnonzero(
            self._swings > np.maximum(WORTH_A_WARNING * self._resolved, least * self._scales)
        )
        if not (self._waits and found.size and self._motion.waits):
            return
        self._waits = False
        first, *others = found  # motors before joints and supports
        names = ", ".join(self._names[k] for k in others)
        unit = self._units[first]
        warn(
            self._comm,
            f"Up to t = {self._t:.6g} s {self._names[first]} goes back and forth from step to "
            f"step by {self._swings[first]:.3g} {unit}: its peak is {self._most[first]:.3g}, that "
            f"of the motion that Δt resolves {self._resolved[first]:.3g} {unit}"
            f"{names and f' (likewise {names})'}. Cells vibrate faster than Δt = {self._dt:.3g} s "
            "resolves. Pictures and the columns …_resolved of rf.read_history leave this vibration "
            "out, reports with rf.ResolvedForces() in the scene. Motions that begin smoothly "
            "vibrate less.",
        )
