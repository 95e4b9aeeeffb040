"""Shapes of modes for ParaView and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import OutputError, SceneError, agree
from rigidfx.base.inputs import path_of, whole
from rigidfx.base.types import Array
from rigidfx.output.field_reader import grid_of
from rigidfx.output.paraview import Body, Series
from rigidfx.plot.curves import on_first_rank
from rigidfx.plot.renders import Look, Photograph, check_camera, sheet, surface_of
from rigidfx.plot.shapes import SHOWN

__all__ = ["draw_modes", "write_modes"]


class Shaped(Protocol):
    """Modes, as far as they are shown: see `Modes`."""

    @property
    def scene(self) -> Any:
        """The problem."""

    @property
    def frequencies(self) -> Array:
        """In Hz."""

    @property
    def shapes(self) -> Array:
        """Shape (n, nodes, 3)."""


def write_modes(modes: Shaped, folder: Path) -> Path:
    """Write modes.pvd into a folder: see `Modes.write`. Collective."""
    scene = modes.scene
    folder = scene.comm.bcast(folder)
    body, path = Body(scene.space), folder / "modes.pvd"
    fields = [body.on_nodes(shape) for shape in _scaled(modes)]
    problem = None
    if scene.comm.rank == 0:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            series = Series(path, body)
            for f, field in zip(modes.frequencies, fields, strict=True):
                series.write(float(f), {"displacement": field}, {})
        except OSError as error:
            problem = (
                f"Modes.write: cannot write to the folder '{folder}' ({error.strerror or error}). "
                "Name a folder that you may write to."
            )
    agree(scene.comm, problem, OutputError)
    return path


def draw_modes(
    modes: Shaped,
    path: str | Path,
    columns: int,
    view: tuple[float, float, float],
    up: tuple[float, float, float],
) -> None:
    """Draw the shapes: see `Modes.draw`. Collective."""
    path = path_of("Modes.draw", "path", path)
    whole("Modes.draw", "columns", columns, least=1)
    check_camera("Modes.draw", view, up)
    if not len(modes.shapes):
        raise SceneError("Modes.draw: there is no mode to draw.")
    body = Body(modes.scene.space)
    fields = [body.on_nodes(shape) for shape in _scaled(modes)]

    def draw() -> None:
        grid, photographs = grid_of(body), []
        for k, (f, u) in enumerate(zip(modes.frequencies, fields, strict=True), start=1):
            size = np.linalg.norm(u, axis=1)
            surface = surface_of(grid, u, "shape", size / max(float(size.max()), 1e-300))
            photographs.append(Photograph(0.0, surface, f"mode {k}: {f:.5g} Hz"))
        look = Look(view, up, body.cells.shape[1] in (4, 8))
        sheet(path, photographs, "shape", look, columns)

    on_first_rank(modes.scene.comm, draw, f"Modes: '{path}'")


def _scaled(modes: Shaped) -> list[Array]:
    """The shapes with their largest displacement a tenth of the size of the whole. Collective."""
    scene = modes.scene
    X, n = scene.space.tabulate_dof_coordinates(), scene.owned_nodes
    ends = np.r_[X[:n].max(axis=0, initial=-np.inf), -X[:n].min(axis=0, initial=np.inf)]
    scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    size = float(np.linalg.norm(ends[:3] + ends[3:]))
    largest = np.linalg.norm(modes.shapes[:, :n], axis=2).max(axis=1, initial=0.0)
    scene.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    scale = SHOWN * size / np.maximum(largest, 1e-300)
    return list(scale[:, None, None] * modes.shapes)
