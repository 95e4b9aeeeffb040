"""Photographs of a deformed body by one camera, and sheets of them side by side.

All photographs of a sheet or a film show the same piece of space at the same scale, coloured by one
field with the same range; strain rates, which differ by powers of ten, have a logarithmic one.
pyvista draws without a screen; it and matplotlib are imported where they are used. Every function
here is called on one rank only.

A film is an animated GIF. Its heading and scale of colours are drawn once; into it go the
photographs, in the number of pixels that there is for them, and their times.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers, shown
from rigidfx.base.progress import bar_over
from rigidfx.base.types import TINY, Array
from rigidfx.plot.arrows import Arrows, add_arrows, ends_of, largest_of, told
from rigidfx.plot.curves import DPI, figure_of, prefixed, save

VIEW = (1.0, -0.6, 0.5)  # direction from the body to the camera, unless told otherwise
SIDE = 2.9  # inches of a photograph in a sheet
# Of the levels of cells, in the order of their numbers; light and dark as in the paper's Fig. 6.
LEVELS = {"flexible": "#e8e4da", "reduced": "#c98b4b", "rigid": "#33475b"}

# Fields that can colour a body: titles and units of their scales; flags have a legend instead.
FIELDS = {
    "rigid": ("", ""),
    "displacement": ("displacement $|u|$", "m"),
    "shape": ("mode shape, over its largest displacement", "1"),
    "velocity": ("velocity $|v|$", "m/s"),
    "von_mises": ("von Mises stress at nodes", "Pa"),
    "cell_von_mises": ("von Mises stress, mean of each cell", "Pa"),
    "strain_rate": ("strain rate", "1/s"),
}
OF_CELLS = frozenset({"rigid", "cell_von_mises", "strain_rate"})
LOGARITHMIC = frozenset({"strain_rate"})
DECADES = 6  # that a logarithmic scale shows at most; two at least, or it has one number


@dataclass(frozen=True)
class Photograph:
    """A deformed body at a time."""

    t: float  # time [s]
    surface: Any  # deformed surface, from `surface_of`
    caption: str | None = None  # text above it; the time if None
    arrows: Arrows | None = None  # forces of joints; None if there are none


@dataclass(frozen=True)
class Look:
    """How a body is looked at."""

    view: Sequence[float]  # direction from the body to the camera
    up: Sequence[float]  # direction that points upwards in the picture
    edges: bool  # whether edges of cells are drawn
    title: str = ""  # heading
    scale: float = 1.0  # factor of displacements, which the picture tells


def check_camera(owner: str, view: Sequence[float], up: Sequence[float]) -> None:
    """Refuse directions to a camera, and upwards, that are none or parallel."""
    for name, direction in (("view", view), ("up", up)):
        array = numbers(direction)
        if array.shape != (3,) or not np.isfinite(array).all() or not array.any():
            raise SceneError(
                f"{owner}: {name} must be three finite numbers, not all zero, "
                f"got {shown(direction)}."
            )
    if not np.cross(numbers(view), numbers(up)).any():
        raise SceneError(f"{owner}: view and up are parallel: {view!r} and {up!r}.")


def pyvista() -> Any:
    """The module pyvista, told to draw without a screen where there is none."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista as pv

    return pv


def plain(title: str) -> str:
    """A title without its formula: VTK reads a pair of $ as one, in which | begins a column."""
    return title.partition(" $")[0]


def surface_of(
    grid: Any, displacement: Array, field: str, values: Array, scale: float = 1.0
) -> Any:
    """The deformed surface of a body, coloured by a field; the grid's data are replaced.

    Values are those of cells if the field is among `OF_CELLS`, else of points.
    """
    grid.clear_data()
    grid.point_data["displacement"] = displacement
    data = grid.cell_data if field in OF_CELLS else grid.point_data
    data["colour"] = np.asarray(values, np.float32)
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    # Edges of second-order cells are curved: the displacement is interpolated as the points are.
    skin = vtkDataSetSurfaceFilter()
    skin.SetNonlinearSubdivisionLevel(2)
    skin.SetInputData(grid)
    skin.Update()
    surface = pyvista().wrap(skin.GetOutput())
    moved = surface.points + scale * surface.point_data["displacement"]
    surface.points = np.asarray(moved, np.float32)
    return surface


