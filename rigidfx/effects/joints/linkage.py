"""All joints of a division: where their vectors are, their rows, and the forces of these.

The vectors of joints are averages of places of nodes, or turn with a mean face. Rows are at most
quadratic in them, so that forces λ ∇g(p½) do no work where g is zero at both ends of a step
(docs/theory/joints.md). g(x₁) is computed from increments: what rounding leaves of places is the
same in all iterates of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, dense, stacked
from rigidfx.base.named import Named, no_such
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure
from rigidfx.effects.joints.drives import Drives, Element
from rigidfx.effects.joints.elements import Blow
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.pieces import Coordinates, Terms
from rigidfx.effects.joints.remote import Points, RemoteMotion, at_rest
from rigidfx.effects.joints.sides import GROUND
from rigidfx.effects.joints.vectors import BoundAverages, Vectors, stiff_rows
from rigidfx.effects.nodes import Forces, ForcesOfNodes, Instant, Motion
from rigidfx.mechanics.bodies import Bodies

# Force [N], moment [N m] and efforts of a joint.
Acting = tuple[Array, Array, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class JointReport:
    """Force and motion of a joint in a step; forces are those at its midpoint, in space.

    Attributes:
        place: Place of the joint on its first side at the end of the step, shape (3,) [m].
        acting: Finds its forces, when they are first asked for.
        angle: Of the second side about the axis, turns counted [rad]; NaN if it leaves none free.
        travel: Of the second side along the axis [m]; NaN if it leaves none free.
        angle_rate: Mean rate of the angle in the step [rad/s]; NaN likewise.
        travel_rate: Mean rate of the travel [m/s]; NaN likewise.
        gap: Largest violation of its rows at the end of the step [m].
    """

    place: Array
    acting: Callable[[], Acting] = field(repr=False)
    angle: float = np.nan
    travel: float = np.nan
    angle_rate: float = np.nan
    travel_rate: float = np.nan
    gap: float = 0.0

    @cached_property
    def _acts(self) -> Acting:
        return self.acting()

    def __getstate__(self) -> dict[str, Any]:
        """Its forces in place of the function that finds them, for files."""
        return {**vars(self), "acting": None, "_acts": self._acts}

    @property
    def force(self) -> Array:
        """On its second side, of rows, motors and springs together, shape (3,) [N]."""
        return self._acts[0]

    @property
    def moment(self) -> Array:
        """On its second side about the joint's place, likewise [N m]."""
        return self._acts[1]

    @property
    def efforts(self) -> Mapping[str, float]:
        """Torque [N m] or force [N] of each motor, spring and stop that acts, by its owner.

        An owner is "Motor of 'pin'", say. Of two with one owner in the scene each has more: "Motor
        of 'pin', torque 2".
        """
        return self._acts[2]


@dataclass(eq=False, repr=False)
class JointReports(Mapping[str, JointReport]):
    """Reports of joints by title, each made when it is first asked for."""

    titles: Sequence[str] = ()  # of the joints, in the order of the scene
    of: Callable[[int], JointReport] | None = None  # makes the report of a joint by its number
    total: float = 0.0  # sum of the sizes of all multipliers [N]
    later: Sequence[str] = ()  # titles that are known from the first step on, at t = 0
    blows: Mapping[str, Blow] = field(default_factory=dict)  # of stops in the step, by titles
    _made: dict[str, JointReport] = field(default_factory=dict, init=False)

    def __getitem__(self, title: str) -> JointReport:
        if title not in self._made:
            if self.of is None or title not in self.titles:
                raise no_such("report.joints", title, self, self.later)
            self._made[title] = self.of(self.titles.index(title))
        return self._made[title]

    def __iter__(self) -> Iterator[str]:
        return iter(self.titles)

    def __len__(self) -> int:
        return len(self.titles)


