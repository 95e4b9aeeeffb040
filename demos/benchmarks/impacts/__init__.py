"""Impacts with known answers: cases of the benchmark `impact.py`."""

from .bars import bars
from .bounces import bounces
from .energy import energy_in_contact
from .friction import friction
from .hertz import hertz
from .pairs import energy_of_pairs
from .search import share_of_search
from .wall import bar_against_wall

__all__ = [
    "bar_against_wall", "bars", "bounces", "energy_in_contact", "energy_of_pairs", "friction",
    "hertz", "share_of_search",
]  # fmt: skip