def sheet(
    path: str | Path, photographs: Sequence[Photograph], field: str, look: Look, columns: int
) -> None:
    """Draw photographs side by side, coloured by a field, so many in a row."""
    wide = min(columns, len(photographs))
    rows = -(-len(photographs) // wide)
    figure, axes = figure_of(rows, wide, (SIDE * wide + 1.2, SIDE * rows + 0.4), look.title)
    for ax in axes.flat:
        ax.axis("off")
        ax.set_box_aspect(1)
    for ax, photograph in zip(axes.flat, photographs, strict=False):
        caption = photograph.caption or f"$t$ = {photograph.t:.4g} s"
        ax.set_title(caption, loc="center", fontsize=12)
    key(figure, axes, field, photographs)
    if field != "shape":
        tell_scale(figure, look.scale, photographs)
    # Each is drawn in the pixels that there is room for: to draw more and to make them fewer took
    # most of the time of a sheet.
    figure.set_dpi(DPI)
    figure.draw_without_rendering()
    boxes = [ax.get_window_extent() for ax in axes.flat]
    side = int(min(box.width for box in boxes))
    taken: Iterable[Any] = images(photographs, field, look, side)
    taken = bar_over(taken, f"drawing {Path(path).name}", len(photographs))
    for image, box in zip(taken, boxes, strict=False):
        figure.figimage(image, round(box.x0), round(box.y0), origin="upper")
    save(figure, path)


def tell_scale(figure: Any, scale: float, photographs: Sequence[Photograph]) -> None:
    """Tell how large displacements and forces of joints are drawn."""
    text = "displacements to scale" if scale == 1.0 else f"displacements × {scale:g}"
    _, radius = _ball(photographs)
    if of_joints := told(largest_of([p.arrows for p in photographs], radius)):
        text = f"{text}\n{of_joints}"
    figure.supxlabel(text, fontsize=11, color="0.35")


def _range(photographs: Sequence[Photograph], field: str) -> tuple[float, float]:
    """The ends of the scale of colours."""
    return range_of(field, [p.surface["colour"] for p in photographs])


def range_of(field: str, colours: Iterable[Array]) -> tuple[float, float]:
    """The ends of the scale of a field, by its values at each time."""
    if field == "rigid":
        return 0.0, 1.0
    top = max(*(float(c.max()) for c in colours), TINY)
    if field not in LOGARITHMIC:
        return 0.0, top
    least = (float(c[c > 0].min(initial=top)) for c in colours)
    return max(min(*least, top / 100), top * 10.0**-DECADES), top


def images(photographs: Sequence[Photograph], field: str, look: Look, pixels: int) -> Iterator[Any]:
    """The photographs, coloured by a field, as arrays of shape (pixels, pixels, 3)."""
    bottom, top = _range(photographs, field)
    logarithmic = field in LOGARITHMIC
    pv = pyvista()
    middle, size = _ball(photographs)
    largest = largest_of([p.arrows for p in photographs], size)
    ends = [ends_of(p.arrows, largest, size) for p in photographs if p.arrows is not None]
    reach = np.concatenate([np.empty((0, 3)), *ends]) - middle
    radius = max(size, float(np.linalg.norm(reach, axis=1).max(initial=0.0)))
    towards = np.asarray(look.view, float) / np.linalg.norm(look.view)
    # One window for all of them: to open one takes longer than to draw.
    plotter = pv.Plotter(off_screen=True, window_size=(pixels, pixels))
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    # To draw pictures four times as large, and to shrink them, takes a fifth more time in all.
    plotter.enable_anti_aliasing("msaa", multi_samples=4)
    for photograph in photographs:
        plotter.clear_actors()
        if logarithmic:  # none is below the scale, such as zeros of rigid cells
            colour = photograph.surface["colour"]
            photograph.surface["colour"] = np.maximum(colour, np.float32(bottom))
        plotter.add_mesh(
            photograph.surface,
            scalars="colour",
            cmap=list(LEVELS.values()) if field == "rigid" else "viridis",
            clim=(bottom, top),
            log_scale=logarithmic,
            show_scalar_bar=False,
            show_edges=look.edges,
            edge_color="#30303060",
            ambient=0.35,
            diffuse=0.6,  # a light face towards the camera is not to vanish before the white
        )
        if not look.edges:
            plotter.add_mesh(photograph.surface.extract_feature_edges(), color="#303030")
        if photograph.arrows is not None:
            add_arrows(plotter, photograph.arrows, largest, size)
        plotter.camera.focal_point = middle
        plotter.camera.position = middle + 4 * radius * towards
        plotter.camera.up = look.up
        plotter.camera.parallel_scale = 1.02 * radius
        plotter.reset_camera_clipping_range()
        yield np.array(plotter.screenshot(return_img=True))
    plotter.close()


def _ball(photographs: Sequence[Photograph]) -> tuple[Array, float]:
    """Middle and radius of a ball round the body at all times [m]."""
    boxes = np.array([p.surface.bounds for p in photographs])
    middle = (boxes[:, ::2].min(axis=0) + boxes[:, 1::2].max(axis=0)) / 2
    arms = (np.linalg.norm(p.surface.points - middle, axis=1) for p in photographs)
    return middle, max(float(arm.max()) for arm in arms)


def key(figure: Any, axes: Any, field: str, photographs: Sequence[Photograph]) -> None:
    """Draw a legend of the flags, or a scale of the colours, in a unit with a prefix."""
    if field == "rigid":
        from matplotlib.patches import Patch

        reduced = any((p.surface["colour"] == 0.5).any() for p in photographs)
        of = {level: c for level, c in LEVELS.items() if reduced or level != "reduced"}
        patches = [Patch(facecolor=c, label=level) for level, c in reversed(of.items())]
        figure.legend(handles=patches, loc="outside right center")
        return
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm, Normalize

    (title, unit), (bottom, top) = FIELDS[field], _range(photographs, field)
    factor, unit = prefixed(unit, top)
    norm = LogNorm if field in LOGARITHMIC else Normalize
    scale = ScalarMappable(norm(bottom * factor, top * factor), "viridis")
    label = f"{title} ({unit})"
    bar = figure.colorbar(scale, ax=axes, shrink=0.7, aspect=30, pad=0.02, label=label)
    bar.outline.set_visible(False)


FILM, PIXELS = (6.4, 5.0), 100  # inches, and pixels of each
DURATION = 80  # ms, of a photograph


def film(path: str | Path, photographs: Sequence[Photograph], field: str, look: Look) -> None:
    """Draw photographs one after another, as an animated GIF that starts anew at its end."""
    from PIL import Image

    canvas, ax = _frame(photographs, field, look)
    empty = canvas.copy_from_bbox(canvas.figure.bbox)
    box = ax.get_window_extent()
    side = int(min(box.width, box.height))
    left = round(box.x0 + (box.width - side) / 2)
    over = round(FILM[1] * PIXELS - box.y1 + (box.height - side) / 2)  # rows are counted from above
    frames = []
    taken = images(photographs, field, look, side)
    what = f"drawing {Path(path).name}"
    for image, photograph in zip(bar_over(taken, what, len(photographs)), photographs, strict=True):
        canvas.restore_region(empty)
        ax.set_title(_time(photograph), loc="center", fontsize=12)
        ax.draw_artist(ax.title)
        pixels = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        pixels[over : over + side, left : left + side] = image[..., :3]
        frames.append(Image.fromarray(pixels))
    # One table of colours for all: to find one for each takes as long as to draw it.
    some = np.vstack([np.asarray(frame) for frame in frames[:: -(-len(frames) // 4)]])
    colours = Image.fromarray(some).quantize(256)
    frames = [f.quantize(palette=colours, dither=Image.Dither.NONE) for f in frames]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=DURATION, loop=0)


def _frame(photographs: Sequence[Photograph], field: str, look: Look) -> tuple[Any, Any]:
    """The canvas of a picture without a photograph, and the axes where one belongs."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, axes = figure_of(1, 1, FILM, look.title)
    figure.set_dpi(PIXELS)
    canvas, ax = FigureCanvasAgg(figure), axes[0, 0]
    ax.axis("off")
    key(figure, axes, field, photographs)
    tell_scale(figure, look.scale, photographs)
    ax.set_title(_time(photographs[0]), loc="center", fontsize=12)
    canvas.draw()  # which makes room for the time, too
    figure.set_layout_engine("none")
    ax.set_title("", loc="center")
    canvas.draw()
    return canvas, ax


def _time(photograph: Photograph) -> str:
    return f"$t$ = {photograph.t:.4g} s"
