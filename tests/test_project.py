"""What lies around the package: the top level, the changelog's length."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
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
