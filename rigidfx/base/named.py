"""Values by name: a wrong name raises a KeyError that lists the right ones."""

from collections.abc import Iterable, Mapping
from typing import TypeVar

V = TypeVar("V")


class Named(dict[str, V]):
    """A dict of a report; the KeyError of a wrong name lists the names.

    Attributes:
        owner: How a user reads it, such as "report.joints".
        later: Names that it has from the first step on, at t = 0.
    """

    def __init__(self, owner: str, values: Mapping[str, V], later: Iterable[str] = ()) -> None:
        super().__init__(values)
        self.owner, self.later = owner, tuple(later)

    def __missing__(self, name: object) -> V:
        raise no_such(self.owner, name, self, self.later)


def no_such(owner: str, name: object, names: Iterable[str], later: Iterable[str] = ()) -> KeyError:
    """The error of a wrong name of a mapping; it has later names from the first step on."""
    later = tuple(later)
    if name in later:
        return KeyError(f"{owner} has {name!r} from the first step on; this report is of t = 0")
    listed = ", ".join(map(repr, (*names, *later)))
    return KeyError(
        f"{owner} has no {name!r}; its names are {listed}"
        if listed
        else f"{owner} has no {name!r}; it is empty"
    )
