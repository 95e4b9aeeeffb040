"""The bar that benchmarks take, and what they all do with it."""

from __future__ import annotations

import rigidfx as rf

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)  # Pa, 1, kg/m³
DT = 0.1  # s
PUSH = rf.Traction("x1", (0.0, 2.0, 3.0))  # Pa; on the end, sideways


def cells_of_bar(unknowns: int) -> tuple[int, int]:
    """Cells along and across a bar ten times as long as thick with about so many unknowns."""
    across = max(1, round((unknowns / 30) ** (1 / 3)))
    return max(2, round(unknowns / (3 * (across + 1) ** 2)) - 1), across


def bar(along: int, across: int) -> rf.Domain:
    """A bar of so many cells, 1 m long each."""
    size = (along, across, across)
    return rf.box((0, 0, 0), size, size)