def resultant(joint: Joint, middle: Array, forces: Array) -> tuple[Array, Array]:
    """Force [N] and moment about the joint's place [N m] on the second side, shape (3,) each.

    Vectors, shape (vectors, 3), are those at which forces on them act: one on a place acts there,
    one on a direction d is d × f.
    """
    sides, places = np.array(joint.pieces.sides), joint.pieces.places
    side = 0 if joint.b == GROUND else 1  # the ground tells no forces of its own
    sign, on = 1.0 if side else -1.0, sides == side
    arms = middle - np.where(places[:, None], middle[np.argmax(places)], 0.0)
    moment = np.cross(arms[on], forces[on]).sum(axis=0)
    return sign * forces[on & places].sum(axis=0), sign * moment


class JointRows:
    """The rows of all joints, those left out that others imply."""

    def __init__(self, joints: Sequence[Any], firsts: Sequence[int], vectors: int) -> None:
        """Number the rows of placed joints, by the number of each one's first vector."""
        pieces = [joint.pieces for joint in joints]
        counts = [len(own.rows) for own in pieces]
        self.terms = Terms([own.rows for own in pieces], firsts, vectors)
        self.sizes = np.repeat([own.size for own in pieces], counts)
        self.masses = np.repeat([own.mass for own in pieces], counts)  # that joints move [kg]
        self.of_joints = [slice(*pair) for pair in pairwise(accumulate(counts, initial=0))]
        self._titles = [f"{j.title}: {row.title}" for j in joints for row in j.pieces.rows]
        self.active: Ints = np.arange(len(self._titles))  # those that have forces
        self._dropped: Ints = self.active[:0]  # and that follow from the others
        self.multipliers: Array = np.zeros(len(self._titles))  # λ of all rows [N]
        self.violation: Array = self.multipliers  # g of all rows at the end of the step [m]
        self._g0: Array = self.multipliers
        self._motion = at_rest(np.zeros((vectors, 3)))

    def keep(self, rows: Ints) -> None:
        """Let only these rows have forces: numbers among all of them, sorted."""
        self.active = rows
        self._dropped = np.setdiff1d(np.arange(len(self._titles)), rows)
        self.multipliers[self._dropped] = 0.0

    def begin(self, at: RemoteMotion) -> None:
        """Begin a step where vectors are."""
        p = at.places
        g = self.terms.value(p)
        self._g0 = np.where(np.abs(g) > self.terms.rounding(p), g, 0.0)  # at rest nothing moves
        self._motion, self.violation = at, self._g0

    def look(self, motion: RemoteMotion, multipliers: Array) -> None:
        """See an iterate, and λ of the active rows [N]."""
        self._motion, self.multipliers[self.active] = motion, multipliers
        self.violation = self._g0 + self.terms.gained(motion.after(0.5), motion.moved)

    @property
    def redundant(self) -> dict[str, float]:
        """Rows without force, as others imply them: violation over size, by title."""
        off = np.abs(self.violation[self._dropped]) / self.sizes[self._dropped]
        return {self._titles[k]: float(by) for k, by in zip(self._dropped, off, strict=True)}

    def gradient(self, share: float) -> Matrix:
        """Derivatives of the active rows by vectors, after a part of the step."""
        every = self.terms.gradient(self._motion.after(share))
        return every[self.active] if self._dropped.size else every


