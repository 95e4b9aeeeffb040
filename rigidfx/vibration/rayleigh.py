"""Rayleigh damping by the damping ratios at two frequencies."""

from __future__ import annotations

from math import pi

from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import positive
from rigidfx.effects import MassDamping, StiffnessDamping
from rigidfx.effects.damping import warn_of_ratio


def rayleigh(
    first: float, second: float, ratio: float, second_ratio: float | None = None
) -> tuple[MassDamping, StiffnessDamping]:
    """Rayleigh damping with given damping ratios at two frequencies.

    A mode of angular frequency ω has the ratio ζ = α/(2ω) + βω/2 (R. W. Clough and J. Penzien,
    Dynamics of Structures, 3rd ed., Section 12-5). Between both frequencies ζ is lower than at
    them, outside it is higher.

    Example:
        >>> found = modes(scene, 3).frequencies                       # doctest: +SKIP
        >>> effects = [Fixed("x0"), *rayleigh(found[0], found[2], 0.02)]

    Args:
        first: Frequency [Hz], such as that of the first mode.
        second: Another one, higher [Hz].
        ratio: Damping ratio ζ at the first, 1 where it is critical.
        second_ratio: Damping ratio at the second; the same if None.

    Returns:
        Both effects, for the list of a scene's effects.

    Raises:
        SceneError: If a number cannot be used, or no α > 0 and β > 0 give these ratios.
    """
    f1, f2 = positive("rayleigh", "first", first), positive("rayleigh", "second", second)
    z1 = positive("rayleigh", "ratio", ratio)
    z2 = z1 if second_ratio is None else positive("rayleigh", "second_ratio", second_ratio)
    warn_of_ratio(MPI.COMM_WORLD, "rayleigh", max(z1, z2))
    if not f1 < f2:
        raise SceneError(f"rayleigh: first must be below second, got {f1:g} and {f2:g} Hz.")
    w1, w2 = 2 * pi * f1, 2 * pi * f2
    beta = 2 * (z2 * w2 - z1 * w1) / (w2**2 - w1**2)
    alpha = 2 * z1 * w1 - beta * w1**2
    if not (alpha > 0 and beta > 0):
        raise SceneError(
            f"rayleigh: no α > 0 and β > 0 give the ratio {z1:g} at {f1:g} Hz and {z2:g} at {f2:g} "
            f"Hz: the second must lie between {z1 * f1 / f2:.4g} and {z1 * f2 / f1:.4g}. Take "
            "MassDamping or StiffnessDamping alone beyond."
        )
    return MassDamping(alpha), StiffnessDamping(beta * pi * f1, f1)
