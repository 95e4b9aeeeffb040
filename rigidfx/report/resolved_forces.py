"""Forces without the vibration that neither the mesh nor Δt resolves.

A contact's force in a step is its impulse over Δt, in short steps one between nodes, with twice the
force ρ c v A of the body. Its mean over a few crossings of the layer of cells behind, weighted by a
triangle, converges to that of the body: docs/theory/contact.md#times-of-a-blow. Forces λ of
constraints lose the part that alternates: docs/theory/joints.md#forces-that-do-not-alternate.
"""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.named import Named
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array, Bools
from rigidfx.effects import Contact
from rigidfx.effects.contacts.surface import area_vectors, modulus_of, surface_of, triangles_of
from rigidfx.effects.rigid import Rigid
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.alternation import FIRST, WORTH_A_WARNING

CROSSINGS = 4.0  # of a layer: a mean over them is ρ c v of a flat face within a few per cent
Steps = list[tuple[float, float]]  # length [s] and force [N] of the last steps


def resolved_part(forces: Array) -> Array:
    """Forces without the part that alternates; all of them in less than eight steps."""
    if len(forces) < 2 * FIRST:
        return forces
    rest, ends = np.diff(forces, 4, axis=0) / 2**4, np.diff(forces, 2, axis=0)[[0, -1]] / 2**2
    turns = np.cumsum(rest[1:] * rest[:-1] < 0, axis=0)
    turns = np.concatenate([np.zeros_like(turns[:1]), turns])
    middle = np.clip(np.arange(len(forces)) - 2, 0, len(rest) - 1)
    begin = np.clip(middle - FIRST, 0, None)
    end = np.clip(middle + FIRST, None, len(rest) - 1)
    alternates = 3 * (turns[end] - turns[begin]) >= 2 * (end - begin)[:, None]
    inner = forces[1:-1] - np.concatenate([-ends[:1], rest, -ends[1:]])
    first, last = 2 * inner[:1] - inner[1:2], 2 * inner[-1:] - inner[-2:-1]
    return np.where(alternates, np.concatenate([first, inner, last]), forces)


def resolved(forces: Array, dt: Array, cut: Bools) -> Array:
    """Forces of all steps without the part that alternates; something else acts after a cut."""
    longer = np.abs(np.diff(dt, prepend=dt[:1])) > WORTH_A_WARNING * dt
    at = np.flatnonzero(cut | longer)
    return np.concatenate([resolved_part(part) for part in np.split(forces, at)])


class ResolvedForces:
    """Adds `Touch.resolved` to reports."""

    remembered: ClassVar[Remembered] = same("_steps")

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._times: dict[str, float] = {}  # that the mesh resolves, once a contact has closed [s]
        self._steps: dict[str, Steps] = {}  # of contacts that press, or have just pressed

    def of(self, report: Report) -> Report:
        """A report with resolved forces. Collective."""
        found = {}
        for contact in self._scene.named(Contact):
            touch = report.touches.get(contact.title)
            steps = self._steps.setdefault(contact.title, [])
            if touch is None:
                steps.clear()
            if touch is None or not (steps or touch.pressing > 0):
                continue
            if contact.title not in self._times:
                self._times[contact.title] = resolved_time(self._scene, contact)
            steps.append((report.dt, touch.pressing))
            resolved = trailing_mean(steps, self._times[contact.title])
            found[contact.title] = replace(touch, resolved=resolved)
        if not found:
            return report
        touches = Named("report.touches", {**report.touches, **found})
        return replace(report, result=replace(report.result, touches=touches))


def trailing_mean(steps: Steps, time: float) -> float:
    """Mean force [N] over the last time [s], weighted by a triangle; of the last step if longer.

    Earlier steps are removed.
    """
    lengths, forces = np.array(steps[::-1]).T
    ages = np.concatenate([[0.0], np.cumsum(lengths)])  # of the ends of steps, the last one first
    if lengths[0] >= time:
        steps.clear()
        return float(forces[0])
    x = np.minimum(ages / time, 1.0)
    weights = np.diff(np.where(x < 0.5, 2.0 * x**2, 1.0 - 2.0 * (1.0 - x) ** 2))
    mean = float(weights @ forces)
    del steps[: np.count_nonzero(ages[:-1] >= time)]
    if not any(force for _, force in steps):
        steps.clear()
    return mean


