"""Pieces of parts named rigid: cells that share no node with other cells of the name.

A name may hold several pieces, such as eight nuts. They are one body, or one each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx import effects as fx
from rigidfx.base.errors import SceneError
from rigidfx.base.types import Indices
from rigidfx.base.warning import warn
from rigidfx.domain.connected import connected_parts
from rigidfx.domain.domain import Domain, EntitySet, replace_sets


def divide(
    domain: Domain, effects: Sequence[fx.Effect]
) -> tuple[Domain, tuple[fx.Effect, ...], Mapping[str, int]]:
    """Make a part of each piece, where that is asked for or the part deforms. Collective.

    The domain also knows pieces as "nut 1", "nut 2", ..., effects have a body for each, and there
    is a count of the pieces of each name. A name that is taken is refused.
    """
    out: list[fx.Effect] = []
    counts: dict[str, int] = {}
    every: Sequence[Any] = effects
    for effect in every:
        pieces = _pieces(domain, effect) if effect.is_body and effect.each is not False else []
        if not pieces or not (effect.each or (effect.deforms and len(pieces) > 1)):
            out.append(effect)
            continue
        counts[effect.name] = len(pieces)
        for k, cells in enumerate(pieces, 1):
            name = f"{effect.name} {k}"
            if (name, 3) in domain.sets:
                raise SceneError(
                    f"{effect.kind} '{effect.name}': each=True names its pieces '{name}' and so "
                    "on, and there are cells of this name already. Rename them."
                )
            sets = {**domain.sets, (name, 3): EntitySet(name, 3, cells)}
            domain = replace_sets(domain, sets)
            out.append(replace(effect, where=name, each=False))
    domain, out = _merged(domain, out)
    return domain, tuple(out), counts


def _merged(domain: Domain, effects: list[fx.Effect]) -> tuple[Domain, list[fx.Effect]]:
    """Effects with one `Reduced` for each group of sets that share nodes. Collective.

    The set of a group is named by its sets, such as "plate + hub". Those of `Rigid` parts stay
    rigid in it.
    """
    every: list[Any] = [effect for effect in effects if effect.is_body]
    bodies = [e for e in every if e.where is not None and not e.given]
    parts = [e for e in bodies if e.deforms]
    cells = [domain.find(part.name, (3,), part.kind).entities for part in parts]
    if not parts:
        return domain, effects
    for part in (e for e in bodies if not e.deforms):
        own = domain.find(part.name, (3,), part.kind).entities
        twice = any(np.intersect1d(own, some).size for some in cells)
        if not domain.comm.allreduce(twice, op=MPI.LOR):  # else it is refused
            parts, cells = [*parts, part], [*cells, own]
    if len(parts) < 2:
        return domain, effects
    map_ = domain.mesh.topology.index_map(3)
    among = np.zeros(map_.size_local + map_.num_ghosts, dtype=bool)
    among[np.concatenate(cells)] = True
    of_cell = connected_parts(domain.mesh, 0, among).of_cell
    groups: list[tuple[set[int], list[int]]] = []  # connected pieces, and the parts in them
    for k, own in enumerate(cells):
        found = domain.comm.allgather(np.unique(of_cell[own]).tolist())
        pieces, members = {piece for some in found for piece in some}, [k]
        for group in [group for group in groups if group[0] & pieces]:
            groups.remove(group)
            pieces, members = pieces | group[0], group[1] + members
        groups.append((pieces, members))
    for members in (sorted(group[1]) for group in groups if len(group[1]) > 1):
        deform = [parts[k] for k in members if parts[k].deforms]
        if not deform:
            continue
        name = " + ".join(parts[k].name for k in members)
        union = EntitySet(name, 3, np.unique(np.concatenate([cells[k] for k in members])))
        domain = replace_sets(domain, {**domain.sets, (name, 3): union})
        asked = [part.shapes for part in deform]
        stiff = tuple(parts[k].name for k in members if not parts[k].deforms)
        count = None if None in asked else sum(n for n in asked if n is not None)
        effects = [e for e in effects if not any(e is parts[k] for k in members)]
        effects.append(fx.Reduced(name, shapes=count, stiff=stiff))
    return domain, effects


def warn_of_pieces(domain: Domain, effects: Sequence[fx.Effect]) -> None:
    """Warn of a name with several pieces if nothing says that they are one body. Collective."""
    named: list[Any] = [effect for effect in effects if effect.is_rigid]
    for rigid in named:
        if rigid.each is not None:
            continue
        count = len(_pieces(domain, rigid))
        if count > 1:
            warn(
                domain.comm,
                f"Rigid '{rigid.name}': its cells are in {count} pieces, which move as one: what "
                "holds or drives one of them holds or drives all. each=True makes a body of each "
                "piece; each=False says that one body of all is meant.",
            )


def pieces_in_words(
    domain: Domain, effects: Sequence[fx.Effect], divided: Mapping[str, int]
) -> list[str]:
    """A line for each name of a rigid part that has several pieces, or is divided. Collective."""
    lines = [f"Rigid '{name}': in {n} pieces, a body each" for name, n in divided.items() if n > 1]
    named: list[Any] = [effect for effect in effects if effect.is_rigid]
    for rigid in named:
        if (count := len(_pieces(domain, rigid))) > 1:
            lines.append(f"Rigid '{rigid.name}': in {count} pieces, which move as one")
    return lines


def _pieces(domain: Domain, rigid: fx.Rigid) -> list[Indices]:
    """Local cells of each piece, ghosts included, in the order of the mesh file. Collective."""
    topology = domain.mesh.topology
    map_ = topology.index_map(3)
    local = map_.size_local + map_.num_ghosts
    if rigid.where is None:
        cells: Indices = np.arange(local, dtype=np.int32)
        parts = connected_parts(domain.mesh, 0)
    else:
        cells = domain.find(rigid.where, (3,), rigid.kind).entities
        among = np.zeros(local, dtype=bool)
        among[cells] = True
        parts = connected_parts(domain.mesh, 0, among)
    own = parts.of_cell[cells]
    every = np.unique(np.concatenate(domain.comm.allgather(np.unique(own))))
    return [cells[own == number] for number in every]
