"""The largest stress over named sets, from the cells at their nodes alone.

Stress is that at nodes, extrapolated and averaged within each material
(`rigidfx.flexible.nodal_stress`). A node where materials meet has a value for each; over a set of
cells only those of the set's own materials count.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from rigidfx.base.sealed import Sealed
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.flexible.nodal_stress import NodalStress, material_groups, summed
from rigidfx.flexible.stress import tensors, von_mises
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene


@dataclass(frozen=True)
class Peak(Sealed):
    """Where the stress over a set is largest.

    Attributes:
        von_mises: Von Mises' equivalent stress there [Pa].
        place: The node, in the reference shape, shape (3,) [m].
    """

    von_mises: float
    place: Array


class Peaks:
    """Looks for the largest stress over sets of a scene.

    Attributes:
        names: Of the sets.
    """

    def __init__(self, scene: Scene, names: Sequence[str], owner: str) -> None:
        """Compile stresses; find nodes and cells of sets, or refuse them. Collective."""
        self.names = tuple(names)
        self._scene, self._masks = scene, dict[str, Bools]()
        groups = material_groups(scene)
        table = scene.space.dofmap.list[: groups.size]
        local = scene.space.tabulate_dof_coordinates().shape[0]
        wanted = np.zeros(groups.size, dtype=bool)
        for name in names:
            on = np.zeros(local, dtype=bool)
            on[scene.nodes(name, owner)] = True
            cells = on[table].any(axis=1)
            wanted |= cells
            if (name, 2) not in scene.domain.sets and (name, 3) in scene.domain.sets:
                cells = np.zeros(groups.size, dtype=bool)
                cells[scene.owned_cells(name, owner)] = True
            self._masks[name] = self._marked(on, cells, groups, table)
        self._nodal = NodalStress(scene, cells=np.flatnonzero(wanted).astype(np.int32))

    def _marked(self, on: Bools, cells: Bools, groups: Indices, table: Indices) -> Bools:
        """Which values at owned nodes count, shape (materials, nodes). Collective."""
        marks = np.zeros((len(self._scene.materials), len(on), 1))
        marks[np.repeat(groups[cells], table.shape[1]), table[cells].reshape(-1)] = 1.0
        marks[:, ~on] = 0.0
        owned = self._scene.owned_nodes
        return np.stack([summed(self._scene, m)[:owned, 0] > 0 for m in marks])

    def measure(self, report: Report) -> Mapping[str, Peak]:
        """The largest stress over each set, by its name. Collective."""
        state, scene = report.state, self._scene
        state.rebuild()
        values = self._nodal.measure(state.u, report.strains())
        sizes = von_mises(tensors(values[:, : scene.owned_nodes, :6]))
        return {
            name: Peak(*self.largest(np.where(m, sizes, -1.0))) for name, m in self._masks.items()
        }

    def largest(self, sizes: Array) -> tuple[float, Array]:
        """The largest value at owned nodes, shape (values, nodes), and its place. Collective.

        Of nodes that have it up to rounding all ranks choose the same one.
        """
        scene = self._scene
        own = sizes.max(axis=0, initial=-1.0)
        largest = scene.comm.allreduce(float(own.max(initial=-1.0)), op=MPI.MAX)
        near = np.flatnonzero(own >= largest * (1 - np.finfo(np.float64).eps ** 0.5))
        X = scene.space.tabulate_dof_coordinates()[near]
        offers = zip(X.round(9).tolist(), X.tolist(), strict=True)
        best = max(scene.comm.allgather(max(offers, default=([], []))))
        return largest, np.array(best[1])
