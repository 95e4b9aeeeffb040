"""The standard pictures of a run, from its folder, in one call; and the tools for any others.

    from rigidfx.plot import pictures
    pictures("out/bar")

    python3 -m rigidfx.plot out/bar

They are made from the recorder's files, so also while a run goes on and after one that was stopped.
`Curve`, `curves` and `histories` draw numbers of any runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import OutputError, SceneError
from rigidfx.base.inputs import number, path_of, shown
from rigidfx.base.progress import bar_over
from rigidfx.base.types import Array
from rigidfx.output.field_reader import read_fields
from rigidfx.output.history import columns_of, resolved_columns
from rigidfx.plot.arrows import Arrows
from rigidfx.plot.curves import (
    Curve,
    check_time,
    curves,
    histories,
    on_first_rank,
)
from rigidfx.plot.panels import of_joints, of_probes
from rigidfx.plot.renders import (
    VIEW,
    Look,
    Photograph,
    check_camera,
    film,
    sheet,
    surface_of,
)
from rigidfx.plot.shapes import Scale, check_scale, factor_of

Camera = tuple[Sequence[float], Sequence[float]]

FRAMES = 100  # times that a film shows at most, unless told otherwise
ENERGIES = {"frozen": "frozen vibration"}


def spent(history: Mapping[str, Array]) -> dict[str, list[Curve]]:
    """The accounts of the ledger in per cent, by panel; nothing where nothing was estimated.

    Args:
        history: The columns of a history.csv by name.
    """
    if not np.isfinite(history.get("deformation", np.array([np.nan]))).any():
        return {}
    t, panels = history["t"], {}
    panels["Energies, % of the energy of deformation"] = _panel(
        t, history, "deformation", ENERGIES, "energy_allowed"
    )
    if np.any(history["damped"] > 0):
        panels["Numerical damping, % of the energy of deformation"] = _panel(
            t, history, "deformation", {"damped": "taken"}, "damping_allowed"
        )
    panels["Time integration, % of the largest displacement"] = _panel(
        t, history, "displacement", {"time_error": "estimated error"}, "time_allowed"
    )
    panels["Rigid parts, % of the largest displacement"] = _panel(
        t, history, "displacement", {"rigidity_error": "estimated error"}, "rigidity_allowed"
    )
    if np.isfinite(history.get("measured_error", np.array([np.nan]))).any():
        # What the one share leaves is the other's: together they are all that was asked.
        budget = history["time_allowed"] + np.nan_to_num(history["rigidity_allowed"])
        panels["All errors, % of the largest displacement"] = _panel(
            t,
            {**history, "budget": budget},
            "displacement",
            {"measured_error": "measured"},
            "budget",
        )
    return {title: curves for title, curves in panels.items() if curves}


def _panel(
    t: Array, h: Mapping[str, Array], scale: str, names: Mapping[str, str], allowed: str
) -> list[Curve]:
    sizes = np.where(h[scale] > 0, h[scale], np.inf)
    every = {**names, allowed: "allowed"}
    known = {
        name: words for name, words in every.items() if name in h and np.isfinite(h[name]).any()
    }
    return [Curve(words, t, 100 * np.nan_to_num(h[name]) / sizes) for name, words in known.items()]


def pictures(
    folder: str | Path,
    *,
    shapes: int = 8,
    frames: int = FRAMES,
    view: Sequence[float] = VIEW,
    up: Sequence[float] = (0.0, 0.0, 1.0),
    scale: Scale = 1.0,
    free_since: float | None = None,
    title: str = "",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> list[Path]:
    """Draw the standard pictures of a run into its folder. Collective.

    These are histories.png, energies and momenta against time; probes.png, displacements and
    stresses of probes, and reactions, as far as there are some; joints.png, see `joints`, if there
    are some; unknowns.png, their number and that of bodies, if it changed; ledger.png, what was
    spent of accuracy, if a run estimates that; shapes.png, the deformed body at several times,
    rigid parts dark, or coloured by displacement where nothing was rigid; stress.png, the same
    shapes coloured by von Mises stress at nodes, if the run has recorded it; strain_rate.png, by
    what the criterion measures, on a logarithmic scale, if a run looks for rigid parts; and
    film.gif, all of the motion. Shapes and film have arrows at joints along the force and the
    moment on their second sides.

    Args:
        folder: Folder of a `Recorder`.
        shapes: How many times are shown in a picture at most.
        frames: How many times the film shows at most; 0 for no film.
        view: Direction from the body to the camera.
        up: Direction that points upwards in the pictures.
        scale: Factor of displacements in shapes and film, which stands on each of them; "auto" for
            one that draws the largest displacement as about a tenth of the body, at least 1.
        free_since: See `histories`.
        title: Heading.
        comm: Ranks that call this.

    Returns:
        The files written, on all ranks.

    Raises:
        SceneError: If shapes, frames, view, up or scale cannot be used.
        OutputError: If the files of the run are not there, or a picture cannot be drawn or written.
    """
    _check(shapes, frames, view, up)
    check_time("pictures", free_since)
    factor = check_scale("pictures", scale)
    place = path_of("pictures", "folder", folder)
    made: list[Path] = []

    def draw() -> None:
        history = place / "history.csv"
        if not history.exists():
            raise OutputError(f"there is no {history}; a Recorder writes it")
        made.extend(_of_numbers(history, free_since, title))
        made.extend(_of_shapes(place, int(shapes), int(frames), (view, up), title, factor))

    on_first_rank(comm, draw, f"pictures of '{folder}'")
    return list(comm.bcast(made))


def _of_numbers(history: Path, free_since: float | None, title: str) -> list[Path]:
    """Draw the content of a table; the files written, on this rank."""
    place, h = history.parent, columns_of(history)
    made = [place / "histories.png"]
    histories(history, made[0], free_since=free_since, title=title, comm=MPI.COMM_SELF)

    def add(name: str, panels: Mapping[str, Sequence[Curve]], ylabel: str | Sequence[str]) -> None:
        if panels:
            made.append(place / name)
            curves(
                panels,
                made[-1],
                xlabel="time (s)",
                ylabel=ylabel,
                title=title,
                comm=MPI.COMM_SELF,
            )

    shown = h | resolved_columns(h)
    for name, panels in (("probes.png", of_probes(shown)), ("joints.png", of_joints(shown))):
        lines = {heading: curves for heading, (curves, _) in panels.items()}
        add(name, lines, [label for _, label in panels.values()])
    if np.ptp(h["unknowns"]) > 0:
        numbers = {"Unknowns": "unknowns", "Rigid bodies": "bodies"}
        of_numbers = {heading: [Curve(n, h["t"], h[n])] for heading, n in numbers.items()}
        add("unknowns.png", of_numbers, "number")
    add("ledger.png", spent(h), "spent (%)")
    return made


def _of_shapes(
    folder: Path, shapes: int, frames: int, camera: Camera, title: str, scale: Scale
) -> list[Path]:
    """Draw the fields of a run; the files written, on this rank."""
    run, made = _Run(folder), []
    factor = factor_of(scale, run.points, run.displacements(max(shapes, frames)))
    look = Look(*camera, run.edges, title, factor)
    first = "rigid" if run.was_rigid() else "displacement"
    others = {"stress": "von_mises", "strain_rate": "strain_rate"}
    wanted = {"shapes": first} | {name: f for name, f in others.items() if run.has(f)}
    for name, field in wanted.items():
        made.append(folder / f"{name}.png")
        photographs = run.photographs(field, shapes, factor)
        sheet(made[-1], photographs, field, look, columns=4)
    if frames > 0:
        made.append(folder / "film.gif")
        film(made[-1], run.photographs(first, frames, factor), first, look)
    return made


def chosen_times(times: Array, most: int) -> Array:
    """So many of these times at most, spread evenly [s]."""
    chosen = np.linspace(0, len(times) - 1, min(most, len(times))).round().astype(int)
    return np.asarray(times[np.unique(chosen)])


def _check(shapes: int, frames: int, view: Sequence[float], up: Sequence[float]) -> None:
    for name, count, least in (("shapes", shapes, 1), ("frames", frames, 0)):
        value = number("pictures", name, count)
        if value < least or not value.is_integer():
            raise SceneError(f"pictures: {name} must be an integer ≥ {least}, got {shown(count)}.")
    check_camera("pictures", view, up)


class _Run:
    """The fields of a run, read back."""

    def __init__(self, folder: Path) -> None:
        """Open the fields."""
        self._fields = read_fields(folder)
        self.points: Array = self._fields.points
        self.edges = self._fields.cells.shape[1] in (4, 8)  # of first order
        known = [folder / f"joints.{kind}" for kind in ("vtkhdf", "pvd")]
        self._joints = next((read_fields(path) for path in known if path.exists()), None)

    def has(self, name: str) -> bool:
        """Whether cells or nodes have a field."""
        return name in (*self._fields.on_nodes, *self._fields.on_cells)

    def was_rigid(self) -> bool:
        """Whether any cell is rigid, or reduced, at any time."""
        flags = (name for name in ("rigid", "level") if self.has(name))
        return any(bool(self._fields[name].any()) for name in flags)

    def _chosen(self, most: int) -> Array:
        """So many times at most, spread evenly [s]."""
        return chosen_times(self._fields.times, most)

    def displacements(self, most: int) -> Iterator[Array]:
        """Displacements of points at so many times at most [m]."""
        return (self._fields.at(t)["displacement"] for t in self._chosen(most))

    def photographs(self, field: str, most: int, scale: float) -> list[Photograph]:
        """The deformed surface at so many times at most, spread evenly."""
        times, out = self._chosen(most), []
        for t in bar_over(times, "reading fields", len(times)):
            found = self._fields.at(t)
            values, u = found[field], found["displacement"]
            if field == "rigid" and "level" in found:
                values = found["level"] / 2
            if values.ndim > 1:
                values = np.linalg.norm(values, axis=1)
            surface = surface_of(self._fields.body(), u, field, values, scale)
            out.append(Photograph(float(t), surface, arrows=self._arrows(float(t), scale)))
        return out

    def _arrows(self, t: float, scale: float) -> Arrows | None:
        """Forces and moments of joints at a time [s]; None if the run has no joints."""
        if self._joints is None:
            return None
        found = self._joints.at(t)
        places = self._joints.points + scale * found["displacement"]
        return Arrows(places, found["force"], found["moment"])
