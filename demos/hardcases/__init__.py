"""Hard cases: small scenes at the ends of what a method can be asked, with bounds for each."""

from . import bodies, cad_parts, contact, extremes, failure, first_week, ranks, stepping, twin
from .case import CASES, Case, Result, Run, carry_out, follow, judge
