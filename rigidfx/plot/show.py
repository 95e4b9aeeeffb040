"""The deformed body of a report, in a window or a notebook."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import positive, shown
from rigidfx.output.paraview import Body
from rigidfx.plot.arrows import add_arrows, arrows_of, largest_of
from rigidfx.plot.renders import FIELDS, plain, pyvista, surface_of
from rigidfx.report.report import Report

__all__ = ["show"]

Colour = Literal["rigid", "displacement", "velocity"]


def show(report: Report, colour: Colour = "displacement", scale: float = 1.0) -> Any:
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
    if colour not in get_args(Colour):
        wanted = ", ".join(get_args(Colour))
        raise SceneError(f"show: colour must be one of {wanted}, got {shown(colour)}.")
    factor, space = positive("show", "scale", scale), report.state.u.function_space
    if space.mesh.comm.size > 1:
        raise SceneError("show: a window is for one rank; on several, take Shapes or pictures.")
    body, (moved, moving, _) = Body(space), report.shown()
    u = body.on_nodes(moved)
    if colour == "rigid":
        values = body.on_cells(report.state.levels) / 2
    else:
        values = np.linalg.norm(u if colour == "displacement" else body.on_nodes(moving), axis=1)
    pv = pyvista()
    table = np.insert(body.cells, 0, body.cells.shape[1], axis=1)
    types = np.full(len(body.cells), body.vtk_type, np.uint8)
    grid = pv.UnstructuredGrid(table.reshape(-1), types, body.points)
    plotter, (title, unit) = pv.Plotter(), FIELDS[colour]
    plotter.add_mesh(
        surface_of(grid, u, colour, values, factor),
        scalars="colour",
        scalar_bar_args={"title": f"{plain(title)} [{unit}]" if title else "rigid: 1"},
    )
    arrows = arrows_of(report) if factor == 1.0 else None
    if arrows is not None:
        radius = 0.5 * float(np.linalg.norm(np.ptp(body.points, axis=0)))
        add_arrows(plotter, arrows, largest_of([arrows], radius), radius)
    plotter.add_title(f"t = {report.t:.4g} s", font_size=10)
    return plotter.show()
