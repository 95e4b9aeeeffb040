"""The list of cases in which first-order cells lock."""

from __future__ import annotations

from .locking_cases import (
    ELEMENTS,
    PROMISED,
    SOLID,
    Case,
    cantilever,
    cook,
    incompressible,
    large_deflection,
    plate,
    roll_up,
)
from .shell_cases import cylinder, hemisphere, pinched, roof

PLATES = (10, None), (100, 0.00126532), (1000, 0.00126532)  # a/t, and the middle's w D/(q a⁴)


def cases(short: bool) -> list[Case]:
    """All, or those that take seconds."""
    large = PROMISED if short else tuple(ELEMENTS)  # standard cells take longest
    some = [
        Case("cantilever, out of plane", (6, 1, 1), 0.4321, cantilever(2)),
        *(Case(f"clamped plate, a/t {k}", (8, 8, 1), w, plate(k, 8)) for k, w in PLATES),
        Case("pinched hemisphere", (8, 8, 1), 0.0930, hemisphere(8)),
        Case("Cook's membrane", (8, 8, 1), 23.96, cook(8), SOLID),
        Case("cantilever under 4 N, down", (16, 1, 1), 6.698, large_deflection(2), large),
    ]
    if short:
        return some
    return [
        *some,
        Case("cantilever, in plane", (6, 1, 1), 0.1081, cantilever(1)),
        Case("pinched hemisphere", (16, 16, 1), 0.0930, hemisphere(16)),
        Case("roof under its weight", (8, 8, 1), 0.3024, roof(8)),
        Case("nearly incompressible block", (4, 4, 4), None, incompressible(4), SOLID),
        *(Case(f"clamped plate, a/t {k}", (16, 16, 1), w, plate(k, 16)) for k, w in PLATES),
        Case("roof under its weight", (16, 16, 1), 0.3024, roof(16)),
        *(Case("pinched cylinder", (n, n, 1), 1.8248e-5, cylinder(n)) for n in (16, 32)),
        Case("Cook's membrane", (16, 16, 1), 23.96, cook(16), SOLID),
        Case("cantilever under 4 N, back", (16, 1, 1), 3.286, large_deflection(0)),
        Case("strip rolled up", (24, 1, 1), 12.0, roll_up(24), PROMISED),
        Case("hemisphere under 400 N, in", (16, 16, 1), 8.178, pinched(16, 0), PROMISED),
        Case("hemisphere under 400 N, out", (16, 16, 1), 4.067, pinched(16, 1), PROMISED),
        Case("hemisphere under 400 N, in", (24, 24, 1), 8.178, pinched(24, 0), PROMISED),
        Case("hemisphere under 400 N, out", (24, 24, 1), 4.067, pinched(24, 1), PROMISED),
        Case("nearly incompressible block", (6, 6, 6), None, incompressible(6), SOLID),
    ]


# Relative errors allowed on meshes that are coarse on purpose.
TOLERANCES = {
    ("pinched hemisphere", "8x8x1", "enhanced"): 0.3,
    ("pinched cylinder", "16x16x1", "enhanced"): 0.1,
    ("pinched cylinder", "16x16x1", "assumed"): 0.08,
    **{
        (f"hemisphere under 400 N, {way}", mesh, element): most
        for way in ("in", "out")
        for mesh, most in (("16x16x1", 0.11), ("24x24x1", 0.05))
        for element in ("enhanced", "assumed")
    },
    ("nearly incompressible block", "4x4x4", "enhanced"): 0.05,
}
