"""A plate on four columns, half of it: the frame of Göttlicher & Schweizerhof (2005), section 7.2.

The paper's figure with the dimensions is not in its text; they are chosen here. The plate is
6 × 6 m, of which y < 3 m is meshed; the columns are 0.25 × 0.25 × 3 m.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx import Domain, from_gmsh

HEIGHT = 3.0  # m; of the columns
# Lines along each axis [m], and the number of cells between them; the plate is above the last.
LINES = {
    0: ((0.0, 0.6, 0.85, 5.15, 5.4, 6.0), (2, 2, 18, 2, 2)),
    1: ((0.0, 0.6, 0.85, 3.0), (2, 2, 9)),
    2: ((0.0, HEIGHT), (10, 3)),
}
COLUMNS = (1, 1), (3, 1)  # intervals along x and y in which columns stand
COLUMN_INTERVALS = {0: (1, 3), 1: (1,), 2: (0,)}  # those whose cells are cells of columns, too
# Lines in which edges lie at which stresses have no bound: of columns at the plate and the ground.
SHARP = {0: (0.6, 0.85, 5.15, 5.4), 1: (0.6, 0.85), 2: (0.0, HEIGHT)}


def spatial_frame(
    refine: int = 1,
    coarse: int = 1,
    thickness: float = 1.5,
    comm: MPI.Comm = MPI.COMM_WORLD,
    grading: float = 1.0,
) -> Domain:
    """The frame. Collective.

    Cells are named "plate" and "columns"; facets "side", where the plate is pushed, "feet" and
    "symmetry".

    Args:
        refine: How often each interval is divided more finely than at first.
        coarse: How many of these cells are one in the plate, where no column stands above or below.
        thickness: Of the plate [m].
        comm: Communicator of the mesh.
        grading: Power with which cells shrink towards the edges of columns at plate and ground; at
            1 those of an interval are alike.
    """
    domain = from_gmsh(lambda gmsh: _build(gmsh, refine, coarse, thickness), comm)
    if grading != 1.0:
        x = domain.mesh.geometry.x
        for axis, (lines, _) in LINES.items():
            all_lines = (*lines, lines[-1] + thickness) if axis == 2 else lines
            x[:, axis] = _graded(x[:, axis], all_lines, SHARP[axis], grading)
    return domain


def _graded(
    x: npt.NDArray[np.float64],
    lines: tuple[float, ...],
    sharp: tuple[float, ...],
    power: float,
) -> npt.NDArray[np.float64]:
    """Coordinates drawn towards the sharp ones of lines, which stay."""
    out = x.copy()
    for low, high in pairwise(lines):
        inside = (x > low + 1e-9) & (x < high - 1e-9)
        t = (x[inside] - low) / (high - low)
        if low in sharp and high in sharp:
            t = np.where(t < 0.5, (2 * t) ** power / 2, 1 - (2 - 2 * t) ** power / 2)
        elif low in sharp:
            t = t**power
        elif high in sharp:
            t = 1 - (1 - t) ** power
        out[inside] = low + (high - low) * t
    return out


def _build(gmsh: Any, refine: int, coarse: int, thickness: float) -> None:
    """Boxes between the lines, glued, each cut into bricks."""
    occ, model = gmsh.model.occ, gmsh.model
    top = HEIGHT + thickness
    lines_of = {axis: lines for axis, (lines, _) in LINES.items()}
    lines_of[2] = (*lines_of[2], top)
    x, y, z = lines_of.values()
    for i in range(len(x) - 1):
        for j in range(len(y) - 1):
            layers = (0, 1) if (i, j) in COLUMNS else (1,)
            for k in layers:
                size = (x[i + 1] - x[i], y[j + 1] - y[j], z[k + 1] - z[k])
                occ.addBox(x[i], y[j], z[k], *size)
    boxes = occ.getEntities(3)
    occ.fragment(boxes[:1], boxes[1:])
    occ.synchronize()
    for _, curve in model.getEntities(1):
        bounds = np.reshape(model.getBoundingBox(1, curve), (2, 3))
        axis = int(np.argmax(bounds[1] - bounds[0]))
        lines, cells = lines_of[axis], LINES[axis][1]
        interval = int(np.argmin(np.abs(np.asarray(lines) - bounds[0, axis])))
        of_column = interval in COLUMN_INTERVALS[axis]
        count = cells[interval] if of_column else max(1, cells[interval] // coarse)
        model.mesh.setTransfiniteCurve(curve, refine * count + 1)
    for _, surface in model.getEntities(2):
        model.mesh.setTransfiniteSurface(surface)
        model.mesh.setRecombine(2, surface)
    for _, volume in model.getEntities(3):
        model.mesh.setTransfiniteVolume(volume)

    def within(dim: int, lower: tuple[float, ...], upper: tuple[float, ...]) -> list[int]:
        low, high = np.asarray(lower) - 1e-6, np.asarray(upper) + 1e-6
        return [tag for _, tag in model.getEntitiesInBoundingBox(*low, *high, dim)]

    far, middle = x[-1], y[-1]
    for dim, name, lower, upper in (
        (3, "plate", (0, 0, HEIGHT), (far, middle, top)),
        (3, "columns", (0, 0, 0), (far, middle, HEIGHT)),
        (2, "side", (0, 0, HEIGHT), (0, middle, top)),
        (2, "feet", (0, 0, 0), (far, middle, 0)),
        (2, "symmetry", (0, middle, HEIGHT), (far, middle, top)),
    ):
        model.addPhysicalGroup(dim, within(dim, lower, upper), name=name)
    model.mesh.generate(3)
