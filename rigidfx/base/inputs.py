"""Checked input: numbers, vectors and time functions that a user gives."""

from __future__ import annotations

import os
from math import isfinite, isnan
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError

__all__ = ["check_factor", "number", "numbers", "path_of", "positive", "scalar", "vector", "whole"]


def number(owner: str, name: str, value: Any, *, infinite: bool = False) -> float:
    """A user's number as a float.

    Args:
        owner: Whose number it is, for the message.
        name: Name of the number.
        value: The given value.
        infinite: Whether plus or minus infinity will do.

    Raises:
        SceneError: If it is no number, or not finite where it has to be.
    """
    if not isinstance(value, (str, bool)) and value is not None and np.ndim(value) == 0:
        try:
            result = float(value)
        except (TypeError, ValueError):
            result = float("nan")
        if isfinite(result) or (infinite and not isnan(result)):
            return result
    raise SceneError(f"{owner}: {name} must be a finite number, got {value!r}.")


def positive(owner: str, name: str, value: Any, *, infinite: bool = False) -> float:
    """A user's number above zero as a float.

    Args:
        owner: Whose number it is, for the message.
        name: Name of the number.
        value: The given value.
        infinite: Whether infinity will do.

    Raises:
        SceneError: If it is no number, not above zero, or not finite where it has to be.
    """
    result = number(owner, name, value, infinite=infinite)
    if result > 0:
        return result
    kind = "number" if infinite else "finite number"
    raise SceneError(f"{owner}: {name} must be a {kind} > 0, got {value!r}.")


def whole(owner: str, name: str, value: Any, *, least: int) -> int:
    """A user's whole number.

    Args:
        owner: Whose number it is, for the message.
        name: Name of the number.
        value: What was given.
        least: The least that will do.

    Raises:
        SceneError: If it is anything else, or less.
    """
    if not isinstance(value, (bool, np.bool_)) and isinstance(value, (int, np.integer)):
        result = int(value)
        if result >= least:
            return result
    raise SceneError(f"{owner}: {name} must be a whole number ≥ {least}, got {value!r}.")


def path_of(owner: str, name: str, value: Any) -> Path:
    """A user's file or folder.

    Args:
        owner: Whose it is, for the message.
        name: Name of the argument.
        value: What was given.

    Raises:
        SceneError: If it is no path, or an empty one.
    """
    if isinstance(value, (str, os.PathLike)):
        text = os.fspath(value)
        if isinstance(text, str) and text and "\0" not in text:
            return Path(text)
    raise SceneError(f"{owner}: {name} must be the name of a file or folder, got {value!r}.")


def numbers(value: Any) -> npt.NDArray[np.float64]:
    """A copy of the given value as an array; an empty one if it is ragged, or not of real numbers.

    Args:
        value: The given value; a function may change it in place before it gives it again.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biufO":  # neither text nor complex numbers, which NumPy would cast
            return array.astype(np.float64, copy=True)
    except (TypeError, ValueError):
        pass
    return np.empty(0)


def scalar(value: Any) -> float:
    """What a function gave as a number; NaN if it is not one real number, such as a text.

    Args:
        value: What was given.
    """
    array = numbers(value)
    return float(array) if array.ndim == 0 else float("nan")


def vector(owner: object, name: str, value: Any) -> npt.NDArray[np.float64]:
    """Three finite numbers as an array, shape (3,).

    Args:
        owner: Whose value it is, for the message.
        name: Name of the value.
        value: The given value.

    Raises:
        SceneError: If it is anything else.
    """
    array = numbers(value)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(
            f"{type(owner).__name__}: {name} must be three finite numbers, got {value!r}."
        )
    return array


def check_factor(owner: object, time: Any) -> None:
    """Check a factor in time.

    Args:
        owner: Whose factor it is, for the message.
        time: The given factor.

    Raises:
        SceneError: If it is neither a function nor None.
    """
    if time is not None and not callable(time):
        raise SceneError(f"{type(owner).__name__}: time must be a function of t, got {time!r}.")
