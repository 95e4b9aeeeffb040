"""The cards of an Abaqus or CalculiX input file: keyword, parameters, data.

A card is `*KEYWORD, PARAMETER=VALUE, FLAG` and the lines of data below it. `**` begins a comment,
names do not tell capitals of ASCII from small letters, and the lines of another file stand in for
`*INCLUDE`, be they cards or data.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.text_files import Decoder

DEEPEST = 9  # files that include each other
BEFORE = "**"  # which begins a comment, and no card
BLANKS = " \t\v\f"  # others may be halves of letters, in encodings that are not known

Where = tuple[Path, int]  # a file and the number of a line


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
        lines: Lines of data, each with its place, without comments and empty ones.
        at: The card's own line.
    """

    keyword: str
    given: Mapping[str, str]
    lines: list[tuple[Where, str]]
    at: Where

    def wrong(self, problem: str, at: Where | None = None) -> SceneError:
        """The error that names the place.

        Args:
            problem: The fault there, and the remedy.
            at: The line; that of the card if None.
        """
        path, number = at or self.at
        return SceneError(f"read_inp: '{path}', line {number}, *{self.keyword}: {problem}")

    def named(self, key: str) -> str:
        """The value of a parameter that has to be there."""
        if not self.given.get(key):
            raise self.wrong(f"the parameter {key}= is missing.")
        return self.given[key]

    def rows(self) -> list[tuple[Where, list[str]]]:
        """Entries of each line of data with its place, without empty ones at its end."""
        out = []
        for at, line in self.lines:
            entries = entries_of(line)
            while entries and not entries[-1]:
                entries.pop()
            out.append((at, entries))
        return out

    def whole_numbers(self, entries: list[str], at: Where) -> list[int]:
        """Entries as whole numbers, empty ones left out.

        Raises:
            SceneError: If one is none.
        """
        try:
            return [int(entry) for entry in entries if entry]
        except ValueError:
            raise self.wrong(f"{', '.join(entries)!r} are no whole numbers.", at) from None

    def numbers(self, entries: list[str], count: int, at: Where) -> list[float]:
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
        raise self.wrong(f"{', '.join(entries)!r} are no finite numbers.", at)


def cards_of(path: Path, decoder: Decoder) -> Iterator[Card]:
    """The cards of a file and of those it includes, in order.

    Lines before the first card, which CalculiX passes over, are one of keyword `BEFORE`.

    Raises:
        SceneError: If a file cannot be read, or has data and no card.
    """
    card = Card(BEFORE, {}, [], (path, 1))
    for at, line in _lines(path, decoder):
        if not line.startswith("*"):
            card.lines.append((at, line))
            continue
        if card.keyword != BEFORE or card.lines:
            yield card
        card = _begun(line, at)
    if card.keyword != BEFORE:
        yield card
    elif card.lines:
        (file, number), _ = card.lines[0]
        raise SceneError(
            f"read_inp: '{file}', line {number}: data without a card. An input file of Abaqus or "
            "CalculiX consists of cards, such as *NODE."
        )


def _lines(path: Path, decoder: Decoder, depth: int = 0) -> Iterator[tuple[Where, str]]:
    """Lines of a file, each with its place; those of files that it includes stand in for these."""
    try:
        text = decoder.read(path)
    except OSError as error:
        raise SceneError(f"read_inp: '{path}' cannot be read: {error.strerror}.") from None
    for number, line in _joined(text):
        at = path, number
        card = _begun(line, at) if line.startswith("*") else None
        if card is None or card.keyword != "INCLUDE":
            yield at, line
        elif depth == DEEPEST:
            raise card.wrong("files include each other without end.")
        else:
            yield from _lines(path.parent / card.named("INPUT"), decoder, depth + 1)


def _joined(text: str) -> Iterator[tuple[int, str]]:
    """Lines that count, with their numbers; those of a card, up to one without a comma, are one."""
    head, first = "", 0
    for number, line in enumerate(re.split("\r\n|\r|\n", text), start=1):
        line = line.strip(BLANKS)
        if not line or line.startswith("**"):
            continue
        if head and line.startswith("*"):
            yield first, head
            head = ""
        if not head:
            first = number
        head += line
        if not (head.startswith("*") and head.endswith(",")):
            yield first, head
            head = ""
    if head:
        yield first, head


def _begun(head: str, at: Where) -> Card:
    keyword, *parameters = entries_of(head)
    pairs = (parameter.partition("=")[::2] for parameter in parameters if parameter)
    given = {key.strip(BLANKS).upper(): value.strip(BLANKS).strip('"') for key, value in pairs}
    return Card(" ".join(keyword[1:].split()).upper(), given, [], at)
