"""The mesh in an Abaqus or CalculiX input file: nodes, elements, sets, surfaces.

A file with parts has those of each part, once for each of its instances, where that is placed; sets
of the assembly name the instance whose numbers they have. A card is `*KEYWORD, PARAMETER=VALUE` and
the lines of data below it. `**` begins a comment, names do not tell capitals of ASCII from small
letters, and the lines of another file stand in for `*INCLUDE`, be they cards or data.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import radians
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rigidfx.base.errors import SceneError
from rigidfx.base.files import Decoder
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array, Ints

BEFORE = "**"  # which begins a comment, and no card
BLANKS = " \t\v\f"  # others may be halves of letters, in encodings that are not known

Where = tuple[Path, int]  # a file and the number of a line


def entries_of(line: str) -> list[str]:
    """The entries of a line between its commas, those in quotes left alone."""
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
    """A card of a file."""

    keyword: str  # in capitals, without the star
    given: Mapping[str, str]  # parameters by their names in capitals; flags have "" as value
    # Lines of data, each with its place, without comments and empty ones
    lines: list[tuple[Where, str]]
    at: Where  # the card's own line

    def wrong(self, problem: str, at: Where | None = None) -> SceneError:
        """The error that names a line, that of the card if None, with problem and remedy."""
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
        """Entries as whole numbers, empty ones left out; another one is refused."""
        try:
            return [int(entry) for entry in entries if entry]
        except ValueError:
            raise self.wrong(f"{', '.join(entries)!r} are no whole numbers.", at) from None

    def numbers(self, entries: list[str], count: int, at: Where) -> list[float]:
        """So many finite numbers; those that are missing or empty are zero, others are refused."""
        try:
            values = [float(entry.upper().replace("D", "E")) if entry else 0.0 for entry in entries]
            if np.isfinite(values).all():
                return (values + [0.0] * count)[:count]
        except ValueError:
            pass
        raise self.wrong(f"{', '.join(entries)!r} are no finite numbers.", at)


def cards_of(path: Path, decoder: Decoder) -> Iterator[Card]:
    """The cards of a file and of those it includes, in order.

    Lines before the first card, which CalculiX passes over, are one of keyword `BEFORE`. Data
    without a card are refused.
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


def _lines(
    path: Path, decoder: Decoder, above: tuple[Path, ...] = ()
) -> Iterator[tuple[Where, str]]:
    """Lines of a file, each with its place; those of files that it includes stand in for these."""
    try:
        text = decoder.read(path)
    except OSError as error:
        raise SceneError(f"read_inp: '{path}' cannot be read: {error.strerror}.") from None
    within = *above, path.resolve()
    for number, line in _joined(text):
        at = path, number
        card = _begun(line, at) if line.startswith("*") else None
        if card is None or card.keyword != "INCLUDE":
            yield at, line
            continue
        included = path.parent / card.named("INPUT")
        if included.resolve() in within:
            raise card.wrong("files include each other without end.")
        yield from _lines(included, decoder, within)


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


# Types of elements, and how many nodes they have. Membranes are flat, trusses are neither.
SOLIDS = r"[A-Z]{0,2}3D([4-9]|\d\d+)"
FLAT = r"(?:CPS|CPE|CAX|DC2D|M3D|R3D|SFM3D|STRI|DS|S)([346789])\D*$"

# Cards that make nodes or elements of others.
MAKERS = ("NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY", "SYSTEM")


@dataclass
class Group:
    """A set or a surface."""

    name: str  # as it is written first
    # Numbers by the instances that they are of ("" for the place of the group), ranges of which
    # some may not be there ...
    members: list[tuple[str, Ints | range]] = field(default_factory=list)
    # ... and names of other groups, or names and numbers behind an instance's name and a dot
    others: list[tuple[str, str]] = field(default_factory=list)
    # Of a set of nodes: instances and names of sets of elements whose nodes it has
    of_elements: list[tuple[str, str]] = field(default_factory=list)
    # Of a surface: pairs of an element's number or a set's name, and a face such as "S3"
    faces: list[tuple[str, str, Card, Where]] = field(default_factory=list)
    of_nodes: bool = False  # whether a surface is one of nodes

    def add(self, entry: str, instance: str = "") -> None:
        """Add a member by its number or set's name, behind an instance's name and a dot if any."""
        name = folded(entry.replace('"', ""))
        if is_number(name):
            self.members.append((instance, np.array([int(name)])))
        else:
            self.others.append((instance, name))


