"""How a scene starts, and which parts are rigid from the beginning."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, numbers, positive, vector
from rigidfx.effects.base import WHOLE, Effect, Vector
from rigidfx.effects.loads import DeadLoad

__all__ = ["InitialVelocity", "Preload", "Rigid"]

SYMMETRY = 1e-6  # of a given tensor, relative to its largest entry; the rest is averaged out


@dataclass(frozen=True)
class InitialVelocity(Effect):
    """Velocity at the start: a rigid motion, or any function of the reference position.

    Attributes:
        linear: Velocity of the centre [m/s].
        angular: Angular velocity ω [rad/s].
        centre: Point of the rotation [m]; the centre of mass if None.
        function: x of shape (3, n) [m] → velocities of shape (3, n) [m/s], added to the rigid
            motion.
    """

    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)
    centre: Vector | None = None
    function: Callable[[npt.NDArray[np.float64]], npt.ArrayLike] | None = None

    def __post_init__(self) -> None:
        """Check the vectors.

        Raises:
            SceneError: If one is not three finite numbers, or `function` is not callable.
        """
        super().__post_init__()
        vector(self, "linear", self.linear)
        vector(self, "angular", self.angular)
        if self.centre is not None:
            vector(self, "centre", self.centre)
        if self.function is not None and not callable(self.function):
            raise SceneError("InitialVelocity: function must be callable.")


@dataclass(frozen=True)
class Preload(Effect):
    """Static equilibrium under loads of its own, found before the dynamics start from rest in it.

    The loads act in the statics only: one that is to stay on is named in the scene as well, one
    that is not is thereby let go suddenly at the start.

    Attributes:
        loads: Dead loads, taken at the start time.
        increments: Number of equal load increments.
    """

    loads: Sequence[DeadLoad]
    increments: int = 1

    def __post_init__(self) -> None:
        """Check the loads.

        Raises:
            SceneError: If there are none, one is not a dead load, or increments < 1.
        """
        super().__post_init__()
        given = (self.loads,) if isinstance(self.loads, DeadLoad) else self.loads
        loads = tuple(given) if isinstance(given, Iterable) else ()
        if not loads or not all(isinstance(load, DeadLoad) for load in loads):
            raise SceneError(f"Preload: loads must be one or more dead loads, got {given!r}.")
        object.__setattr__(self, "loads", loads)
        increments = number("Preload", "increments", self.increments)
        if increments < 1 or not increments.is_integer():
            raise SceneError(
                f"Preload: increments must be an integer ≥ 1, got {self.increments!r}."
            )
        object.__setattr__(self, "increments", int(increments))


@dataclass(frozen=True)
class Rigid(Effect):
    """Cells that move as one rigid body from the beginning.

    A body whose nodes a support holds is refused, unless all components of three or more of its
    nodes that do not lie on a line are held by one support: then it is fixed, or follows the
    support's motion.

    Attributes:
        where: Name of a set of cells; all cells if None.
        mass: Mass in place of the computed one [kg].
        inertia: Inertia about the centre of mass in place of the computed one, shape (3, 3)
            [kg m²].
    """

    where: str | None = None
    mass: float | None = None
    inertia: Sequence[Sequence[float]] | None = None

    @property
    def name(self) -> str:
        """Name of the body in reports."""
        return self.where or WHOLE

    @property
    def given(self) -> bool:
        """Whether it has a mass or an inertia other than that of its cells."""
        return self.mass is not None or self.inertia is not None

    def __post_init__(self) -> None:
        """Check the given data.

        Raises:
            SceneError: If the mass is not positive or the inertia not symmetric positive definite
                with principal moments that a body can have.
        """
        super().__post_init__()
        if self.mass is not None:
            positive("Rigid", "mass", self.mass)
        if self.inertia is None:
            return
        J = numbers(self.inertia)
        shaped = J.shape == (3, 3) and np.isfinite(J).all()
        if not shaped or np.abs(J - J.T).max() > SYMMETRY * np.abs(J).max():
            raise SceneError(
                f"Rigid: inertia must be a symmetric 3×3 matrix, got {self.inertia!r}."
            )
        a, b, c = np.linalg.eigvalsh(J)
        if a <= 0 or c > (a + b) * (1 + 1e-9):
            raise SceneError(
                f"Rigid: no body has the principal moments of inertia {a:.3g}, {b:.3g}, {c:.3g}: "
                "they must be positive and none above the sum of the others."
            )
