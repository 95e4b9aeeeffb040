"""Problems that others publish: cases of the benchmark `known_problems.py`."""

from .contacts import BARS, CAPSTAN
from .machines import ANDREWS, BRICARD, FOUR_BARS, HEAVY_TOP
from .motions import EL_CENTRO, PENDULUM, SPIN_UP, TURNING_BAR
from .nafems import BEND, DEEP_BEAM, PLATE, THICK_PLATE
from .row import Found, Problem
from .slender import CHAIN, FIRST_ORDER, PRESTRESSED, PRINCETON, SOFT_CANTILEVER

__all__ = ["PROBLEMS", "Found", "Problem"]

PROBLEMS: dict[str, Problem] = {
    "Princeton beam": PRINCETON,
    "its first-order cells": FIRST_ORDER,
    "spin-up beam": SPIN_UP,
    "turning bar": TURNING_BAR,
    "heavy top": HEAVY_TOP,
    "four-bar linkages": FOUR_BARS,
    "Bricard": BRICARD,
    "Andrews' squeezer": ANDREWS,
    "pendulum": PENDULUM,
    "NAFEMS FV52": PLATE,
    "NAFEMS 5T": DEEP_BEAM,
    "NAFEMS LE10": THICK_PLATE,
    "NAFEMS 3DNLG-5": BEND,
    "prestressed beam": PRESTRESSED,
    "soft cantilever": SOFT_CANTILEVER,
    "hanging chain": CHAIN,
    "two bars": BARS,
    "capstan": CAPSTAN,
    "El Centro": EL_CENTRO,
}
