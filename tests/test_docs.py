"""Docstrings render as pages, without a warning (warnings are errors in this suite).

The changelog is grouped, the citation is of this version, pages are short and name their subjects.
"""

import ast
import re
import runpy
from pathlib import Path

import pytest
from mpi4py import MPI

import rigidfx

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="needs no ranks")

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = Path(rigidfx.__file__).parent
MODULES = sorted(
    ".".join(["rigidfx", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(
        ".__init__"
    )
    for path in PACKAGE.rglob("*.py")
)


def test_every_module_becomes_a_page(tmp_path):
    pdoc = pytest.importorskip("pdoc", reason="pdoc is not installed")
    pdoc.render.configure(docformat="google", math=True)
    pdoc.pdoc(*MODULES, output_directory=tmp_path)
    pages = {
        page.relative_to(tmp_path).with_suffix("").as_posix() for page in tmp_path.rglob("*.html")
    }
    assert {module.replace(".", "/") for module in MODULES} <= pages


def test_changelog_is_grouped():
    """Each release by Added, Changed, Fixed, Removed, in this order, with entries in each."""
    _, *releases = re.split(
        r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.M
    )
    assert releases
    for release in releases:
        title, *groups = re.split(r"^### ", release, flags=re.M)
        assert "\n- " not in title
        names = [group.split("\n")[0] for group in groups]
        assert names == [n for n in ("Added", "Changed", "Fixed", "Removed") if n in names]
        assert all(re.search(r"^- \S", group, re.M) for group in groups)


def test_citation_is_of_this_version():
    def found(file, pattern):
        return re.findall(pattern, (ROOT / file).read_text(encoding="utf-8"), re.M)

    assert found("CITATION.cff", r"^version: (.*)") == [rigidfx.__version__]
    assert found("pyproject.toml", r"^version = (.*)") == ['{ attr = "rigidfx.__version__" }']
    assert found("CITATION.cff", r"^  - name: (.*)") == found(
        "pyproject.toml", r'name = "(The .*?)"'
    )


# Words of each page, and of prose in docs/; notes, the lab book, have no limit.
LIMITS = {"README.md": 700, "theory.md": 2000}
LIMIT = 1550
PROSE = 21_300
# "what" in 1000 words: it stands for a noun that a reader would have to find.
WHAT = 3.0


def told(text):
    """How often "what" stands in 1000 words."""
    return 1000 * len(re.findall(r"\bwhat\b(?!:)", text, re.I)) / len(text.split())


def prose(text):
    """Words that a reader reads: no blocks of code, equations, tags, names of code or links."""
    text = re.sub(
        r"^```.*?^```|^    .*?$|<[a-z][^<>]*>|`[^`]*`|\]\([^)]*\)", "", text, flags=re.M | re.S
    )
    return re.findall(r"[^\W\d_][^\W\d_'’-]+", text)


def test_pages_are_short_and_name_their_subjects():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    pages = {
        p: p.read_text(encoding="utf-8") for p in pages if p.parent.name not in ("notes", "paper")
    }
    for page, text in pages.items():
        assert len(text.split()) <= LIMITS.get(page.name, LIMIT), page.name
    assert sum(len(prose(text)) for page, text in pages.items() if page.parent != ROOT) <= PROSE
    assert told("\n".join(pages.values())) <= WHAT


def test_docstrings_name_their_subjects():
    documented = ast.Module, ast.ClassDef, ast.FunctionDef
    files = [ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")]
    nodes = [node for file in files for node in ast.walk(file) if isinstance(node, documented)]
    assert told("\n".join(ast.get_docstring(node) or "" for node in nodes)) <= WHAT


# For each call that warns: the beginning of its entry on the page of errors and warnings.
WARNINGS = {
    "decide/policy.py": [
        "the window is shorter",
        "the tolerance is below",
        "bodies are released again",
    ],
    "decide/accuracy.py": ["the error is unknown", "the budget was not met"],
    "domain/cad.py": ["the cells have more or less volume"],
    "domain/cell_quality.py": ["cells are inside out or flat at a corner"],
    "domain/domain.py": ["edges or vertices are left out"],
    "domain/arrays.py": ["volume cells are in no physical group", "edges or vertices are left out"],
    "effects/contact.py": ["a contact overlaps at the start"],
    "effects/loads/dead_load.py": ["a force per volume"],
    "scene/checks.py": ["first-order cells lock"],
    "growth/shaping.py": 2 * ["a reduced part bends far"],
    "shapes/bends.py": ["a reduced part bends far"],
    "scene/doubts.py": [
        *6 * ["an unlikely mass"],
        *2 * ["a load does nothing"],
        "a round contact surface",
    ],
    "scene/cells.py": ["a stored energy falls", "a stored energy falls"],
    "scene/mesh_checks.py": [
        "first-order cells lock",
        "parts touch without common nodes",
        "parts share a node or an edge",
        "the mesh reaches far",
        "an effect acts on both ends of edges",
    ],
    "effects/damping.py": ["an unlikely mass"],
    "effects/joints/elements.py": ["an unlikely mass"],
    "effects/joints/sides.py": ["an unlikely mass"],
    "report/report.py": ["an argument, or an attribute", "a reduced part bends far"],
    "simulation.py": ["an argument, or an attribute", "a resumed run is over"],
    "step/watches/alternation.py": ["the motion goes back", "rounding ends an iteration"],
    "scene/pieces.py": ["a `Rigid` part has several pieces"],
    "statics.py": ["contacts leave a rigid motion free"],
    "step/length/time_control.py": ["supports hold all probes", "the shortest steps err"],
    "linear/petsc_options.py": ["PETSc options"],
    "step/watches/cells.py": ["a cell is strongly compressed", "a body rotates by more than 1 rad"],
    "step/watches/jumps.py": ["a path of a support or an obstacle", "a path of a support or"],
    "switch/switch.py": [
        *("a motor begins apart", "rows of joints follow", "velocities do not fit the joints"),
    ],
    "vibration/modes.py": [
        *("a state is unstable", "parts turn differently", "shapes do not span"),
    ],
}

# Further texts that readers of files find, and one call in domain/arrays.py shows.
OF_READERS = {"cells would be inside out", "elements of an input file"}


def warns(tree):
    """How many calls of a module warn; those that hand a message on count where it is made."""
    told, outer = ("warn", "say", "_say"), ("say", "_say")
    handed_on = {
        id(call)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and node.name in outer
        and "message" in [argument.arg for argument in node.args.args]
        for call in ast.walk(node)
    }
    return sum(
        isinstance(node, ast.Call)
        and id(node) not in handed_on
        and getattr(node.func, "attr", getattr(node.func, "id", "")) in told
        and not (node.args and isinstance(node.args[0], ast.Starred))
        for node in ast.walk(tree)
    )


def test_each_warning_has_its_entry():
    found = {}
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).as_posix()
        # `say` prints there, `warn` is made, and the table of advice has entries of its own.
        if name.startswith(("command/", "base/", "report/advice")):
            continue
        if count := warns(ast.parse(path.read_text(encoding="utf-8"))):
            found[name] = count
    assert found == {name: len(entries) for name, entries in WARNINGS.items()}
    page = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
    for entry in OF_READERS.union(*WARNINGS.values()):
        assert f"\n| {entry}" in page, entry
    assert runpy.run_path(ROOT / "docs" / "messages.py")["made"](page) == page


def test_each_error_has_its_entry():
    page = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
    public = [getattr(rigidfx, name) for name in rigidfx.__all__]
    kinds = [kind for kind in public if isinstance(kind, type) and issubclass(kind, Exception)]
    assert len(kinds) >= 5
    for kind in kinds:
        assert f"\n## {kind.__name__}\n" in page or f"`{kind.__name__}`" in page, kind
