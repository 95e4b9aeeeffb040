"""Cells that can share a compiled kernel: those whose materials share an energy function.

A parameter that has one value within a class is a constant of the kernel, one that varies is a
cell-wise coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from rigidfx.base.types import Bools, Indices
from rigidfx.effects import Effect
from rigidfx.mechanics.materials import Energy
from rigidfx.mechanics.schemes import Law
from rigidfx.scene.scene import Scene


@dataclass(frozen=True)
class MaterialClass:
    """Cells whose materials share an energy function, and on which the same effects may act.

    Attributes:
        law: Their stored energy.
        effects: Which of the effects told apart may act on them.
        cells: Owned cells, sorted.
    """

    law: Law
    effects: tuple[int, ...]
    cells: Indices


def material_classes(scene: Scene, effects: Sequence[Effect] = ()) -> list[MaterialClass]:
    """Classes of a scene's owned cells, the same list on all ranks. Collective.

    Args:
        scene: The problem.
        effects: Effects on cells, whose attribute `where` tells cells apart.
    """
    owned = scene.owned_cells(None, "")
    covered = np.zeros((owned.size, len(effects)), dtype=bool)
    for k, effect in enumerate(effects):
        covered[scene.owned_cells(getattr(effect, "where", None), effect.kind), k] = True
    members: dict[tuple[Energy, bool, tuple[int, ...]], list[Any]] = {}
    for material, cells in scene.materials:
        for numbers in _combinations(scene, covered[cells]):
            own = cells[(covered[cells] == np.isin(np.arange(len(effects)), numbers)).all(axis=1)]
            key = material.energy, material.quadratic, numbers
            members.setdefault(key, []).append((material, own))
    return [
        MaterialClass(
            Law(energy, quadratic, _parameters(scene, pairs)),
            numbers,
            np.sort(np.concatenate([cells for _, cells in pairs])),
        )
        for (energy, quadratic, numbers), pairs in members.items()
    ]


def _parameters(scene: Scene, pairs: Sequence[Any]) -> dict[str, Any]:
    """Constants, or piecewise constant functions, from pairs of a material and its cells."""
    out: dict[str, Any] = {}
    for name in pairs[0][0].parameters:
        values = [(m.parameters[name], cells) for m, cells in pairs]
        same = len({value for value, _ in values}) == 1
        out[name] = (
            fem.Constant(scene.mesh, float(values[0][0])) if same else scene.cellwise(values)
        )
    return out


def _combinations(scene: Scene, covered: Bools) -> list[tuple[int, ...]]:
    """Which effects act together on any cell of any rank, the same list on all. Collective."""
    if covered.shape[1] == 0:
        return [()]
    mine = {tuple(int(k) for k in np.flatnonzero(row)) for row in np.unique(covered, axis=0)}
    return sorted(set().union(*scene.comm.allgather(mine)))
