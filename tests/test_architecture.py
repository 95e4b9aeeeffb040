"""Layers: every module imports from layers above it only."""

from __future__ import annotations

import ast
from pathlib import Path

import rigidfx

# Data flow one way, from top to bottom. A new module takes its place here.
LAYERS = [
    "errors",
    "files",
    "_compat",
    "rotation",
    "materials",
    "effects",
    "description",
    "criterion",
    "hysteresis",
    "timeline",
    "ledger",
    "quality",
    "domain",
    "msh",
    "geo",
    "cad",
    "assignment",
    "forms",
    "kernels",
    "linear",
    "newton",
    "conflicts",
    "scene",
    "changes",
    "regions",
    "decision",
    "body",
    "ensemble",
    "increments",
    "pressures",
    "groups",
    "internal",
    "strain_rate",
    "stress",
    "inversion",
    "rows",
    "partition",
    "prolongation",
    "rim",
    "condensation",
    "mass",
    "inertia",
    "state",
    "observation",
    "freezing",
    "projection",
    "supports",
    "ground",
    "monitor",
    "probes",
    "prediction",
    "loads",
    "parts",
    "rounding",
    "equilibrium",
    "preload",
    "system",
    "integrator",
    "report",
    "switching",
    "balance",
    "simulation",
    "multibody",
    "paraview",
    "view",
    "output",
    "figures",
    "photographs",
    "shapes",
    "plot",
]

PACKAGE = Path(rigidfx.__file__).parent


def _imports(path):
    """Modules of this package that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (a.name.split(".")[1] for a in node.names if a.name.startswith("rigidfx."))
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            if node.module == "rigidfx":
                yield from (a.name for a in node.names)
            elif (node.module or "").startswith("rigidfx."):
                yield node.module.split(".")[1]


def _modules():
    """Files of each module; a folder is one module."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if name != "__init__":
            found.setdefault(name, []).append(path)
    return found


def test_every_module_has_its_layer():
    """Nothing is missing in the list above, or there twice."""
    assert set(_modules()) <= set(LAYERS)
    assert len(LAYERS) == len(set(LAYERS))


def test_modules_import_from_layers_above_only():
    """No circles and no calls upwards."""
    for name, paths in _modules().items():
        allowed = LAYERS[: LAYERS.index(name)]
        for path in paths:
            inside = [name] if path.parent != PACKAGE else []
            for imported in _imports(path):
                known = imported in allowed + inside
                assert known, f"{path} imports {imported}, which is not above it"


def test_everything_public_is_exported_by_its_module():
    """Each module names what it offers, and has it; the package re-exports such names only."""
    offered = set()
    for name in sorted(_modules()):
        module = __import__(f"rigidfx.{name}", fromlist=["__all__"])
        assert module.__doc__
        assert module.__all__ == sorted(module.__all__, key=_isort_key)
        for item in module.__all__:
            assert hasattr(module, item), f"{name}.__all__ names {item}"
        offered |= set(module.__all__)
    assert set(rigidfx.__all__) <= offered


def _isort_key(name):
    """Constants, classes, functions, each by the alphabet, as ruff sorts __all__."""
    kind = 0 if name.isupper() and len(name) > 1 else 1 if name[0].isupper() else 2
    return kind, name


def test_only_one_module_names_a_version():
    """What differs between releases of DOLFINx stays in _compat."""
    for name, paths in _modules().items():
        for path in paths if name != "_compat" else ():
            text = path.read_text(encoding="utf-8")
            assert "__version__" not in text, path
            assert "_compat.VERSION" not in text, path
