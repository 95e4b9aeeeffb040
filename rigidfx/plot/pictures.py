"""The standard pictures of a run, from the files in its folder, also while the run goes on."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import OutputError
from rigidfx.base.inputs import path_of, whole
from rigidfx.base.progress import bar_over
from rigidfx.base.types import Array
from rigidfx.output.field_reader import RecordedFields, read_fields
from rigidfx.output.history import columns_of, resolved_columns
from rigidfx.plot.arrows import Arrows
from rigidfx.plot.curves import Curve, check_time, curves, histories, on_first_rank
from rigidfx.plot.panels import of_joints, of_probes
from rigidfx.plot.renders import VIEW, Look, Photograph, check_camera, film, sheet, surface_of
from rigidfx.plot.shapes import Scale, check_scale, factor_of

Camera = tuple[Sequence[float], Sequence[float]]

FRAMES = 100  # times that a film shows at most, unless told otherwise
# Panels of the ledger: a heading, a scale, an amount with its name in the legend, the allowed one.
ACCOUNTS = (
    ("Energies", "deformation", "frozen", "frozen vibration", "energy_allowed"),
    ("Numerical damping", "deformation", "damped", "taken", "damping_allowed"),
    ("Time integration", "displacement", "time_error", "estimated error", "time_allowed"),
    ("Rigid parts", "displacement", "rigidity_error", "estimated error", "rigidity_allowed"),
    ("All errors", "displacement", "measured_error", "measured", "budget"),
)
SCALES = {"deformation": "energy of deformation", "displacement": "largest displacement"}


def spent(history: Mapping[str, Array]) -> dict[str, list[Curve]]:
    """The accounts of the ledger in per cent, by panel; nothing where nothing was estimated."""
    h = {name: values for name, values in history.items() if np.isfinite(values).any()}
    if "deformation" not in h:
        return {}
    if not np.any(history["damped"] > 0):
        h = {name: h[name] for name in h if name not in ("damped", "damping_allowed")}
    if "measured_error" in h:
        # What the one share leaves is the other's: together they are all that was asked.
        h["budget"] = history["time_allowed"] + np.nan_to_num(history["rigidity_allowed"])
    out = {}
    for heading, scale, amount, words, allowed in ACCOUNTS:
        sizes = np.where(history[scale] > 0, history[scale], np.inf)
        out[f"{heading}, % of the {SCALES[scale]}"] = [
            Curve(label, h["t"], 100 * np.nan_to_num(h[name]) / sizes)
            for name, label in ((amount, words), (allowed, "allowed"))
            if name in h
        ]
    return {heading: curves for heading, curves in out.items() if curves}


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
    many = whole("pictures", "shapes", shapes, least=1)
    most = whole("pictures", "frames", frames, least=0)
    check_camera("pictures", view, up)
    check_time("pictures", free_since)
    factor = check_scale("pictures", scale)
    place = path_of("pictures", "folder", folder)
    made: list[Path] = []

    def draw() -> None:
        history = place / "history.csv"
        if not history.exists():
            raise OutputError(f"there is no {history}; a Recorder writes it")
        made.extend(_of_numbers(history, free_since, title))
        made.extend(_of_shapes(place, many, most, (view, up), title, factor))

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
                panels, made[-1], xlabel="time (s)", ylabel=ylabel, title=title, comm=MPI.COMM_SELF
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
    run, made = read_fields(folder), []
    known = (folder / f"joints.{kind}" for kind in ("vtkhdf", "pvd"))
    joints = next((read_fields(path) for path in known if path.exists()), None)
    times = chosen_times(run.times, max(shapes, frames))
    factor = factor_of(scale, run.points, (run.at(t)["displacement"] for t in times))
    look = Look(*camera, run.cells.shape[1] in (4, 8), title, factor)
    fields = {*run.on_nodes, *run.on_cells}
    was_rigid = any(run[name].any() for name in ("rigid", "level") if name in fields)
    first = "rigid" if was_rigid else "displacement"
    others = {"stress": "von_mises", "strain_rate": "strain_rate"}
    wanted = {"shapes": first} | {name: field for name, field in others.items() if field in fields}
    for name, field in wanted.items():
        made.append(folder / f"{name}.png")
        photographs = _photographs(run, joints, field, shapes, factor)
        sheet(made[-1], photographs, field, look, columns=4)
    if frames > 0:
        made.append(folder / "film.gif")
        film(made[-1], _photographs(run, joints, first, frames, factor), first, look)
    return made


def _photographs(
    run: RecordedFields, joints: RecordedFields | None, field: str, most: int, scale: float
) -> list[Photograph]:
    """The deformed surface at so many times at most, spread evenly."""
    times, out = chosen_times(run.times, most), []
    for t in bar_over(times, "reading fields", len(times)):
        found = run.at(t)
        values = found[field]
        if field == "rigid" and "level" in found:
            values = found["level"] / 2
        if values.ndim > 1:
            values = np.linalg.norm(values, axis=1)
        surface = surface_of(run.body(), found["displacement"], field, values, scale)
        arrows = None
        if joints is not None:
            of = joints.at(t)
            places = joints.points + scale * of["displacement"]
            arrows = Arrows(places, of["force"], of["moment"])
        out.append(Photograph(float(t), surface, arrows=arrows))
    return out


def chosen_times(times: Array, most: int) -> Array:
    """So many of these times at most, spread evenly [s]."""
    chosen = np.linspace(0, len(times) - 1, min(most, len(times))).round().astype(int)
    return np.asarray(times[np.unique(chosen)])
