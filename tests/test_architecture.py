"""Folders: data flow one way through them, from top to bottom of the list below."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

import rigidfx

FLOW = [
    "base",
    "domain",
    "mechanics",
    "effects",
    "scene",
    "flexible",
    "state",
    "coupling",
    "step",
    "report",
    "decide",
    "switch",
    "simulation",
    "output",
    "plot",
]
MOVED = ["files", "shapes", "stress"]  # of one release: they warn, and point to where they are

PACKAGE = Path(rigidfx.__file__).parent
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path.stem not in ("__init__", *MOVED))


def _room(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _name(path):
    return ".".join(("rigidfx", *path.relative_to(PACKAGE).with_suffix("").parts))


def _imports(path):
    """Modules of this package that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.startswith("rigidfx."))
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            if module.split(".")[0] == "rigidfx":
                inner = (f"{module}.{a.name}" for a in node.names)
                yield from (n if _exists(n) else module for n in inner)


def _exists(module):
    place = PACKAGE.joinpath(*module.split(".")[1:])
    return place.is_dir() or place.with_suffix(".py").exists()


def test_every_folder_has_its_place():
    """Nothing is missing in the flow, nothing there is without a folder."""
    assert {_room(path) for path in FILES} == set(FLOW)


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_imports_run_one_way(path):
    """From folders above, or from the same folder."""
    allowed = FLOW[: FLOW.index(_room(path)) + 1]
    for module in _imports(path):
        assert module.split(".")[1] in allowed, f"{path} imports {module}, which is not above it"


def test_modules_of_a_folder_do_not_import_in_a_circle():
    """An order exists in which each module imports earlier ones only."""
    left = {_name(path): set(_imports(path)) for path in FILES}
    while ready := [name for name, needs in left.items() if not needs & left.keys()]:
        for name in ready:
            del left[name]
    assert not left


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_modules_name_what_they_offer(path):
    module = importlib.import_module(_name(path))
    assert module.__doc__
    assert module.__all__ == sorted(module.__all__, key=_isort_key)
    for item in module.__all__:
        assert hasattr(module, item), f"{module.__name__}.__all__ names {item}"


def test_what_the_package_exports_is_offered_by_a_module():
    offered = {item for path in FILES for item in importlib.import_module(_name(path)).__all__}
    assert set(rigidfx.__all__) <= offered


@pytest.mark.parametrize("name", MOVED)
def test_what_has_moved_says_where(name):
    with pytest.warns(DeprecationWarning, match=rf"rigidfx\.{name} has moved to rigidfx\.\w+\."):
        importlib.reload(importlib.import_module(f"rigidfx.{name}"))


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_one_place_writes_the_state(path):
    """No module but state.py assigns to an attribute of a state, or into its arrays."""
    if path.stem == "state":
        return
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AugAssign):
            targets = [node.target]
        else:
            continue
        for target in targets:
            written = ast.unparse(target)
            place = re.match(r"(?:\w+\.)*state\.", written)
            assert not place, f"{path}:{node.lineno} writes {written}"


def _isort_key(name):
    """Constants, classes, functions, each by the alphabet, as ruff sorts __all__."""
    kind = 0 if name.isupper() and len(name) > 1 else 1 if name[0].isupper() else 2
    return kind, name


def test_only_one_module_names_a_version():
    """What differs between releases of DOLFINx stays in base/compat.py."""
    for path in FILES:
        if path.stem != "compat":
            text = path.read_text(encoding="utf-8")
            assert "__version__" not in text, path
            assert "compat.VERSION" not in text, path
