"""The command: its words for Python's, and the largest values of all steps."""

import ast
import re
import sys
import warnings
from pathlib import Path

import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.command.main import WORDS, in_options, main
from rigidfx.command.options import ask
from rigidfx.command.pair import Pair
from rigidfx.report.peaks import Peaks

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="writes files")

PACKAGE = Path(rf.__file__).parent
BAR = """*NODE
1, 0, 0, 0
2, 0, 0.1, 0
3, 0, 0, 0.1
4, 0.1, 0, 0
5, 0.1, 0.1, 0
6, 0.1, 0, 0.1
*ELEMENT, TYPE=C3D4, ELSET=bar
1, 1, 2, 3, 4
2, 2, 3, 4, 5
3, 3, 4, 5, 6
*SURFACE, NAME=wall
1, S1
*SURFACE, NAME=end
3, S3
"""


def texts():
    """All that the package may say, with {} for what is filled in; not its docstrings."""

    def joined(node):
        values = node.values if isinstance(node, ast.JoinedStr) else [node]
        return "".join(v.value if isinstance(v, ast.Constant) else "{}" for v in values)

    for file in PACKAGE.rglob("*.py"):
        if file.relative_to(PACKAGE).parts[0] == "command":
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        inner = {id(v) for n in nodes if isinstance(n, ast.JoinedStr) for v in n.values}
        inner |= {id(n.value) for n in nodes if isinstance(n, ast.Expr)}
        for node in nodes:
            text = isinstance(node, ast.Constant) and isinstance(node.value, str)
            if (text or isinstance(node, ast.JoinedStr)) and id(node) not in inner:
                yield joined(node)


