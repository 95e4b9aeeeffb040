"""Read-only arrays, as reports show them."""

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Entry = TypeVar("Entry", bound=np.generic)


class Sealed:
    """A record whose arrays are read-only once it is made."""

    def __post_init__(self) -> None:
        seal(self)


def seal(record: Any) -> None:
    """Make the arrays of an object read-only, without a copy."""
    for name, value in list(vars(record).items()):
        if isinstance(value, np.ndarray):
            object.__setattr__(record, name, read_only(value))


def read_only(array: npt.NDArray[Entry]) -> npt.NDArray[Entry]:
    """The same numbers, not a copy, through an array that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view
