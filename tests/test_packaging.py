"""The top level, recipes, containers, workflows, the site and the paper agree with one another."""

import json
import re
import runpy
import shutil
import subprocess
import sys
import types
import zipfile
from pathlib import Path

import pytest
from mpi4py import MPI

import rigidfx

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="needs no ranks")

ROOT = Path(__file__).resolve().parent.parent
# What a dependency of pyproject.toml is called elsewhere, if it has another name.
CONDA = {"matplotlib": "matplotlib-base"}


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def dependencies():
    listed = re.search(r"^dependencies = \[(.*?)\]", text("pyproject.toml"), re.M)[1]
    return re.findall(r'"([\w-]+)', listed)


def test_conda_recipe_is_that_of_pyproject():
    recipe, project = text(".packaging/conda/meta.yaml"), text("pyproject.toml")
    assert f'version = "{rigidfx.__version__}"' in recipe
    runs = recipe.split("  run:\n")[1].split("\n\n")[0]
    names = re.findall(r"- ([\w-]+)", runs)
    assert {CONDA.get(name, name) for name in dependencies()} <= set(names)
    assert {"petsc4py", "slepc4py", "python-gmsh", "h5py", "mpi4py"} <= set(names)
    assert "fenics-dolfinx >=0.9,<0.12" in runs
    python = re.search(r'requires-python = "(.*?)"', project)[1]
    assert recipe.count(f"- python {python}\n") == 2
    builder = re.search(r'requires = \["setuptools(.*?)"\]', project)[1]
    assert f"- setuptools {builder}\n" in recipe
    assert re.search(r'^rigidfx = "(.*?)"$', project, re.M)[1] in recipe
    assert re.search(r'^description = "(.*?)"$', project, re.M)[1] in recipe


def test_spack_recipe_is_that_of_pyproject(monkeypatch):
    """It runs as Spack runs it, with directives that only note what they are given."""
    told = {name: {} for name in ("license", "version", "depends_on")}
    directives = {
        name: lambda first, told=given, **more: told.update({first: more})
        for name, given in told.items()
    }
    kinds = {"spack_repo.builtin.build_systems.python": {"PythonPackage": object}}
    for name, members in {"spack.package": directives, **kinds}.items():
        monkeypatch.setitem(sys.modules, name, types.SimpleNamespace(**members))
    runpy.run_path(str(ROOT / ".packaging" / "spack" / "package.py"))
    project = text("pyproject.toml")
    assert told["license"] == {re.search(r'^license = "(.*?)"', project, re.M)[1]: {}}
    assert told["version"] == {rigidfx.__version__: {"tag": f"v{rigidfx.__version__}"}}
    needed = told["depends_on"]
    assert {"py-gmsh", "py-h5py", "py-mpi4py", *("py-" + name for name in dependencies())} <= set(
        needed
    )
    assert "py-fenics-dolfinx@0.9:0.11+petsc4py+slepc4py" in needed
    python = re.search(r'requires-python = ">=(.*?)"', project)[1]
    builder = re.search(r'requires = \["setuptools>=(.*?)"\]', project)[1]
    assert needed[f"python@{python}:"]["type"] == ("build", "run")
    assert needed[f"py-setuptools@{builder}:"]["type"] == "build"


def test_container_and_workflows_run_the_commands_that_run_here():
    """Packages of apt are some that ./fenicsx installs, extras are pyproject's, scripts exist."""
    listed = re.search(r"^packages=\((.*?)^\)", text("fenicsx"), re.M | re.S)[1]
    extras = set(re.findall(r"^(\w+) = \[", text("pyproject.toml"), re.M))
    files = [".devcontainer/Dockerfile", ".devcontainer/devcontainer.json"]
    files += [str(path) for path in (ROOT / ".github" / "workflows").glob("*.yml")]
    for name in files:
        commands = text(name)
        for names in re.findall(r"apt-get install ((?:-\S+ |[\w-]+ ?)+)", commands):
            assert {n for n in names.split() if n[0] != "-"} <= set(listed.split()), name
        used = re.findall(r"pip install .*?\[([\w,]+)\]", commands)
        assert set(",".join(used).split(",")) <= extras, name
        for script in re.findall(r"python3 (\S+\.py)", commands):
            assert (ROOT / script).exists(), script
    assert "python3 demos/first/bar.py" in text(files[1])  # tests/test_demos.py runs it


