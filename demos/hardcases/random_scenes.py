"""Hundreds of random scenes, as many as are wanted."""

from __future__ import annotations

import warnings
from collections import Counter

from hypothesis import HealthCheck, given, settings

import rigidfx as rf

from .drafts import BALANCED, ERROR, drafts, outcome


def try_scenes(number: int) -> dict[str, int]:
    """Draw scenes, the same on every machine, and follow each; how many ended how. Collective.

    Raises:
        AssertionError: If a scene neither refuses its input nor keeps its balances.
    """
    seen: Counter[str] = Counter()

    @settings(
        max_examples=number,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(drafts)
    def tried(draft: dict) -> None:
        found = outcome(draft)
        seen[found] += 1
        assert found in (ERROR, BALANCED), f"{found}\n{draft}"

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rf.RigidfxWarning)
        tried()
    return dict(seen)