@dataclass
class Place:
    """Nodes, elements, sets and surfaces of a part, or of all that is in none."""

    # Numbers and positions, shape (n,) and (n, 3), of each card
    nodes: list[tuple[Ints, Array]] = field(default_factory=list)
    # Type, numbers and nodes, shape (n,) and (n, nodes), of each card
    elements: list[tuple[str, Ints, Ints]] = field(default_factory=list)
    # The same of triangles and quadrilaterals, which may bound cells
    flat: list[tuple[str, Ints, Ints]] = field(default_factory=list)
    # How many elements there are of other types
    no_cells: dict[str, int] = field(default_factory=dict)
    # By kind, "NSET", "ELSET" or "SURFACE", and folded name
    groups: dict[tuple[str, str], Group] = field(default_factory=dict)

    def group(self, kind: str, name: str) -> Group:
        """The group of a name, a new one if there is none."""
        return self.groups.setdefault((kind, folded(name)), Group(name))


@dataclass(frozen=True)
class Instance:
    """A part where it is."""

    name: str  # folded
    part: Place  # its part
    R: Array  # rotation, shape (3, 3)
    shift: Array  # translation that follows [in the file's unit of length]


@dataclass
class Model:
    """All of a file."""

    top: Place = field(default_factory=Place)  # all that is in no part
    parts: dict[str, Place] = field(default_factory=dict)  # by folded name
    instances: list[Instance] = field(default_factory=list)  # in the order of the file
    notes: list[str] = field(default_factory=list)  # texts of warnings


def model_of(path: Path, decoder: Decoder) -> Model:
    """Read a file; a card that cannot be understood is refused by its line."""
    model = Model()
    place = model.top
    for card in cards_of(path, decoder):
        if card.keyword == "PART":
            name = folded(card.named("NAME"))
            if name in model.parts:
                raise card.wrong(f"there is a part '{name}' before it.")
            place = model.parts[name] = Place()
        elif card.keyword in ("END PART", "END INSTANCE"):
            place = model.top
        elif card.keyword == "INSTANCE":
            model.instances.append(_instance(card, model))
            place = model.instances[-1].part
        elif card.keyword in MAKERS:
            raise card.wrong(
                "cards that make nodes or elements of others are not read. Save the model once "
                "more from a program that has read it: with all nodes and elements."
            )
        elif card.keyword == "ELEMENT":
            _elements(card, place, model.notes)
        elif card.keyword in READ:
            READ[card.keyword](card, place)
        elif card.keyword == BEFORE:
            (file, number), line = card.lines[0]
            model.notes.append(
                f"line {number} of '{file.name}' comes before the first card, and is passed over: "
                f"{shown(line)}."
            )
    return model


def _instance(card: Card, model: Model) -> Instance:
    part, name = (folded(card.named(key)) for key in ("PART", "NAME"))
    if part not in model.parts:
        raise card.wrong(f"there is no part '{part}' before it.")
    if any(name == other.name for other in model.instances):
        raise card.wrong(f"there is an instance '{name}' before it.")
    R: Array = np.eye(3)
    shift: Array = np.zeros(3)
    rows = card.rows()
    if rows:
        shift = np.array(card.numbers(rows[0][1], 3, rows[0][0]))
    if len(rows) > 1:
        at, entries = rows[1]
        *line, angle = card.numbers(entries, 7, at)
        a, b = np.reshape(line, (2, 3))
        if not (b - a).any():
            raise card.wrong("the axis of its rotation is no line.", at)
        turn = Rotation.from_rotvec(radians(angle) * (b - a) / np.linalg.norm(b - a))
        R = turn.as_matrix()
        shift = a + R @ (shift - a)
    return Instance(name, model.parts[part], R, shift)


