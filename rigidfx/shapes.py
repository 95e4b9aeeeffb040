"""Pictures of the deformed body at several times, by one camera.

pyvista and matplotlib are imported where they are used, not with the package.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from rigidfx.errors import SceneError
from rigidfx.paraview import Body
from rigidfx.plot import figure_of, on_first_rank, save
from rigidfx.report import Report
from rigidfx.scene import Scene

__all__ = ["Shapes"]

Array = npt.NDArray[np.float64]


LIGHT, DARK = "#e8e4da", "#33475b"  # flexible and rigid parts, as in the paper's Fig. 6

Colour = Literal["displacement", "velocity", "rigid"]


@dataclass(frozen=True)
class _Shape:
    """A body at one time; values belong to points, or to cells where these are rigid or not."""

    t: float
    points: Array
    values: Array


class Shapes:
    """Collects the deformed body at several times and draws it, always by the same camera.

    Example:
        >>> shapes = Shapes(scene, times=(0, 1, 2))   # doctest: +SKIP
        >>> for report in simulate(scene, dt=0.01, t_end=2.0):
        ...     shapes.add(report)
        >>> shapes.draw("shapes.png")
    """

    def __init__(
        self,
        scene: Scene,
        times: Iterable[float],
        *,
        colour: Colour = "velocity",
    ) -> None:
        """Choose what is to be seen. Collective.

        Args:
            scene: The problem that is run.
            times: Times [s]; of each, the first step that ends at or after it is taken.
            colour: The field whose magnitude colours the body, or "rigid" for rigid (dark) and
                flexible (light) cells.

        Raises:
            SceneError: If there are no times, or the colour is not one of these.
        """
        self._times = sorted(times)
        if not self._times:
            raise SceneError("Shapes: times must name at least one time.")
        if colour not in get_args(Colour):
            raise SceneError(
                f"Shapes: colour must be one of {', '.join(get_args(Colour))}, got {colour!r}."
            )
        self._colour = colour
        self._comm = scene.comm
        self._body = Body(scene.space)
        self._shapes: list[_Shape] = []

    def add(self, report: Report) -> None:
        """Keep the shape if its time has come. Collective.

        Args:
            report: A step of the run.
        """
        due = 0
        while due < len(self._times) and report.t >= self._times[due] * (1 - 1e-9):
            due += 1
        if not due:
            return
        del self._times[:due]
        state = report.state
        state.rebuild()
        u = self._body.on_nodes(state.u)
        if self._colour == "rigid":
            values = (self._body.on_cells(state.body_numbers()) > 0).astype(np.float64)
        else:
            field = u if self._colour == "displacement" else self._body.on_nodes(state.v)
            values = np.linalg.norm(field, axis=1)
        self._shapes.append(_Shape(report.t, self._body.points + u, values))

    def draw(
        self,
        path: str | Path,
        *,
        columns: int = 4,
        view: tuple[float, float, float] = (1.0, -0.6, 0.5),
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
        title: str = "",
    ) -> None:
        """Draw the shapes kept so far side by side. Collective.

        Args:
            path: Picture to write.
            columns: Shapes in a row.
            view: Direction from the body to the camera.
            up: Direction that points upwards in the picture.
            title: Heading.

        Raises:
            OutputError: If the picture cannot be drawn or written.
        """

        def draw() -> None:
            shapes = self._shapes
            flags = self._colour == "rigid"
            top = 1.0 if flags else max(max(float(s.values.max()) for s in shapes), 1e-300)
            images = _photographs(self._body, shapes, top, view, up, flags)
            wide = min(columns, len(images))
            rows = -(-len(images) // wide)
            figure, axes = figure_of(rows, wide, (2.8 * wide + 1.2, 2.9 * rows + 0.4), title)
            for ax in axes.flat:
                ax.axis("off")
            for ax, shape, image in zip(axes.flat, shapes, images, strict=False):
                ax.imshow(image, interpolation="lanczos")
                ax.set_title(f"$t$ = {shape.t:.4g} s", loc="center", fontsize=12)
            if flags:
                _legend(figure)
            else:
                _colour_bar(figure, axes, top, self._colour)
            save(figure, path)

        on_first_rank(self._comm, draw, f"Shapes: '{path}'")


def _photographs(
    body: Body,
    shapes: Sequence[_Shape],
    top: float,
    view: Sequence[float],
    up: Sequence[float],
    of_cells: bool,
) -> list[Any]:
    """Pictures of the shapes as arrays; colours from 0 to `top`."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista as pv

    every = np.concatenate([shape.points for shape in shapes])
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    radius = float(np.linalg.norm(every - middle, axis=1).max())
    towards = np.asarray(view, float) / np.linalg.norm(view)
    table = np.insert(body.cells, 0, body.cells.shape[1], axis=1)
    types = np.full(len(body.cells), body.vtk_type, np.uint8)
    images = []
    for shape in shapes:
        grid = pv.UnstructuredGrid(table.reshape(-1), types, shape.points)
        data = grid.cell_data if of_cells else grid.point_data
        data["colour"] = shape.values
        surface = grid.extract_surface(nonlinear_subdivision=2)
        plotter = pv.Plotter(off_screen=True, window_size=(700, 700))
        plotter.set_background("white")
        plotter.add_mesh(
            surface,
            scalars="colour",
            cmap=[LIGHT, DARK] if of_cells else "viridis",
            clim=(0.0, top),
            show_scalar_bar=False,
            show_edges=body.cells.shape[1] in (4, 8),
            edge_color="#30303060",
            ambient=0.35,
        )
        plotter.enable_parallel_projection()
        plotter.camera.focal_point = middle
        plotter.camera.position = middle + 4 * radius * towards
        plotter.camera.up = up
        plotter.camera.parallel_scale = 1.02 * radius
        plotter.reset_camera_clipping_range()
        plotter.enable_anti_aliasing("ssaa")
        images.append(plotter.screenshot(return_img=True))
        plotter.close()
    return images


def _legend(figure: Any) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(facecolor=DARK, label="rigid"), Patch(facecolor=LIGHT, label="flexible")]
    figure.legend(handles=patches, loc="outside right center")


def _colour_bar(figure: Any, axes: Any, top: float, colour: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    label = {"displacement": "displacement $|u|$ (m)", "velocity": "velocity $|v|$ (m/s)"}[colour]
    scale = ScalarMappable(Normalize(0.0, top), "viridis")
    bar = figure.colorbar(scale, ax=axes, shrink=0.7, aspect=30, pad=0.02, label=label)
    bar.outline.set_visible(False)