@pytest.fixture(scope="module")
def options():
    """All options of the command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["rigidfx", "part.step"])
        parser, _ = ask("rigidfx", None)
    return set(re.findall(r"--[a-z][\w-]*", parser.format_help()))


def test_messages_name_options_that_there_are(options):
    """In all texts of the package; each rule is for one of them."""
    every = {text for text in texts() if " " in text}
    assert len(every) > 800
    for text in every:
        told = in_options(text)
        named = set(re.findall(r"(?<![\w-])--[a-z][\w-]*", told)) - {"--output-format"}  # meshio's
        assert named <= options, told
        body, _, others = told.partition(" (Only scripts in Python have ")
        for name in re.findall(r"\brf\.\w+|\bwith_\w+|(?<=[ (])[a-z]\w+=(?=\w)", body):
            assert name.strip("=") in others, told
    for pattern in (words for words, _ in WORDS if words.strip("\\b") not in rf.__all__):
        assert any(re.search(pattern.replace("[\\d.e-]", "[\\w.{}-]"), t) for t in every), pattern


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            "Scene: cells lock. Take element='enhanced' or order=2, or a smaller ν.",
            "cells lock. Take --element enhanced or --order 2, or a smaller ν.",
        ),
        (
            "read_cad: less mass. Smaller cells (size), (per_circle=16), or curved ones (order=2).",
            "less mass. Smaller cells (--size), (--per-circle 16), or curved ones (--curved).",
        ),
        ("read_inp: read_inp(…, corners=True); then.", "--corners; then."),
        (
            "Traction: no facets named 'order=2 Fixed'.",
            "--load: no facets named 'order=2 Fixed'.",
        ),
        (
            "static: add supports, or a weak Spring, rf.Table.",
            "add supports, or a weak Spring, rf.Table. (Only scripts in Python have Spring, "
            "rf.Table.)",
        ),
        (
            "read_cad: no facets, Spring.\nSurfaces:\n Plane",
            "no facets, Spring. (Only scripts in Python have Spring.)\nSurfaces:\n Plane",
        ),
        ("It's gmsh's and Newton's tol: order=2.", "It's gmsh's and Newton's tol: --order 2."),
    ],
)
def test_words(message, words):
    assert in_options(message) == words


def called(monkeypatch, folder, options):
    """Content of the summary."""
    (folder / "bar.inp").write_text(BAR)
    given = [str(folder / "bar.inp"), *options.split(), "--out", str(folder / "out")]
    monkeypatch.setattr(sys, "argv", ["rigidfx", *given])
    return main("rigidfx")


def test_the_largest_stress_of_all_steps(tmp_path, monkeypatch, capsys):
    """Of a short load between two times of pictures and fields; drawn, and told once."""
    summary = called(
        monkeypatch,
        tmp_path,
        "--hold wall --load end 0 0 -1e4 --until 2e-5 --dt 1e-5 --t-end 2e-4 --damping 0",
    )
    effects = [rf.Fixed("wall"), rf.Traction("end", (0, 0, -1e4), total=True, until=2e-5)]
    steel = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7850.0)
    domain = rf.read_inp(tmp_path / "bar.inp")
    scene = rf.Scene(domain, steel, effects, order=2, mass="consistent")
    peaks = Peaks(scene, ["bar"], "test")
    steps = rf.simulate(scene, 1e-5, 2e-4, progress=False, verbose=False)
    largest = max(peaks.measure(report)["bar"].von_mises for report in steps)
    assert summary["largest_von_mises"] == pytest.approx(largest, rel=1e-6)
    told = capsys.readouterr().out
    assert told.count("largest von Mises stress") == 1
    assert "0 … 2e-05 s are run all flexible first, to find the tolerance (--tol)" in told
    assert "largest_von_mises" not in told, "that is in summary.json"
    assert "at the support wall: at its edge the exact one may be infinite" in told
    for name in ("stress.png", "rigid_parts.png", "summary.json"):
        assert (tmp_path / "out" / name).stat().st_size > 100


def test_warnings_are_lines_that_name_options(tmp_path, monkeypatch, capsys):
    """In a terminal and in log.txt; without a line of this package's code."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        options = "--hold wall --load end 0 0 -1e4 --nu 0.499 --order 1 --static"
        called(monkeypatch, tmp_path, options)
    line = "rigidfx: warning: first-order cells lock at ν = 0.499"
    told = capsys.readouterr().err
    assert line in told
    assert "Take --order 2, or a smaller ν." in told
    assert ".py:" not in told
    with pytest.raises(SystemExit):
        called(monkeypatch, tmp_path, "--hold wall --load tip 0 0 1 --static")
    assert capsys.readouterr().err.startswith("rigidfx: --load: there are no facets named 'tip'")


def test_nothing_held_or_loaded(tmp_path, monkeypatch, capsys):
    """A free part has modes; statics and runs are refused."""
    assert min(called(monkeypatch, tmp_path, "--modes 1")["frequencies"]) > 0
    for options in ("--static", "--t-end 1e-4"):
        with pytest.raises(SystemExit) as stopped:
            called(monkeypatch, tmp_path, options)
        assert stopped.value.code
        assert "Say what is held and loaded" in capsys.readouterr().err


def test_warnings_of_a_run_are_told_once(tmp_path, monkeypatch, capsys):
    """Not by the run that finds the tolerance as well, whose times are others."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        called(monkeypatch, tmp_path, "--hold wall --dt 1e-5 --t-end 1e-4")
    assert capsys.readouterr().err.count("nothing acts") == 1


@pytest.mark.parametrize("terminal", [False, True])
def test_a_switch_is_told_once(monkeypatch, capsys, terminal):
    """By the run in a terminal, else by the command."""
    box = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    spin = rf.InitialVelocity(angular=(0.0, 0.0, 1.0))
    scene = rf.Scene(box, rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1e3), [spin])
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    rule = rf.StrainRate(1e9, 0.02, min_cells=1, patience=1)
    with Pair(scene, 0.01, 0.04, rule, compare=False) as run:
        assert sum(len(report.events) for report in run) == 1
    out, err = capsys.readouterr()
    assert out.count("freeze") == (not terminal)
    assert err.count("freeze") == terminal
