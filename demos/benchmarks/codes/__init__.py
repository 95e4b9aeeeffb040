"""Codes that run the same cases: what each needs, and what each gives back."""

from .calculix import calculix
from .case import Case, Outcome, metal_bracket, soft_l
from .exudyn import Found, exudyn, matrices, part_of
from .kratos import kratos
from .ours import rigidfx
from .plain_dolfinx import plain_dolfinx

__all__ = [
    "Case", "Found", "Outcome", "calculix", "exudyn", "kratos", "matrices", "metal_bracket",
    "part_of", "plain_dolfinx", "rigidfx", "soft_l",
]  # fmt: skip
