"""The pieces that joints are made of: rows g = 0, at most quadratic in averages of nodal places.

    point on point      p_A - p_B = 0                  three rows
    a ⊥ b               d_A · d_B = 0                  one row
    point in a plane    (p_B - p_A) · d_A = 0          one row

A row is g = Σ c p_i + Σ s p_k · p_l + constant, in metres: products of directions, which have no
unit, are multiplied by the size of the joint. As rows are quadratic, g(x₁) - g(x₀) is exactly the
gradient at the middle of a step times its increments (docs/theory/joints.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rigidfx.effects.joints.coordinates import Coordinate
from rigidfx.effects.joints.face_motion import Vector

__all__ = ["Pieces", "Row", "perpendiculars"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """A scalar constraint.

    Attributes:
        title: Direction that it holds, in words.
        linear: Number of an average, its component and the factor, of each linear term.
        products: Numbers of two averages and the factor, of each product.
    """

    title: str
    linear: tuple[tuple[int, int, float], ...] = ()
    products: tuple[tuple[int, int, float], ...] = ()


@dataclass
class Pieces:
    """The averages and rows of a joint, as they are put together.

    Attributes:
        size: Length that products of directions are multiplied by [m].
        mass: Mass that the joint moves, in order of magnitude [kg].
        averages: Vectors that rows are made of.
        sides: Side that each of them is of, 0 or 1.
        places: Whether each of them is a place, not a direction.
        rows: The rows.
        coordinates: Free coordinates of the joint, by name: "angle", "travel".
    """

    size: float
    mass: float
    averages: list[Vector] = field(default_factory=list)
    sides: list[int] = field(default_factory=list)
    places: list[bool] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    coordinates: dict[str, Coordinate] = field(default_factory=dict)

    def add(self, average: Vector, side: int) -> int:
        """Take an average of a side, 0 or 1; its number."""
        self.averages.append(average)
        self.sides.append(side)
        self.places.append(average.is_place)
        return len(self.averages) - 1

    def point_on_point(self, a: int, b: int) -> None:
        """Have two points in one place."""
        self.rows += [Row(axis, linear=((a, i, 1.0), (b, i, -1.0))) for i, axis in enumerate("xyz")]

    def perpendicular(self, a: int, b: int, title: str) -> None:
        """Have two directions perpendicular."""
        self.rows.append(Row(title, products=((a, b, self.size),)))

    def in_plane(self, a: int, b: int, normal: int, title: str) -> None:
        """Have two points in one plane across a direction."""
        self.rows.append(Row(title, products=((b, normal, 1.0), (a, normal, -1.0))))


def perpendiculars(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with a unit vector."""
    first: Array = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return first, np.asarray(np.cross(axis, first))
