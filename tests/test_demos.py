"""Every demo, short, most on two ranks: its assertions hold and it leaves what it says.

A demo takes --short and --out FOLDER, asserts what has to hold, and leaves summary.json and
pictures in the folder. A new one is found by itself.
"""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import parallel
import pytest
from cad import saved
from mpi4py import MPI

from rigidfx.command.main import materials
from rigidfx.command.options import Example, ask
from rigidfx.output.history import read_history

ROOT = Path(__file__).resolve().parent.parent
DEMOS = sorted((ROOT / "demos").glob("*.py"))
FIRST = sorted((ROOT / "demos" / "first").glob("*.py"))
KNOWN = ROOT / "demos" / "benchmarks" / "known_problems.py"
BENCHMARKS = sorted({*(ROOT / "demos" / "benchmarks").glob("*.py")} - {KNOWN})
# Benchmarks of many scenes, of which one is run.
SOME = {
    "waking": ("--only", "eight cells"),
    "budgets": ("--only", "push", "--budgets", "0.05"),
    "impact": ("--only", "friction"),
    "mechanisms": ("--only", "pendulum"),
    "reduced": ("--only", "spin", "--levels", "flexible", "reduced"),
    "solver_ablation": ("--rules", "secants"),
}
# Long ones, whose steps, switches, contacts and files others have on two ranks.
ON_ONE_RANK = (
    "accuracy_vs_time",
    "drop_test",
    "free_flying_body",
    "gong",
    "spatial_frame",
    "tumbling_l",
)

pytestmark = [
    pytest.mark.demo,
    pytest.mark.slow,
    pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself"),
]


def run(demo, ranks, *arguments):
    """Run a demo as a reader would: in processes of its own, which take seconds to start."""
    launcher, kept = parallel.launch(ranks)
    command = [*(launcher if ranks > 1 else [sys.executable]), str(demo), *map(str, arguments)]
    process = subprocess.Popen(
        command, env=kept, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with process:
        try:
            out, err = process.communicate(timeout=600)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpirun ends its ranks
            out, err = process.communicate()
            pytest.fail(f"{demo.name} hangs\n{out}\n{err}")
    return process.returncode, f"{out}\n{err}"


def on_ranks(demo, ranks, *arguments):
    """Run a demo on ranks that wait for scripts; it must end well."""
    parallel.run(demo, ranks, 600, *map(str, arguments))


@pytest.mark.parametrize(
    ("demo", "ranks"),
    [
        pytest.param(demo, 1)
        if demo.stem in ON_ONE_RANK
        else pytest.param(demo, 2, marks=pytest.mark.parallel)
        for demo in DEMOS
    ],
    ids=lambda value: getattr(value, "stem", value),
)
def test_demo(tmp_path, demo, ranks):
    # On one rank each hard case has a test of its own, and those about ranks have one on three.
    some = {"hard_cases": ["--only", "failure"], "accuracy_vs_time": ["--only", "body"]}.get(
        demo.stem, []
    )
    on_ranks(demo, ranks, "--short", *some, "--out", tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary
    pictures = list((tmp_path / "out").glob("*.png"))
    assert pictures
    assert all(picture.read_bytes().startswith(b"\x89PNG") for picture in pictures)


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(script, marks=pytest.mark.parallel) if script.stem == "two_ranks" else script
        for script in FIRST
    ],
    ids=lambda script: script.stem,
)
def test_first_example(script):
    """Short, and what it asserts holds; on the ranks that its command names."""
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert "\nassert " in text
    assert f"python3 demos/first/{script.name}\n" in text
    on_ranks(script, 2 if "mpirun -n 2" in text else 1)


