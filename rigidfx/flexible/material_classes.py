"""Cells that can share a compiled kernel: those whose materials share an energy function.

A parameter that has one value within a group is a constant of the kernel, one that varies is a
cell-wise coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.effects import KelvinVoigt
from rigidfx.mechanics.materials import Energy
from rigidfx.scene.scene import Scene

__all__ = ["Group", "group_cells"]


@dataclass(frozen=True)
class Group:
    """Cells whose materials share an energy function and that are damped alike.

    Attributes:
        energy: The common stored energy.
        quadratic: Whether it is quadratic in the strain.
        dampers: Numbers of the Kelvin-Voigt effects on them.
        cells: Owned cells, sorted.
        parameters: UFL constants or piecewise constant functions by name.
    """

    energy: Energy
    quadratic: bool
    dampers: tuple[int, ...]
    cells: npt.NDArray[np.int32]
    parameters: dict[str, Any]


def group_cells(scene: Scene, dampers: Sequence[KelvinVoigt] = ()) -> list[Group]:
    """Groups of a scene's owned cells, the same list on all ranks. Collective.

    Args:
        scene: The problem.
        dampers: Kelvin-Voigt effects that tell cells apart.
    """
    owned = scene.owned_cells(None, "")
    covered = np.zeros((owned.size, len(dampers)), dtype=bool)
    for k, damper in enumerate(dampers):
        covered[scene.owned_cells(damper.where, "KelvinVoigt"), k] = True
    members: dict[tuple[Energy, bool, tuple[int, ...]], list[Any]] = {}
    for material, cells in scene.materials:
        for numbers in _combinations(scene, covered[cells]):
            own = cells[(covered[cells] == np.isin(np.arange(len(dampers)), numbers)).all(axis=1)]
            key = material.energy, material.quadratic, numbers
            members.setdefault(key, []).append((material, own))
    groups = []
    for (energy, quadratic, numbers), pairs in members.items():
        parameters: dict[str, Any] = {}
        for name in pairs[0][0].parameters:
            values = [(m.parameters[name], cells) for m, cells in pairs]
            same = len({value for value, _ in values}) == 1
            parameters[name] = (
                fem.Constant(scene.mesh, float(values[0][0])) if same else scene.cellwise(values)
            )
        cells = np.sort(np.concatenate([cells for _, cells in pairs]))
        groups.append(Group(energy, quadratic, numbers, cells, parameters))
    return groups


def _combinations(scene: Scene, covered: npt.NDArray[np.bool_]) -> list[tuple[int, ...]]:
    """Which dampers act together on any cell of any rank, the same list on all. Collective."""
    if covered.shape[1] == 0:
        return [()]
    mine = {tuple(int(k) for k in np.flatnonzero(row)) for row in np.unique(covered, axis=0)}
    return sorted(set().union(*scene.comm.allgather(mine)))
