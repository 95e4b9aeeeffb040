"""Builds the site in out/docs: the pages of docs/, README, and a page of each public name.

./fenicsx docs
./fenicsx docs --run    runs the blocks of the long tutorial first, in an empty folder (minutes)

Sphinx and its extensions (the extra `docs` of pyproject.toml) go into a folder of the cache, so
that no environment changes. A warning is an error: a link that leads nowhere, say.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LONG = ROOT / "docs" / "tutorials" / "machine_part.md"


def packages() -> Path:
    """Folder with Sphinx, made at the first call."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    folder = cache / "rigidfx" / f"docs-{version}"
    if not (folder / "whole").exists():
        extra = re.search(r"^docs = \[(.*?)\]", (ROOT / "pyproject.toml").read_text("utf-8"), re.M)
        assert extra is not None
        names = re.findall(r'"(.*?)"', extra[1])
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--upgrade", "--target"]
        subprocess.run([*pip, str(folder), *names], check=True)
        (folder / "whole").touch()
    return folder


def run_blocks(page: Path) -> None:
    """Run the Python blocks of a page, as one script."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-c", "\n".join(blocks)], cwd=folder, check=True)


if __name__ == "__main__":
    if "--run" in sys.argv[1:]:
        run_blocks(LONG)
    path = os.pathsep.join(filter(None, [str(packages()), os.environ.get("PYTHONPATH", "")]))
    sphinx = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q"]
    site = [*sphinx, "-c", "docs", ".", "out/docs"]
    done = subprocess.run(site, cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, check=False)
    fine = done.returncode == 0
    print("the site is in out/docs/docs/index.html" if fine else "the site has faults")
    sys.exit(done.returncode)
