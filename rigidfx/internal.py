"""The internal forces of a scene: compiled once, bound to the cells that are flexible.

Cells of materials that share an energy function share a kernel. A parameter that has one value
within such a group is a constant of the kernel, one that varies is a cell-wise coefficient.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from rigidfx.effects import NumericalDamping
from rigidfx.forms import static_virtual_work, stored_energy
from rigidfx.kernels import Kernel
from rigidfx.materials import Energy
from rigidfx.scene import Scene

__all__ = ["BoundForces", "InternalForces"]

Cells = Mapping[int, npt.NDArray[np.int32]]


@dataclass(frozen=True)
class Group:
    """Cells whose materials share an energy function.

    Attributes:
        energy: The common stored energy.
        quadratic: Whether it is quadratic in the strain.
        cells: Owned cells, sorted.
        parameters: UFL constants or piecewise constant functions by name.
    """

    energy: Energy
    quadratic: bool
    cells: npt.NDArray[np.int32]
    parameters: dict[str, Any]


@dataclass(frozen=True)
class BoundForces:
    """Forms over the flexible cells.

    Attributes:
        residual: Internal force vector.
        core: Its derivative by the unknown displacement, over cells that touch no rigid body.
        rim: The same over those that do.
    """

    residual: fem.Form
    core: fem.Form
    rim: fem.Form


class InternalForces:
    """Compiled internal virtual work, tangent and stored energy of a scene.

    Attributes:
        u0: Displacement at the begin of the step, a coefficient of the forms.
        u1: Displacement at its end, a coefficient of the forms.
        strain_noise: Rounding error of the algorithmic strain in units of the machine precision:
            1 for stresses linear in the strain, more for the quotient in the discrete gradient.
    """

    def __init__(self, scene: Scene, u0: fem.Function) -> None:
        """Compile the forms. Collective.

        Args:
            scene: The problem.
            u0: Function that holds the displacement at the begin of each step.
        """
        self._scene = scene
        self.u0, self.u1 = u0, fem.Function(scene.space)
        self._groups = _groups(scene)
        self._xi = fem.Constant(scene.mesh, 0.0) if scene.named(NumericalDamping) else None
        test, trial = ufl.TestFunction(scene.space), ufl.TrialFunction(scene.space)
        work = self._integrate(
            lambda g: scene.scheme.virtual_work(
                g.energy, g.quadratic, g.parameters, self.u0, self.u1, test, self._xi
            )
        )
        V = scene.space
        self._residual = Kernel(work, [V], scene.mesh)
        self._tangent = Kernel(ufl.derivative(work, self.u1, trial), [V, V], scene.mesh)
        self._energy = Kernel(
            self._integrate(lambda g: stored_energy(g.energy, self.u0, g.parameters)),
            [],
            scene.mesh,
        )
        linear = all(g.quadratic for g in self._groups) or not scene.scheme.conserving
        self.strain_noise = 1.0 if linear else 30.0

    def _integrate(self, integrand: Any) -> ufl.Form:
        dx = ufl.Measure(
            "dx",
            domain=self._scene.mesh,
            metadata={"quadrature_degree": self._scene.quadrature_degree},
        )
        return sum(
            (integrand(group) * dx(i) for i, group in enumerate(self._groups, start=1)),
            ufl.Form([]),
        )

    def cells(self, flexible: npt.NDArray[np.int32] | None = None) -> Cells:
        """Owned cells by subdomain id.

        Args:
            flexible: Sorted owned cells to keep; all if None.
        """
        return {
            i: g.cells if flexible is None else np.intersect1d(g.cells, flexible)
            for i, g in enumerate(self._groups, start=1)
        }

    def bind(
        self, cells: Cells, core: Cells | None = None, rim: Cells | None = None
    ) -> BoundForces:
        """Internal forces of a step.

        Args:
            cells: Flexible cells.
            core: Those that touch no rigid body; all if None.
            rim: Those that do; none if None.
        """
        return _bound(self._residual, self._tangent, cells, core, rim)

    def bind_energy(self, cells: Cells) -> fem.Form:
        """Stored energy at `u0` over the given cells."""
        return self._energy.bind(cells)

    def bind_static(self, cells: Cells) -> BoundForces:
        """Static internal forces at `u1` over the given cells; compiled when first asked for."""
        test, trial = ufl.TestFunction(self._scene.space), ufl.TrialFunction(self._scene.space)
        work = self._integrate(lambda g: static_virtual_work(g.energy, g.parameters, self.u1, test))
        V, mesh = self._scene.space, self._scene.mesh
        tangent = ufl.derivative(work, self.u1, trial)
        return _bound(Kernel(work, [V], mesh), Kernel(tangent, [V, V], mesh), cells)

    def set_time(self, t: float) -> None:
        """Set what in the forms depends on the midpoint of the step, t [s]."""
        if self._xi is not None:
            self._xi.value = sum(d.xi for d in self._scene.named(NumericalDamping) if d.active(t))


def _bound(
    residual: Kernel,
    tangent: Kernel,
    cells: Cells,
    core: Cells | None = None,
    rim: Cells | None = None,
) -> BoundForces:
    none = {i: own[:0] for i, own in cells.items()}
    return BoundForces(
        residual.bind(cells),
        tangent.bind(cells if core is None else core),
        tangent.bind(none if rim is None else rim),
    )


def _groups(scene: Scene) -> list[Group]:
    members: dict[tuple[Energy, bool], list[Any]] = {}
    for material, cells in scene.materials:
        members.setdefault((material.energy, material.quadratic), []).append((material, cells))
    groups = []
    for (energy, quadratic), pairs in members.items():
        parameters: dict[str, Any] = {}
        for name in pairs[0][0].parameters:
            values = [(m.parameters[name], cells) for m, cells in pairs]
            same = len({value for value, _ in values}) == 1
            parameters[name] = (
                fem.Constant(scene.mesh, float(values[0][0])) if same else scene.cellwise(values)
            )
        cells = np.sort(np.concatenate([cells for _, cells in pairs]))
        groups.append(Group(energy, quadratic, cells, parameters))
    return groups
