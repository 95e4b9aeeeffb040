"""A look at a UNV file before gmsh reads it, whose reader ends Python over some of them.

A group may name an element that the file has not: gmsh itself writes groups of points so.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rigidfx.base.errors import SceneError
from rigidfx.base.text_files import decoded

__all__ = ["check_unv"]

ELEMENTS = "2412"  # the number of their data set
GROUPS = ("2429", "2430", "2432", "2435", "2452", "2467", "2477")  # those of groups
BEAMS = ("11", "21", "22", "23", "24")  # kinds of elements that take a line more
OF_ELEMENTS = "8"  # the kind of a group's member that is an element


def check_unv(path: Path) -> None:
    """Refuse groups of elements that are not there.

    Args:
        path: The file.

    Raises:
        SceneError: With the group's name and the element.
    """
    known: set[str] = set()
    members: list[tuple[str, str]] = []
    for kind, lines in _data_sets(path):
        try:
            if kind == ELEMENTS:
                known.update(_elements(lines))
            elif kind in GROUPS:
                members += _members(lines)
        except (IndexError, ValueError, RuntimeError, StopIteration):
            raise SceneError(f"'{path}' is damaged: data set {kind} breaks off.") from None
    for name, number in members:
        if number not in known:
            raise SceneError(
                f"'{path}': the group '{name}' names element {number}, which is not in the file. "
                "Write it without this group, of points, say; with_vertices names points."
            )


def _data_sets(path: Path) -> Iterator[tuple[str, Iterator[list[str]]]]:
    """Number of each data set, and the words of its lines."""
    own: list[list[str]] | None = None
    with path.open("rb") as file:
        for line in file:
            words = decoded(line).split()
            if words != ["-1"]:
                if own is not None and (not own or own[0][0] in (ELEMENTS, *GROUPS)):
                    own.append(words or [""])
            elif own is None:
                own = []
            else:
                if own and own[0]:
                    yield own[0][0], iter(own[1:])
                own = None
    if own is not None:
        raise SceneError(f"'{path}' is damaged: its last data set breaks off.")


def _elements(lines: Iterator[list[str]]) -> Iterator[str]:
    for words in lines:
        yield words[0]
        left = int(words[5])
        if words[1] in BEAMS:
            next(lines)
        while left > 0:
            left -= len(next(lines))


def _members(lines: Iterator[list[str]]) -> list[tuple[str, str]]:
    """Pairs of a group's name and an element of it."""
    found = []
    for words in lines:
        left, name = int(words[-1]), " ".join(next(lines))
        while left > 0:
            entries = next(lines)
            for kind, number in zip(entries[0::4], entries[1::4], strict=False):
                left -= 1
                if kind == OF_ELEMENTS:
                    found.append((name, number))
    return found
