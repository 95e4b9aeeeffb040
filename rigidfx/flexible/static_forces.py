"""Static internal forces, and follower loads on facets, at the end of a load step.

    w·∫ S(E₁) : δE₁ dV + ∫ p cof(F₁) N · w dA

Viscous stresses and numerical damping have no part in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import ufl

from rigidfx.effects import Effect
from rigidfx.flexible.bound_forces import BoundForces
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.flexible.kernels import Kernel
from rigidfx.mechanics.schemes import static_virtual_work
from rigidfx.scene.scene import Scene


def static_forces(
    scene: Scene,
    forces: InternalForces,
    cells: Cells,
    interior: Cells | None = None,
    interface: Cells | None = None,
    driven: Cells | None = None,
    acting: Sequence[Effect] = (),
) -> BoundForces:
    """Static forces at `forces.u1`; compiled when first asked for. Collective.

    Args:
        scene: The problem.
        forces: Owner of the coefficient that the forms read.
        cells: Flexible cells.
        interior: Those that touch no rigid body; all if None.
        interface: Those that do; none if None.
        driven: Cells that a support moves; pressure on them is for the support to bear.
        acting: Effects of which loads on facets are taken.
    """
    V, mesh, element, at = scene.space, scene.mesh, scene.element, forces.u1
    test, trial = ufl.TestFunction(V), ufl.TrialFunction(V)
    loads = forces.select_static(acting)
    work = forces.integrate(lambda i, c: static_virtual_work(element, c.law, at, test))
    less = forces.integrate(lambda i, c: element.eliminated((at,), at, 1.0, None, test, trial))
    for k, term in loads:
        work += term.virtual_work(element, at, at, test) * scene.boundary_measure(k + 1)
    tangent = Kernel(ufl.derivative(work, at, trial) + less, [V, V], mesh)
    none = {i: own[:0] for i, own in cells.items()}
    each = cells if interior is None else interior, interface or none
    parts = [(own, forces.facets_of(own)) for own in each]
    residual = Kernel(work, [V], mesh).bind(cells, forces.facets_of(cells, driven or {}))
    return forces.bound(residual, tangent, parts)
