"""Docstrings render as pages, without a warning (warnings are errors in this suite).

The changelog is grouped, the citation is of this version, pages are short and name their subjects.
"""

from __future__ import annotations

import ast
import re
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
PROSE = 19_000
# "what" in 1000 words: it stands for a noun that a reader would have to find.
WHAT = 3.0


def told(text):
    """How often "what" stands in 1000 words."""
    return 1000 * len(re.findall(r"\bwhat\b(?!:)", text, re.I)) / len(text.split())


def prose(text):
    """Words that a reader reads: no blocks of code or equations, no names of code, no links."""
    text = re.sub(r"^```.*?^```|^    .*?$|`[^`]*`|\]\([^)]*\)", "", text, flags=re.M | re.S)
    return re.findall(r"[^\W\d_][^\W\d_'’-]+", text)


def test_pages_are_short_and_name_their_subjects():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    pages = {p: p.read_text(encoding="utf-8") for p in pages if p.parent.name != "notes"}
    for page, text in pages.items():
        assert len(text.split()) <= LIMITS.get(page.name, LIMIT), page.name
    assert sum(len(prose(text)) for page, text in pages.items() if page.parent != ROOT) <= PROSE
    assert told("\n".join(pages.values())) <= WHAT


def test_docstrings_name_their_subjects():
    documented = ast.Module, ast.ClassDef, ast.FunctionDef
    files = [ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")]
    nodes = [node for file in files for node in ast.walk(file) if isinstance(node, documented)]
    assert told("\n".join(ast.get_docstring(node) or "" for node in nodes)) <= WHAT
