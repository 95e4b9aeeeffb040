"""Forces proportional to mass, on nodes by the mass operator and on bodies by Σ m a aᵀ."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.effects.action import Structure
from rigidfx.effects.motion import Forces, Tangent

__all__ = ["Inertia"]

Array = npt.NDArray[np.float64]


class Inertia:
    """The mass of a division; `destroy` frees its work vectors.

    Attributes:
        field: A vector that `add` may be given, of the nodes of the rows.
        spread: Σ m a aᵀ of each body, on the first rank, shape (bodies, n, n).
    """

    def __init__(self, structure: Structure) -> None:
        """Take the mass over. Collective.

        Args:
            structure: The division.
        """
        self._mass, n = structure.mass, structure.bodies.pose.shape[1]
        self.spread: Array = np.zeros((len(structure.bodies), n, n))
        for k, body in enumerate(structure.bodies.of.records):
            products = structure.once * body.mass_products
            self.spread[k, : len(products), : len(products)] = products
        self.field, self._image = structure.rows.vector(), structure.rows.vector()

    def add(self, factor: float, at_nodes: Any, of_bodies: Array, forces: Forces) -> None:
        """Add a multiple of M x.

        Args:
            factor: The factor.
            at_nodes: x of the nodes of the rows, a vector.
            of_bodies: Matrices of x of the bodies, shape (bodies, n, 3).
            forces: The forces.
        """
        self._mass.mult(at_nodes, self._image)
        forces.vector.axpy(factor, self._image)
        if len(of_bodies):
            forces.moments[...] += factor * (self.spread @ of_bodies)

    def stiffen(self, factor: float, tangent: Tangent) -> None:
        """Add the derivative of that by x. Collective."""
        self._mass.add_to(tangent.matrix, factor, tangent.prolongation)
        tangent.add_spread(self.spread, factor * np.eye(3))

    def square(self, at_nodes: Any, of_bodies: Array) -> float:
        """x · M x; those of ranks add up."""
        self._mass.mult(at_nodes, self._image)
        own = float(at_nodes.array_r @ self._image.array_r)
        return own + float(np.vdot(of_bodies, self.spread @ of_bodies))

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        self.field.destroy()
        self._image.destroy()