class Linkage:
    """The joints, motors, springs and remote points of a scene, bound to a division.

    Arrays are equal on all ranks. Averages that are not `used` have no forces: they are measured
    only. `forces` are a resistance on the vectors at the last iterate, shape (vectors, 3) [N].
    """

    def __init__(
        self,
        joints: Sequence[Any],
        elements: Sequence[Element],
        structure: Structure,
        points: Points,
    ) -> None:
        """Bind joints, carried masses last, and motors, springs and stops that act. Collective."""
        scene, bodies, static = structure.scene, structure.bodies, structure.static
        self._share = 1.0 if static else 0.5
        self._joints = tuple(joints)
        self._notes = {} if structure.notes is None else structure.notes
        every = [joint.pieces.averages for joint in joints]
        self._firsts = firsts = [0, *accumulate(map(len, every))]
        self.points = points
        vectors = [vector for own in every for vector in own]
        vectors += points.number(len(vectors))
        stiff = stiff_rows(scene, bodies.of.records, vectors)
        self._vectors = of = Vectors(vectors, stiff)
        self.averages = BoundAverages(of.averages, of.stiff, structure)
        self.rows = JointRows(joints, firsts, of.count)
        self.drives = Drives(scene, elements, firsts, of.count, static)
        self.used = np.zeros(len(of.averages), dtype=bool)
        for k in (*self.rows.terms.averages, *self.drives.averages, *range(firsts[-1], of.count)):
            self.used[of.needed[k]] = True
        stiffness = max(material.stiffness for material, _ in scene.materials)
        sizes = self.rows.sizes
        size = float(np.mean(sizes) if sizes.size else scene.mean_cell_size)
        self._modulus, self.stiffness = stiffness, stiffness * size  # of what moves [N/m²], [N/m]
        free = {
            (k, name): own
            for k, joint in enumerate(joints)
            for name, own in joint.pieces.coordinates.items()
        }
        self._free = Coordinates(list(free.values()), [firsts[k] for k, _ in free], of.count)
        self._q: dict[tuple[int, str], float] = dict.fromkeys(free, 0.0)
        for k, (joint, rows) in enumerate(zip(joints, self.rows.of_joints, strict=True)):
            if (before := self._notes.get(id(joint))) is not None:
                self.rows.multipliers[rows] = before[0]
                self._q |= {(k, name): q for name, q in before[1].items()}
        self.drives.remember(self._notes)
        self._dt = 1.0
        self._motion = at_rest(np.zeros((of.count, 3)))
        self.forces: Array = self._motion.moved

    @property
    def count(self) -> int:
        """Number of rows that have forces, those of motors and springs among them."""
        return self.rows.active.size + len(self.drives)

    @property
    def masses(self) -> Array:
        """Mass that each active row moves, in order of magnitude [kg]."""
        return np.concatenate([self.rows.masses[self.rows.active], self.drives.masses])

    def scale(self, dt: float, drag: float = 0.0) -> Array:
        """κ of each active row: force over displacement of its parts [N/m].

        In statics a drag per mass [1/s²] may resist in place of stiffness.
        """
        stiff = self.drives.static and not drag
        out: Any = self._modulus * self.sizes if stiff else (drag or 2.0 / dt**2) * self.masses
        self.drives.kappa = out[self.rows.active.size :]
        return np.asarray(out)

    @property
    def sizes(self) -> Array:
        """Lengths of what each active row joins [m]."""
        return np.concatenate([self.rows.sizes[self.rows.active], self.drives.sizes])

    @property
    def multipliers(self) -> Array:
        """λ of each active row in the last step [N]."""
        own = self.rows.multipliers[self.rows.active]
        return np.concatenate([own, self.drives.multipliers])

    # Where averages are ---------------------------------------------------------------------------

    def rates(self, v: Array) -> Array:
        """Rates of rows at a step's start by velocities of nodes in no body [m/s]. Collective."""
        of_nodes = v.reshape(-1, 3)[self.averages.rows]
        return np.asarray(self.test() @ self.averages.mean(of_nodes).ravel())

    def _coordinates(self, p: Array) -> dict[tuple[int, str], float]:
        """Angles [rad] and travels [m] where vectors are at p, by joint and name."""
        before = np.array(list(self._q.values()), dtype=np.float64)
        return dict(zip(self._q, map(float, self._free.values(p, before)), strict=True))

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time for a step from t on, of dt [s]; raise as `Motor.at`."""
        self._dt = dt
        self.drives.set_time(t, dt, self._q)
        for action in self.points.actions:
            action.set_time(t + self._share * dt, dt)

    def begin(self, bodies: Bodies) -> None:
        """Begin a step of these bodies: find where averages and vectors are. Collective."""
        self._motion = at_rest(self._vectors.begin(self.averages.positions(Instant(bodies))))
        self._q = self._coordinates(self._motion.places)
        self.drives.begin(self._q, self._motion)
        self.rows.begin(self._motion)

    def look(self, motion: Motion, multipliers: Array) -> None:
        """See an iterate, with λ of the active rows [N]. Collective."""
        n, moved = self.rows.active.size, self._vectors.look(self.averages.moved(motion))
        dt = self._dt or 1.0  # a time that is fixed has none
        self._motion = RemoteMotion(self._motion.places, moved, dt)
        self.rows.look(self._motion, multipliers[:n])
        self.drives.look(self._motion, multipliers[n:])
        p = self._motion.after(self._share)
        self.forces = self.rows.terms.forces(p, self.rows.multipliers)
        if len(self.drives):
            self.drives.add_to(self.forces)
        self.points.resist(self._motion, self.forces)

    def test(self) -> Matrix:
        """Forces on averages per multiplier, transposed, shape (rows, 3 · averages)."""
        return self._by_averages(self._share, self.drives.test)

    def trial(self) -> Matrix:
        """Derivatives of the equations of rows by averages, likewise."""
        return self._by_averages(1.0, self.drives.trial)

    def gradient(self, share: float) -> Matrix:
        """Derivatives of the rows of joints after a part of the step, likewise."""
        return self._vectors.onto_averages(self.rows.gradient(share), share)

    def _by_averages(self, share: float, of_drives: Callable[[], Matrix]) -> Matrix:
        return self._vectors.onto_averages(self._by_vectors(share, of_drives), share)

    def _by_vectors(self, share: float, of_drives: Callable[[], Matrix]) -> Matrix:
        """Rows of joints and drives, shape (rows, 3 · vectors)."""
        rows = self.rows.gradient(share)
        return stacked(rows, of_drives()) if len(self.drives) else rows

    def kept(self) -> Linkage:
        """The joints in this step, which later steps do not change."""
        out = copy(self)
        out.rows, out.drives, out._vectors = copy(self.rows), copy(self.drives), copy(self._vectors)
        return out

    def across(self, share: float, moving: Array) -> Array:
        """Velocities across rows at the step's start (0) or end (1), by those of averages [m/s]."""
        rows = self._by_vectors(share, partial(self.drives.along, share))
        return np.asarray(rows @ self._vectors.rates(moving.ravel(), share))

    def leading(self, end: int) -> tuple[Array, Array, Array]:
        """Rows that keep joints closed and motors' motions, at the step's start (0) or end (1).

        Their derivatives by vectors, shape (rows, vectors, 3), where these are, and the rates that
        rows have [m/s].
        """
        drives, share = self.drives, float(end)
        rows = dense(self._by_vectors(share, partial(drives.along, share)))
        speeds = [-drive.size * (drive.given or (0.0, 0.0))[end] for drive in drives.each]
        active = self.rows.active.size
        bound = np.r_[np.ones(active, dtype=bool), drives.prescribed]
        rates = np.r_[np.zeros(active), speeds][bound]
        return rows[bound].reshape(rates.size, -1, 3), self._motion.after(share), rates

    def bound(self) -> tuple[Array, Array]:
        """Rows that joints and motors of given motion keep, at a step's start: values and slopes.

        Values [m] are those of joints' rows and -ℓ q of motors, shape (rows,); derivatives are by
        averages, shape (rows, 3 · averages).
        """
        drives = self.drives
        q = [-drive.size * self._q[drive.key] for drive in drives.each]
        rows = dense(self._by_averages(0.0, partial(drives.along, 0.0)))
        bound = np.r_[np.ones(self.rows.active.size, dtype=bool), drives.prescribed]
        return np.r_[self.rows.violation[self.rows.active], q][bound], rows[bound]

    def sprung(self) -> Array:
        """Springs of joints and stops that press: slopes, likewise, by √stiffness, at its start."""
        rows = dense(self._by_averages(0.0, partial(self.drives.along, 0.0)))
        return np.sqrt(self.drives.stiffness())[:, None] * rows[self.rows.active.size :]

    def on_vectors(self, multipliers: Array) -> Array:
        """Forces of multipliers on vectors, as a resistance, shape (vectors, 3) [N]."""
        rows = self._by_vectors(self._share, self.drives.test)
        return np.asarray(rows.T @ multipliers).reshape(-1, 3)

    def residual(self) -> Array:
        """Gap that is to vanish at the end of the step, of each active row [m]."""
        return np.concatenate([self.rows.violation[self.rows.active], self.drives.residual()])

    def compliance(self) -> Array:
        """Derivatives of that by the row's own multiplier [m/N]."""
        return np.concatenate([np.zeros(self.rows.active.size), self.drives.compliance()])

    def curvature(self) -> Matrix:
        """Derivative of forces on averages by these, shape (3 · averages,) * 2 [N/m]."""
        rows = self.rows.terms.curvature(self.rows.multipliers, self._share)
        if self.drives.static and len(self.drives):
            rows = csr_array(rows + self.drives.curvature())
        if self.points.actions:
            rows = csr_array(rows + self.points.stiffness(self._motion))
        return self._vectors.stiffness(rows, self.forces, self._share)

    # Forces ---------------------------------------------------------------------------------------

    def resist(self, forces: Forces, on_vectors: Array | None = None) -> None:
        """Add the forces on nodes and bodies, or those of other forces on vectors."""
        on_vectors = self.forces if on_vectors is None else on_vectors
        self.averages.add(self._vectors.forces(on_vectors, self._share), forces)

    def resist_at_nodes(self, motion: Motion, forces: ForcesOfNodes) -> None:
        """Add the forces on nodes, in bodies or not, at the last iterate."""
        self.averages.add(self._vectors.forces(self.forces, self._share), forces)
        of = motion.increments
        self._vectors.spread(self.forces, of.start.pose + self._share * of.displacement, forces)

    def accept(self) -> None:
        """Remember multipliers and coordinates for later steps and divisions."""
        self.points.accept()
        self._q = self._coordinates(self._motion.after(1.0))
        for k, (joint, own) in enumerate(zip(self._joints, self.rows.of_joints, strict=True)):
            free = {name: q for (j, name), q in self._q.items() if j == k}
            self._notes[id(joint)] = self.rows.multipliers[own].copy(), free
        self.drives.note(self._notes)

    def stored(self, bodies: Bodies) -> float:
        """Energy of the springs of joints and remote points now [J]. Collective."""
        if not (len(self.drives) or self.points.actions):
            return 0.0
        p = self._vectors.at(self.averages.positions(Instant(bodies)))
        return self.drives.stored(self._coordinates(p)) + self.points.stored(at_rest(p))

    def work(self) -> tuple[float, list[tuple[str, float]]]:
        """Work of motors and torques in the step, and loss by each damper with its kind [J]."""
        (driven, damped), (done, lost) = self.drives.work(), self.points.work(self._motion)
        return driven + done, [*damped, *lost]

    def told(
        self, added: Callable[[], tuple[Array, Array]] | None = None
    ) -> tuple[JointReports, dict[str, Any]]:
        """Reports of joints in the step that has been solved, and of actions with a title.

        Those of joints are found when asked for. `added` gives additions to multipliers [N], and
        their forces on vectors; none in statics.
        """
        end, middle = self._motion.after(1.0), self._motion.after(self._share)
        before, now, rows, drives = self._q, self._coordinates(end), self.rows, self.drives
        dt = np.inf if drives.static else self._dt
        forces, multipliers = self.forces, drives.multipliers
        open_by = np.abs(rows.violation)
        joints = [joint for joint in self._joints if isinstance(joint, Joint)]

        def acting(k: int) -> Acting:
            on, λ = forces, multipliers
            if added is not None:
                more, on_vectors = added()
                on, λ = forces + on_vectors, multipliers + more[rows.active.size :]
            own = slice(self._firsts[k], self._firsts[k + 1])
            efforts = Named(f"report.joints[{joints[k].title!r}].efforts", drives.efforts(λ, k))
            return *resultant(joints[k], middle[own], -on[own]), efforts

        def of(k: int) -> JointReport:
            joint, own = joints[k], slice(self._firsts[k], self._firsts[k + 1])
            motion: dict[str, Any] = {name: now[k, name] for name in joint.pieces.coordinates}
            motion |= {f"{name}_rate": (q - before[k, name]) / dt for name, q in motion.items()}
            return JointReport(
                place=end[own][np.argmax(joint.pieces.places)],
                acting=partial(acting, k),
                **motion,
                gap=float(open_by[rows.of_joints[k]].max(initial=0.0)),
            )

        total = float(np.abs(self.multipliers).sum())
        blows = {} if drives.static else drives.blows
        points = {a.title: a.told(self._motion) for a in self.points.actions if a.title}
        return JointReports([joint.title for joint in joints], of, total, blows=blows), points
