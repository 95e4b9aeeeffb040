"""Pictures of the deformed body at several times, by one camera, with displacements enlarged.

pyvista and matplotlib are imported where they are used, not with the package.

`show` draws the body of a report in a window or a notebook.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import floor, log10
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, path_of, positive, shown, whole
from rigidfx.base.instants import reached
from rigidfx.base.types import Array
from rigidfx.flexible.nodal_stress import NodalStress, material_groups
from rigidfx.flexible.stress import tensors, von_mises
from rigidfx.output.field_reader import grid_of
from rigidfx.output.paraview import Body
from rigidfx.plot import renders
from rigidfx.plot.arrows import add_arrows, arrows_of, largest_of
from rigidfx.plot.curves import on_first_rank
from rigidfx.report.report import Report
from rigidfx.report.start import check_report, check_scene
from rigidfx.scene.scene import Scene

Colour = Literal["displacement", "velocity", "rigid", "von_mises"]
SHOWN = 0.1  # largest displacement that is drawn, over the diagonal of the body
Scale = float | Literal["auto"]


def check_scale(owner: str, scale: Any) -> Scale:
    """Refuse a factor that is neither a number > 0 nor "auto"."""
    if isinstance(scale, str):
        if scale != "auto":
            raise SceneError(f"{owner}: scale must be a number > 0 or 'auto', got {shown(scale)}.")
        return "auto"
    return positive(owner, "scale", scale)


def factor_of(scale: Scale, points: Array, displacements: Iterable[Array]) -> float:
    """The factor; if it is to be found, 1, 2 or 5 times a power of ten, and 1 at least.

    The largest displacement of these points is then at most a tenth of the diagonal of the body.
    """
    if scale != "auto":
        return scale
    largest = max((float(np.linalg.norm(u, axis=1).max()) for u in displacements), default=0.0)
    if largest == 0.0:
        return 1.0
    wanted = SHOWN * float(np.linalg.norm(np.ptp(points, axis=0))) / largest
    power = 10 ** floor(log10(wanted))
    return max(1.0, max(step * power for step in (1, 2, 5) if step * power <= wanted))


@dataclass(frozen=True)
class _Shape:
    """A body at one time, and the values that colour its points or its cells."""

    t: float
    displacement: Array
    values: Array
    caption: str | None = None


def _values(colour: str, report: Report, body: Body, u: Array, moving: Any) -> Array:
    """Levels of cells over 2, or sizes of displacements or velocities, on rank 0. Collective."""
    if colour == "rigid":
        return body.on_cells(report.state.levels) / 2
    field = u if colour == "displacement" else body.on_nodes(moving)
    return np.asarray(np.linalg.norm(field, axis=1))


class Shapes:
    """Collects the deformed body at several times and draws it, always by the same camera.

    In a run that goes on from a checkpoint, those of before are there.

    Example:
        >>> shapes = Shapes(scene, times=(0, 1, 2))   # doctest: +SKIP
        >>> for report in simulate(scene, dt=0.01, t_end=2.0):
        ...     shapes.add(report)
        >>> shapes.draw("shapes.png")
    """

    def __init__(
        self, scene: Scene, times: Iterable[float], *, colour: Colour = "velocity"
    ) -> None:
        """Choose times and colours. Collective.

        Args:
            scene: The problem that is run.
            times: Times [s]; of each, the first step that ends at or after it is taken.
            colour: The field whose magnitude colours the body, "von_mises" for that
                stress at nodes, or "rigid" for rigid (dark), reduced and flexible (light) cells.

        Raises:
            SceneError: If there are no times, or the colour is not one of these.
        """
        check_scene("Shapes", scene)
        if not isinstance(times, Iterable) or isinstance(times, str):
            raise SceneError(f"Shapes: times must be a list of times, got {shown(times)}.")
        self._times = sorted(number("Shapes", "times", t) for t in times)
        self.name = f"shapes by {colour} at {self._times}"
        if not self._times:
            raise SceneError("Shapes: times must name at least one time.")
        if colour not in get_args(Colour):
            raise SceneError(
                f"Shapes: colour must be one of {', '.join(get_args(Colour))}, got {shown(colour)}."
            )
        self._colour = colour
        self._scene, self._comm = scene, scene.comm
        stressed = colour == "von_mises"
        self._body = Body(scene.space, material_groups(scene) if stressed else None)
        self._stress = NodalStress(scene) if stressed else None
        self._shapes: list[_Shape] = []
        self._kept: list[_Shape] = []  # one at most
        self._joined = False

    @property
    def count(self) -> int:
        """How many shapes have been kept."""
        return len(self._shapes) + len(self._kept)

    def ends(self) -> Mapping[str, Any] | None:
        """What a checkpoint keeps; on rank 0, else None."""
        if self._comm.rank:
            return None
        return {"times": list(self._times), "shapes": list(self._shapes)}

    def complete(self) -> None:
        """Nothing to do: nothing is kept back."""

    def _go_on(self, report: Report) -> None:
        """Join the run, with what its checkpoint keeps of these shapes."""
        known = report._writers.known(self.name)
        if known is not None:
            self._times, self._shapes = list(known["times"]), list(known["shapes"])
        report._writers.join(self)
        self._joined = True

    def add(self, report: Report) -> None:
        """Keep the shape if its time has come. Collective.

        Args:
            report: The last step of the run so far.

        Raises:
            SceneError: If it is none, of another scene, or the run has gone on since.
        """
        check_report("Shapes.add", self._scene, report)
        if not self._joined:
            self._go_on(report)
        due = 0
        while due < len(self._times) and reached(report.t, self._times[due], report.dt):
            due += 1
        if not due:
            return
        del self._times[:due]
        self._shapes.append(self._shape(report))

    def keep(self, report: Report, caption: str) -> None:
        """Keep the shape of a report, in place of the one that was kept before. Collective.

        Such as where a stress is the largest so far. No checkpoint has it.

        Args:
            report: The last step of the run so far.
            caption: Text above it, before its time.
        """
        check_report("Shapes.keep", self._scene, report)
        self._kept = [replace(self._shape(report), caption=f"{caption}, $t$ = {report.t:.4g} s")]

    def _shape(self, report: Report) -> _Shape:
        """The shape of a report. Collective."""
        state = report.state
        state.rebuild()
        moved, moving = report.shown()
        u = self._body.on_nodes(moved)
        if self._stress is None:
            return _Shape(report.t, u, _values(self._colour, report, self._body, u, moving))
        nodal = self._body.on_nodes_of_parts(self._stress.measure(state.u, report.strains()))
        return _Shape(report.t, u, von_mises(tensors(nodal[:, :6])))

    def draw(
        self,
        path: str | Path,
        *,
        columns: int = 4,
        view: tuple[float, float, float] = renders.VIEW,
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
        title: str = "",
        scale: Scale = 1.0,
    ) -> None:
        """Draw the shapes kept so far side by side. Collective.

        Args:
            path: Picture to write.
            columns: Shapes in a row.
            view: Direction from the body to the camera.
            up: Direction that points upwards in the picture.
            title: Heading.
            scale: Factor of displacements, or "auto"; see `pictures`.

        Raises:
            OutputError: If the picture cannot be drawn or written.
            SceneError: If no shape has been kept, or an argument cannot be used.
        """
        path = path_of("Shapes.draw", "path", path)
        whole("Shapes.draw", "columns", columns, least=1)
        renders.check_camera("Shapes.draw", view, up)
        scale = check_scale("Shapes.draw", scale)
        if not self.count:
            raise SceneError("Shapes.draw: no shape has been added yet, at none of the times.")

        def draw() -> None:
            body = self._body
            by_time = {shape.t: shape for shape in [*self._shapes, *self._kept]}
            kept = [by_time[t] for t in sorted(by_time)]
            factor = factor_of(scale, body.points, (s.displacement for s in kept))
            grid, photographs = grid_of(body), []
            for s in kept:
                surface = renders.surface_of(grid, s.displacement, self._colour, s.values, factor)
                photographs.append(renders.Photograph(s.t, surface, s.caption))
            look = renders.Look(view, up, body.cells.shape[1] in (4, 8), title, factor)
            renders.sheet(path, photographs, self._colour, look, columns)

        on_first_rank(self._comm, draw, f"Shapes: '{path}'")


Magnitude = Literal["rigid", "displacement", "velocity"]


def show(report: Report, colour: Magnitude = "displacement", scale: float = 1.0) -> Any:
    """Show the deformed body by pyvista: in a notebook a picture, else a window.

    Joints have arrows along their forces and moments where displacements are to scale.

    Args:
        report: The last step of a run so far, on one rank.
        colour: The field whose magnitude colours the body, or "rigid" for the levels of cells.
        scale: Factor of the displacement.

    Returns:
        The result of pyvista's `Plotter.show`, which a notebook displays.

    Raises:
        SceneError: If it is no report, the run has gone on, or there are several ranks.
    """
    if not isinstance(report, Report):
        raise SceneError(f"show: report must be a Report, got {type(report).__name__}.")
    if colour not in get_args(Magnitude):
        wanted = ", ".join(get_args(Magnitude))
        raise SceneError(f"show: colour must be one of {wanted}, got {shown(colour)}.")
    factor, space = positive("show", "scale", scale), report.state.u.function_space
    if space.mesh.comm.size > 1:
        raise SceneError("show: a window is for one rank; on several, take Shapes or pictures.")
    body, (moved, moving) = Body(space), report.shown()
    u = body.on_nodes(moved)
    values = _values(colour, report, body, u, moving)
    plotter, (title, unit) = renders.pyvista().Plotter(), renders.FIELDS[colour]
    plotter.add_mesh(
        renders.surface_of(grid_of(body), u, colour, values, factor),
        scalars="colour",
        scalar_bar_args={"title": f"{renders.plain(title)} [{unit}]" if title else "rigid: 1"},
    )
    arrows = arrows_of(report) if factor == 1.0 else None
    if arrows is not None:
        radius = 0.5 * float(np.linalg.norm(np.ptp(body.points, axis=0)))
        add_arrows(plotter, arrows, largest_of([arrows], radius), radius)
    plotter.add_title(f"t = {report.t:.4g} s", font_size=10)
    return plotter.show()
