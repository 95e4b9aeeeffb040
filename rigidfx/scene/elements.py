"""Which element a scene takes, and whether it goes with the rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import basix.ufl
from dolfinx import fem

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.domain.thickness import thickness_axes
from rigidfx.mechanics.assumed import AssumedElement, AssumedStrains
from rigidfx.mechanics.element import Element, StandardElement
from rigidfx.mechanics.enhanced import EnhancedElement
from rigidfx.mechanics.materials import StVenantKirchhoff
from rigidfx.mechanics.schemes import EnergyMomentum

__all__ = ["ELEMENTS", "element_of"]


def element_of(scene: Any, name: Any) -> Element:
    """The element of a name. Collective.

    Args:
        scene: The problem, as far as its mesh, materials and scheme.
        name: Such as "standard", see `ELEMENTS`; or AssumedStrains(…).

    Raises:
        SceneError: If the name is unknown, or the element cannot do with the rest.
    """
    if isinstance(name, AssumedStrains):
        return _assumed(scene, name)
    if not isinstance(name, str) or name not in ELEMENTS:
        known = ", ".join(map(repr, ELEMENTS))
        given = shown(name)
        raise SceneError(f"Scene: element must be {known} or AssumedStrains(…), got {given}.")
    return ELEMENTS[name](scene)


def _standard(scene: Any) -> Element:
    """It goes with everything."""
    return StandardElement()


def _enhanced(scene: Any) -> Element:
    """With the elastic constants of each cell."""
    _check_enhanced(scene, "'enhanced'")
    return EnhancedElement(*_laws(scene, 0))


def _assumed(scene: Any, asked: AssumedStrains) -> Element:
    """With the direction of each cell's thickness, too."""
    _check_enhanced(scene, "AssumedStrains")
    return AssumedElement(*_laws(scene, thickness_axes(scene.domain, asked.thickness)))


def _laws(scene: Any, axes: Any) -> tuple[fem.Function, fem.Function]:
    """Elastic constants and, for viscous stresses, those of the identity."""
    elastic = [((m.parameters["lmbda"], m.parameters["mu"]), c) for m, c in scene.materials]
    viscous = [((0.0, 0.5), c) for _, c in scene.materials]
    return _law(scene, elastic, axes), _law(scene, viscous, axes)


def _check_enhanced(scene: Any, asked: str) -> None:
    """Refuse what enhanced and assumed strains cannot do with.

    Raises:
        SceneError: If there is any.
    """
    wrong = None
    other = [m for m, _ in scene.materials if not isinstance(m, StVenantKirchhoff)]
    if scene.simplex:
        wrong = (
            "is for hexahedra, and these cells are tetrahedra. Mesh with hexahedra, or take "
            "order=2 with mass='consistent'"
        )
    elif scene.order != 1:
        wrong = (
            f"is for order 1, got order {scene.order}, which does not lock. Leave out one of both"
        )
    elif other:
        wrong = (
            "is for StVenantKirchhoff materials, whose stresses are linear in the strain, got "
            f"{type(other[0]).__name__}: its energy would not be conserved. Take order=2 and "
            "element='standard'"
        )
    elif not isinstance(scene.scheme, EnergyMomentum):
        wrong = f"goes with EnergyMomentum, not with {type(scene.scheme).__name__}"
    if wrong is not None:
        raise SceneError(f"Scene: element={asked} {wrong}.")


def _law(scene: Any, values: Any, axes: Any = 0) -> fem.Function:
    """A function on the integration points: λ, μ and a thickness's axis, or 0, of a cell first."""
    element = basix.ufl.quadrature_element(
        scene.mesh.basix_cell(), value_shape=(6,), degree=scene.quadrature_degree
    )
    f = fem.Function(fem.functionspace(scene.mesh, element))
    dofs = f.function_space.dofmap.list[:, 0]
    for (first, second), cells in values:
        f.x.array[6 * dofs[cells]] = first
        f.x.array[6 * dofs[cells] + 1] = second
    f.x.array[6 * dofs + 2] = axes
    return f


# How each is made of a scene, which it may refuse.
ELEMENTS: Mapping[str, Callable[[Any], Element]] = {
    StandardElement.name: _standard,
    EnhancedElement.name: _enhanced,
}
