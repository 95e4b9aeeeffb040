"""The cards of an Abaqus or CalculiX input file: keyword, parameters, data.

A card is `*KEYWORD, PARAMETER=VALUE, FLAG` and the lines of data below it. `**` begins a comment,
names do not tell capitals of ASCII from small letters, and `*INCLUDE` reads another file at its
place.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.text_files import Decoder

__all__ = ["BEFORE", "Card", "cards_of", "entries_of", "folded", "is_number"]


DEEPEST = 9  # files that include each other
BEFORE = "**"  # which begins a comment, and no card
BLANKS = " \t\v\f"  # others may be halves of letters, in encodings that are not known


def entries_of(line: str) -> list[str]:
    """The entries of a line between its commas, those in quotes left alone.

    Args:
        line: A line of a card.
    """
    quoted = '"' in line and line.count('"') % 2 == 0
    entries = re.split(r',(?=(?:[^"]*"[^"]*")*[^"]*$)', line) if quoted else line.split(",")
    return [entry.strip(BLANKS) for entry in entries]


def folded(name: str) -> str:
    """The name by which a set is found: small letters of ASCII are capitals.

    Other letters stay, as CalculiX leaves them, and one behind them, which may be the second half
    of a letter of GB18030.

    Args:
        name: As it is written.
    """
    return re.sub(r"(?<![^\x00-\x7f])[a-z]+", lambda found: found[0].upper(), name)


def is_number(entry: str) -> bool:
    """Whether an entry is a number of a node or an element, rather than a name."""
    return entry.isascii() and entry.isdigit()


@dataclass(frozen=True)
class Card:
    """A card of a file.

    Attributes:
        keyword: In capitals, without the star.
        given: Parameters by their names in capitals; flags have "" as value.
        lines: Lines of data with their numbers in the file, without comments and empty ones.
        path: The file.
        number: The card's own line.
    """

    keyword: str
    given: Mapping[str, str]
    lines: list[tuple[int, str]]
    path: Path
    number: int

    def wrong(self, problem: str, number: int | None = None) -> SceneError:
        """The error that names the place.

        Args:
            problem: The fault there, and the remedy.
            number: The line; that of the card if None.
        """
        line = self.number if number is None else number
        return SceneError(f"read_inp: '{self.path}', line {line}, *{self.keyword}: {problem}")

    def named(self, key: str) -> str:
        """The value of a parameter that has to be there."""
        if not self.given.get(key):
            raise self.wrong(f"the parameter {key}= is missing.")
        return self.given[key]

    def rows(self) -> list[tuple[int, list[str]]]:
        """Entries of each line of data with its number, without empty ones at its end."""
        out = []
        for number, line in self.lines:
            entries = entries_of(line)
            while entries and not entries[-1]:
                entries.pop()
            out.append((number, entries))
        return out

    def whole_numbers(self, entries: list[str], number: int) -> list[int]:
        """Entries as whole numbers, empty ones left out.

        Raises:
            SceneError: If one is none.
        """
        try:
            return [int(entry) for entry in entries if entry]
        except ValueError:
            raise self.wrong(f"{', '.join(entries)!r} are no whole numbers.", number) from None

    def numbers(self, entries: list[str], count: int, number: int) -> list[float]:
        """So many real numbers; those that are missing or empty are zero.

        Raises:
            SceneError: If one is none, or not finite.
        """
        try:
            values = [float(entry.upper().replace("D", "E")) if entry else 0.0 for entry in entries]
            if np.isfinite(values).all():
                return (values + [0.0] * count)[:count]
        except ValueError:
            pass
        raise self.wrong(f"{', '.join(entries)!r} are no finite numbers.", number)


def cards_of(path: Path, decoder: Decoder, depth: int = 0) -> Iterator[Card]:
    """The cards of a file and of those it includes, in order.

    Lines before the first card, which CalculiX passes over, are one of keyword `BEFORE`.

    Args:
        path: The file.
        decoder: Reads its letters.
        depth: How many files are around it.

    Raises:
        SceneError: If a file cannot be read, or has data and no card.
    """
    card: Card | None = None
    head = ""
    before: list[tuple[int, str]] = []  # lines before the first card
    for number, line in enumerate(re.split("\r\n|\r|\n", _text(path, decoder)), start=1):
        line = line.strip(BLANKS)
        if not line or line.startswith("**"):
            continue
        if line.startswith("*") or head.endswith(","):
            if card is not None:
                yield from _included(card, decoder, depth)
                card = None
            head = head + line if head.endswith(",") else line
            if not head.endswith(","):
                card, head = _begun(head, path, number), ""
        else:
            (before if card is None else card.lines).append((number, line))
    if card is None and before:
        raise SceneError(
            f"read_inp: '{path}', line {before[0][0]}: data without a card. An input file of "
            "Abaqus or CalculiX consists of cards, such as *NODE."
        )
    if before:
        yield Card(BEFORE, {}, before, path, before[0][0])
    if card is not None:
        yield from _included(card, decoder, depth)


def _text(path: Path, decoder: Decoder) -> str:
    try:
        return decoder.read(path)
    except OSError as error:
        raise SceneError(f"read_inp: '{path}' cannot be read: {error.strerror}.") from None


def _begun(head: str, path: Path, number: int) -> Card:
    keyword, *parameters = entries_of(head)
    pairs = (parameter.partition("=")[::2] for parameter in parameters if parameter)
    given = {key.strip(BLANKS).upper(): value.strip(BLANKS).strip('"') for key, value in pairs}
    return Card(" ".join(keyword[1:].split()).upper(), given, [], path, number)


def _included(card: Card, decoder: Decoder, depth: int) -> Iterator[Card]:
    """The card, or those of the file that it includes."""
    if card.keyword != "INCLUDE":
        yield card
        return
    if depth == DEEPEST:
        raise card.wrong("files include each other without end.")
    yield from cards_of(card.path.parent / card.named("INPUT"), decoder, depth + 1)
