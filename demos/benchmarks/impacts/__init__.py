"""Impacts with known answers: cases of the benchmark `impact.py`."""

from .rattling import energy_in_contact, energy_of_pairs
from .search import share_of_search
from .single import bounces, friction, hertz
from .waves import bar_against_wall, bars

__all__ = [
    "bar_against_wall", "bars", "bounces", "energy_in_contact", "energy_of_pairs", "friction",
    "hertz", "share_of_search",
]  # fmt: skip
