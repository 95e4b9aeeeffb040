"""Joints in a multibody file: as a scene has placed them, to be read back."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import path_of
from rigidfx.effects import (
    Cylindrical,
    Joint,
    MeanFace,
    Prismatic,
    Revolute,
    RigidFace,
    Spherical,
    Tied,
    Universal,
)
from rigidfx.scene.scene import Scene

__all__ = ["joints_as_data", "read_joints"]

KINDS: dict[str, type[Joint]] = {
    kind.__name__: kind for kind in (Cylindrical, Prismatic, Revolute, Spherical, Tied, Universal)
}
FACES: dict[str, Any] = {face.__name__: face for face in (MeanFace, RigidFace)}


def joints_as_data(scene: Scene) -> list[dict[str, Any]]:
    """The joints of a scene for JSON: kind, sides, and places and axes at the start."""
    out = []
    for joint in scene.named(Joint):
        data: dict[str, Any] = {"kind": joint.kind, "name": joint.title}
        for item in (f.name for f in fields(joint) if f.name != "name"):
            value = getattr(joint, item)
            if hasattr(value, "where"):
                value = {type(value).__name__: value.where}
            data[item] = value if isinstance(value, (str, dict)) else [float(x) for x in value]
        out.append(data)
    return out


def read_joints(path: str | Path) -> tuple[Joint, ...]:
    """The joints of a file of `write_bodies`, as they were placed at the start.

    Sides are called as in the scene that wrote them: the mesh has to have their sets, and named
    parts are to be named again.

    Args:
        path: JSON file of `write_bodies`.

    Raises:
        SceneError: If the file cannot be read, or a joint in it is damaged.
    """
    path = path_of("read_joints", "path", path)
    try:
        given = json.loads(path.read_text(encoding="utf-8"))["joints"]
        return tuple(_joint(data) for data in given)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SceneError(
            f"read_joints: '{path}' cannot be read as a file of write_bodies with joints: "
            f"{type(error).__name__}: {error}"
        ) from error


def _joint(data: dict[str, Any]) -> Joint:
    own = dict(data)
    kind = KINDS[own.pop("kind")]
    for side in ("a", "b"):
        if isinstance(own[side], dict):
            ((face, where),) = own[side].items()
            own[side] = FACES[face](where)
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in own.items()}
    return kind(**values)
