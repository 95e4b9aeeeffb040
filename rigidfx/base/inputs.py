"""Checked input: numbers, vectors and time functions that a user gives.

A check takes the owner of a value and its name, for the message, and the value. It returns the
value in one form, or raises a `SceneError` that names all three.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Set
from math import isfinite, isnan
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array


def number(owner: str, name: str, value: Any, *, infinite: bool = False) -> float:
    """A user's finite number as a float; plus or minus infinity if it may be infinite."""
    try:
        result = _real(value)
    except Exception:  # whatever a foreign kind of number may raise
        result = float("nan")
    if isfinite(result) or (infinite and not isnan(result)):
        return result
    raise SceneError(f"{owner}: {name} must be a finite number, got {shown(value)}.")


def positive(owner: str, name: str, value: Any, *, infinite: bool = False) -> float:
    """A user's number above zero as a float; infinity if it may be infinite."""
    result = number(owner, name, value, infinite=infinite)
    if result > 0:
        return result
    kind = "number" if infinite else "finite number"
    raise SceneError(f"{owner}: {name} must be a {kind} > 0, got {shown(value)}.")


def at_least_zero(owner: str, name: str, value: Any) -> float:
    """A user's number that is not negative, as a float."""
    result = number(owner, name, value)
    if result < 0:
        raise SceneError(f"{owner}: {name} must be ≥ 0, got {shown(value)}.")
    return result


def whole(owner: str, name: str, value: Any, *, least: int) -> int:
    """A user's whole number, which is no less than the least."""
    other = isinstance(value, (bool, np.bool_, np.timedelta64))
    if isinstance(value, (int, np.integer)) and not other and value >= least:
        return int(value)
    raise SceneError(f"{owner}: {name} must be a whole number ≥ {least}, got {shown(value)}.")


def truth(owner: str, name: str, value: Any) -> None:
    """Check that a user's value is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise SceneError(f"{owner}: {name} must be True or False, got {shown(value)}.")


def of_time(owner: str, name: str, value: Any) -> None:
    """Check that a user's value is a function."""
    if not is_function(value):
        raise SceneError(f"{owner}: {name} must be a function of t, got {shown(value)}.")


def vector(owner: str, name: str, value: Any) -> Array:
    """Three finite numbers as an array, shape (3,)."""
    array = numbers(value)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"{owner}: {name} must be three finite numbers, got {shown(value)}.")
    return array


def direction(owner: str, name: str, value: Any) -> Array:
    """The unit vector along three finite numbers that are not all zero, shape (3,)."""
    given = vector(owner, name, value)
    size = np.abs(given).max()
    if not size > 0:
        raise SceneError(f"{owner}: {name} must have a direction, got {shown(value)}.")
    given = given / size  # whose squares neither overflow nor vanish
    return np.asarray(given / np.linalg.norm(given))


def names(owner: str, name: str, given: Any, of: str) -> tuple[str, ...]:
    """Names of things of some kind as a user lists them; one alone is a list of one."""
    listed = (given,) if isinstance(given, str) else given
    # A set has another order on each rank, as texts are hashed with a random number.
    every = sorted(listed, key=str) if isinstance(listed, Set) else listed
    several = isinstance(every, Iterable) and not isinstance(every, Mapping)
    found = tuple(every) if several else (None,)
    if not all(isinstance(one, str) for one in found):
        raise SceneError(f"{owner}: {name} must be names of {of}, got {shown(given)}.")
    return found


def communicator(owner: str, comm: Any) -> MPI.Intracomm:
    """The communicator that a mesh is to have; not the null communicator."""
    if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL:
        raise SceneError(
            f"{owner}: comm must be a communicator of mpi4py, such as MPI.COMM_WORLD, got "
            f"{shown(comm)}."
        )
    return comm


def path_of(owner: str, name: str, value: Any) -> Path:
    """A user's file or folder, whose name is not empty."""
    if isinstance(value, (str, os.PathLike)):
        text = os.fspath(value)
        if isinstance(text, str) and text and "\0" not in text:
            return Path(text)
    raise SceneError(f"{owner}: {name} must be the name of a file or folder, got {shown(value)}.")


def _real(value: Any) -> float:
    """A real number as a float; other values that could be cast into one raise `TypeError`."""
    if isinstance(value, (np.generic, np.ndarray)) or hasattr(type(value), "__array__"):
        array = np.asarray(value)
        if array.ndim == 0 and not np.ma.is_masked(value):
            if array.dtype.kind in "iuf":
                return float(array)
            if array.dtype.kind == "O":
                return _real(array.item())
    elif not isinstance(value, (bool, str, bytes, bytearray)):
        return float(value)
    raise TypeError(f"{shown(value)} is no real number")


def numbers(value: Any) -> Array:
    """A copy of a value as an array; an empty one if it is ragged, or not of real numbers.

    A function may change the value in place before it gives it again.
    """
    try:
        array = np.asarray(value)
        if not (np.ma.is_masked(value) or _has_truth(value)):
            if array.dtype.kind in "iuf":  # nothing else that NumPy would cast
                return array.astype(np.float64, copy=True)
            if array.dtype.kind == "O":
                return np.array([_real(item) for item in array.flat]).reshape(array.shape)
    except Exception:  # whatever a foreign kind of array or number may raise
        pass
    return np.empty(0)


def _has_truth(value: Any) -> bool:
    """Whether there is a truth value in lists, which NumPy makes a number beside others."""
    if type(value) is float:  # what functions of time give, many times a step
        return False
    if isinstance(value, (list, tuple)):
        return any(map(_has_truth, value))
    return isinstance(value, bool) or getattr(value, "dtype", None) == np.bool_


def scalar(value: Any) -> float:
    """Result of a function as a number, 1 or 0 of a truth value; NaN if it is no real number."""
    if isinstance(value, (float, bool, np.bool_)):
        return float(value)
    array = numbers(value)
    return float(array) if array.ndim == 0 else float("nan")


def is_function(value: Any) -> TypeGuard[Callable[..., Any]]:
    """Whether a value can be a function of time.

    A number that can be called, such as a constant of DOLFINx, is a number.
    """
    return callable(value) and (isinstance(value, type) or not hasattr(value, "__float__"))


def shown(value: Any) -> str:
    """The given value, for a message, whatever it is."""
    try:
        return repr(_plain(value))
    except Exception:  # Python writes no whole number of more than 4300 digits
        return f"something of type {type(value).__name__}"


def _plain(value: Any) -> Any:
    """A value with NumPy's numbers as Python's, in lists and tuples too: 0.3 is shown as 0.3."""
    if isinstance(value, np.number) and not np.ma.is_masked(value):
        return value.item()
    if type(value) in (list, tuple):
        return type(value)(map(_plain, value))
    return value
