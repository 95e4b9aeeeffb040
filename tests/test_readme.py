"""README and the pages of docs/: their Python blocks run as they are; whatever they name exists."""

import json
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

import rigidfx
from rigidfx.effects import Effect

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
README, INDEX, DEMOS = ROOT / "README.md", DOCS / "index.md", DOCS / "demos.md"
LONG = DOCS / "tutorials" / "machine_part.md"  # runs for minutes: as the site is built
# In the order in which the index lists them, and in which their blocks run.
PAGES = [
    DOCS / name
    for name in re.findall(r"^- \[[^]]+\]\(([\w/]+\.md)\)", INDEX.read_text("utf-8"), re.M)
]
TEXTS = {
    path: path.read_text(encoding="utf-8")
    for path in (README, INDEX, *PAGES, ROOT / "CONTRIBUTING.md")
}
COMMANDS = sorted(
    {
        *(
            command.strip()
            for text in TEXTS.values()
            for command in re.findall(r"\./fenicsx [^`…#\n]+(?=[`#\n])", text)
        ),
        *(
            f"./fenicsx python3 demos/{name}"
            for name in re.findall(r"^\| `([\w/]+\.py[^`]*)`", TEXTS[DEMOS], re.M)
        ),
    }
)
# Runs the blocks of the pages as one script; an error names the line of the page.
DRIVER = """
import json

names = {"__name__": "__main__"}
for page, line, code in json.load(open("blocks.json", encoding="utf-8")):
    exec(compile("\\n" * line + code, page, "exec"), names)
"""

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its processes itself")


def blocks(path):
    """Page, lines above, and text of each Python block."""
    text = TEXTS[path]
    found = re.finditer(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    return [(path.name, text.count("\n", 0, m.start(1)), m[1]) for m in found]


def anchors(text):
    """The headings of a page as GitHub links to them."""
    headings = re.findall(r"^#+ (.*)", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h).strip().lower().replace(" ", "-") for h in headings}


@pytest.mark.slow
def test_python_blocks_run_in_order(tmp_path):
    """As one script, in an empty folder; they leave what the text says.

    Blocks marked `py` draw pictures, which tests/test_pictures.py does.
    """
    pytest.importorskip("gmsh")
    pytest.importorskip("pyvista")
    code = [block for page in (README, *PAGES) if page != LONG for block in blocks(page)]
    assert len(code) >= 5
    (tmp_path / "blocks.json").write_text(json.dumps(code), encoding="utf-8")
    (tmp_path / "tour.py").write_text(DRIVER, encoding="utf-8")
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    run = subprocess.run(
        # The bar of the tour is two cells across, which its page says the warning of.
        [sys.executable, "-W", "error::UserWarning", "-W", "ignore:Body", "tour.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert run.returncode == 0, f"{run.stdout}\n{run.stderr}"
    assert "freeze" in run.stdout
    left = {file.name for file in (tmp_path / "out" / "bar").iterdir()}
    results = TEXTS[ROOT / "docs" / "results.md"]
    told = set(re.findall(r"^\| `(\w+\.\w+)` \|", results, flags=re.MULTILINE))
    assert {"history.csv", "events.csv", "bodies.csv", "fields.pvd", "view.py"} <= told & left


def test_index_links_every_page():
    assert PAGES
    paper = DOCS / "paper" / "paper.md"  # which a journal prints
    assert set(PAGES) | {INDEX, paper} == set(DOCS.rglob("*.md"))


def source_of(script):
    """A demo's text with that of the packages beside it that it imports, and of demos/common."""
    text = script.read_text(encoding="utf-8")
    packages = re.findall(r"^from (\w+)", text, flags=re.MULTILINE)
    folders = [script.parent / name for name in packages] + [ROOT / "demos" / "common"]
    if "from rigidfx.command import" in text:
        folders.append(ROOT / "rigidfx" / "command")
    files = [file for folder in folders for file in folder.glob("*.py")]
    return "\n".join([text, *(file.read_text(encoding="utf-8") for file in files)])


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_name_what_there_is(command, monkeypatch, capsys):
    words = shlex.split(command)
    assert (ROOT / words[0]).exists()
    for k, word in enumerate(words):
        if word.startswith(("demos/", "tests/")):
            file, _, test = word.partition("::")
            script = source_of(ROOT / file)
            assert test in script
            for option in (w for w in words[k:] if w.startswith("--")):
                assert f'"{option}"' in script, f"{word} has no option {option}"
        if word == "-m" and words[k + 1].startswith("rigidfx"):
            module = words[k + 1]
            monkeypatch.delitem(sys.modules, f"{module}.__main__", raising=False)
            monkeypatch.setattr(sys, "argv", [module, "--help"])
            with pytest.raises(SystemExit):
                runpy.run_module(module, run_name="__main__")
            assert f"-m {module}" in capsys.readouterr().out


def test_commands_are_found():
    assert len(COMMANDS) >= 15


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_links_and_pictures_exist(path):
    links = re.findall(r'(?:src="|\]\()([^")\s:]+)["\)]', TEXTS[path])
    for link in links:
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_files_and_modules_exist(path):
    """From the project's folder, or from the package's, as in the page on theory."""
    named = re.findall(r"`((?:\w+/)+(?:\w+\.py)?|(?:run|simulation|state)\.py)", TEXTS[path])
    for file in named:
        if not file.startswith("out/"):  # left by a run
            folders = ROOT, ROOT / "rigidfx", ROOT / "demos"
            assert any((folder / file).exists() for folder in folders), file


def test_every_demo_and_benchmark_has_its_row():
    for demo in (*(ROOT / "demos").glob("*.py"), *(ROOT / "demos" / "first").glob("*.py")):
        name = demo.relative_to(ROOT / "demos").as_posix()
        assert re.search(rf"^\| `{re.escape(name)}", TEXTS[DEMOS], re.M), name
    for benchmark in (ROOT / "demos" / "benchmarks").glob("*.py"):
        assert f"| `./fenicsx python3 demos/benchmarks/{benchmark.name}" in TEXTS[DEMOS]


def test_every_effect_has_its_row():
    rows = re.findall(r"^\| `.*", TEXTS[ROOT / "docs" / "effects.md"], re.M)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    public = (getattr(rigidfx, name) for name in rigidfx.__all__)
    effects = {e.__name__ for e in public if isinstance(e, type) and issubclass(e, Effect)}
    assert named == effects


def test_every_name_they_use_is_public():
    names = {name for text in TEXTS.values() for name in re.findall(r"\brf\.(\w+)", text)}
    assert names <= set(rigidfx.__all__)
