"""Read gmsh's scripts: geometry with physical names, meshed when it is read.

A script's constants, `DefineConstant[ length = 2.0 ];`, are parameters that the reader may set.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.text_files import decoded
from rigidfx.base.warning import warn
from rigidfx.domain.curved_cells import straighten
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_model import domain_of, find_file
from rigidfx.domain.silence import silent

__all__ = ["check_order", "mesh_model", "read_geo", "tell"]

DEEPEST = 20  # files that include each other

LAST: dict[Path, tuple[float, bytes]] = {}  # of each file, the last size and a mesh's digest


def read_geo(
    path: str | Path,
    parameters: Mapping[str, float | str] | None = None,
    *,
    size: float | None = None,
    order: int | None = None,
    scale: float = 1.0,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Domain:
    """Run a .geo script of gmsh and mesh its geometry. Collective.

    Its physical groups become the names of the domain, as `read_msh` says. A mesh that the script
    generates itself is taken as it is, unless a size or an order is asked for.

    Example:
        >>> domain = read_geo("meshes/bracket.geo", {"thickness": 0.004})   # doctest: +SKIP

    Args:
        path: The script; it is run on rank 0 only.
        parameters: Values of constants that the script defines by DefineConstant.
        size: Largest edge of a cell [m]; where the script asks for less, that holds. The script's
            own if None.
        order: Order of the cells' geometry, 1 or 2; the script's own if None.
        scale: Metres per unit of length of the script.
        comm: Communicator of the mesh.

    Raises:
        SceneError: If the script is missing or fails, knows no such parameter, cannot be meshed, or
            its mesh cannot be a domain (see `read_msh`).
    """
    factor = positive("read_geo", "scale", scale)
    largest = None if size is None else positive("read_geo", "size", size) / factor
    check_order("read_geo", order)
    if not (parameters is None or isinstance(parameters, Mapping)):
        raise SceneError(
            f"read_geo: parameters must be a dict of names to numbers or texts, "
            f"got {shown(parameters)}."
        )
    given = dict(parameters or {})
    for name, value in given.items():
        if not isinstance(value, str):
            given[name] = number("read_geo", f"the parameter '{name}'", value)

    told: list[str] = []

    def fill(gmsh: Any) -> None:
        find_file(path, "geometry")
        _check_parameters(Path(path), given)
        gmsh.model.add("rigidfx")
        _run(gmsh, path, given)
        told.extend(mesh_model(gmsh, path, largest, order, factor))

    domain = domain_of(comm, f"gmsh: '{path}'", f"'{path}'", fill, factor)
    tell(comm, f"read_geo: '{path}'", told)
    return domain


def _run(gmsh: Any, path: str | Path, given: Mapping[str, float | str]) -> None:
    """Run a script to its end. Left in the middle, gmsh's parser would spoil the next one."""
    gmsh.parser.clear()  # values of another script
    gmsh.onelab.clear()
    for name, value in given.items():
        if isinstance(value, str):
            gmsh.parser.setString(name, [value])
        else:
            gmsh.parser.setNumber(name, [value])
    stop = gmsh.option.getNumber("General.AbortOnError")
    gmsh.option.setNumber("General.AbortOnError", 0)
    gmsh.logger.start()
    try:
        with silent():
            gmsh.merge(str(path))  # `open` would forget the values
        errors = [line for line in gmsh.logger.get() if line.startswith("Error")]
    finally:
        gmsh.logger.stop()
        gmsh.option.setNumber("General.AbortOnError", stop)
    if errors:
        raise SceneError(f"gmsh: {errors[0].removeprefix('Error').lstrip(' :')}")
    for name, value in given.items():
        text = isinstance(value, str)
        if len(gmsh.parser.getNumber(name) if text else gmsh.parser.getString(name)):
            raise SceneError(
                f"read_geo: the parameter '{name}' of '{path}' must be a "
                f"{'number' if text else 'text'}, got {shown(value)}."
            )


