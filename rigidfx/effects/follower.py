"""Loads that follow the motion of the surface they act on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import check_factor, number, scalar
from rigidfx.effects.base import TimeFunction, Windowed

__all__ = ["Pressure"]


@dataclass(frozen=True)
class Pressure(Windowed):
    """Pressure on the deformed boundary: the force -p n da, with n da = cof(F½) N dA.

    On a closed surface it changes neither linear nor angular momentum. It has no potential in
    general; its work is reported with that of the other loads.

    Attributes:
        where: Name of a set of boundary facets.
        value: p [Pa], positive where it pushes inwards, or a function of time giving it.
        time: Factor as a function of time, such as a `Table`; 1 if None.
    """

    where: str
    value: float | Callable[[float], float]
    time: TimeFunction | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window, value and time function.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        if not callable(self.value):
            number("Pressure", "value", self.value)
        check_factor(self, self.time)

    def intensity(self, t: float) -> float:
        """Pressure at t [Pa]; zero outside the window.

        Args:
            t: Time [s].

        Raises:
            SceneError: If it is not a finite number.
        """
        if not self.active(t):
            return 0.0
        value = self.value(t) if callable(self.value) else self.value
        pressure = scalar(value) * (1.0 if self.time is None else scalar(self.time(t)))
        if not isfinite(pressure):
            raise SceneError(
                f"Pressure on '{self.where}': at t = {t:g} s it is {pressure}; check its value "
                "and time function."
            )
        return pressure
