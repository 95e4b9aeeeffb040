"""A scene in words: its effects, and which of them act when."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from math import inf, isfinite
from typing import Any

import numpy as np

from rigidfx.effects import Effect, Joint, Motor, PointMass, Rigid, Table, rigid_faces
from rigidfx.effects.contacts.surface import modulus_of
from rigidfx.mechanics.element import StandardElement
from rigidfx.scene.mesh_checks import parts_in_words
from rigidfx.scene.pieces import pieces_in_words
from rigidfx.scene.weights import inertial_masses

ELSEWHERE = ("where", "joint", "components", "since", "until", "a", "b")  # not among the values

# What modules that come later in the flow of data add to a description, from the scene, the time
# step thought of and the number of periods: lines.
FURTHER: list[Callable[[Any, float | None, int | None], list[str]]] = []


def in_words(record: Any) -> str:
    """Kind and values of a frozen record, such as a material."""
    return f"{_kind(record)}: {_values(record)}"


def description(scene: Any, step: float | None, periods: int | None = None) -> list[str]:
    """The content in a scene and when it acts, line by line. Collective.

    A step is one that is thought of [s]; periods of vibrations are told where cheap if None.
    """
    cells = scene.mesh.topology.index_map(3).size_global
    nodes = scene.space.dofmap.index_map.size_global
    lines = [
        f"Scene of {cells} {_cells(scene)} of order {scene.order}"
        f"{_element(scene)}, {nodes} nodes; {scene.mass} mass; "
        f"{type(scene.scheme).__name__}",
        f"  {_extent(scene)}",
        *(f"  {line}, which shares no node with others" for line in parts_in_words(scene.domain)),
        *(f"  {line}" for line in pieces_in_words(scene.domain, scene.effects, scene.pieces)),
        "Materials",
        *(
            f"  {f'{name!r}: ' if name else ''}{in_words(material)}; "
            f"{int(scene.sum(own.size))} cells; {speed}"
            for name, (material, own), speed in zip(
                scene.material_sets, scene.materials, _speeds(scene, step), strict=True
            )
        ),
        *(line for more in FURTHER for line in more(scene, step, periods)),
        "Effects" if scene.effects else "Effects: none",
        *(f"  {line}" for line in effects_table(scene.effects)),
        *_freedom(scene),
    ]
    acting = phases(scene.effects)
    return lines + (["Acting", *(f"  {line}" for line in acting)] if acting else [])


def _freedom(scene: Any) -> list[str]:
    """A line on how many directions joints and motors hold, and what rigid parts have. Collective.

    How many are left is not told where supports hold parts, too.
    """
    joints = scene.named(Joint)
    if not joints:
        return []
    held, parts = sum(len(joint.pieces.rows) for joint in joints), len(scene.named(Rigid))
    loose = scene.parts.count - parts
    given = sum(motor.prescribes and motor.acts(0.0) for motor in scene.named(Motor))
    left = 6 * parts - held - given
    told = loose <= 0 and not scene.supports
    counted = f" At least {max(left, 0)} are left." if told else ""
    driven = f", and motors at the start {given} more" if given else ""
    named = f"; the parts named rigid have {6 * parts} degrees of freedom without them"
    return [
        f"  {len(joints)} joint{'s' * (len(joints) > 1)} hold{'s' * (len(joints) == 1)} {held} "
        f"directions{driven}{named if parts else ''}.{counted} "
        "A run tells which directions are held twice."
    ]


def _element(scene: Any) -> str:
    """The name of its element, if that is not the usual one."""
    name = scene.element.name
    return "" if name == StandardElement.name else f", {name}"


def _extent(scene: Any) -> str:
    """Mass, box and number of dofs of a scene. Collective."""
    n, X = scene.owned_nodes, scene.start_places
    mass = scene.sum(inertial_masses(scene).sum())
    low, high = scene.box_of(X[:n])
    low, high = (np.where(np.abs(x) < 1e-12 * (high - low).max(), 0.0, x) for x in (low, high))
    box = " × ".join(f"{a:.4g} … {b:.4g}" for a, b in zip(low, high, strict=True))
    held = np.zeros((len(X), 3), dtype=bool)
    for support, nodes in scene.supports:
        if support.acts(0.0):
            held[np.ix_(nodes, support.axes)] = True
    faces = rigid_faces(scene.effects)
    for face in faces:
        held[scene.nodes(face.where, face.name, (2,))] = True
    bodies = len(faces) + sum(mass.is_carried for mass in scene.named(PointMass))
    free = int(scene.sum(np.count_nonzero(~held[:n]))) + 6 * bodies
    return f"{mass:.6g} kg in a box of {box} m; {free} unknowns at the start, if all is flexible"


def _speeds(scene: Any, dt: float | None) -> list[str]:
    """For each material, how fast a wave is in it and how far it gets in a step [s]. Collective.

    The speed is √(ℂ₀₁₁₁₁/ρ), that of pressure waves in the unstrained material, and the size of a
    cell the cube root of the mean volume of a cell of the mesh.
    """
    size, out = scene.mean_cell_size, []
    for material, _ in scene.materials:
        stiffness = modulus_of(scene.comm, material)
        if not stiffness > 0:
            out.append("no stiffness when unstrained")
            continue
        speed = np.sqrt(stiffness / material.rho)
        text = f"waves of {speed:.3g} m/s"
        if dt is not None:
            text += f", which pass {speed * dt / size:.3g} cells in Δt = {dt:g} s"
        out.append(text)
    return out


def in_a_line(scene: Any) -> str:
    """Size and number of effects."""
    cells = scene.mesh.topology.index_map(3).size_global
    dofs = 3 * scene.space.dofmap.index_map.size_global
    materials, effects = len(scene.materials), len(scene.effects)
    return (
        f"<Scene: {cells} {_cells(scene)} of order {scene.order}, {dofs} dofs, "
        f"{materials} material{'s' * (materials != 1)}, {effects} effect{'s' * (effects != 1)}>"
    )


def _cells(scene: Any) -> str:
    return "tetrahedra" if scene.simplex else "hexahedra"


def effects_table(effects: Sequence[Effect]) -> list[str]:
    """A line for each effect: its kind, where it acts, its values, and when."""
    rows = [(_kind(e), _where(e), _values(e), _window(e)) for e in effects]
    width = [max(map(len, column)) for column in zip(*rows, strict=True)] if rows else []
    return [
        "  ".join(text.ljust(n) for text, n in zip(row, width, strict=True)).rstrip()
        for row in rows
    ]


def phases(effects: Sequence[Effect]) -> list[str]:
    """A line for each span of time in which the same effects act, from t = 0 on.

    An effect that has no time window and acts, such as a spring, does so in all of them. None if
    nothing of the kind is there.
    """
    windowed: list[Any] = [e for e in effects if e.is_windowed]
    if not windowed and not any(e.is_lasting for e in effects):
        return []
    ends = {t for e in windowed for t in (e.since, e.until) if isfinite(t) and t > 0}
    lines = []
    starts = [0.0, *sorted(ends)]
    for begin, end in zip(starts, [*starts[1:], inf], strict=True):
        here = {id(e) for e in windowed if e.acts(begin)}
        acting = [_short(e) for e in effects if e.is_lasting or id(e) in here]
        span = f"from {begin:g} s on" if end == inf else f"{begin:g} … {end:g} s"
        lines.append(f"{span}: {', '.join(acting) or 'nothing'}")
    return lines


def _kind(effect: Any) -> str:
    return type(effect).__name__


def _short(effect: Effect) -> str:
    where: Any = getattr(effect, "where", getattr(effect, "joint", None))
    return _kind(effect) + (f" {_place(where)}" if where else "")


def _place(where: Any) -> str:
    return f"'{where}'" if isinstance(where, str) else str(where.name)


def _where(effect: Any) -> str:
    if hasattr(effect, "between"):
        return str(effect.between)
    if hasattr(effect, "joint"):
        return f"of '{effect.joint}'"
    if not hasattr(effect, "where"):
        return "everywhere"
    components = getattr(effect, "components", "xyz")
    axes = "" if components == "xyz" else f" ({components})"
    return "everywhere" if effect.where is None else f"on {_place(effect.where)}{axes}"


def _values(effect: Any) -> str:
    given = ((f, getattr(effect, f.name)) for f in fields(effect) if f.name not in ELSEWHERE)
    return ", ".join(
        f"{f.name} {_word(value)}" for f, value in given if not _idle(value, f.default)
    )


def _idle(value: Any, default: Any) -> bool:
    """Whether a value is its default and changes nothing: None, zeros, or the factor 1."""
    if value is None or default is None:
        return value is default
    same = np.shape(value) == np.shape(default) and np.all(value == default)
    return bool(same) and (not np.any(value) or (np.ndim(value) == 0 and value == 1))


def _word(value: Any) -> str:
    if isinstance(value, Table):
        return f"Table({value.times[0]:g} … {value.times[-1]:g} s)"
    if callable(value):
        return "function"
    if isinstance(value, Sequence) and value and isinstance(value[0], Effect):
        return "(" + ", ".join(map(_short, value)) + ")"
    if isinstance(value, float):
        return f"{value:g}"
    array = np.asarray(value)
    if array.ndim and array.dtype.kind in "fiu":
        return "(" + ", ".join(map(_word, array.tolist())) + ")"
    return str(value)


def _window(effect: Any) -> str:
    if not effect.is_windowed:
        return ""
    if effect.since <= 0 and effect.until == inf:
        return "always"
    since = f"from {effect.since:g} s" if effect.since > 0 else ""
    until = f"until {effect.until:g} s" if effect.until < inf else ""
    return f"{since} {until}".strip()
