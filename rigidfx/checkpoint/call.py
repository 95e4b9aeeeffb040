"""The call of a run, as its checkpoints keep it, and whether a scene is the same."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigidfx.base.compat import package_version
from rigidfx.base.errors import SceneError
from rigidfx.base.same_input import digest
from rigidfx.base.taken import taken
from rigidfx.checkpoint.files import dumped, loaded
from rigidfx.scene.mesh_order import mesh_hash, scene_hashes
from rigidfx.scene.scene import Scene


def head_of(scene: Scene) -> dict[str, Any]:
    """Version, mesh and scene of a checkpoint. Collective."""
    return {"rigidfx": package_version(), "mesh": mesh_hash(scene), "scene": scene_hashes(scene)}


def check_scene_of(head: Mapping[str, Any], scene: Scene, path: str) -> None:
    """Refuse another version, mesh or scene. Collective.

    Args:
        head: Of the checkpoint.
        scene: The problem that is to go on.
        path: Of the checkpoint.

    Raises:
        SceneError: On every rank, if one is another one.
    """
    if head["rigidfx"] != package_version():
        raise SceneError(
            f"resume: '{path}' was written by rigidfx {head['rigidfx']}, this is "
            f"{package_version()}. "
            "Resume with that version, or run anew."
        )
    own, had = scene_hashes(scene), head["scene"]
    changed = [name for name in {**had, **own} if had.get(name) != own.get(name)]
    if mesh_hash(scene) != head["mesh"]:
        raise SceneError(
            f"resume: '{path}' was written for another mesh: cells or nodes differ. Give the scene "
            "the mesh that the run had."
        )
    if changed:
        raise SceneError(
            f"resume: '{path}' was written for another scene: {changed[0]} differs. Give the scene "
            "that the run had; of functions none can be compared."
        )


def asked(given: Mapping[str, Any]) -> dict[str, tuple[bytes, bytes | None]]:
    """Of each argument its hash, and its value; None if no file can hold that.

    Args:
        given: Arguments by name.
    """
    plain = {name: _plain(value) for name, value in given.items()}
    return {name: (digest(value), dumped(value)) for name, value in plain.items()}


def _plain(value: Any) -> Any:
    """A value with numbers and mappings of Python's own kinds."""
    value = taken(value)
    return dict(value) if isinstance(value, Mapping) else value


def given_again(
    kept: Mapping[str, tuple[bytes, bytes | None]], given: Mapping[str, Any]
) -> dict[str, Any]:
    """The arguments of a run that goes on.

    Args:
        kept: Of `asked`.
        given: Arguments that are given again, None where they are not.

    Raises:
        SceneError: If one has to be given, or is another one.
    """
    out = {}
    for name, (known, data) in kept.items():
        value = given.get(name)
        if value is None and data is None:
            raise SceneError(
                f"resume: {name} holds a function, or a class of your own, which no file keeps. "
                f"Give it again: resume(…, {name}=…)."
            )
        if value is not None and digest(_plain(value)) != known:
            raise SceneError(
                f"resume: {name} is not what the run had. Leave it out, or give the same."
            )
        out[name] = loaded(data) if value is None and data is not None else value
    return out
