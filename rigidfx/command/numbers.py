"""Numbers of the command line."""

from __future__ import annotations

from argparse import ArgumentTypeError
from math import isfinite, nan

__all__ = ["count", "nonnegative", "number", "positive"]


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not isfinite(value):
        raise ArgumentTypeError(f"'{text}' is no finite number")
    return value


def count(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or int(text) == 0:
        raise ArgumentTypeError(f"must be a whole number ≥ 1, got {text}")
    return int(text)


def positive(text: str) -> float:
    """A number above zero."""
    if number(text) <= 0:
        raise ArgumentTypeError(f"must be > 0, got {text}")
    return number(text)


def nonnegative(text: str) -> float:
    """A number that is not below zero."""
    if number(text) < 0:
        raise ArgumentTypeError(f"must be ≥ 0, got {text}")
    return number(text)
