"""The contents of a CAD file: its volumes and surfaces, and a table of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.types import Array

__all__ = ["CALLED", "Cad", "CadEntity", "Which"]


CALLED = {3: "volumes", 2: "surfaces"}


@dataclass(frozen=True)
class CadEntity:
    """A volume or a surface of a CAD file.

    Attributes:
        dim: 3 for a volume, 2 for a surface.
        number: Its number, the same whenever the file is read.
        label: Its label in the file, "" if it has none; gmsh reads those of parts, seldom those of
            faces.
        kind: "Volume", or the shape of the surface: "Plane", "Cylinder", "Torus" and so on;
            "Other surface" is one that gmsh does not name, such as an extruded spline.
        measure: Volume [m³] or area [m²].
        centre: Centre of mass, shape (3,) [m].
        lower: Least coordinates, shape (3,) [m].
        upper: Greatest coordinates, shape (3,) [m].
        normal: Outward unit normal of a plane, shape (3,); NaN for anything else.
        radius: Radius of a cylinder or a sphere [m], written as a spline or not; NaN for anything
            else.
        volumes: Numbers of the volumes that a surface bounds: two where they are glued.
    """

    dim: int
    number: int
    label: str
    kind: str
    measure: float
    centre: Array
    lower: Array
    upper: Array
    normal: Array
    radius: float
    volumes: tuple[int, ...]

    def within(self, lower: Sequence[float], upper: Sequence[float]) -> bool:
        """Whether it lies in a box.

        Args:
            lower: Corner with the least coordinates [m].
            upper: Opposite corner [m].
        """
        margin = 1e-6 * float(np.max(self.upper - self.lower))  # gmsh's boxes are a little large
        inside = (self.lower >= np.asarray(lower) - margin) & (
            self.upper <= np.asarray(upper) + margin
        )
        return bool(inside.all())

    def __str__(self) -> str:
        """One line with all that tells it from others."""
        extent = self.upper - self.lower
        flat = extent < 1e-6 * extent.max()
        box = " × ".join(f"{x:.4g}" for x in np.where(flat, 0.0, extent))
        shape = f"{self.measure:.4g} m³" if self.dim == 3 else f"{self.measure:.4g} m²"
        if np.isfinite(self.normal).all():
            shape += f", normal {_triple(self.normal)}"
        if np.isfinite(self.radius):
            shape += f", radius {self.radius:.4g} m"
        if self.volumes:
            shape += ", of volume " + " and ".join(map(str, self.volumes))
        label = f" '{self.label}'" if self.label else ""
        return f"{self.number:5d}  {self.kind}{label} at {_triple(self.centre)} m, {box} m, {shape}"


def _triple(x: Array) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in np.round(x, 9) + 0.0) + ")"


@dataclass(frozen=True)
class Cad:
    """The contents of a CAD file; printed, a table.

    Attributes:
        volumes: The volumes by increasing number.
        surfaces: The surfaces by increasing number.
    """

    volumes: tuple[CadEntity, ...]
    surfaces: tuple[CadEntity, ...]

    def of(self, dim: int) -> tuple[CadEntity, ...]:
        """The volumes (3) or the surfaces (2)."""
        return self.volumes if dim == 3 else self.surfaces

    @property
    def size(self) -> float:
        """Diagonal of the box around everything [m]."""
        lower = np.min([v.lower for v in self.volumes], axis=0)
        upper = np.max([v.upper for v in self.volumes], axis=0)
        return float(np.linalg.norm(upper - lower))

    def table(self, dims: Iterable[int] = (3, 2), most: int | None = None) -> str:
        """The lines of the table.

        Args:
            dims: 3 for volumes, 2 for surfaces.
            most: Most lines of each; all if None.
        """
        lines = []
        for dim in dims:
            rows = self.of(dim)
            lines += [f"{CALLED[dim].capitalize()}:", *map(str, rows[:most])]
            if most is not None and len(rows) > most:
                lines.append(f"       and {len(rows) - most} more; list_cad shows all.")
        return "\n".join(lines)

    def __str__(self) -> str:
        """The whole table."""
        return self.table()


Which = int | str | Callable[[CadEntity], bool] | Sequence[Any]