CUSTOM = ROOT / "demos" / "custom_geometry.py"
BRACKET = ROOT / "meshes" / "bracket.geo"


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        ([BRACKET], 0, "'wall' (facets)"),
        ([BRACKET, "--hold", "feet", "--t-end", 1], 2, "named 'feet'"),
        ([BRACKET, "--hold", "wall", "--load", "tip", 0, 0, 1, "--t-end", 1], 2, "'end' (facets)"),
        (["--help"], 0, "--hold"),
        (["--t-end", -1], 2, "--t-end: must be > 0, got -1"),
        (["--dt", -1], 2, "--dt: must be > 0, got -1"),
        (["--dt", "nan"], 2, "--dt: 'nan' is no finite number"),
        (["--until", -1], 2, "--until: must be > 0, got -1"),
        (["--window", "abc"], 2, "--window: 'abc' is no finite number"),
        (["--window", -3], 2, "--window: must be > 0, got -3"),
        (["--tol", -1], 2, "--tol: must be ≥ 0, got -1"),
        (["--modes", 0], 2, "--modes: must be a whole number ≥ 1, got 0"),
        (["--damping", 2], 2, "xi must lie in"),
        (["--load", "end", 0, "x", 1], 2, "--load end: 'x' is no finite number"),
        (["--material", "a", 1, 0.3, "x"], 2, "--material a: 'x' is no finite number"),
        (["--material", "a", 1, 0.3, 1, "--material", "a", 2, 0.3, 1], 2, "a name is given twice"),
        (["--material", "foot", 1e7, 0.3, 1e3], 2, "named 'foot'"),
        (["--name", "a=1"], 2, "--name is for .step"),
        (["part.msh", "--name", "a=1"], 2, "--name is for .step"),
        (["part.msh", "--set", "a=1"], 2, "--set is for .geo"),
        (["part.msh", "--size", 1], 2, "--size is for what is meshed here"),
        (["part.step", "--set", "a=1"], 2, "--set is for .geo"),
        (["part.msh", "--encoding", "gb18030"], 2, "--encoding is for .inp"),
        (["part.step", "--name", "a=1", "--name", "a=2"], 2, "the name 'a' is given twice"),
        (["part.step", "--name", "a"], 2, "'a' should be NAME=VALUE"),
        (["--set", "no=1"], 2, "has no parameter 'no'"),
    ],
)
def test_custom_geometry_says_what_is_wrong(tmp_path, monkeypatch, capfd, arguments, code, told):
    """Names that are missing with those there are; options that are wrong or would do nothing.

    Without a process of its own, which would take longer to start than to answer.
    """
    words = [CUSTOM, *arguments, "--short", "--out", tmp_path / "out"]
    monkeypatch.setattr(sys, "argv", list(map(str, words)))
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(CUSTOM), run_name="__main__")
    assert (end.value.code or 0) == code
    assert told in "".join(capfd.readouterr())


def test_results_are_where_one_is(monkeypatch):
    """Not beside the script; those of a file by its name."""
    bracket = Example(BRACKET, Path("out", "custom_geometry"))
    for words, where in (
        ([], "out/custom_geometry"),
        (["a/part.step", "--t-end", "1"], "out/part"),
    ):
        monkeypatch.setattr(sys, "argv", ["rigidfx", *words])
        assert ask(None, bracket)[1].out == Path(where)
    assert 'Path("out", "custom_geometry")' in CUSTOM.read_text(encoding="utf-8")


def test_each_part_has_a_material_of_its_own(monkeypatch):
    words = ["part.step", "--material", "post", "1e7", "0.45", "1100"]
    monkeypatch.setattr(
        sys, "argv", ["rigidfx", *words, "--material", "plate", "7e10", "0.3", "2700"]
    )
    found = materials(ask(None, None)[1])
    assert {name: (m.E, m.nu, m.rho) for name, m in found.items()} == {
        "post": (1e7, 0.45, 1100.0),
        "plate": (7e10, 0.3, 2700.0),
    }


@pytest.mark.parallel
def test_custom_geometry_stops_on_all_ranks(tmp_path):
    """Rank 0 alone says why, of an option and of a step that fails."""
    pytest.importorskip("gmsh")
    code, text = run(CUSTOM, 2, "--window", -3)
    assert (code, text.count("must be > 0")) == (2, 1), text
    bar = row_of_trapezia(tmp_path / "bar.msh")
    arguments = [bar, "--hold", "left", "--load", "right", -1e12, 0, 0, "--E", 1e3, "--order", 1]
    arguments += ["--tol", 0, "--dt", 1, "--t-end", 1, "--until", 1, "--out", tmp_path / "out"]
    code, text = run(CUSTOM, 2, *arguments)
    assert code == 1, text
    assert "Traceback" not in text
    assert len([line for line in text.splitlines() if "custom_geometry.py: " in line]) == 1, text


def row_of_trapezia(path, cells=4):
    """A bar of hexahedra, whose ends "left" and "right" are trapezia of area 0.7 m²."""
    section = [(0.0, 0.0), (1.0, 0.0), (0.4, 1.0), (0.0, 1.0)]
    nodes = [
        f"{4 * i + k + 1} {i} {y} {z}" for i in range(cells + 1) for k, (y, z) in enumerate(section)
    ]
    ring = [" ".join(str(4 * i + k) for k in (1, 2, 3, 4)) for i in range(cells + 1)]
    elements = [f"1 3 2 1 1 {ring[0]}", f"2 3 2 2 2 {ring[-1]}"]
    elements += [f"{i + 3} 5 2 3 3 {ring[i]} {ring[i + 1]}" for i in range(cells)]
    blocks = {
        "MeshFormat": ["2.2 0 8"],
        "PhysicalNames": ["3", '2 1 "left"', '2 2 "right"', '3 3 "bar"'],
        "Nodes": [str(len(nodes)), *nodes],
        "Elements": [str(len(elements)), *elements],
    }
    text = "".join("\n".join([f"${k}", *rows, f"$End{k}\n"]) for k, rows in blocks.items())
    path.write_text(text)
    return path


