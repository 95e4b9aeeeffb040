"""How a scene starts, what damps it, and which parts are rigid from the beginning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.effects.base import WHOLE, Effect, Vector, Windowed, vector
from rigidfx.effects.loads import DeadLoad
from rigidfx.errors import SceneError, number

__all__ = ["InitialVelocity", "NumericalDamping", "Preload", "Rigid"]


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
        vector(self, "linear", self.linear)
        vector(self, "angular", self.angular)
        if self.centre is not None:
            vector(self, "centre", self.centre)
        if self.function is not None and not callable(self.function):
            raise SceneError("InitialVelocity: function must be callable.")


@dataclass(frozen=True)
class NumericalDamping(Windowed):
    """High-frequency dissipation of Armero and Petöcz, equation (22).

    Attributes:
        xi: ξ ≥ 0, dimensionless; the scheme is of first order in Δt where ξ > 0.
    """

    xi: float

    def __post_init__(self) -> None:
        """Check ξ.

        Raises:
            SceneError: If ξ is negative, above ½ or not finite.
        """
        super().__post_init__()
        if not 0 <= number("NumericalDamping", "xi", self.xi) <= 0.5:
            raise SceneError(f"NumericalDamping: xi must lie in [0, 1/2], got {self.xi!r}.")


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
        loads = (self.loads,) if isinstance(self.loads, DeadLoad) else tuple(self.loads)
        object.__setattr__(self, "loads", loads)
        if not self.loads or not all(isinstance(load, DeadLoad) for load in self.loads):
            raise SceneError("Preload: loads must be one or more dead loads.")
        if int(self.increments) != self.increments or self.increments < 1:
            raise SceneError(f"Preload: increments must be an integer ≥ 1, got {self.increments}.")


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
        if self.mass is not None and not number("Rigid", "mass", self.mass) > 0:
            raise SceneError(f"Rigid: mass must be a finite number > 0, got {self.mass!r}.")
        if self.inertia is None:
            return
        J = np.asarray(self.inertia, dtype=np.float64)
        if J.shape != (3, 3) or not np.isfinite(J).all() or not np.allclose(J, J.T, rtol=1e-12):
            raise SceneError(f"Rigid: inertia must be a symmetric 3×3 matrix, got {self.inertia}.")
        a, b, c = np.linalg.eigvalsh(J)
        if a <= 0 or c > (a + b) * (1 + 1e-9):
            raise SceneError(
                f"Rigid: no body has the principal moments of inertia {a:.3g}, {b:.3g}, {c:.3g}: "
                "they must be positive and none above the sum of the others."
            )
