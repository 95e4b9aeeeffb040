"""Follower pressure: on flexible cells as part of the compiled forms, on bodies in closed form.

The force on the nodes is -∫ p cof(F½) N Nᵢ dA. Where a body has the deformation gradient R F_f, the
midpoint's is R_av F_f with R_av = ½ (R₀ + R₁) = (I - ½θ̂)⁻¹ R₀, so that cof F½ = cof(R_av) cof F_f
with cof(R_av) = T R₀, T the Cayley map's tangent: the forces at its nodes are turned by one matrix.
A step therefore needs no facets of frozen cells, and momenta and work come out as if it had them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from rigidfx.base.errors import together
from rigidfx.effects import Pressure, Windowed
from rigidfx.flexible.kernels import Kernel
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rigid_body import BodyMotion, RigidBody
from rigidfx.mechanics.rotation import IDENTITY
from rigidfx.mechanics.schemes import deformation_gradient
from rigidfx.scene.scene import Scene

__all__ = ["Pressures", "RotatedLoads"]

Array = npt.NDArray[np.float64]
Pairs = npt.NDArray[np.int32]


class Pressures:
    """The pressures of a scene and what they add to forms; nothing where it names none."""

    def __init__(self, scene: Scene, u0: fem.Function, u1: fem.Function) -> None:
        """Find the facets. Collective.

        Args:
            scene: The problem.
            u0: Displacement at the start of a step.
            u1: Displacement at its end.
        """
        self._scene, self._u0, self._u1 = scene, u0, u1
        self._named: tuple[Pressure, ...] = scene.named(Pressure)
        self._facets = [scene.boundary(p.where, "Pressure") for p in self._named]
        self._values = [fem.Constant(scene.mesh, 0.0) for _ in self._named]
        # Exact for the moments of a closed surface of first and of second order.
        degree = {"quadrature_degree": 4 * scene.order}
        self._ds = ufl.Measure("ds", domain=scene.mesh, metadata=degree)
        self._acting: tuple[int, ...] = ()
        self._work = self._virtual_work(u1 - u0)
        self._power = Kernel(self._work, [], scene.mesh) if self._named else None
        self._surface: Kernel | None = None

    def select(self, acting: Sequence[Windowed]) -> tuple[int, ...]:
        """Take the pressures among the acting effects as those that act; their numbers."""
        here = {id(effect) for effect in acting}
        self._acting = tuple(j for j, p in enumerate(self._named) if id(p) in here)
        return self._acting

    def _virtual_work(self, w: ufl.core.expr.Expr) -> ufl.Form:
        F = deformation_gradient((self._u0 + self._u1) / 2)
        n = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(self._scene.mesh)
        terms = ((j, self._values[j]) for j in range(len(self._named)))
        return sum((p * ufl.inner(n, w) * self._ds(j + 1) for j, p in terms), ufl.Form([]))

    def virtual_work(self, w: ufl.core.expr.Expr) -> ufl.Form:
        """Σ ∫ p cof(F½) N·w dA over the pressures that act: what they add to a residual."""
        form = self._virtual_work(w)
        ids = {j + 1 for j in self._acting}
        return ufl.Form([i for i in form.integrals() if i.subdomain_id() in ids])

    def facets(self, cells: Iterable[npt.NDArray[np.int32]]) -> dict[int, Pairs]:
        """Facets of the given cells that pressures act on now, by subdomain id."""
        if not self._acting:
            return {}
        every = np.concatenate([np.empty(0, np.int32), *cells])
        return {j + 1: self._of(j, every) for j in self._acting}

    def _of(self, j: int, cells: npt.NDArray[np.int32]) -> Pairs:
        pairs = self._facets[j]
        return pairs[np.isin(pairs[:, 0], cells)]

    def bind_work(self, cells: Iterable[npt.NDArray[np.int32]]) -> list[fem.Form]:
        """What cells do against the pressures in a step [J]; no form if none acts."""
        if self._power is None or not self._acting:
            return []
        none = {j + 1: np.empty((0, 2), np.int32) for j in range(len(self._named))}
        return [self._power.bind({}, {**none, **self.facets(cells)})]

    def set_time(self, t: float) -> None:
        """Set the pressures to those at t [s]. Collective.

        Raises:
            SceneError: On every rank, if one is not a finite number on any.
        """
        for j in self._acting:
            own = self._named[j]
            owner = f"Pressure on '{own.where}' at t = {t:g} s: its value or time function"
            self._values[j].value = together(self._scene.comm, owner, partial(own.intensity, t))

    def on_bodies(
        self, bodies: Sequence[RigidBody], motions: Sequence[BodyMotion]
    ) -> list[RotatedLoads]:
        """What each of the acting pressures does to the bodies. Collective.

        The displacement u₀ must be up to date inside the bodies.
        """
        if not self._acting or not bodies:
            return []
        scene = self._scene
        if self._surface is None:
            F, w = deformation_gradient(self._u0), ufl.TestFunction(scene.space)
            n = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(scene.mesh)
            self._surface = Kernel(ufl.inner(n, w) * self._ds(1), [scene.space], scene.mesh)
        out = np.zeros((len(self._acting), len(bodies), 4, 3))
        force = fem.Function(scene.space)
        for k, (body, motion) in enumerate(zip(bodies, motions, strict=True)):
            for place, j in enumerate(self._acting):
                force.x.array[:] = 0.0
                form = self._surface.bind({}, {1: self._of(j, body.cells)})
                fem.assemble_vector(force.x.array, form)
                force.x.scatter_reverse(la.InsertMode.add)
                nodal = force.x.array.reshape(-1, 3)[body.nodes] @ motion.R
                arms = np.c_[np.ones(body.nodes.size), body.offsets]
                out[place, k] = arms.T @ nodal
        every = np.asarray(scene.sum(out))
        return [
            RotatedLoads(own, self._values[j]) for own, j in zip(every, self._acting, strict=True)
        ]


@dataclass(frozen=True)
class RotatedLoads:
    """A pressure on the rigid bodies.

    Attributes:
        arms: Σ f and Σ V fᵀ of the forces for p = 1, pushing outwards, in the bodies' frames, shape
            (bodies, 4, 3) [m², m³].
        pressure: p of the step [Pa].
    """

    arms: Array
    pressure: fem.Constant

    def moments(self, increments: Increments) -> Array:
        """See `rigidfx.mechanics.body_step.BodyTerm`."""
        turn = increments.T @ increments.start.R
        return float(self.pressure.value) * np.asarray(self.arms @ turn.swapaxes(1, 2))

    def tangent(self, increments: Increments) -> Array:
        """See `rigidfx.mechanics.body_step.BodyTerm`.

        d(T a) = (½ w × a - ½ (θ·w) T a)/(1 + ¼ |θ|²) in the direction w.
        """
        theta, length = increments.theta, increments.start.of.length
        scale = 0.5 * float(self.pressure.value) / (1 + 0.25 * (theta * theta).sum(axis=1)) / length
        a = self.arms @ increments.start.R.swapaxes(1, 2)
        turned = a @ increments.T.swapaxes(1, 2)
        G = np.zeros((len(increments), 6, 6))
        for j, w in enumerate(IDENTITY):
            change = np.cross(w, a) - theta[:, j, None, None] * turned
            G[:, :, 3 + j] = increments.resultant(scale[:, None, None] * change)
        return G

    def work(self, increments: Increments) -> float:
        """Work of the pressure in a step [J]."""
        return -increments.work(increments.resultant(self.moments(increments)))