def mesh_model(
    gmsh: Any, path: str | Path, size: float | None, order: int | None, metres: float
) -> list[str]:
    """Mesh gmsh's model, unless there is a mesh already that is as asked for.

    Args:
        gmsh: The module.
        path: The file of the geometry.
        size: Largest edge of a cell, in the model's unit of length; the model's own if None.
        order: Order of the cells' geometry; the model's own if None.
        metres: Those of the model's unit of length.

    Returns:
        Texts of warnings.

    Raises:
        SceneError: If gmsh cannot mesh it.
    """
    mesh = gmsh.model.mesh
    own = size is not None or not len(mesh.getElements(3)[0])
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    if own:
        mesh.clear()
        try:
            mesh.generate(3)
        except Exception as error:  # gmsh raises nothing else
            raise SceneError(
                f"gmsh finds no mesh: {error}. Smaller cells (size; in read_cad also "
                "per_circle=24, along curves) often help; else the geometry needs repair."
            ) from None
    if order is not None:
        mesh.setOrder(order)
    told = [straighten(gmsh, metres)] if own or order == 2 else []
    if size is not None:
        told.append(_same(gmsh, Path(path).resolve(), size, metres))
    return [text for text in told if text]


def _same(gmsh: Any, path: Path, size: float, metres: float) -> str:
    """What to say if another size gave the same mesh in this process; else nothing.

    Args:
        gmsh: The module.
        path: The file of the geometry.
        size: Largest edge of a cell, in the model's unit of length.
        metres: Those of the unit.
    """
    _, x, _ = gmsh.model.mesh.getNodes()
    digest = hashlib.sha1((x / np.ptp(x)).round(6).tobytes()).digest()
    before, mesh = LAST.get(path, (size, b""))
    LAST[path] = size, digest
    if mesh != digest or before == size:
        return ""
    return (
        f"The sizes {metres * before:g} m and {metres * size:g} m give the same mesh. gmsh makes "
        "no cells larger than a tenth of the geometry's diagonal, and smaller ones at short edges. "
        "Only smaller sizes give finer meshes."
    )


def tell(comm: MPI.Intracomm, owner: str, told: list[str]) -> None:
    """Warn of how a geometry was meshed. Collective.

    Args:
        comm: Ranks of the mesh.
        owner: Name of the function and its file, for the message.
        told: Texts of `mesh_model`, on rank 0.
    """
    texts: list[str] = comm.bcast(told)
    for text in texts:
        warn(comm, f"{owner}: {text}")


def check_order(owner: str, order: int | None) -> None:
    """Refuse an order that cells cannot have.

    Raises:
        SceneError: If it is not 1, 2 or None.
    """
    if order not in (None, 1, 2):
        raise SceneError(f"{owner}: order must be 1 or 2, got {shown(order)}.")


def _check_parameters(path: Path, given: Mapping[str, float | str]) -> None:
    """Refuse parameters that a script does not define."""
    known = _constants(_text(path))
    unknown = [name for name in given if name not in known]
    if unknown:
        raise SceneError(
            f"read_geo: '{path}' has no parameter '{unknown[0]}'. It defines by DefineConstant: "
            f"{', '.join(known) or 'none'}."
        )


def _text(path: Path, depth: int = 0) -> str:
    """The text of a script and of those it includes, without comments."""
    if depth > DEEPEST or not path.is_file():
        return ""
    text = decoded(path.read_bytes())
    text = re.sub(
        r'("(?:\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/', lambda m: m[1] or " ", text, flags=re.DOTALL
    )
    included = re.findall(r'\b(?:Include|Merge)\s*"([^"]+\.geo)"', text)
    return text + "".join(_text(path.parent / name, depth + 1) for name in included)


def _constants(text: str) -> list[str]:
    """Names that the DefineConstant commands of a script define."""
    text = re.sub(r'"(?:\\.|[^"\\])*"', '""', text)
    inner = re.compile(r"\{[^{}]*\}|\([^()]*\)")
    while inner.search(text):
        text = inner.sub("", text)
    bodies = re.findall(r"\bDefineConstant\s*\[([^\]]*)\]", text)
    names = [name for body in bodies for name in re.findall(r"(\w+)\s*(?:=|,|$)", body)]
    return list(dict.fromkeys(names))