def _nodes(card: Card, place: Place) -> None:
    if card.given.get("SYSTEM", "R").upper() != "R":
        raise card.wrong("nodes in cylindrical or spherical coordinates are not read: SYSTEM=R.")
    rows = card.rows()
    numbers = [n for at, entries in rows for n in card.whole_numbers(entries[:1], at)]
    x = [card.numbers(entries[1:], 3, at) for at, entries in rows]
    labels: Ints = np.array(numbers, dtype=np.int64)
    place.nodes.append((labels, np.reshape(x, (-1, 3))))
    if card.given.get("NSET"):
        place.group("NSET", card.given["NSET"]).members.append(("", labels))


def _elements(card: Card, place: Place, notes: list[str]) -> None:
    kind = card.named("TYPE").upper()
    flat = re.match(FLAT, kind)
    solid = None if flat else re.match(SOLIDS, kind)
    if not (solid or flat):
        place.no_cells[kind] = place.no_cells.get(kind, 0) + len(card.lines)
        return
    width = 1 + int(solid[1] if solid else flat[1] if flat else 0)
    rows: list[list[int]] = []
    longer: list[int] = []
    for at, entries in card.rows():
        if not rows or len(rows[-1]) == width:
            rows.append([])
        begins = not rows[-1]
        rows[-1].extend(card.whole_numbers(entries, at))
        if len(rows[-1]) > width:
            if not begins:
                raise card.wrong(f"element {rows[-1][0]} has more than {width - 1} nodes.", at)
            longer = longer or rows[-1]  # as CalculiX, which takes the first ones of its line
            del rows[-1][width:]
    if rows and len(rows[-1]) < width:
        raise card.wrong(f"the last element has less than {width - 1} nodes.")
    if longer:
        notes.append(
            f"line {card.at[1]}, *ELEMENT: lines, the first of element {longer[0]}, have more "
            f"nodes than the {width - 1} of {kind}. These are read, as by CalculiX, and others not."
        )
    table = np.array(rows, dtype=np.int64).reshape(-1, width)
    elements = place.elements if solid else place.flat
    elements.append((kind, table[:, 0], table[:, 1:]))
    if card.given.get("ELSET"):
        place.group("ELSET", card.given["ELSET"]).members.append(("", table[:, 0]))


def _set(card: Card, place: Place) -> None:
    kind = card.keyword
    group = place.group(kind, card.named(kind))
    instance = folded(card.given.get("INSTANCE", ""))
    if kind == "NSET" and card.given.get("ELSET"):
        group.of_elements.append((instance, folded(card.given["ELSET"])))
    for at, entries in card.rows():
        if "GENERATE" in card.given:
            given = card.whole_numbers(entries, at)
            first, last, step = [*given, 1, 1, 1][:3]
            if step < 1 or last < first or not 2 <= len(entries) <= 3 or "" in entries:
                raise card.wrong(
                    "GENERATE needs the first, the last, not below it, and at most a third "
                    "number, a step above 0.",
                    at,
                )
            group.members.append((instance, range(first, last + 1, step)))
            continue
        written = [entry for entry in entries if entry]
        labels = [entry for entry in written if is_number(entry)]
        if labels:
            group.members.append((instance, np.array(card.whole_numbers(labels, at))))
        for entry in written:
            if not is_number(entry):
                group.add(entry, instance)


def _surface(card: Card, place: Place) -> None:
    group = place.group("SURFACE", card.named("NAME"))
    kind = card.given.get("TYPE", "ELEMENT").upper()
    if kind not in ("ELEMENT", "NODE"):
        return  # analytical, by equations
    group.of_nodes = kind == "NODE"
    combined = card.given.get("COMBINE", "UNION").upper()
    if combined != "UNION":
        raise card.wrong(f"COMBINE={combined} is not read, only UNION: list its faces.")
    for at, line in card.lines:
        item, face = [*entries_of(line), ""][:2]
        if "COMBINE" in card.given:  # names of other surfaces
            for name in filter(None, entries_of(line)):
                group.add(name)
        elif item and group.of_nodes:
            group.add(item)
        elif item:
            group.faces.append((item, face.upper(), card, at))


READ: dict[str, Callable[[Card, Place], None]] = {
    "NODE": _nodes,
    "NSET": _set,
    "ELSET": _set,
    "SURFACE": _surface,
}
