"""Which element a scene takes, and whether it goes with the rest.

Hexahedra are thin through the facets of a surface, and on behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import shown
from rigidfx.domain.domain import Domain
from rigidfx.mechanics.assumed import AssumedElement, AssumedStrains
from rigidfx.mechanics.element import Element, StandardElement
from rigidfx.mechanics.enhanced import EnhancedElement
from rigidfx.mechanics.rest import rest_moduli
from rigidfx.mechanics.schemes import EnergyMomentum

Moduli = Sequence[tuple[float, float]]


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
    moduli = _check_enhanced(scene, "'enhanced'")
    return EnhancedElement(*_laws(scene, moduli, 0), _linear(scene))


def _assumed(scene: Any, asked: AssumedStrains) -> Element:
    """With the direction of each cell's thickness, too."""
    moduli = _check_enhanced(scene, "AssumedStrains")
    axes = thickness_axes(scene.domain, asked.thickness)
    return AssumedElement(*_laws(scene, moduli, axes), _linear(scene))


def _linear(scene: Any) -> bool:
    """Whether stresses of all materials are linear in the strain."""
    return all(m.quadratic for m, _ in scene.materials)


def _laws(scene: Any, moduli: Moduli, axes: Any) -> tuple[fem.Function, fem.Function]:
    """Elastic constants and, for viscous stresses, those of the identity."""
    elastic = [(own, c) for own, (_, c) in zip(moduli, scene.materials, strict=True)]
    viscous = [((0.0, 0.5), c) for _, c in scene.materials]
    return _law(scene, elastic, axes), _law(scene, viscous, axes)


def _check_enhanced(scene: Any, asked: str) -> Moduli:
    """λ and μ of materials at rest; unsuitable ones for such strains are refused.

    Raises:
        SceneError: If there is any.
    """
    wrong = None
    moduli = [rest_moduli(m) for m, _ in scene.materials]
    unknown = [m for own, (m, _) in zip(moduli, scene.materials, strict=True) if own is None]
    if scene.simplex:
        wrong = (
            "is for hexahedra, and these cells are tetrahedra. Mesh with hexahedra, or take "
            "order=2 with mass='consistent'"
        )
    elif scene.order != 1:
        wrong = (
            f"is for order 1, got order {scene.order}, which does not lock. Leave out one of both"
        )
    elif unknown:
        owner = getattr(unknown[0], "label", type(unknown[0]).__name__)
        wrong = (
            f"needs λ and μ of each material at rest, C = I, and those of {owner} cannot be told: "
            "its energy depends on the place, has functions that UFL does not evaluate, or no "
            "stiffness there. Take order=2 and element='standard'"
        )
    elif not isinstance(scene.scheme, EnergyMomentum):
        wrong = f"goes with EnergyMomentum, not with {type(scene.scheme).__name__}"
    if wrong is not None:
        raise SceneError(f"Scene: element={asked} {wrong}.")
    return [own for own in moduli if own is not None]


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


Axes = npt.NDArray[np.int8]

# Facets of a hexahedron k and 5 - k are opposite, across the coordinates
ACROSS = np.array([2, 1, 0, 0, 1, 2])


def thickness_axes(domain: Domain, name: str) -> Axes:
    """The coordinate of each local cell across its thickness, 1 to 3; 0 where it has none.

    Collective.

    Args:
        domain: A mesh of hexahedra.
        name: Facets; from each of them the thickness goes on facet by opposite facet.

    Raises:
        SceneError: On every rank, if the name is unknown, or two directions meet in a cell.
    """
    found = domain.find(name, (2,), "AssumedStrains")
    topology = domain.mesh.topology
    topology.create_connectivity(3, 2)
    facets = topology.connectivity(3, 2).array.reshape(-1, 6)
    marks = la.vector(topology.index_map(2), 1, dtype=np.float64)
    marks.array[found.entities] = 1.0
    count = 0
    while True:
        _share(marks)
        now = int(np.count_nonzero(marks.array))
        grown = domain.comm.allreduce(now - count, op=MPI.MAX)
        if grown == 0:
            break
        count = now
        hit = marks.array[facets] > 0
        marks.array[facets[hit[:, ::-1]]] = 1.0
    hit = marks.array[facets] > 0
    across = np.stack([hit[:, k] | hit[:, 5 - k] for k in range(3)], axis=1)  # of facets 0, 1, 2
    several = domain.comm.allreduce(int(np.count_nonzero(across.sum(axis=1) > 1)))
    agree(
        domain.comm,
        f"AssumedStrains: through '{name}' the thickness goes two ways in some cells. Name one "
        "side of the thin part, without its rim."
        if several
        else None,
    )
    axes = np.where(across.any(axis=1), ACROSS[np.argmax(across, axis=1)] + 1, 0)
    return np.asarray(axes, dtype=np.int8)


def _share(marks: la.Vector) -> None:
    """Mark a facet on all ranks that know it. Collective."""
    marks.scatter_reverse(la.InsertMode.add)
    marks.array[:] = marks.array > 0
    marks.scatter_forward()
