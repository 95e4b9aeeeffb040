"""Damping of cells in bodies that deform by shapes.

A viscous stress of cells gives a body the stresses C Δe/Δt, C = Φᵀ C_cells Φ, numerical damping
gives ξ K Δe, both of the shape at the freeze. The tangent of a step tells them. Without motion it
is

    ½ K + ξ K + C/Δt,

so that each kind of damping is one of them where it is so large that ½ K counts for nothing.
"""

import numpy as np
from dolfinx import fem

from rigidfx.base.types import Array
from rigidfx.coupling.rows import Rows, product
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.shapes import times
from rigidfx.scene.scene import Scene

LARGE = float(np.finfo(np.float64).eps ** -2)  # a scene's times in its unit, over rounding


class ShapeDamping:
    """The damping of the shapes of some bodies by the effects that act."""

    def __init__(self, scene: Scene, forces: InternalForces, bodies: Bodies) -> None:
        """Assemble C of each body, with shapes or without, and of each kind. Collective."""
        self._steady: dict[str, Array] = {}  # by kind, times 1
        self._viscous: dict[str, Array] = {}  # by kind, times 1/Δt
        if bodies.of.shapes is None or not forces.damps:
            return
        self._scene, self._forces = scene, forces
        each = [self._of(body) for body in bodies.of.records]
        m = bodies.of.columns - 6
        for which, out in ((0, self._steady), (1, self._viscous)):
            for kind in {kind for own in each for kind in own[which]}:
                out[kind] = np.zeros((len(each), m, m))
                for k, own in enumerate(each):
                    if kind in own[which]:
                        n = len(own[which][kind])
                        out[kind][k, :n, :n] = own[which][kind]

    def _of(self, body: RigidBody) -> tuple[dict[str, Array], dict[str, Array]]:
        """The matrices of a body, steady and viscous ones, by kind. Collective."""
        if body.shapes is None:
            return {}, {}
        at_freeze = fem.Function(self._scene.space)
        at_freeze.x.array.reshape(-1, 3)[body.nodes] = body.displacement
        at_freeze.x.scatter_forward()
        form = self._forces.bind_tangent(self._forces.cells(body.cells), at_freeze)
        rows = Rows(self._scene.space, body.nodes)
        fields = body.shapes.modes.swapaxes(0, 1).reshape(len(body.shapes), -1)

        with self._forces.undamped() as parts:
            steady, viscous = dict[str, Array](), dict[str, Array]()
            for kind, is_viscous, multiply in parts:
                multiply(LARGE)
                A = rows.assembled(form)
                C = fields @ product(A.matMult, fields.T, rows.comm)
                A.destroy()
                C = np.asarray(self._scene.sum(C)) / LARGE
                multiply(0.0)
                found = viscous if is_viscous else steady
                found[kind] = found.get(kind, 0.0) + 0.5 * (C + C.T)
        return steady, viscous

    def matrix(self, dt: float) -> Array | None:
        """Derivative of the forces by Δq in a step of Δt [s]; None without damping [N/m]."""
        parts = [*self._steady.values(), *(C / dt for C in self._viscous.values())]
        return np.sum(parts, axis=0) if parts else None

    def taken(self, increments: Increments, dt: float) -> dict[str, float]:
        """Energy that each kind takes in a step [J]."""
        de = increments.de
        out = {kind: float(np.vdot(de, times(C, de))) for kind, C in self._steady.items()}
        for kind, C in self._viscous.items():
            out[kind] = out.get(kind, 0.0) + float(np.vdot(de, times(C, de))) / dt
        return out
