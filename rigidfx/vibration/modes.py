"""Modes of small free vibrations: frequencies, shapes, participation, effective masses.

    K φ = ω² M φ,    φᵀMφ = 1,    Γ = φᵀM r,    effective mass Γ²

with r a unit motion of the whole. The sum of the effective masses of all modes, those of zero
frequency among them, is the mass that no support holds (R. W. Clough and J. Penzien, Dynamics of
Structures, 3rd ed., Section 26-4).
"""

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from rigidfx.base.errors import SceneError, on_rank_0
from rigidfx.base.inputs import path_of, whole
from rigidfx.base.sealed import Sealed
from rigidfx.base.taken import check_same
from rigidfx.base.types import TINY, Array, Ints
from rigidfx.base.warning import warn
from rigidfx.linear.eigenpairs import clusters, lowest
from rigidfx.output.field_reader import grid_of
from rigidfx.output.paraview import Body, Series
from rigidfx.plot.curves import on_first_rank
from rigidfx.plot.renders import Look, Photograph, check_camera, sheet, surface_of
from rigidfx.plot.shapes import SHOWN
from rigidfx.report.report import Report
from rigidfx.report.start import Start, check_about, check_scene, taken_from
from rigidfx.scene.scene import Scene
from rigidfx.scene.summary import FURTHER
from rigidfx.scene.weights import inertial_masses
from rigidfx.shapes.responses import LACKING
from rigidfx.vibration.problem import NEGLECTED, Problem

CHEAP = 12_000  # unknowns up to which a description has periods unasked
SAME = 1e-6  # relative distance of two ω² below which any combination of both shapes is a mode