@pytest.mark.parallel
def test_custom_geometry_applies_the_total_force(tmp_path):
    """On facets that are no parallelograms, on two ranks: the momentum is the force times the time.

    On one rank it is asked below.
    """
    pytest.importorskip("gmsh")
    bar = row_of_trapezia(tmp_path / "bar.msh")
    arguments = [bar, "--load", "right", 300, 0, -1000, "--order", 1, "--damping", 0, "--tol", 0]
    arguments += ["--dt", 1e-5, "--t-end", 2e-5, "--until", 2e-5, "--out", tmp_path / "out"]
    on_ranks(CUSTOM, 2, *arguments)
    history = read_history(tmp_path / "out" / "history.csv")
    momentum = [history[f"L_{axis}"][-1] for axis in "xyz"]
    assert momentum == pytest.approx([300 * 2e-5, 0.0, -1000 * 2e-5], rel=1e-9, abs=1e-12)


def test_custom_geometry_applies_the_total_force_to_curved_facets(tmp_path):
    """Of cells of second order."""

    def build(model):
        model.occ.addCylinder(0, 0, 0, 2, 0, 0, 1)
        model.occ.synchronize()
        model.addPhysicalGroup(3, [1], name="bar")
        faces = [tag for _, tag in model.getEntities(2) if model.getType(2, tag) != "Plane"]
        model.addPhysicalGroup(2, faces, name="round")
        model.mesh.generate(3)
        model.mesh.setOrder(2)

    saved(tmp_path / "bar.msh", build, MeshSizeMax=1.2)
    arguments = [tmp_path / "bar.msh", "--load", "round", 0, 0, -1000, "--damping", 0, "--tol", 0]
    arguments += ["--dt", 1e-5, "--t-end", 2e-5, "--until", 2e-5, "--out", tmp_path / "out"]
    on_ranks(CUSTOM, 1, *arguments)
    history = read_history(tmp_path / "out" / "history.csv")
    assert history["L_z"][-1] == pytest.approx(-1000 * 2e-5, rel=1e-9)


def test_custom_geometry_takes_cad(tmp_path, monkeypatch, capfd):
    """Surfaces are listed, named by number, held and loaded."""

    def build(model):
        model.occ.addBox(0, 0, 0, 100, 10, 10)
        model.occ.synchronize()

    saved(tmp_path / "bar.step", build)
    monkeypatch.setattr(sys, "argv", [str(CUSTOM), str(tmp_path / "bar.step"), "--list"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(CUSTOM), run_name="__main__")
    text = "".join(capfd.readouterr())
    assert not end.value.code, text
    assert "Plane at (0.05, 0, 0.005) m" in text
    arguments = ["--name", "root=1", "--name", "end=2", "--size", 0.01, "--order", 1, "--hold"]
    arguments += ["root", "--load", "end", 0, 0, 10, "--dt", 1e-4, "--t-end", 1e-3, "--tol", 1e-2]
    on_ranks(CUSTOM, 1, tmp_path / "bar.step", *arguments, "--out", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["file"] == "bar.step"


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda benchmark: benchmark.stem)
def test_benchmark(tmp_path, benchmark):
    """A benchmark's own assertions hold; its times mean nothing here."""
    on_ranks(benchmark, 1, "--short", *SOME.get(benchmark.stem, ()), "--out", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Folder of all known problems, whose bounds hold."""
    folder = tmp_path_factory.mktemp("known")
    on_ranks(KNOWN, 1, "--short", "--out", folder)
    return folder


@pytest.mark.parallel
def test_known_problems_are_the_same_on_two_ranks(tmp_path, known):
    on_ranks(
        KNOWN, 2, "--short", "--only", "NAFEMS 5T", "--out", tmp_path / "two", "--beside", known
    )


@pytest.mark.parallel
def test_demo_fails_on_all_ranks_without_a_folder(tmp_path):
    """One for all, which write by the same functions."""
    (tmp_path / "file").touch()
    code, text = run(ROOT / "demos" / "tumbling_l.py", 2, "--short", "--out", tmp_path / "file")
    assert code not in (0, None)
    assert "OutputError" in text
