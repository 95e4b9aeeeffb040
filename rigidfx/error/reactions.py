"""Forces of supports on u + e, less those on u.

    R = Σ (K e + C ė)     over the nodes that a support holds

in the frame of the shape, turned with the part. Forces of inertia that a consistent mass has there
are left out: they fade with the size of the cells beside the support.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.error.frames import Frames, to_space
from rigidfx.error.linear_motion import LinearMotion
from rigidfx.error.response import Response
from rigidfx.scene.scene import Scene
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["Reactions"]

Array = npt.NDArray[np.float64]


class Reactions:
    """Sums over the supports' rows of K and C.

    Attributes:
        sums: By weights of this rank's dofs, shape (3, dofs) each: K and, if there is one, C of
            each support on each connected part.
    """

    def __init__(
        self, scene: Scene, held: PrescribedDofs, motion: LinearMotion, frames: Frames
    ) -> None:
        """Take the rows. Collective.

        Args:
            scene: The problem.
            held: Supports that act.
            motion: The equations of all rows.
            frames: The shape.
        """
        K, _, C = motion.matrices
        self._scene, self._viscous = scene, C is not None
        self._names: list[str] = []
        self._parts: list[int] = []
        self.sums: list[csr_array] = []
        for name, dofs in held.of_each():
            part = frames.part[dofs // 3]
            on = scene.sum(np.bincount(part, minlength=scene.parts.count).astype(float))
            for k in np.flatnonzero(on):
                self._names.append(name)
                self._parts.append(int(k))
                own = dofs[part == k]
                self.sums += [_summed(A, own) for A in (K, C) if A is not None]

    def of(self, response: Response, dt: float, xi: float, turned: Array) -> Mapping[str, Array]:
        """In the middle of the last step, by the name of the support's set. Collective.

        Args:
            response: Knows e at its end.
            dt: Length of the step [s].
            xi: ξ of the numerical damping.
            turned: Rotation of each connected part, shape (parts, 3, 3).

        Returns:
            Shape (3,) each [N].
        """
        both = self._scene.sum(np.stack(response.at(self.sums))) if self._names else np.empty(0)
        kinds = 1 + self._viscous
        out: dict[str, Array] = {}
        for k, (name, part) in enumerate(zip(self._names, self._parts, strict=True)):
            elastic, rate = both[:, kinds * k]
            force = elastic + (xi - 0.5) * dt * rate  # of e in the middle, and numerical damping
            if self._viscous:
                force = force + both[1, kinds * k + 1]
            out[name] = out.get(name, np.zeros(3)) + to_space(force, turned[part])
        return out


def _summed(A: PETSc.Mat, dofs: npt.NDArray[np.int64]) -> csr_array:
    """Sum of a symmetric matrix's rows along each axis, by this rank's columns. Collective."""
    ones, found = A.createVecs()
    out = []
    for axis in range(3):
        ones.set(0.0)
        ones.array[dofs[dofs % 3 == axis]] = 1.0
        A.mult(ones, found)
        out.append(found.array_r.copy())
    ones.destroy()
    found.destroy()
    return csr_array(np.array(out))