@dataclass(frozen=True)
class Modes(Sealed):
    """Modes in the order of their frequencies; numbers are equal on all ranks.

    Attributes:
        scene: The problem.
        squares: ω² of each, shape (n,) [1/s²]; below zero where the state is unstable.
        shapes: φ at all local nodes, ghosts included, shape (n, nodes, 3) [1/√kg]; those of equal
            frequencies are aligned with the axes as far as they can be.
        participation: Γ = φᵀM r with the unit translations x, y, z [√kg] and rotations about the
            centre of mass [√kg m], shape (n, 6).
        rigid: Number of motions without energy, which are not among the modes.
        mass: Mass of the whole [kg].
    """

    scene: Scene
    squares: Array
    shapes: Array
    participation: Array
    rigid: int
    mass: float

    def __len__(self) -> int:
        return self.squares.size

    @property
    def angular_frequencies(self) -> Array:
        """ω, shape (n,) [rad/s]; zero for an unstable mode."""
        return np.asarray(np.sqrt(np.maximum(self.squares, 0.0)))

    @property
    def frequencies(self) -> Array:
        """f = ω/2π, shape (n,) [Hz]."""
        return np.asarray(self.angular_frequencies / (2 * pi))

    @property
    def periods(self) -> Array:
        """T = 1/f, shape (n,) [s]; infinite for an unstable mode."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.frequencies)

    @property
    def effective_mass(self) -> Array:
        """Mass that takes part in each mode as the whole moves along x, y, z, shape (n, 3) [kg]."""
        return np.asarray(self.participation[:, :3] ** 2)

    def write(self, folder: str | Path) -> Path:
        """Write the shapes for ParaView, one "time" each, its frequency in Hz. Collective.

        The field `displacement` has the shape with its largest displacement as a tenth of the size
        of the whole. ParaView's filter "Warp By Vector" shows it.

        Args:
            folder: Folder for modes.pvd and its files; made if it does not exist.

        Returns:
            Path of modes.pvd.

        Raises:
            OutputError: If it cannot be written.
        """
        into: Path = self.scene.comm.bcast(path_of("Modes.write", "folder", folder))
        path, (body, fields) = into / "modes.pvd", self._scaled()

        def write() -> None:
            into.mkdir(parents=True, exist_ok=True)
            series = Series(path, body)
            for f, field in zip(self.frequencies, fields, strict=True):
                series.write(float(f), {"displacement": field}, {})

        def problem(error: Exception) -> str:
            why, remedy = getattr(error, "strerror", error), "Name a folder that you may write to."
            return f"Modes.write: cannot write to the folder '{into}' ({why or error}). {remedy}"

        on_rank_0(self.scene.comm, write, problem)
        return path

    def draw(
        self,
        path: str | Path,
        *,
        columns: int = 3,
        view: tuple[float, float, float] = (1.0, -0.6, 0.5),
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
    ) -> None:
        """Draw the shapes side by side, with their frequencies. Collective.

        Args:
            path: Picture to write.
            columns: Shapes in a row.
            view: Direction from the body to the camera.
            up: Direction that points upwards in the picture.

        Raises:
            OutputError: If the picture cannot be drawn or written.
            SceneError: If there is no mode, or an argument cannot be used.
        """
        path = path_of("Modes.draw", "path", path)
        whole("Modes.draw", "columns", columns, least=1)
        check_camera("Modes.draw", view, up)
        if not len(self):
            raise SceneError("Modes.draw: there is no mode to draw.")
        body, fields = self._scaled()

        def draw() -> None:
            grid, photographs = grid_of(body), []
            for k, (f, u) in enumerate(zip(self.frequencies, fields, strict=True), start=1):
                size = np.linalg.norm(u, axis=1)
                surface = surface_of(grid, u, "shape", size / max(float(size.max()), TINY))
                photographs.append(Photograph(0.0, surface, f"mode {k}: {f:.5g} Hz"))
            look = Look(view, up, body.cells.shape[1] in (4, 8))
            sheet(path, photographs, "shape", look, columns)

        on_first_rank(self.scene.comm, draw, f"Modes: '{path}'")

    def _scaled(self) -> tuple[Body, list[Array]]:
        """The shapes on rank 0, their largest displacement a tenth of the whole's size. Collective.

        They have the order of the body's points.
        """
        body, fields = Body(self.scene.space), []
        size = np.linalg.norm(np.ptp(body.points, axis=0)) if body.points.size else 0.0
        for shape in self.shapes:
            u = body.on_nodes(shape)
            fields.append(SHOWN * size / np.linalg.norm(u, axis=1).max(initial=TINY) * u)
        return body, fields


def modes(scene: Scene, count: int = 6, *, about: Report | None = None) -> Modes:
    """The lowest modes of small free vibrations of a scene. Collective.

    Supports and springs act as at t = 0, or at the time of the report; parts named `Rigid` are
    rigid, `Reduced` ones move by their shapes about that state, joints hold and their springs act.
    A state that turns as a whole vibrates in the frame that turns with it, with the centrifugal
    softening and without Coriolis forces; `Reduced` parts are flexible there. Contacts, damping and
    the stiffness of follower pressure are left out. A second-order error of the mesh stiffens them:
    see docs/modes.md.

    Args:
        scene: The problem.
        count: Least number of modes, 1 or more. If the last one belongs to a cluster, the whole
            cluster is returned.
        about: A report of the state about which the scene vibrates, with its stresses: the last one
            of `static`, say. The reference without stresses if None, without loads unless they
            leave a mechanism in balance.

    Returns:
        The modes; fewer than asked for where there are no more. Rigid motions that supports and
        springs leave free are left out.

    Raises:
        SceneError: If an argument cannot be used, no modes are found, or Coriolis forces decide a
            motion of the whole.
    """
    check_scene("modes", scene)
    count = whole("modes", "count", count, least=1)
    check_same(scene.comm, "modes", {"count": count, "about": about is not None})
    if about is not None:
        check_about("modes", scene, about)
    state = None if about is None else (about, taken_from(scene, about))
    found, problem = _found(scene, count, state)
    turning = float(problem.spin.omega @ problem.spin.omega)
    decided = bool(problem.motions) and found.squares.min(initial=0.0) < -SAME * turning < 0
    if decided:
        found, problem = _found(scene, count, state, turns=False)
    least = float(found.squares[found.squares > 0].min(initial=np.inf))
    if decided and turning > NEGLECTED * least:
        raise SceneError(
            f"modes: the state turns with {np.sqrt(turning):.4g} rad/s, and nothing holds it "
            "against another motion as a whole, which Coriolis forces decide; modes leave them "
            "out. Hold it by a PrescribedRotation, or by a hinge with a Motor."
        )
    if lacking := problem.lacking:
        near = ", ".join(f"{np.sqrt(max(own, 0.0)) / (2 * pi):.4g}" for own in lacking.values())
        warn(
            scene.comm,
            f"modes: shapes of reduced parts do not span modes {', '.join(map(str, lacking))}, "
            f"which have {near} Hz at most. Loads that excite them give shapes for them; or leave "
            "the Reduced out.",
        )
    if problem.spin.apart**2 > NEGLECTED * least:
        warn(
            scene.comm,
            f"modes: parts of the state turn with angular velocities that differ by "
            f"{problem.spin.apart:.4g} rad/s, and the lowest mode has {np.sqrt(least):.4g} rad/s. "
            "The centrifugal softening of these parts is left out. Take scenes of one part each.",
        )
    if growing := int((found.squares < 0).sum()):
        now = "reference" if about is None else f"state at t = {about.t:g} s"
        warn(
            scene.comm,
            f"modes: the {now} is unstable: {growing} of the modes grow. Take a state before "
            "the limit load.",
        )
    return found


def _found(
    scene: Scene, count: int, about: tuple[Report, Start] | None = None, turns: bool = True
) -> tuple[Modes, Problem]:
    """The modes of a problem, equal ones aligned; its matrices are free then. Collective."""
    problem = Problem(scene, about, turns)
    try:
        pairs = lowest(problem.K, problem.M, count, problem.motions, scale=problem.of_loads)
        seen, n = [problem.seen(q) for q in pairs.vectors], len(pairs.vectors)
        pairs.destroy()
        shapes = np.reshape([own for own, _ in seen], (n, scene.nodal_mass.size, 3))
        gamma = np.reshape([own for _, own in seen], (n, 6))
        turn = _aligned(scene, pairs.values, shapes)
        shapes = np.einsum("ij,jnk->ink", turn, shapes)
        mass = float(scene.sum(inertial_masses(scene).sum()))
        if (division := problem.richer(shapes)) is not None:
            problem.lacking = _lacking(pairs.values, Problem(scene, about, turns, division))
        return Modes(scene, pairs.values, shapes, turn @ gamma, pairs.rigid, mass), problem
    finally:
        problem.destroy()


def _lacking(squares: Array, richer: Problem) -> dict[int, float]:
    """Numbers of modes that are above those of a richer problem, and its ω² [1/s²]. Collective.

    Modes have ω² [1/s²]. The matrices of the richer problem are free then.
    """
    try:
        pairs = lowest(richer.K, richer.M, len(squares), richer.motions, scale=richer.of_loads)
        pairs.destroy()
    finally:
        richer.destroy()
    every = dict(enumerate(pairs.values, start=1))
    known = squares - 2 * LACKING * np.abs(squares)
    return {k: lower for k, lower in every.items() if k > len(known) or lower < known[k - 1]}


def _aligned(scene: Scene, values: Array, shapes: Array) -> Array:
    """Rotation of equal modes, and signs, that do not depend on the ranks, shape (n, n).

    Equal modes are made orthogonal in a second product, whose weights differ by axes, and those
    that this leaves equal in a third one, whose weights differ by places. A weighted sum of each
    mode is positive.
    """
    n = scene.owned_nodes
    X = scene.space.tabulate_dof_coordinates()[:n] - scene.centre_of_mass
    size = float(np.sqrt(scene.sum((X * X).sum()) / max(scene.sum(n), 1.0)))
    weights = scene.averaging_mass[:n, None] * np.array([3.0, 2.0, 1.0])
    # Even and odd in each direction, so that no symmetry of a mode makes its sums vanish.
    slant = np.array([0.5, 0.7, 1.1])
    uneven = weights * np.exp(0.3 * np.tanh(X @ slant / size))[:, None]
    own = shapes[:, :n]
    turn = np.eye(values.size)
    equal: list[tuple[Ints, Array]] = [(np.arange(values.size), values)]
    for product in (weights, uneven):
        equal = [pair for at, of in equal for pair in _equal(at, of)]
        for k, (at, _) in enumerate(equal):
            some = np.einsum("ij,jna->ina", turn[at], own)
            gram = np.asarray(scene.sum(np.einsum("ina,jna,na->ij", some, some, product)))
            found, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
            turn[at] = vectors.T @ turn[at]
            equal[k] = at, found
    slopes = np.exp(np.tanh(X @ slant[::-1] / size))
    sums = np.asarray(scene.sum(np.einsum("ina,na->i", own, weights * slopes[:, None])))
    turned = turn @ sums
    return np.asarray(np.where(turned < 0, -1.0, 1.0)[:, None] * turn)


def _equal(at: Ints, values: Array) -> list[tuple[Ints, Array]]:
    """Those of some sorted values that have equal ones beside them, as clusters."""
    of = clusters(values, SAME)
    every = (np.flatnonzero(of == k) for k in range(int(of.max(initial=-1)) + 1))
    return [(at[own], values[own]) for own in every if own.size > 1]


def periods(scene: Scene, count: int = 3) -> Array:
    """The longest periods of small free vibrations of a scene at its start. Collective.

    They are the periods of `modes`.

    Args:
        scene: The problem.
        count: How many, 1 or more.

    Returns:
        T [s], the longest first; fewer than asked for where a scene has fewer. Unstable modes have
        none.

    Raises:
        SceneError: If there is no scene, or the count is none.
    """
    check_scene("periods", scene)
    count = whole("periods", "count", count, least=1)
    check_same(scene.comm, "periods", {"count": count})
    return _periods(scene, count)[0]


def _periods(scene: Scene, count: int) -> tuple[Array, str]:
    """See `periods`; and words on those of a model with reduced parts. Collective."""
    (found, problem), words = _found(scene, count), ""
    if problem.shaping is not None:
        also = [f"{2 * pi / np.sqrt(own):.4g}" for own in problem.lacking.values() if own > 0]
        words = f", which lacks some near {', '.join(also)} s," if also else ""
        words = f" of the reduced model{words}"
    return found.periods[found.squares > 0][:count], words


def periods_in_words(scene: Scene, dt: float | None, count: int | None) -> list[str]:
    """The line of a description: the periods asked for, or three where they are cheap. Collective.

    A time step that is thought of is compared with them [s].
    """
    if count == 0:
        return []
    if count is None and 3 * scene.space.dofmap.index_map.size_global > CHEAP:
        return ["Periods of small vibrations: describe(periods=3) finds them, in some seconds"]
    try:
        found, of = _periods(scene, 3 if count is None else count)
    except SceneError:
        if count is not None:
            raise
        return []  # nobody has asked
    if not found.size:
        return ["Periods: none, as nothing can vibrate"]
    text = ", ".join(f"{T:.4g}" for T in found)
    steps = "" if dt is None else f"; the first is {found[0] / dt:.3g} steps of Δt = {dt:g} s"
    return [f"Periods of small vibrations{of} as it begins, without loads: {text} s{steps}"]


FURTHER.append(periods_in_words)
