"""Photographs of a deformed body one after another, as an animated GIF.

What stays the same, heading and scale of colours, is drawn once; into it go the photographs, in the
number of pixels that there is for them, and their times.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rigidfx.base.progress import bar_over
from rigidfx.plot.curves import figure_of
from rigidfx.plot.renders import Photograph, images, key, tell_scale

__all__ = ["film"]

SIZE, DPI = (6.4, 5.0), 100  # inches, and pixels of each
DURATION = 80  # ms, of a photograph


def film(
    path: str | Path,
    photographs: Sequence[Photograph],
    field: str,
    *,
    view: Sequence[float],
    up: Sequence[float],
    title: str,
    edges: bool,
    scale: float = 1.0,
) -> None:
    """Draw photographs one after another, as an animated GIF that starts anew at its end.

    Args:
        path: File to write.
        photographs: Photographs, in order.
        field: Field that colours it, one of `FIELDS`.
        view: Direction from the body to the camera.
        up: Direction that points upwards in the picture.
        title: Heading.
        edges: Whether edges of cells are drawn.
        scale: By what their displacements are multiplied, to be told in the film.
    """
    from PIL import Image

    canvas, ax = _frame(photographs, field, title, scale)
    empty = canvas.copy_from_bbox(canvas.figure.bbox)
    box = ax.get_window_extent()
    side = int(min(box.width, box.height))
    left = round(box.x0 + (box.width - side) / 2)
    over = round(SIZE[1] * DPI - box.y1 + (box.height - side) / 2)  # rows are counted from above
    frames = []
    taken = images(photographs, field, view, up, edges, side)
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


def _frame(
    photographs: Sequence[Photograph], field: str, title: str, scale: float
) -> tuple[Any, Any]:
    """The canvas of a picture without a photograph, and the axes where one belongs."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, axes = figure_of(1, 1, SIZE, title)
    figure.set_dpi(DPI)
    canvas, ax = FigureCanvasAgg(figure), axes[0, 0]
    ax.axis("off")
    key(figure, axes, field, photographs)
    tell_scale(figure, scale, photographs)
    ax.set_title(_time(photographs[0]), loc="center", fontsize=12)
    canvas.draw()  # which makes room for the time, too
    figure.set_layout_engine("none")
    ax.set_title("", loc="center")
    canvas.draw()
    return canvas, ax


def _time(photograph: Photograph) -> str:
    return f"$t$ = {photograph.t:.4g} s"
