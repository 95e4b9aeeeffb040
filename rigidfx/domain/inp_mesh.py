"""Cells of one kind, and named rows of cells, facets and nodes, of an input file."""

import reprlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Ints
from rigidfx.domain.arrays import FileMesh, element_name
from rigidfx.domain.cell_quality import CORNERS, advice_on, collapsed, in_dolfinx_order, widths
from rigidfx.domain.inp_model import Group, Instance, Model, folded, is_number


def faces_of(kind: str) -> list[tuple[int, ...]]:
    """Corners of the faces S1, S2, … of a cell, as Abaqus and CalculiX number them."""
    if kind == "tetrahedron":
        return [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)]
    sides = [(0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    return [(0, 1, 2, 3), (4, 7, 6, 5), *sides]


def edges_of(kind: str) -> list[tuple[int, int]]:
    """Both ends of the edges of a cell, in the order in which the nodes on them follow corners."""
    if kind == "tetrahedron":
        return [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    low = [(k, (k + 1) % 4) for k in range(4)]
    return [*low, *((a + 4, b + 4) for a, b in low), *((k, k + 4) for k in range(4))]


class Numbers:
    """Rows by the numbers of one instance."""

    def __init__(self, labels: Ints, rows: Ints) -> None:
        """Sort numbers in a file, and the rows in which they are."""
        order = np.argsort(labels, kind="stable")
        self.labels, self.rows = labels[order], rows[order]

    def find(self, wanted: Ints) -> tuple[Ints, Ints]:
        """Rows of the numbers that there are, and the numbers that there are not."""
        if not len(self.labels):
            return np.empty(0, np.int64), wanted
        at = np.minimum(np.searchsorted(self.labels, wanted), len(self.labels) - 1)
        there = self.labels[at] == wanted
        return self.rows[at[there]], wanted[~there]


def kind_of(width: int) -> str:
    """The kind of cells with so many nodes; "other" if unknown."""
    if width == CORNERS["hexahedron"] + 12:  # a node on each edge
        return "hexahedron"
    return next((kind for kind in CORNERS if width in widths(kind)), "other")


def mesh_of(model: Model, path: Path, corners: bool, scale: float) -> FileMesh:
    """The mesh of a model, in metres; of cells with corners alone if these are asked for.

    It is refused without cells, with several kinds, or with names of what is not there.
    """
    return _Flat(model, path, corners, scale).mesh()


class _Flat:
    """All instances together, numbered one after the other."""

    def __init__(self, model: Model, path: Path, corners: bool, scale: float) -> None:
        here = Instance("", model.top, np.eye(3), np.zeros(3))
        self._places = [here, *model.instances]
        self._path, self._corners, self._scale = path, corners, scale
        self._nodes: dict[str, Numbers] = {}
        self._cells: dict[str, Numbers] = {}
        self._flat: dict[str, Numbers] = {}  # triangles and quadrilaterals that bound cells
        self._x: Array = np.empty((0, 3))
        self._tables: list[Ints] = []  # all nodes of cells
        self._notes = model.notes
        self._left_out: dict[str, int] = {}  # elements by their types
        self._elements: list[tuple[str, Ints]] = []  # names of instances, numbers of elements
        self._empty: list[str] = []  # names of sets without anything of the cells
        self._missing: dict[str, str] = {}  # sets, and the first of theirs that is not there

    def _error(self, problem: str) -> SceneError:
        return SceneError(f"read_inp: '{self._path}' {problem}")

    def mesh(self) -> FileMesh:
        """Cells, and the sets behind names."""
        for place in self._places:
            self._take_nodes(place)
        kind, rows = self._taken_cells()
        count = CORNERS[kind]
        self._used, where = np.unique(rows, return_inverse=True)
        used = self._used
        self._new = np.full(len(self._x), -1)
        self._new[used] = np.arange(len(used))
        table = where.reshape(rows.shape)
        points = self._scale * self._x[used]
        mesh = FileMesh(kind, points, table, notes=self._notes, elements=self._elements)
        self._check_twice(mesh)
        faces = np.sort(table[:, faces_of(kind)], axis=2)
        self._faces = faces  # of each cell, by S1, S2, …
        flat, times = np.unique(faces.reshape(-1, faces.shape[2]), axis=0, return_counts=True)
        self._boundary = flat[times == 1]
        self._is_corner = np.zeros(len(used), dtype=bool)
        self._is_corner[table[:, :count]] = True
        self._sides_of_flat: Ints = np.empty((0, faces.shape[2]), np.int64)
        for place in self._places:
            self._take_flat(place)
        self._name(mesh)
        if told := self._told():
            mesh.notes.append(told)
        mesh.cells, problem = in_dolfinx_order(points, table, kind)
        if problem:
            raise SceneError(problem)
        return mesh

    def _told(self) -> str:
        """The text of a warning of elements and sets that are left out; empty if none are."""
        texts = []
        if self._left_out:
            listed = ", ".join(f"{n} of {type_}" for type_, n in sorted(self._left_out.items()))
            texts.append(
                f"elements that are no volume cells are left out: {listed}. Point masses and "
                "springs are effects of a scene (PointMass, Spring)."
            )
        if self._empty:
            texts.append(
                "sets without any cell, or corner of one, are left out: "
                f"{reprlib.repr(self._empty)[1:-1]}."
            )
        if self._missing:
            first, names = next(iter(self._missing.values())), [*self._missing]
            texts.append(
                f"sets name nodes and elements that are not there, such as {first}, and are read "
                f"without them: {reprlib.repr(names)[1:-1]}."
            )
        return " Also, ".join(texts)

    def _check_twice(self, mesh: FileMesh) -> None:
        """Refuse cells of the same nodes."""
        same, times = np.unique(np.sort(mesh.cells, axis=1), axis=0, return_counts=True)
        if times.max() > 1:
            rows = np.flatnonzero((np.sort(mesh.cells, axis=1) == same[times.argmax()]).all(axis=1))
            first, second = (element_name(mesh.elements, int(row)) for row in rows[:2])
            raise self._error(f"has {first} and {second} with the same nodes. Leave one out.")

    def _take_flat(self, place: Instance) -> None:
        """Triangles and quadrilaterals that bound cells; others are left out."""
        corners = self._boundary.shape[1]
        every = self._faces.reshape(-1, corners)
        labels: list[Ints] = [np.empty(0, np.int64)]
        rows: list[Ints] = []
        for type_, numbers, nodes in place.part.flat:
            if corners != (3 if nodes.shape[1] in (3, 6, 7) else 4):  # no sides of these cells
                self._left_out[type_] = self._left_out.get(type_, 0) + len(numbers)
                continue
            own = self._new[self._rows_of(place, type_, numbers, nodes)[:, :corners]]
            own.sort(axis=1)
            _, which = np.unique(np.concatenate([every, own]), axis=0, return_inverse=True)
            which = which.reshape(-1)
            bounds = np.isin(which[len(every) :], which[: len(every)])
            labels.append(numbers[bounds])
            rows.append(own[bounds])
            if not bounds.all():
                lost = int(np.count_nonzero(~bounds))
                self._left_out[type_] = self._left_out.get(type_, 0) + lost
        for type_, number in place.part.no_cells.items():
            self._left_out[type_] = self._left_out.get(type_, 0) + number
        first = len(self._sides_of_flat)
        self._sides_of_flat = np.concatenate([self._sides_of_flat, *rows])
        found = np.concatenate(labels)
        self._flat[place.name] = Numbers(found, first + np.arange(len(found)))

    def _take_nodes(self, place: Instance) -> None:
        labels = [np.empty(0, np.int64), *(labels for labels, _ in place.part.nodes)]
        x = [np.empty((0, 3)), *(x for _, x in place.part.nodes)]
        every = np.concatenate(labels)
        given = np.concatenate(x)
        moved = given @ place.R.T + place.shift
        rows = len(self._x) + np.arange(len(every))
        unique, first, which = np.unique(every, return_index=True, return_inverse=True)
        moves = (given[first][which.reshape(-1)] != given).any(axis=1)
        if moves.any():
            raise self._error(f"has node {every[moves][0]} at two places.")
        self._nodes[place.name] = Numbers(unique, rows[first])
        self._x = np.concatenate([self._x, moved])

    def _taken_cells(self) -> tuple[str, Ints]:
        """The kind of cells, and their nodes."""
        kinds: dict[tuple[str, int], int] = {}
        tables = []
        for place in self._places:
            of_place: list[tuple[Ints, Ints]] = []
            for type_, labels, nodes in place.part.elements:
                key = kind_of(nodes.shape[1]), nodes.shape[1]
                kinds[key] = kinds.get(key, 0) + len(labels)
                of_place.append((labels, self._rows_of(place, type_, labels, nodes)))
                if fault := collapsed(nodes[:, : CORNERS.get(key[0], 0)]):
                    at, problem = fault
                    raise self._error(f"has element {labels[at]} of type {type_}, which {problem}")
            tables.append(of_place)
        count = self._check_kinds(kinds)
        first = 0
        rows: list[Ints] = []
        for place, of_place in zip(self._places, tables, strict=True):
            labels = np.concatenate([np.empty(0, np.int64), *(some for some, _ in of_place)])
            if len(np.unique(labels)) < len(labels):
                numbers, times = np.unique(labels, return_counts=True)
                raise self._error(f"has element {numbers[times.argmax()]} {times.max()} times.")
            self._elements.append((place.name, labels))
            self._cells[place.name] = Numbers(labels, first + np.arange(len(labels)))
            rows += [nodes[:, :count] for _, nodes in of_place]
            self._tables += [nodes for _, nodes in of_place]
            first += len(labels)
        return next(kind for kind, _ in kinds), np.concatenate(rows)

    def _rows_of(self, place: Instance, type_: str, labels: Ints, nodes: Ints) -> Ints:
        found, missing = self._nodes[place.name].find(nodes.reshape(-1))
        if len(missing):
            at = labels[np.isin(nodes, missing).any(axis=1)][0]
            raise self._error(
                f"has no node {missing[0]}, which element {at} of type {type_} names."
            )
        return found.reshape(nodes.shape)

    def _check_kinds(self, kinds: dict[tuple[str, int], int]) -> int:
        """How many nodes of each cell are taken."""
        listed = ", ".join(f"{n} of {width} nodes" for (_, width), n in sorted(kinds.items()))
        if not kinds:
            raise self._error(
                "has no volume elements, such as C3D8 or C3D4 or C3D10, in a part that is placed."
            )
        known = {kind for kind, _ in kinds}
        if known - set(CORNERS):
            width = next(width for kind, width in kinds if kind not in CORNERS)
            raise self._error(f"has elements: {listed}.{advice_on('hexahedron', width)}")
        if len(known) > 1:
            raise self._error(
                f"has tetrahedra and hexahedra: {listed}. A domain takes one kind: mesh all of it "
                "with C3D10 or C3D4, or all with C3D8."
            )
        kind = next(iter(known))
        if self._corners:
            return CORNERS[kind]
        if len(kinds) > 1 or next(iter(kinds))[1] not in widths(kind):
            raise self._error(
                f"has elements: {listed}. Bricks of 20 nodes, and cells of both orders, are read "
                "by their corners: read_inp(…, corners=True); let the scene be of second order "
                "(order=2), then."
            )
        return next(iter(kinds))[1]

    # Names --------------------------------------------------------------------------------------

    def _name(self, mesh: FileMesh) -> None:
        """Give the mesh its names; those of nodes last, which yield to others of the same name."""
        every = [
            (kind == "NSET" or group.of_nodes, kind, place, group)
            for place in self._places
            for (kind, _), group in place.part.groups.items()
            if not group.name.startswith("_")
        ]
        for of_nodes, kind, place, group in sorted(every, key=lambda each: each[0]):
            name = self._called(place, kind, group)
            if of_nodes:
                self._name_nodes(mesh, name, place, group)
            elif kind == "SURFACE":
                rows = [self._boundary[:0], *self._sides(place, group)]
                self._put(mesh.sets[2], name, np.unique(np.concatenate(rows), axis=0), "surface")
            else:
                cells = self._of(place, "ELSET", group)
                flat = self._sides_of_flat[self._of(place, "FLAT", group)]
                if len(flat) and not len(cells):
                    self._put(mesh.sets[2], name, np.unique(flat, axis=0), "elements")
                else:
                    self._put(mesh.sets[3], name, cells, "elements")
        if not mesh.sets[3]:
            mesh.sets[3]["body"] = np.arange(len(mesh.cells))

    def _put(self, table: dict[str, Ints], name: str, rows: Ints, of: str) -> None:
        """Name rows; by their kind, too, where others have the name."""
        if not len(rows):
            self._empty.append(name)
            return
        if name in table and not np.array_equal(table[name], rows):
            name = f"{name} ({of})"
            if name in table:
                raise self._error(f"gives several sets the name '{name}'.")
        table[name] = rows

    def _called(self, place: Instance, kind: str, group: Group) -> str:
        key = kind, folded(group.name)
        several = sum(key in other.part.groups for other in self._places) > 1
        return f"{place.name}.{group.name}" if several and place.name else group.name

    def _name_nodes(self, mesh: FileMesh, name: str, place: Instance, group: Group) -> None:
        """Facets or edges of all nodes of a set, or vertices; nothing for all nodes of cells."""
        of_file = self._of(place, "NSET", group)
        rows = self._new[of_file]
        own = np.zeros(len(mesh.points), dtype=bool)
        own[rows[rows >= 0]] = True
        own &= self._is_corner
        if name in mesh.sets[3]:
            whole = np.unique(mesh.cells[mesh.sets[3][name], : CORNERS[mesh.kind]])
            if np.array_equal(np.flatnonzero(own), whole):
                return
            self._put(mesh.sets[3], f"{name} (elements)", mesh.sets[3].pop(name), "elements")
        covered = self._boundary[own[self._boundary].all(axis=1)]
        left = own.copy()
        left[covered] = False
        if len(covered) and not left.any():
            self._put(mesh.sets[2], name, covered, "nodes")
            return
        edges = self._edges(mesh.kind, of_file)
        if len(edges) and np.array_equal(np.unique(edges), np.flatnonzero(own)):
            self._put(mesh.sets[1], name, edges, "nodes")
        else:
            self._put(mesh.sets[0], name, np.flatnonzero(own)[:, None], "nodes")

    def _edges(self, kind: str, nodes: Ints) -> Ints:
        """Corners of edges whose ends and middles are among nodes of the file, shape (n, 2)."""
        among = np.zeros(len(self._x), dtype=bool)
        among[nodes] = True
        ends, first = np.array(edges_of(kind)), CORNERS[kind]
        found: list[Ints] = [np.empty((0, 2), np.int64)]
        for table in self._tables:
            cell, edge = np.nonzero(among[table[:, first : first + len(ends)]])
            both = table[cell[:, None], ends[edge]]
            found.append(both[among[both].all(axis=1)])
        return np.unique(np.sort(self._new[np.concatenate(found)], axis=1), axis=0)

    def _sides(self, place: Instance, group: Group, depth: int = 0) -> Iterator[Ints]:
        """Corners of the facets of a surface."""
        for of in group.others:  # other surfaces
            if depth > sum(len(each.part.groups) for each in self._places):
                raise self._error(f"has a surface '{group.name}' that contains itself.")
            yield from self._sides(*self._other(place, "SURFACE", group, of), depth + 1)
        for item, face, card, at in group.faces:
            cells = self._item(place, "ELSET", item)
            own = self._faces[cells]
            if not len(own):
                continue
            if not face:  # all that is not between cells
                every = own.reshape(-1, own.shape[2])
                both = np.concatenate([self._boundary, every])
                _, which = np.unique(both, axis=0, return_inverse=True)
                which = which.reshape(-1)
                yield every[np.isin(which[len(self._boundary) :], which[: len(self._boundary)])]
                continue
            side = int(face[1:]) if face[1:].isdigit() and face[0] == "S" else 0
            if not 1 <= side <= own.shape[1]:
                raise card.wrong(
                    f"{face!r} is no face of these cells, which have S1 to S{own.shape[1]}.", at
                )
            yield own[:, side - 1]

    def _item(self, place: Instance, kind: str, item: str) -> Ints:
        """Rows of a number, or of a set."""
        group = Group(item)
        group.add(item)
        return self._of(place, kind, group)

    def _of(self, place: Instance, kind: str, group: Group, depth: int = 0) -> Ints:
        """Rows of cells or nodes of a set, each once."""
        if depth > sum(len(each.part.groups) for each in self._places):
            raise self._error(f"has a set '{group.name}' that contains itself.")
        tables = {"ELSET": self._cells, "NSET": self._nodes, "FLAT": self._flat}[kind]
        rows: list[Ints] = [np.empty(0, np.int64)]
        missing: list[int] = []
        for instance, labels in group.members:
            of = instance or place.name
            if of not in tables:
                raise self._error(f"has no instance '{of}', which '{group.name}' names.")
            if isinstance(labels, range):  # of GENERATE: those of its numbers that there are
                own, first = tables[of].labels, labels.start
                own = own[(own >= first) & (own < labels.stop) & ((own - first) % labels.step == 0)]
                labels = own if len(own) else np.array([first])
            found, absent = tables[of].find(labels)
            rows.append(found)
            if kind == "NSET" or not self._elsewhere(kind, of):
                missing.extend(int(n) for n in absent)
        for each in group.others:
            rows.append(self._of_other(place, kind, group, each, depth))
        for each in group.of_elements:
            rows.append(self._nodes_of(*self._other(place, "ELSET", group, each)))
        found = np.unique(np.concatenate(rows))
        if missing:
            what = f"{'node' if kind == 'NSET' else 'volume element'} {missing[0]}"
            if not len(found):
                raise self._error(f"has no {what}, which '{group.name}' names.")
            self._missing[group.name] = what
        return found

    def _elsewhere(self, kind: str, of: str) -> bool:
        """Whether numbers may be those of elements of other types."""
        parts = [place.part for place in self._places if place.name == of]
        return kind == "FLAT" or any(part.no_cells or part.flat for part in parts)

    def _of_other(
        self, place: Instance, kind: str, group: Group, of: tuple[str, str], depth: int
    ) -> Ints:
        before, _, after = of[1].rpartition(".")
        group_kind = "ELSET" if kind == "FLAT" else kind
        if before and is_number(after) and not self._others(place, group_kind, of):
            one = Group(group.name, [(before, np.array([int(after)]))])
            return self._of(place, kind, one)
        other, found = self._other(place, group_kind, group, of)
        return self._of(other, kind, found, depth + 1)

    def _others(
        self, place: Instance, kind: str, of: tuple[str, str]
    ) -> list[tuple[Instance, Group]]:
        """Groups that a name may mean, likelier ones first, each with its place."""
        before, _, after = of[1].rpartition(".")
        return [
            (other, other.part.groups[kind, name])
            for instance, name in (of, (before or of[0], after))
            for other in self._places
            if other.name == (instance or place.name) and (kind, name) in other.part.groups
        ]

    def _other(
        self, place: Instance, kind: str, group: Group, of: tuple[str, str]
    ) -> tuple[Instance, Group]:
        """The group that another one names, with its place."""
        if found := self._others(place, kind, of):
            return found[0]
        what = "surface" if kind == "SURFACE" else "set"
        raise self._error(f"has no {what} '{of[1]}', which '{group.name}' names.")

    def _nodes_of(self, place: Instance, group: Group) -> Ints:
        """Rows of all nodes of the elements of a set."""
        cells, first = self._of(place, "ELSET", group), 0
        rows = [self._used[self._sides_of_flat[self._of(place, "FLAT", group)]].reshape(-1)]
        for table in self._tables:
            own = cells[(cells >= first) & (cells < first + len(table))]
            rows.append(table[own - first].reshape(-1))
            first += len(table)
        return np.concatenate(rows)
