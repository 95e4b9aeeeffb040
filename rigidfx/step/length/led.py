"""The rigid motion s that supports and motors lead, in which steps do not err.

docs/theory/time_steps.md, (3a): errors are at most the sum of those of u, and that of u - s.
"""

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Ints
from rigidfx.effects import Joint, PointMass
from rigidfx.effects.joints.elements import end_rates
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.step.system.rigid_motion import FREE, every_motion
from rigidfx.step.system.system import System


class Led:
    """Finds the led motion in steps; there is none beside masses that faces carry."""

    def __init__(self, scene: Scene) -> None:
        """Find the parts of nodes, and of vectors of joints. Collective."""
        self._scene, self._of_node = scene, parts_of_nodes(scene)
        self._X = scene.space.tabulate_dof_coordinates()
        self._carries = any(mass.is_carried for mass in scene.named(PointMass))
        vectors = [v for joint in scene.named(Joint) for v in joint.pieces.averages]
        own = [self._of_node[v.nodes].max(initial=-1) for v in vectors]
        self._of_vector: Ints = np.array(own, dtype=np.int64)  # -1 of the ground's
        scene.comm.Allreduce(MPI.IN_PLACE, self._of_vector, op=MPI.MAX)
        self._is_place = np.array([v.is_place for v in vectors], dtype=bool)

    def rates(self, system: System, u: Array, t: float, dt: float) -> list[Array]:
        """ṡ by motions of parts at both ends of a solved step, (6 · parts,); none if not led [m/s].

        It begins at t with displacements u of local dofs, and takes Δt [s, m]. Collective.
        """
        linkage, supports, d, found = system.linkage, system.prescribed, np.zeros_like(u), []
        driven = linkage is not None and linkage.drives.prescribed.any()
        if self._carries or not (driven or supports.moves):
            return []
        held, half = np.flatnonzero(supports.mask), t + dt / 2
        first = d[held] = supports.increments(t, half, u)
        whole = first + supports.increments(half, t + dt, u + d)
        d[held], d[system.layout.rows.dofs] = 0.0, system.d.array_r
        for end, given in enumerate(end_rates(np.zeros(held.size), whole, first, dt)):
            x = self._X + (u + end * d).reshape(-1, 3)
            rows = self.motions(x, held // 3)[np.arange(held.size), held % 3]
            sums = np.asarray(self._scene.sum(rows.T @ np.c_[rows, given]))
            if linkage is not None:
                rows, given = self._of_joints(*linkage.leading(end))
                sums += rows.T @ np.c_[rows, given]
            values = np.linalg.eigvalsh(sums[:, :-1])
            if values[0] <= FREE * values[-1]:
                return []
            found.append(np.linalg.solve(sums[:, :-1], sums[:, -1]))
        return found

    def motions(self, x: Array, nodes: Ints) -> Array:
        """Displacements of nodes by motions of parts, local nodes at x, (nodes, 3, 6 · parts)."""
        return every_motion(x, self._of_node, self._scene.parts, nodes)

    def _of_joints(self, rows: Array, places: Array, given: Array) -> tuple[Array, Array]:
        """Rows of size one by motions of parts, of those by vectors, and their rates."""
        of, free, parts = self._of_vector, ~self._is_place, self._scene.parts
        x = places[: of.size] + free[:, None] * parts.middle[of]
        moved = every_motion(x, of, parts, np.arange(of.size)).reshape(of.size, 3, -1, 6)
        moved[of < 0], moved[free, :, :, :3] = 0.0, 0.0
        by = rows[:, : of.size].reshape(len(rows), -1) @ moved.reshape(3 * of.size, -1)
        sizes = np.maximum(np.linalg.norm(by, axis=1), np.finfo(np.float64).tiny)
        return by / sizes[:, None], given / sizes
