"""Hard cases: small scenes at the ends of what a method can be asked, with bounds for each."""

from . import (
    bodies,
    cad_parts,
    contact,
    failure,
    first_week,
    material,
    ranks,
    shape,
    stepping,
    twin,
    units,
)
from .case import CASES, Case, Result, Run, carry_out, follow, judge

__all__ = [
    "CASES", "Case", "Result", "Run", "bodies", "cad_parts", "carry_out", "contact", "failure",
    "first_week", "follow", "judge", "material", "ranks", "shape",
    "stepping", "twin", "units",
]  # fmt: skip
