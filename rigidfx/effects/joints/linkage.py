"""All joints of a division: where their vectors are, their rows, and the forces of these.

Averages are B = W x over nodes that are no body's, plus those of nodes in bodies, which move as
[1, V, Φ₁, ..., Φ_m] times the bodies' poses. The vectors p of joints are averages, or turn with a
mean face; in a step they gain J̄ ΔB exactly (`vectors`). With g at most quadratic in p,

    g(x₁) = g(x₀) + ∇g(p½) · Δp    exactly,

so that forces λ ∇g(p½) do no work where g is zero at both ends, and have no resultant, as g does
not see rigid motions. g(x₁) is computed like that, from increments: what rounding leaves of places
is the same in all iterates of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, stacked
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure
from rigidfx.effects.joints.coordinates import Coordinates
from rigidfx.effects.joints.drives import Drives, Element
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.joint_report import JointReport, JointReports, told_of
from rigidfx.effects.joints.pieces import Terms
from rigidfx.effects.joints.remote import Points
from rigidfx.effects.joints.vectors import BoundAverages, Vectors, stiff_rows
from rigidfx.effects.motion import Forces, ForcesOfNodes, Instant, Motion
from rigidfx.mechanics.bodies import Bodies

__all__ = ["Linkage"]


class Linkage:
    """The joints of a scene, bound to a division; arrays are equal on all ranks.

    Attributes:
        active: Numbers of the rows that have forces: those that the others follow from.
        averages: Number of averages.
        is_place: Whether each is a place, not a direction.
        used: Which of them have forces; others are measured only.
        drives: Motors and springs.
        points: Remote points.
        own: Weights of nodes that are no body's, shape (averages, places among these nodes).
        held: Weights of the bodies' a = [1, V, Φ₁, ..., Φ_m], shape (averages, n · bodies).
        at: Places of the nodes of `own` among the rows of the division.
    """

    def __init__(
        self,
        joints: Sequence[Any],
        elements: Sequence[Element],
        structure: Structure,
        points: Points | None = None,
    ) -> None:
        """Bind joints to nodes and bodies. Collective.

        Args:
            joints: The joints, as the scene has placed them, and last the carried masses.
            elements: Motors that act, springs and stops.
            structure: The division.
            points: Actions on remote points.
        """
        scene, bodies, static = structure.scene, structure.bodies, structure.static
        self._share = 1.0 if static else 0.5
        self._stiffness = max(material.stiffness for material, _ in scene.materials)
        self._length = float(scene.mean_cell_size)
        self._joints, self._notes = tuple(joints), structure.notes
        pieces = [joint.pieces for joint in joints]
        firsts = [0, *accumulate(len(own.averages) for own in pieces)]
        averages = [average for own in pieces for average in own.averages]
        self.points = Points(()) if points is None else points
        averages += self.points.number(len(averages))
        self._vectors = Vectors(averages, stiff_rows(scene, bodies.of.records, averages))
        self.averages, self._every = len(self._vectors.averages), sum(len(o.rows) for o in pieces)
        rows_of_each = [len(own.rows) for own in pieces]
        self._masses = np.repeat([own.mass for own in pieces], rows_of_each)
        self._sizes = np.repeat([own.size for own in pieces], rows_of_each)
        self.active: Ints = np.arange(self._every)
        self._dropped, self._implied = self.active[:0], list[str]()
        self.is_place = [average.is_place for average in self._vectors.averages]
        linear = self._vectors.averages, self._vectors.stiff
        self._bound = bound = BoundAverages(*linear, structure)
        self.at, self.own, self.held = bound.rows, bound.own, bound.held
        self._terms = Terms([own.rows for own in pieces], firsts, len(averages))
        self._firsts = firsts
        self.drives = Drives(scene, elements, firsts, static)
        self.used = np.zeros(self.averages, dtype=bool)
        own_points = range(firsts[-1], len(averages))
        for k in (*self._terms.averages, *self.drives.averages, *own_points):
            self.used[self._vectors.needed[k]] = True
        self._known = [slice(*pair) for pair in self._ends()]
        self._multipliers: Array = np.zeros(self._every)
        free = {
            (k, name): own
            for k, joint in enumerate(self._joints)
            for name, own in joint.pieces.coordinates.items()
        }
        self._free = Coordinates(list(free.values()), [firsts[k] for k, _ in free])
        self._q: dict[tuple[int, str], float] = dict.fromkeys(free, 0.0)
        self._remember()
        self._dt = 1.0
        none: Array = np.zeros((len(averages), 3))
        self._start, self._moved, self.forces = none, none, none
        self._pose = self._first_pose = bodies.pose
        self._g0: Array = np.zeros(self._every)
        self._open: Array | None = None  # g at the last iterate, once asked for

    def _remember(self) -> None:
        """Take over the memory of earlier divisions."""
        for k, (joint, place) in enumerate(zip(self._joints, self._known, strict=True)):
            before = (self._notes or {}).get(id(joint))
            if before is not None:
                self._multipliers[place] = before[0]
                self._q |= {(k, name): q for name, q in before[1].items()}
        self.drives.remember(self._notes or {})

    def keep(self, rows: Ints) -> None:
        """Let only these rows have forces: numbers among all of them, sorted."""
        self.active = rows
        self._dropped = np.setdiff1d(np.arange(self._every), rows)
        self._multipliers[self._dropped] = 0.0
        titles = [f"{j.title}: {row.title}" for j in self._joints for row in j.pieces.rows]
        self._implied = [titles[k] for k in self._dropped]

    @property
    def count(self) -> int:
        """Number of rows that have forces, those of motors and springs among them."""
        return self.active.size + len(self.drives)

    @property
    def redundant(self) -> dict[str, float]:
        """Rows that have none, as others imply them: violation over size, by title."""
        off = np.abs(self.violation[self._dropped]) / self._sizes[self._dropped]
        return dict(zip(self._implied, map(float, off), strict=True))

    @property
    def masses(self) -> Array:
        """Mass that each active row moves, in order of magnitude [kg]."""
        return np.concatenate([self._masses[self.active], self.drives.masses])

    @property
    def typical(self) -> tuple[float, float]:
        """A stiffness of the parts that joints move, and a size of these [N/m, m]."""
        size = float(np.mean(self._sizes)) if self._sizes.size else self._length
        return self._stiffness * size, size

    def scale(self, dt: float, drag: float = 0.0) -> Array:
        """κ of each active row: force over displacement of its parts [N/m].

        Args:
            dt: Length of a step [s]; of no meaning in statics.
            drag: Drag per mass that resists in statics, in place of stiffness [1/s²].
        """
        if self.drives.static and not drag:
            sizes = np.concatenate([self._sizes[self.active], self.drives.sizes])
            out: Any = self._stiffness * sizes
        else:
            out = (drag or 2.0 / dt**2) * self.masses
        self.drives.kappa = out[self.active.size :]
        return np.asarray(out)

    @property
    def multipliers(self) -> Array:
        """λ of each active row in the last step [N]."""
        return np.concatenate([self._multipliers[self.active], self.drives.multipliers])

    def _ends(self) -> list[tuple[int, int]]:
        """First and last row of each joint."""
        ends = accumulate((len(joint.pieces.rows) for joint in self._joints), initial=0)
        return list(pairwise(ends))

    # Where averages are ---------------------------------------------------------------------------

    def rates(self, v: Array) -> Array:
        """Rates of rows by nodes in no body, at a step's start, shape (rows,) [m/s]. Collective.

        Args:
            v: Velocities of the division's rows, one number each [m/s].
        """
        return np.asarray(self.test() @ self._bound.mean(v.reshape(-1, 3)[self.at]).ravel())

    def coordinates(self, p: Array) -> dict[tuple[int, str], float]:
        """Angles [rad] and travels [m] where vectors are there, by joint and name."""
        before = np.array(list(self._q.values()), dtype=np.float64)
        return dict(zip(self._q, map(float, self._free.values(p, before)), strict=True))

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time for a step from t on; coordinates are of its start.

        Args:
            t: Its start [s].
            dt: Its length [s].

        Raises:
            SceneError: On this rank, if a function cannot be used.
        """
        self._dt = dt
        self.drives.begin(t, dt, self._q)
        self.points.set_time(t + (dt if self._share == 1.0 else 0.5 * dt), dt)

    def begin(self, bodies: Bodies) -> None:
        """Begin a step: find where averages and vectors are. Collective.

        Args:
            bodies: The bodies at its start.
        """
        self._pose = self._first_pose = bodies.pose
        self._start = p = self._vectors.begin(self._bound.positions(Instant(bodies)))
        self._moved = np.zeros_like(p)
        self._q = self.coordinates(p)
        self.drives.begin_at(self._q)
        self.drives.look(p, self._moved, self.drives.multipliers)
        g, self._open = self._terms.value(p), None
        self._g0 = np.where(np.abs(g) > self._terms.rounding(p), g, 0.0)  # at rest nothing moves

    def look(self, motion: Motion, multipliers: Array) -> None:
        """See an iterate. Collective.

        Args:
            motion: The iterate.
            multipliers: λ there [N].
        """
        n = self.active.size
        self._multipliers[self.active], self._open = multipliers[:n], None
        followed = motion.increments.displacement
        self._moved = self._vectors.look(self._bound.moved(motion))
        self._pose = self._first_pose + self._share * followed
        self.drives.look(self._start, self._moved, multipliers[n:])
        p = self._start + self._share * self._moved
        self.forces = self.drives.add_to(self._terms.forces(p, self._multipliers))
        self.points.look(self._start, self._moved, self._dt or 1.0)  # a time that is fixed has none
        self.points.add_to(self.forces)

    def test(self) -> Matrix:
        """Forces on averages per multiplier, transposed, shape (rows, 3 · averages)."""
        return self._with(self._share, self.drives.test)

    def trial(self) -> Matrix:
        """Derivatives of the equations of rows by averages, likewise."""
        return self._with(1.0, self.drives.trial)

    def _with(self, share: float, of_drives: Callable[[int], Matrix]) -> Matrix:
        return self._vectors.onto_averages(self._of_all(share, of_drives), share)

    def _of_all(self, share: float, of_drives: Callable[[int], Matrix]) -> Matrix:
        """Rows of joints and drives by vectors, shape (rows, 3 · vectors)."""
        rows = self._gradient(share)
        if len(self.drives):
            rows = stacked(rows, of_drives(rows.shape[1]))
        return rows

    def kept(self) -> Linkage:
        """The joints in this step, which later steps do not change."""
        out = copy(self)
        out.drives, out._vectors = copy(self.drives), copy(self._vectors)
        return out

    def moving(self, v: Array, bodies: Bodies) -> Array:
        """Velocities of averages, shape (averages, 3) [m/s]. Collective.

        Args:
            v: Velocities of the division's rows, one number each [m/s].
            bodies: The bodies then.
        """
        return self._bound.velocities(v, bodies)

    def across(self, share: float, moving: Array) -> Array:
        """Velocities across rows at the start (0) or end (1) of the step, shape (rows,) [m/s].

        Args:
            share: Which of both.
            moving: Velocities of averages there.
        """
        return np.asarray(self._with(share, partial(self.drives.along, share)) @ moving.ravel())

    def on_vectors(self, multipliers: Array) -> Array:
        """Forces of multipliers on vectors, as a resistance, shape (vectors, 3) [N]."""
        rows = self._of_all(self._share, self.drives.test)
        return np.asarray(rows.T @ multipliers).reshape(-1, 3)

    def residual(self) -> Array:
        """Gap that is to vanish at the end of the step, of each active row [m]."""
        return np.concatenate([self.violation[self.active], self.drives.residual()])

    def compliance(self) -> Array:
        """Derivatives of that by the row's own multiplier [m/N]."""
        return np.concatenate([np.zeros(self.active.size), self.drives.compliance()])

    @property
    def violation(self) -> Array:
        """g at the end of the step, of all rows, shape (rows,) [m]."""
        if self._open is None:
            middle = self._start + 0.5 * self._moved
            self._open = np.asarray(self._g0 + self._terms.gained(middle, self._moved))
        return self._open

    def gradient(self, share: float) -> Matrix:
        """Derivative of the active rows after a part of the step, shape (rows, 3 · averages).

        Args:
            share: 0.5 for the middle of the step, 1 for its end.
        """
        return self._vectors.onto_averages(self._gradient(share), share)

    def _gradient(self, share: float) -> Matrix:
        """The same by vectors, shape (rows, 3 · vectors)."""
        every = self._terms.gradient(self._start + share * self._moved)
        return every if self.active.size == self._every else every[self.active]

    def curvature(self) -> Matrix:
        """Derivative of forces on averages by these, shape (3 · averages,) * 2 [N/m]."""
        rows = self._terms.curvature(self._multipliers, self._share)
        if self.drives.static and len(self.drives):
            rows = csr_array(rows + self.drives.curvature(rows.shape[1]))
        if len(self.points):
            rows = csr_array(rows + self.points.stiffness())
        return self._vectors.stiffness(rows, self.forces, self._share)

    # Forces ---------------------------------------------------------------------------------------

    def resist(self, forces: Forces, on_vectors: Array | None = None) -> None:
        """Add the forces on nodes and bodies, or those of other forces on vectors."""
        self._bound.add(self._on_averages(on_vectors), forces)

    def resist_at_nodes(self, forces: ForcesOfNodes) -> None:
        """Add the forces on nodes, in bodies or not."""
        self._bound.add(self._on_averages(), forces)
        self._vectors.spread(self.forces, self._pose, forces)

    def _on_averages(self, on_vectors: Array | None = None) -> Array:
        """Forces on averages, shape (averages, 3) [N]."""
        on_vectors = self.forces if on_vectors is None else on_vectors
        return self._vectors.forces(on_vectors, self._share)

    def accept(self) -> None:
        """Remember multipliers and coordinates for later steps and divisions."""
        self.points.accept()
        self._q = self.coordinates(self._start + self._moved)
        if self._notes is not None:
            for k, (joint, place) in enumerate(zip(self._joints, self._known, strict=True)):
                own = {name: q for (j, name), q in self._q.items() if j == k}
                self._notes[id(joint)] = self._multipliers[place].copy(), own
            self.drives.note(self._notes)

    def stored(self, bodies: Bodies) -> float:
        """Energy of the springs of joints and remote points now [J]. Collective."""
        if not (len(self.drives) or len(self.points)):
            return 0.0
        p = self._vectors.at(self._bound.positions(Instant(bodies)))
        return self.drives.stored(self.coordinates(p)) + self.points.stored(p)

    def work(self) -> tuple[float, dict[str, float]]:
        """Work of motors and torques in the step, and loss by dampers by their kind [J]."""
        done, taken = self.drives.work()
        more, lost = self.points.work()
        for kind, energy in lost.items():
            taken[kind] = taken.get(kind, 0.0) + energy
        return done + more, taken

    def told(self, added: Callable[[], tuple[Array, Array]] | None = None) -> JointReports:
        """Force and motion of each joint in the step that has been solved, found when asked for.

        Args:
            added: Gives additions to multipliers [N], and their forces on vectors; none in statics.
        """
        q, n = self.coordinates(self._start + self._moved), self.active.size
        dt = np.inf if self.drives.static else self._dt
        rates = {key: (value - self._q[key]) / dt for key, value in q.items()}
        start, moved = self._start, self._moved
        if self.drives.static:  # forces are those at the end
            start, moved = start + moved, np.zeros_like(moved)
        forces, multipliers, open_by = self.forces, self.drives.multipliers, np.abs(self.violation)
        gaps = [float(open_by[own].max(initial=0.0)) for own in self._known]
        joints = [joint for joint in self._joints if isinstance(joint, Joint)]

        def of(k: int) -> JointReport:
            more, on_vectors = (np.zeros(n + multipliers.size), 0.0) if added is None else added()
            own = slice(self._firsts[k], self._firsts[k + 1])
            step = start[own], moved[own], -(forces + on_vectors)[own]
            free = {name: (q[k, name], rates[k, name]) for name in joints[k].pieces.coordinates}
            efforts = self.drives.efforts(multipliers + more[n:], k)
            return told_of(joints[k], step, free, efforts, gaps[k])

        total = float(np.abs(self.multipliers).sum())
        blows = {} if self.drives.static else self.drives.blows
        return JointReports([joint.title for joint in joints], of, total, blows=blows)
