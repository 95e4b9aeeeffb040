"""A run as one HTML file: its motion in 3D, with a slider of time, in any browser and offline.

The file contains the surface of the body, displacements and fields at some times, and a viewer in
WebGL (`web.html`) that needs nothing else. Numbers are integers of 16 bits, packed by zlib.
"""

import base64
import html
import json
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.inputs import path_of, whole
from rigidfx.output.field_reader import RecordedFields, read_fields
from rigidfx.plot import renders
from rigidfx.plot.curves import on_first_rank, prefixed
from rigidfx.plot.pictures import FRAMES, chosen_times
from rigidfx.plot.shapes import Scale, check_scale, factor_of

Array = npt.NDArray[Any]


def web(
    folder: str | Path,
    *,
    frames: int = FRAMES,
    view: Sequence[float] = renders.VIEW,
    up: Sequence[float] = (0.0, 0.0, 1.0),
    scale: Scale = 1.0,
    title: str = "",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Path:
    """Write a run as a motion in 3D with a slider of time, motion.html. Collective.

    The body is coloured by its flexible, reduced and rigid cells, by displacements and velocities
    and, as far as the run has them, by von Mises stresses and strain rates. Between two times that
    are shown it moves along straight lines. Cells of second order are shown with flat pieces.

    Args:
        folder: Folder of a `Recorder`.
        frames: How many times are contained at most, spread evenly over those written.
        view: Direction from the body to the camera at first.
        up: Direction that points upwards.
        scale: Factor of displacements at first, or "auto", see `pictures`.
        title: Heading; the folder's name if empty.
        comm: Ranks that call this.

    Returns:
        The file, on all ranks.

    Raises:
        SceneError: If frames, view, up or scale cannot be used.
        OutputError: If there are no fields of a run, or the file cannot be written.
    """
    renders.check_camera("web", view, up)
    count, asked = whole("web", "frames", frames, least=1), check_scale("web", scale)
    place = path_of("web", "folder", folder)
    path = place / "motion.html"

    def write() -> None:
        run = read_fields(place)
        about, packed = _content(run, chosen_times(run.times, count), asked)
        about |= {"view": [*map(float, view)], "up": [*map(float, up)]}
        text = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
        heading = html.escape(title or place.resolve().name)
        values = {"title": heading, "about": _json(about), "data": packed}
        for name, value in values.items():
            text = text.replace(f"{{{{{name}}}}}", value)
        path.write_text(text, encoding="utf-8")

    on_first_rank(comm, write, f"web of '{folder}'")
    return path


def _json(about: dict[str, Any]) -> str:
    """Text that does not end the element that it is in."""
    return json.dumps(about, allow_nan=False).replace("<", "\\u003c")


def _content(run: RecordedFields, times: Array, scale: Scale) -> tuple[dict[str, Any], str]:
    """The description of a file, and its arrays packed in the order in which that names them."""
    nodes, triangles, lines, owners = _surface(run)
    cells, owners = np.unique(owners, return_inverse=True)
    wanted = [n for n in renders.FIELDS if n in (*run.on_nodes, *run.on_cells) and n != "rigid"]
    u: list[Array] = []
    values: dict[str, list[Array]] = {name: [] for name in ("level", *wanted)}
    for t in times:
        found = run.at(float(t))
        u.append(found["displacement"][nodes])
        found["level"] = _levels(found, len(run.cells))
        for name, every in values.items():
            array = found[name][cells if name in (*renders.OF_CELLS, "level") else nodes]
            every.append(array if array.ndim == 1 else np.linalg.norm(array, axis=1))
    X, motion = run.points[nodes], np.stack(u)
    step = float(np.abs(motion).max(initial=0.0)) / np.iinfo(np.int16).max or 1.0
    about: dict[str, Any] = {
        "times": times.tolist(),
        "step": step,
        "cells": len(cells),
        "fields": [],
    }
    about |= _ball(X + motion) | {"factor": factor_of(scale, X, u)}
    arrays = {"points": X.astype("<f4"), "motion": np.rint(motion / step).astype("<i2")}
    tables = {"triangles": triangles, "owners": owners, "lines": lines}
    arrays |= {name: table.astype("<u4") for name, table in tables.items()}
    for name, every in values.items():
        of, shares = _field(name, np.stack(every))
        about["fields"].append(of)
        arrays[name] = np.rint(shares * np.iinfo(np.uint16).max).astype("<u2")
    # Those of four bytes first: the browser looks at each in place.
    order = sorted(arrays, key=lambda name: -arrays[name].itemsize)
    about["arrays"] = [
        {"name": n, "kind": arrays[n].dtype.name, "length": arrays[n].size} for n in order
    ]
    packed = zlib.compress(b"".join(arrays[name].tobytes() for name in order))
    return about, base64.b64encode(packed).decode("ascii")


def _surface(run: RecordedFields) -> tuple[Array, Array, Array, Array]:
    """Nodes on the surface, its triangles, its lines, and the cell of each triangle."""
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    grid = run.body()
    grid.point_data["node"] = np.arange(len(run.points), dtype=float)
    grid.cell_data["owner"] = np.arange(len(run.cells))
    skin = vtkDataSetSurfaceFilter()
    skin.SetNonlinearSubdivisionLevel(1)  # then all of its points are nodes
    skin.SetInputData(grid)
    skin.Update()
    faces = renders.pyvista().wrap(skin.GetOutput())
    first_order = run.cells.shape[1] in (4, 8)
    edges = faces.extract_all_edges() if first_order else faces.extract_feature_edges()
    triangles = faces.triangulate()
    corners = np.rint(triangles["node"]).astype(int)[triangles.regular_faces]
    ends = np.rint(edges["node"]).astype(int)[edges.lines.reshape(-1, 3)[:, 1:]]
    nodes, places = np.unique(np.append(corners, ends), return_inverse=True)
    numbers, lines = np.split(places, [corners.size])
    return nodes, numbers, lines, np.asarray(triangles["owner"])


def _levels(found: dict[str, Array], cells: int) -> Array:
    """The level of each cell, a number of `LEVELS`."""
    rigid = list(renders.LEVELS).index("rigid")
    return np.asarray(
        found["level"] if "level" in found else rigid * found.get("rigid", np.zeros(cells))
    )


def _ball(x: Array) -> dict[str, Any]:
    """Middle and radius of a ball round all places, shape (…, 3) [m]."""
    x = x.reshape(-1, 3)
    middle = (x.min(axis=0) + x.max(axis=0)) / 2
    radius = float(np.linalg.norm(x - middle, axis=1).max())
    return {"middle": middle.tolist(), "radius": radius}


def _field(name: str, values: Array) -> tuple[dict[str, Any], Array]:
    """The description of a field, and its values as shares of its scale of colours."""
    of_cells = name in (*renders.OF_CELLS, "level")
    if name == "level":
        levels = renders.LEVELS
        labels = {"title": "level", "labels": list(levels), "colours": list(levels.values())}
        return {"name": name, "of_cells": of_cells} | labels, values / (len(levels) - 1)
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    bottom, top = renders.range_of(field=name, colours=values)
    title, unit = renders.FIELDS[name]
    factor, unit = prefixed(unit, top)
    about: dict[str, Any] = {
        "name": name,
        "title": renders.plain(title),
        "unit": unit,
        "of_cells": of_cells,
    }
    about |= {"bottom": bottom * factor, "top": top * factor, "log": name in renders.LOGARITHMIC}
    about["colours"] = [to_hex(c) for c in colormaps["viridis"].colors]
    if name in renders.LOGARITHMIC:
        bottom, top, values = np.log(bottom), np.log(top), np.log(np.maximum(values, bottom))
    return about, np.clip((values - bottom) / (top - bottom), 0.0, 1.0)
