"""Folders: data flow one way through them, from top to bottom of the list below."""

import ast
import importlib
import statistics
from pathlib import Path

import rigidfx

FLOW = [
    "base",
    "linear",
    "domain",
    "mechanics",
    "effects",
    "scene",
    "flexible",
    "state",
    "coupling",
    "step",
    "withheld",
    "shapes",
    "report",
    "decide",
    "inventory",
    "growth",
    "switch",
    "run",
    "preparation",
    "checkpoint",
    "simulation",
    "statics",
    "output",
    "plot",
    "vibration",
    "command",
]

PACKAGE = Path(rigidfx.__file__).parent
OFFERS = sorted(PACKAGE.glob("*/**/__init__.py"))
OTHERS = {"__init__.py", "view.py"}  # view.py runs in ParaView's Python
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path.name not in OTHERS)

TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in [*FILES, *OFFERS]}


def _room(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _name(path):
    return ".".join(("rigidfx", *path.relative_to(PACKAGE).with_suffix("").parts))


def _imports(path):
    """Modules of this package that a file imports, wherever in it."""
    for node in ast.walk(TREES[path]):
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


def test_imports_run_one_way():
    """From folders above, or from the same folder; what a folder offers, too."""
    for path in [*FILES, *OFFERS]:
        allowed = FLOW[: FLOW.index(_room(path)) + 1]
        for module in _imports(path):
            assert module.split(".")[1] in allowed, f"{path} imports {module}, not above it"


def test_imports_can_be_read():
    """Neither by name, nor all of the package at once, which is made of everything."""
    for path in [*FILES, *OFFERS]:
        for node in ast.walk(TREES[path]):
            if isinstance(node, ast.Import):
                assert "rigidfx" not in [a.name for a in node.names], path
            elif isinstance(node, ast.ImportFrom) and node.module == "rigidfx":
                assert all(_exists(f"rigidfx.{a.name}") for a in node.names), path
            elif isinstance(node, ast.Call) and "import_" in ast.unparse(node.func):
                assert "rigidfx" not in ast.unparse(node), path


def test_modules_and_functions_are_short():
    """At most 500 lines, half of the modules at most 200; functions below 60 without docstring."""
    sizes = [len(path.read_text(encoding="utf-8").splitlines()) for path in FILES]
    assert max(sizes) <= 500
    assert statistics.median(sizes) <= 200
    for path in FILES:
        for node in ast.walk(TREES[path]):
            if isinstance(node, ast.FunctionDef):
                told = node.body[0] if ast.get_docstring(node, clean=False) is not None else None
                lines = node.end_lineno - node.lineno + 1
                lines -= told.end_lineno - told.lineno + 1 if told else 0
                assert lines < 60, f"{path}: {node.name} has {lines} lines"


def test_modules_of_a_folder_do_not_import_in_a_circle():
    """An order exists in which each module imports earlier ones only."""
    left = {_name(path): set(_imports(path)) for path in FILES}
    while ready := [name for name, needs in left.items() if not needs & left.keys()]:
        for name in ready:
            del left[name]
    assert not left


def test_rooms_of_a_folder_do_not_import_in_a_circle():
    """Neither do the folders in a folder, each taken as a whole."""

    def room(name):
        return ".".join(name.split(".")[:3]) if name.count(".") > 2 else name

    left = {}
    for path in FILES:
        own = room(_name(path))
        left.setdefault(own, set()).update({room(n) for n in _imports(path)} - {own})
    while ready := [name for name, needs in left.items() if not needs & left.keys()]:
        for name in ready:
            del left[name]
    assert not left


def test_modules_say_what_they_are():
    for path in FILES:
        assert importlib.import_module(_name(path)).__doc__, path


# Tests and demos use what is public ------------------------------------------------------------

ROOT = Path(__file__).resolve().parent.parent
USERS = sorted(path for folder in ("tests", "demos") for path in (ROOT / folder).rglob("*.py"))
OF_OTHERS = {"_cpp_object", "_fixtureinfo"}  # DOLFINx and pytest have no other names for them


def private(source):
    """Lines that use an attribute or a name of somebody else's that begins with an underscore."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
            own |= ast.unparse(node.value) == "super()"
            names = [] if own else [node.attr]
        elif isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", node.func) in (
            "getattr",
            "setattr",
            "hasattr",
        ):
            names = [a.value for a in node.args[1:2] if isinstance(a, ast.Constant)]
        else:
            continue
        hidden = [n for n in names if n.startswith("_") and not n.startswith("__")]
        found += [(node.lineno, name) for name in hidden if name not in OF_OTHERS]
    return found


def test_users_use_what_is_public():
    """No test and no demo pokes at what begins with an underscore."""
    for path in USERS:
        assert private(path.read_text(encoding="utf-8")) == [], path


def test_only_one_module_names_a_version():
    """What differs between releases of DOLFINx stays in base/compat.py."""
    for path in FILES:
        if path.stem != "compat":
            text = path.read_text(encoding="utf-8")
            assert "__version__" not in text, path
            assert "compat.VERSION" not in text, path


# Chosen numbers --------------------------------------------------------------------------------

PLAIN = {0, 1, 2, 0.5}  # in bodies, as are integers up to 12: dimensions and indices
# Numbers that somebody chose in each room: ceilings that only ever go down.
CEILINGS = {
    ".": 1,
    "base": 17,
    "checkpoint": 4,
    "command": 21,
    "coupling": 3,
    "decide": 36,
    "domain": 43,
    "effects": 37,
    "effects/attached": 4,
    "effects/contacts": 20,
    "effects/joints": 17,
    "effects/loads": 6,
    "flexible": 39,
    "growth": 10,
    "inventory": 1,
    "linear": 20,
    "mechanics": 79,
    "output": 6,
    "plot": 41,
    "withheld": 6,
    "report": 27,
    "scene": 30,
    "shapes": 27,
    "step": 12,
    "step/equations": 4,
    "step/length": 33,
    "step/newton": 41,
    "step/system": 1,
    "step/watches": 23,
    "switch": 2,
    "vibration": 11,
}


def numbers_in(node):
    """Numeric literals below a node of the syntax."""
    found = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant))
    return [v for v in found if isinstance(v, (int, float)) and not isinstance(v, bool)]


def chosen(body):
    """How many numbers are at the level of modules and classes, in defaults, and odd in bodies."""
    count = 0
    for node in body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            count += len(numbers_in(node.value))
        elif isinstance(node, ast.ClassDef):
            count += chosen(node.body)
        elif isinstance(node, ast.FunctionDef):
            given = [*node.args.defaults, *filter(None, node.args.kw_defaults)]
            count += sum(v not in PLAIN for d in given for v in numbers_in(d))
            inner = [v for statement in node.body for v in numbers_in(statement)]
            count += sum(v not in PLAIN and (isinstance(v, float) or abs(v) > 12) for v in inner)
    return count


def rooms():
    """Chosen numbers and lines of each folder's own modules."""
    found = {}
    for path in sorted(TREES):
        room = path.relative_to(PACKAGE).parent.as_posix()
        numbers, lines = found.get(room, (0, 0))
        lines += path.read_text(encoding="utf-8").count("\n")
        found[room] = numbers + chosen(TREES[path].body), lines
    return found


def test_chosen_numbers_only_ever_go_down():
    """Who needs another number finds one that buys nothing, and lowers the ceiling with it."""
    for room, (numbers, _) in rooms().items():
        assert numbers <= CEILINGS.get(room, 0), f"{room}: {numbers} numbers"