def resolved_time(scene: Any, contact: Any) -> float:
    """Four crossings of the layer behind a contact, the slower one of two [s]. Collective.

    It is a mean over the surface; 0 if only rigid parts are behind.
    """
    return CROSSINGS * max(_mean(scene, _layer(scene, contact, w)[0]) for w in _sides(contact))


def own_time(scene: Any, contact: Any) -> float:
    """The shortest half period of a contact's layers and rigid parts [s]. Collective.

    Layers count by their mean; inf if neither a modulus nor a rigid part is known.
    """
    surface = surface_of(scene, contact.where, contact.stiffness, contact.owner)
    k, area = scene.sum([of[: scene.owned_nodes].sum() for of in (surface.stiffness, surface.area)])
    times, softness, lightest = [np.inf], 0.0, np.inf
    for where in _sides(contact):
        crossing, layer = _layer(scene, contact, where)
        times.append(np.pi * _mean(scene, crossing * np.sqrt(1.0 + layer * area / k)) or np.inf)
        if where != contact.where:
            lightest = min((m for m, _ in _rigid(scene, contact, where)), default=np.inf)
            softness = _mean(scene, 1.0 / layer) if lightest == np.inf else 0.0
    for m, on in _rigid(scene, contact, contact.where):
        stiffness = on / (area / k + softness)
        times.append(np.pi / np.sqrt(stiffness * (1.0 / m + 1.0 / lightest)))
    return float(min(times))


def _sides(contact: Any) -> tuple[str, ...]:
    """Names of the surfaces that meet."""
    return tuple(dict.fromkeys(contact.keeps_apart)) or (contact.where,)


def _mean(scene: Any, values: npt.NDArray[Any]) -> float:
    """Mean over ranks; 0 of nothing. Collective."""
    total, count = scene.sum([values.sum(), values.size])
    return float(total / max(count, 1.0))


def _layer(scene: Any, contact: Any, where: str) -> tuple[Array, Array]:
    """Time s/c [s] and stiffness (λ + 2μ)/s [N/m³] at each triangle of a surface. Collective.

    Triangles on rigid parts, and on cells of a material that tells no modulus, are left out.
    """
    cells, nodes = triangles_of(scene, where, contact.owner)
    X, dofs = scene.space.tabulate_dof_coordinates(), scene.space.dofmap.list
    modulus, density = np.zeros((2, len(dofs)))
    for material, own in scene.materials:
        modulus[own], density[own] = modulus_of(scene.comm, material), material.rho
    for rigid in (effect for effect in scene.named(Rigid) if effect.is_rigid):
        modulus[scene.owned_cells(rigid.where, rigid.kind)] = np.nan
    known = np.isfinite(modulus[cells])
    cells, corners = cells[known], X[nodes[known]]
    normal = area_vectors(corners)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    from_it = X[dofs[cells]] - corners.mean(axis=1)[:, None]
    s = np.abs(np.einsum("nij,nj->ni", from_it, normal)).max(axis=1, initial=0.0) / scene.order
    return s * np.sqrt(density[cells] / modulus[cells]), modulus[cells] / s


def _rigid(scene: Any, contact: Any, where: str) -> list[tuple[float, float]]:
    """Mass [kg] and area [m²] of each part named rigid that has nodes in a surface. Collective."""
    area = surface_of(scene, where, contact.stiffness, contact.owner).area
    found = []
    for rigid in (effect for effect in scene.named(Rigid) if effect.is_rigid):
        inside = np.zeros(area.size, dtype=bool)
        inside[slice(None) if rigid.where is None else scene.nodes(rigid.where, "Rigid", (3,))] = 1
        inside[scene.owned_nodes :] = False
        pressed, m = scene.sum([area[inside].sum(), scene.nodal_mass[inside].sum()])
        if pressed > 0:
            found.append((m if rigid.mass is None else float(rigid.mass), pressed))
    return found