def test_sdist_becomes_a_wheel_with_all_files_of_the_package(tmp_path):
    """Demos and tests come with the tag's archive, which both recipes take."""
    pytest.importorskip("setuptools", minversion="77")
    build = (
        "import sys; from setuptools import build_meta as b; print(getattr(b, sys.argv[1])('..'))"
    )

    def built(kind, folder):
        command = [sys.executable, "-c", build, f"build_{kind}"]
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
        return tmp_path / run.stdout.splitlines()[-1]

    hidden = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "rigidfx", tmp_path / "tree" / "rigidfx", ignore=hidden)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / "tree")
    shutil.unpack_archive(built("sdist", tmp_path / "tree"), tmp_path, filter="data")
    (folder,) = tmp_path.glob("rigidfx-*/")
    files = {
        path.relative_to(tmp_path / "tree") for path in (tmp_path / "tree" / "rigidfx").rglob("*.*")
    }
    with zipfile.ZipFile(built("wheel", folder)) as wheel:
        packed = {Path(name) for name in wheel.namelist() if name.startswith("rigidfx/")}
        assert packed == files
        (scripts,) = (n for n in wheel.namelist() if n.endswith("entry_points.txt"))
        assert b"rigidfx = rigidfx.command.main:run" in wheel.read(scripts)


def test_the_address_is_the_same_everywhere():
    home = re.search(r'^Homepage = "(.*?)"$', text("pyproject.toml"), re.M)[1]
    for name in (
        ".packaging/conda/meta.yaml",
        ".packaging/spack/package.py",
        "CITATION.cff",
        "README.md",
    ):
        found = re.findall(r"https://github.com/[\w-]+/rigidfx", text(name))
        assert found
        assert set(found) == {home}


def test_hosted_runners_call_parts_of_the_local_run():
    parts = re.findall(r"^    (\w+)\) check", text(".ci/run"), re.M)
    called = [
        part
        for path in (ROOT / ".github" / "workflows").glob("*.yml")
        for part in re.findall(r"\.ci/run (\w+)", path.read_text(encoding="utf-8"))
    ]
    assert sorted(called) == sorted(parts)
    json.loads(text(".devcontainer/devcontainer.json"))


def test_packages_of_the_site_are_those_that_it_imports():
    extra = re.search(r"^docs = \[(.*?)\]", text("pyproject.toml"), re.M)[1]
    listed = {name.replace("-", "_") for name in re.findall(r'"([\w-]+)"', extra)}
    sources = "\n".join(text(path) for path in (ROOT / "docs").glob("*.py"))
    imported = set(re.findall(r"^(?:from|import) (\w+)", sources, re.M)) - sys.stdlib_module_names
    extensions = set(re.findall(r'"(\w+)"', re.search(r"^extensions = \[(.*)\]", sources, re.M)[1]))
    brought = {"nbformat", "jupyter_client", "rigidfx"}  # by nbclient; the package itself
    named = {"pypandoc": "pypandoc_binary"}
    assert {named.get(name, name) for name in imported | extensions} - brought <= listed


def test_figures_of_the_paper_are_those_of_readme():
    rows = [line for line in text("docs/paper/paper.md").splitlines() if re.match(r"\| .*\d", line)]
    assert len(rows) >= 3
    plain = re.sub(r"\[(.*?)\]\(.*?\)", r"\1", text("README.md"))
    assert all(row in plain for row in rows)


def test_the_gallery_has_every_picture_of_the_demos():
    shown = re.findall(r'src="../demos/pictures/(\S+)"', text("docs/gallery.md"))
    assert sorted(shown) == sorted(p.name for p in (ROOT / "demos" / "pictures").glob("*.png"))


TOP_LEVEL = {
    "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md", "pyproject.toml",
    "demos", "docs", "fenicsx", "meshes", "rigidfx", "tests",
}  # fmt: skip


def test_top_level_is_small():
    """Whatever else a project has lies in docs/ or in folders with a dot."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("not a checkout of git")
    names = {name.split("/")[0] for name in listed.stdout.split("\0") if name}
    assert {name for name in names if not name.startswith(".")} == TOP_LEVEL


def test_changelog_is_read_in_ten_minutes():
    assert len((ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split()) <= 3000
