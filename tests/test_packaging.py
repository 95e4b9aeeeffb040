"""Recipes of conda and Spack, and addresses in files, agree with pyproject.toml and the package."""

from __future__ import annotations

import json
import re
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
