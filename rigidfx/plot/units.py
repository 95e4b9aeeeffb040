"""Numbers in units with prefixes: 2.1e8 Pa is read as 210 MPa."""

from __future__ import annotations

from math import floor, isfinite, log10

__all__ = ["prefixed"]

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}


def prefixed(unit: str, largest: float) -> tuple[float, str]:
    """The factor from a unit to one with a prefix, and its name.

    Args:
        unit: The unit, such as "Pa"; one that begins with a digit, such as "1/s", takes no prefix.
        largest: Largest number that is to be shown in it [unit]; it becomes one from 1 to 1000.
    """
    if not unit or unit[0].isdigit() or not isfinite(largest) or largest <= 0:
        return 1.0, unit
    power = min(max(3 * floor(log10(largest) / 3 + 1e-12), -12), 12)
    return 10.0**-power, PREFIXES[power] + unit
