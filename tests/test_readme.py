"""README: its Python blocks run as they are, one after another; its commands and files exist."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
DEMOS = README[README.index("## Demos") : README.index("## What there is")]
COMMANDS = [
    *re.findall(r"^(?:    |\| `)?(\./fenicsx [^`…\n]+)(?:$|`)", README, flags=re.MULTILINE),
    *(
        f"./fenicsx python3 demos/{name}"
        for name in re.findall(r"^\| `(\w+\.py[^`]*)`", DEMOS, re.M)
    ),
]

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its processes itself")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_python_blocks_run_in_order(tmp_path):
    """As one script, in an empty folder; they leave what the text says."""
    pytest.importorskip("gmsh")
    pytest.importorskip("pyvista")
    code = blocks("python")
    assert len(code) >= 5
    (tmp_path / "tour.py").write_text("\n".join(code), encoding="utf-8")
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    run = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "tour.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert run.returncode == 0, f"{run.stdout}\n{run.stderr}"
    assert "freeze" in run.stdout
    left = {file.name for file in (tmp_path / "out" / "bar").iterdir()}
    told = set(re.findall(r"^\| `(\w+\.\w+)` \|", README, flags=re.MULTILINE))
    assert {"history.csv", "events.csv", "bodies.csv", "fields.pvd", "view.py"} <= told & left
    assert {"histories.png", "unknowns.png", "shapes.png", "stress.png", "film.gif"} <= left


def source_of(script):
    """A demo's text with that of the packages beside it that it imports, and of demos/common."""
    text = script.read_text(encoding="utf-8")
    packages = re.findall(r"^from (\w+)", text, flags=re.MULTILINE)
    folders = [script.parent / name for name in packages] + [ROOT / "demos" / "common"]
    files = [file for folder in folders for file in folder.glob("*.py")]
    return "\n".join([text, *(file.read_text(encoding="utf-8") for file in files)])


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_name_what_there_is(command):
    words = shlex.split(command)
    for k, word in enumerate(words):
        if word.startswith("demos/"):
            script = source_of(ROOT / word)
            for option in (w for w in words[k:] if w.startswith("--")):
                assert f'"{option}"' in script, f"{word} has no option {option}"
    assert (ROOT / words[0]).exists()


def test_commands_are_found():
    assert len(COMMANDS) >= 8


def test_links_and_pictures_exist():
    files = re.findall(r'(?:src="|\]\()([^"):#]+)["\)]', README)
    assert files
    for file in files:
        assert (ROOT / file).exists(), file
    anchors = {re.sub(r"[^\w -]", "", h).strip().lower().replace(" ", "-")
               for h in re.findall(r"^#+ (.*)", README, flags=re.MULTILINE)}  # fmt: skip
    assert set(re.findall(r"\]\(#([^)]+)\)", README)) <= anchors


def test_every_demo_has_its_row():
    for demo in (ROOT / "demos").glob("*.py"):
        assert f"`{demo.name}" in DEMOS, demo.name


def test_every_name_it_uses_is_public():
    import rigidfx

    names = set(re.findall(r"\brf\.(\w+)", README))
    assert names <= set(rigidfx.__all__)
