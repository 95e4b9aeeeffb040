"""Which material and which element each cell has.

The stored energy of a user is checked: a scalar that depends on C, finite and stable at rest.
Hexahedra of assumed strains are thin through the facets of a surface, and on behind it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import shown
from rigidfx.base.sealed import read_only
from rigidfx.base.types import Array, Indices
from rigidfx.base.warning import warn
from rigidfx.domain.domain import Domain
from rigidfx.mechanics.element import Element, StandardElement
from rigidfx.mechanics.enhanced import AssumedElement, AssumedStrains, EnhancedElement
from rigidfx.mechanics.materials import Hyperelastic, Material
from rigidfx.mechanics.schemes import EnergyMomentum, evaluated, rest_moduli

STEP = 1e-3  # of C, for differences of W about rest
STRESSED = 1e-2  # stress at rest over stiffness; differences know it to 1e-3


def check_energy(domain: Domain, material: Material) -> None:
    """Check a stored energy, which may be a user's function, as far as its formula tells.

    `SceneError` if it cannot be formed, is no scalar, does not depend on C or knows another mesh,
    or is not finite at rest.
    """
    owner = getattr(material, "label", type(material).__name__)
    C = ufl.variable(ufl.Constant(domain.mesh.ufl_domain(), shape=(3, 3)))
    try:
        W = ufl.as_ufl(material.energy(C, **material.parameters))
    except Exception as error:  # whatever a user's function may raise
        raise SceneError(
            f"Scene: the stored energy of {owner} cannot be formed: {type(error).__name__}: "
            f"{error}. It must be a function of C and of the parameters that are given, written "
            "with functions of UFL (ufl.exp, not math.exp)."
        ) from error
    if W.ufl_shape != ():
        raise SceneError(f"Scene: the stored energy of {owner} must be a scalar.")
    meshes = ufl.domain.extract_domains(W)
    if not meshes:
        raise SceneError(f"Scene: the stored energy of {owner} does not depend on C.")
    if len(meshes) > 1:
        raise SceneError(f"Scene: the stored energy of {owner} is of another mesh than the scene.")
    if isinstance(material, Hyperelastic):
        _check_rest(domain, owner, material)


def _check_rest(domain: Domain, owner: str, material: Material) -> None:
    """Look at the energy about C = I by differences, if UFL can evaluate it."""
    rest = np.eye(3)
    try:
        W0 = _value(material, rest)
        slopes, curvatures = np.transpose([_differences(material, rest, W0, k) for k in range(6)])
    except (ArithmeticError, ValueError):  # such as the logarithm of what is not above zero
        W0, slopes, curvatures = np.nan, *np.full((2, 6), np.nan)
    except Exception:  # it depends on the place, or has functions that UFL does not evaluate
        return
    if not np.isfinite(np.r_[W0, slopes, curvatures]).all():
        raise SceneError(f"Scene: the stored energy of {owner} is not finite at rest, C = I.")
    stiffness = float(np.abs(curvatures).max())
    if curvatures.min() < -STRESSED * stiffness:
        warn(
            domain.comm,
            f"Scene: the stored energy of {owner} falls where rest is strained, by "
            f"{-curvatures.min():.3g} Pa: such a material is not stable. Look at its signs.",
        )
    stress = float(np.abs(slopes).max())
    if stress > STRESSED * stiffness:
        warn(
            domain.comm,
            f"Scene: the stored energy of {owner} has a stress of {stress:.3g} Pa at rest, C = I, "
            "so that the mesh is not its shape without loads: it will spring into another one. "
            "Subtract what is linear in C, if that is not meant.",
        )


def _differences(material: Material, rest: Array, W0: float, k: int) -> tuple[float, float]:
    """2 ∂W/∂C and 4 ∂²W/∂C² along the k-th strain, xx, yy, zz, yz, zx or xy [Pa]."""
    direction = np.zeros((3, 3))
    i, j = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)][k]
    direction[i, j] = direction[j, i] = STEP
    ahead, behind = (_value(material, rest + sign * direction) for sign in (1, -1))
    return (ahead - behind) / STEP, 4 * (ahead - 2 * W0 + behind) / STEP**2


def _value(material: Material, C: Array) -> float:
    """W at a C of numbers [J/m³]."""
    W = material.energy(ufl.as_matrix(C.tolist()), **material.parameters)
    with np.errstate(all="ignore"):
        return evaluated(ufl.as_ufl(W))


def assign(
    domain: Domain, material: Material | Mapping[str, Material]
) -> tuple[tuple[Material, Indices], ...]:
    """Materials with their owned cells. Collective.

    One material, or one for each of the named sets that make up the mesh. `SceneError` if a name or
    a material is none, a cell has no material or several, or a stored energy cannot be formed.
    """
    owned = domain.mesh.topology.index_map(3).size_local
    used = material.values() if isinstance(material, Mapping) else [material]
    for item in used:
        if isinstance(item, Material):
            check_energy(domain, item)
    if isinstance(material, Material):
        return ((material, read_only(np.arange(owned, dtype=np.int32))),)
    if not isinstance(material, Mapping) or not material:
        raise SceneError(
            f"Scene: material must be a Material or a dict of cell-set names to materials, "
            f"got {shown(material)}."
        )
    times_used = np.zeros(owned, dtype=np.int32)
    pairs = []
    if not all(isinstance(name, str) for name in material):
        raise SceneError(
            f"Scene: materials are given by names of cell sets, got {shown(material)}."
        )
    # The sets are looked up on all ranks at a time, and a dict may be ordered otherwise on each.
    names = domain.comm.bcast(list(material))
    for name in names:
        m = material[name]
        if not isinstance(m, Material):
            raise SceneError(f"Scene: the material of '{name}' must be a Material, got {shown(m)}.")
        entities = domain.find(name, (3,), "Scene (material)").entities
        cells = entities[entities < owned]
        times_used[cells] += 1
        pairs.append((m, read_only(cells)))
    none, several = (
        int(domain.comm.allreduce(int(np.count_nonzero(c))))
        for c in (times_used == 0, times_used > 1)
    )
    if none or several:
        raise SceneError(
            f"Scene: every cell needs exactly one material; {none} cells have none and {several} "
            f"have several{_examples(domain, times_used, dict(zip(names, pairs, strict=True)))}. "
            f"Known names: {domain.names}."
        )
    return tuple(pairs)


def _examples(
    domain: Domain, times_used: Indices, given: Mapping[str, tuple[Material, Indices]]
) -> str:
    """A cell without a material, and one with several and their names, by their places."""
    wrong = [np.flatnonzero(found)[:1] for found in (times_used == 0, times_used > 1)]
    mesh, texts = domain.mesh, []
    for kind, cells in zip(("without one", "in"), wrong, strict=True):
        mine = ""
        if cells.size:
            place = mesh.geometry.x[cell_geometry_dofs(mesh)[cells[0]]].mean(axis=0)
            sets = " and ".join(f"'{n}'" for n, (_, own) in given.items() if cells[0] in own)
            mine = f"{kind} {sets}".rstrip() + ", around ({:.4g}, {:.4g}, {:.4g}) m".format(*place)
        texts += [next(filter(None, domain.comm.allgather(mine)), "")]
    return ": one " + "; one ".join(filter(None, texts))


Moduli = Sequence[tuple[float, float]]


def element_of(scene: Any, name: Any) -> Element:
    """The element of a name, see `ELEMENTS`, or of AssumedStrains(…). Collective.

    `SceneError` if the name is unknown, or the element cannot do with the rest.
    """
    if isinstance(name, AssumedStrains):
        return _assumed(scene, name)
    if not isinstance(name, str) or name not in ELEMENTS:
        known = ", ".join(map(repr, ELEMENTS))
        given = shown(name)
        raise SceneError(f"Scene: element must be {known} or AssumedStrains(…), got {given}.")
    return ELEMENTS[name](scene)


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
    """λ and μ of materials at rest; `SceneError` if one is unsuitable for such strains."""
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
    StandardElement.name: lambda scene: StandardElement(),
    EnhancedElement.name: _enhanced,
}


Axes = npt.NDArray[np.int8]

# Facets of a hexahedron k and 5 - k are opposite, across the coordinates
ACROSS = np.array([2, 1, 0, 0, 1, 2])


def thickness_axes(domain: Domain, name: str) -> Axes:
    """The coordinate of each local cell across its thickness, 1 to 3; 0 where it has none.

    Collective. From each of the named facets the thickness goes on facet by opposite facet.
    `SceneError` on every rank, if the name is unknown, or two directions meet in a cell.
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
