"""Forces and moments of supports on u + e, less those on u.

    R = Σ f ,   M = Σ (X - X̄) x f ,   f = K e + C ė     over the nodes that a support holds, mean X̄,

in the frame of the shape, turned with the part; about the origin the moment is M + x̄ x R. Forces of
inertia that a consistent mass has there are left out: they fade with the size of the cells beside
the support.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.types import Array, Ints
from rigidfx.error.frames import Frames, to_space
from rigidfx.error.linear_motion import LinearMotion
from rigidfx.error.response import Response
from rigidfx.mechanics.rotation import cross
from rigidfx.scene.scene import Scene
from rigidfx.step.system.supports import PrescribedDofs

__all__ = ["Reactions"]


class Reactions:
    """Sums over the supports' rows of K and C.

    Attributes:
        sums: By weights of this rank's dofs, shape (3, dofs) each: of each support on each
            connected part the force and the moment by K and, if there is one, those by C.
    """

    def __init__(
        self, scene: Scene, held: PrescribedDofs, motion: LinearMotion, frames: Frames
    ) -> None:
        """Keep the rows. Collective.

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
        self._nodes: list[Ints] = []  # one for each dof that the support holds
        self.sums: list[csr_array] = []
        for name, dofs in held.of_each():
            part = frames.part[dofs // 3]
            on = scene.sum(np.bincount(part, minlength=scene.parts.count).astype(float))
            for k in np.flatnonzero(on):
                own = dofs[part == k]
                self._names.append(name)
                self._parts.append(int(k))
                self._nodes.append(own // 3)
                along = np.eye(3)[own % 3]
                arms = frames.shape[own // 3] - self._centres(frames.shape, [own // 3])[0]
                weights = along.T, np.cross(arms, along).T
                self.sums += [_summed(A, own, w) for A in (K, C) if A is not None for w in weights]

    def _centres(self, x: Array, nodes: Sequence[Ints]) -> Array:
        """Mean place of each set of owned nodes that lie at x, shape (sets, 3) [m]. Collective."""
        own = np.array([[len(n), *x[n].sum(axis=0)] for n in nodes])
        sums = np.asarray(self._scene.sum(own))
        return np.asarray(sums[:, 1:] / sums[:, :1])

    def of(
        self, response: Response, dt: float, xi: float, turned: Array, x: Array
    ) -> Mapping[str, Array]:
        """In the middle of the last step, by the name of the support's set. Collective.

        Args:
            response: Knows e at its end.
            dt: Length of the step [s].
            xi: ξ of the numerical damping.
            turned: Rotation of each connected part, shape (parts, 3, 3).
            x: Places of the owned nodes, shape (nodes, 3) [m].

        Returns:
            Force [N] and moment about the origin [N m] of each, shape (2, 3).
        """
        out: dict[str, Array] = {}
        if not self._names:
            return out
        e, rate = np.asarray(self._scene.sum(np.stack(response.at(self.sums))))
        size = len(self._names), 1 + self._viscous, 2, 3
        e, rate = e.reshape(size), rate.reshape(size)
        both = e[:, 0] + (xi - 0.5) * dt * rate[:, 0]  # of e in the middle, and numerical damping
        if self._viscous:
            both = both + rate[:, 1]
        centres = self._centres(x, self._nodes)
        for name, part, own, centre in zip(self._names, self._parts, both, centres, strict=True):
            both_in_space = to_space(own, turned[part])
            both_in_space[1:] += cross(centre, both_in_space[:1])
            out[name] = out.get(name, np.zeros((2, 3))) + both_in_space
        return out


def _summed(A: PETSc.Mat, dofs: Ints, weights: Array) -> csr_array:
    """Sums of a symmetric matrix's rows, by this rank's columns. Collective.

    Args:
        A: The matrix.
        dofs: Numbers of the rows, among the owned ones.
        weights: Of each row in each sum, shape (sums, dofs).
    """
    given, found = A.createVecs()
    out = []
    for own in weights:
        given.set(0.0)
        given.array[dofs] = own
        A.mult(given, found)
        out.append(found.array_r.copy())
    given.destroy()
    found.destroy()
    return csr_array(np.array(out))
