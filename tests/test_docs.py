"""Docstrings render as pages, without a warning (warnings are errors in this suite)."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

import rigidfx

pdoc = pytest.importorskip("pdoc", reason="pdoc is not installed")
pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="needs no ranks")

PACKAGE = Path(rigidfx.__file__).parent
MODULES = sorted(
    ".".join(["rigidfx", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(
        ".__init__"
    )
    for path in PACKAGE.rglob("*.py")
)


def test_every_module_becomes_a_page(tmp_path):
    pdoc.render.configure(docformat="google", math=True)
    pdoc.pdoc(*MODULES, output_directory=tmp_path)
    pages = {
        page.relative_to(tmp_path).with_suffix("").as_posix() for page in tmp_path.rglob("*.html")
    }
    assert {module.replace(".", "/") for module in MODULES} <= pages
