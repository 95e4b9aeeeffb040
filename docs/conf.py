"""Sphinx's settings of the site: see build.py."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pypandoc

import rigidfx

project = "rigidfx"
version = release = rigidfx.__version__
extensions = ["myst_nb", "sphinx_design", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
nb_execution_mode = "off"  # build.py has run the notebooks
root_doc = "docs/index"
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**"]
include_patterns += ["out/reference.md", "out/paper.md", "out/notebooks/*"]
exclude_patterns = ["docs/paper/**"]  # in a journal's form: write_paper()
html_theme = "furo"
myst_heading_anchors = 4
myst_enable_extensions = ["html_image"]  # pictures of the gallery have a width
suppress_warnings = ["myst.header"]
napoleon_use_ivar = True  # members are described once
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_class_signature = "mixed"
ROOT = Path(__file__).resolve().parent.parent


def write_reference() -> None:
    """One page of all public names, by their docstrings."""
    names = "\n".join(
        f".. autoclass:: {n}" if isinstance(getattr(rigidfx, n), type) else f".. autofunction:: {n}"
        for n in rigidfx.__all__
        if n[0] != "_"
    )
    page = f"# Reference\n\n```{{eval-rst}}\n.. currentmodule:: rigidfx\n\n{names}\n```\n"
    (ROOT / "out" / "reference.md").write_text(page, encoding="utf-8")


def write_paper() -> None:
    """The paper as a page, with its citations filled in."""
    paper = ROOT / "docs" / "paper" / "paper.md"
    title = re.search(r'^title: "(.*)"$', paper.read_text("utf-8"), re.M)
    assert title is not None
    filters = ["--citeproc", "--shift-heading-level-by=1", "--wrap=none"]
    bib = f"--bibliography={paper.with_suffix('.bib')}"
    text = pypandoc.convert_file(paper, "gfm-raw_html", "markdown", extra_args=[*filters, bib])
    text = text.replace("../../demos/", "../demos/")
    (ROOT / "out" / "paper.md").write_text(f"# {title[1]}\n\n{text}", encoding="utf-8")


def add_contents(app: Any, name: str, source: list[str]) -> None:
    """The index's links are the site's table of contents, too."""
    if name == root_doc:
        parts = re.split(r"^## (.*)$", source[0], flags=re.M)
        trees = []
        for title, text in zip(parts[1::2], parts[2::2], strict=True):
            links = "\n".join(re.findall(r"^- \[[^]]+\]\(([\w/]+)\.md\)", text, re.M))
            extra = "\n../out/reference" if title == "Reference" else ""
            trees.append(f"```{{toctree}}\n:hidden:\n:caption: {title}\n\n{links}{extra}\n```\n")
            if title == "Tutorials":
                extra = ":caption: Notebooks\n:glob:\n\n../out/notebooks/*"
                trees.append(f"```{{toctree}}\n:hidden:\n{extra}\n```\n")
        about = ":caption: About\n\n../README\n../CHANGELOG\n../CONTRIBUTING\n../out/paper"
        trees.append(f"```{{toctree}}\n:hidden:\n{about}\n```\n")
        place = "/out/notebooks/"
        links = rf"({{doc}}`notebook <{place}\2>`, {{download}}`file <{place}\2.ipynb>`)"
        tutorials = r"^(- .*\(tutorials/(\w+)\.md\).*)$"
        source[0] = re.sub(tutorials, rf"\1 {links}", source[0], flags=re.M)
        source[0] += "\n" + "\n".join(trees)


def quote(*given: Any) -> None:
    """Formulas in docstrings are text: their signs are no mark-up, and names in ` ` are code."""
    lines: list[str] = given[-1]
    for k, line in enumerate(lines):
        parts = re.split(r"(`[^`]+`)", line)
        texts = [re.sub(r"([*|])", r"\\\1", text) for text in parts[::2]]
        codes = [f"`{code}`" for code in parts[1::2]]
        lines[k] = "".join(a + b for a, b in zip(texts, [*codes, ""], strict=True))


def setup(app: Any) -> None:
    """What Sphinx asks first."""
    write_reference()
    write_paper()
    app.connect("source-read", add_contents)
    app.connect("autodoc-process-docstring", quote, priority=400)
