"""What is fastened to nodes: point masses, springs to ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers, positive
from rigidfx.effects.base import Effect

__all__ = ["PointMass", "Spring"]

Stiffness = float | Sequence[float] | Sequence[Sequence[float]]


@dataclass(frozen=True)
class PointMass(Effect):
    """A mass without size, spread in equal parts over the nodes of a named set.

    It counts in inertia and momenta, in the mass and inertia of a body that holds its nodes, and in
    `Gravity` that acts everywhere.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        mass: *Total* mass > 0 [kg].
    """

    where: str
    mass: float

    def __post_init__(self) -> None:
        """Check the mass.

        Raises:
            SceneError: If it is not a finite number > 0.
        """
        super().__post_init__()
        positive("PointMass", "mass", self.mass)


@dataclass(frozen=True)
class Spring(Effect):
    """Linear springs, and dashpots if asked for, between nodes and the ground.

    The force -(K u½ + C Δu/Δt) is spread in equal parts over the nodes. Without displacement the
    spring has no force; it acts during the whole run, in a static preload too.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        stiffness: *Total* K [N/m]: a number for all directions, three for x, y and z, or a
            symmetric 3×3 matrix without negative eigenvalue.
        damping: *Total* C [N s/m], likewise; none by default.
    """

    where: str
    stiffness: Stiffness
    damping: Stiffness = 0.0

    def __post_init__(self) -> None:
        """Check both tensors.

        Raises:
            SceneError: If one is no such tensor.
        """
        super().__post_init__()
        for name in ("stiffness", "damping"):
            _tensor(self.where, name, getattr(self, name))

    @property
    def K(self) -> npt.NDArray[np.float64]:
        """Total stiffness, shape (3, 3) [N/m]."""
        return _tensor(self.where, "stiffness", self.stiffness)

    @property
    def C(self) -> npt.NDArray[np.float64]:
        """Total damping, shape (3, 3) [N s/m]."""
        return _tensor(self.where, "damping", self.damping)


def _tensor(where: str, name: str, value: Stiffness) -> npt.NDArray[np.float64]:
    """A symmetric positive semidefinite tensor from one, three or nine numbers, shape (3, 3)."""
    given = numbers(value)
    if given.shape == (3, 3):
        tensor = given
    elif given.shape in ((), (3,)):
        tensor = np.diag(np.broadcast_to(given, 3))
    else:
        tensor = np.full((3, 3), np.nan)
    size = np.abs(tensor).max()
    if not np.isfinite(tensor).all() or not np.allclose(tensor, tensor.T, atol=1e-12 * size):
        good = False
    else:
        good = bool(np.linalg.eigvalsh(tensor)[0] >= -1e-12 * size)
    if not good:
        raise SceneError(
            f"Spring on '{where}': {name} must be a number ≥ 0, three of them, or a symmetric 3×3 "
            f"matrix without negative eigenvalue, got {value!r}."
        )
    return tensor
