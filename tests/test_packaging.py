"""Recipes, containers, workflows, the site and the paper agree with pyproject.toml and README."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

import rigidfx

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="needs no ranks")

ROOT = Path(__file__).resolve().parent.parent
# What a dependency of pyproject.toml is called elsewhere, if it has another name.
CONDA, SPACK = {"matplotlib": "matplotlib-base"}, "py-"


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


def test_spack_recipe_is_that_of_pyproject():
    recipe = text(".packaging/spack/package.py")
    compile(recipe, "package.py", "exec")
    assert f'version("{rigidfx.__version__}", tag="v{rigidfx.__version__}")' in recipe
    assert {SPACK + name for name in dependencies()} <= set(re.findall(r'on\("([\w-]+)', recipe))
    assert "py-fenics-dolfinx@0.9:0.11+" in recipe
    python = re.search(r'requires-python = ">=(.*?)"', text("pyproject.toml"))[1]
    assert f"python@{python}:" in recipe


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
