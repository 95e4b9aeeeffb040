"""Codes that run the same cases: what each needs, and what each gives back."""

from .calculix import calculix, calculix_static, calculix_there
from .case import Case, Outcome, metal_bracket, nearest, soft_l
from .exudyn import Found, exudyn, matrices, part_of
from .here import plain_dolfinx, rigidfx
from .kratos import kratos
