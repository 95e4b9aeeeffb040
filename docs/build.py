"""Builds the site in out/docs: pages of docs/, README, notebooks, and a page of each public name.

./fenicsx docs    runs tutorials as notebooks first, if these are older than the code (minutes)

Sphinx and its extensions (the extra `docs` of pyproject.toml) go into a folder of the cache, so
that no environment changes. A warning is an error: a link that leads nowhere, say.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = ROOT / "out" / "notebooks"


def packages() -> Path:
    """Folder with the extra `docs`, made at the first call of each list of packages."""
    extra = re.search(r"^docs = \[(.*?)\]", (ROOT / "pyproject.toml").read_text("utf-8"), re.M)
    assert extra is not None
    names = re.findall(r'"(.*?)"', extra[1])
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    kind = f"{zlib.crc32(' '.join(names).encode()):08x}"
    folder = cache / "rigidfx" / f"docs-{version}-{kind}"
    if not (folder / "whole").exists():
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--upgrade", "--target"]
        subprocess.run([*pip, str(folder), *names], check=True)
        (folder / "whole").touch()
    return folder


def write_notebooks(env: dict[str, str]) -> None:
    """Run each tutorial that is newer than its notebook, and keep the notebook with its outputs."""
    code = max(path.stat().st_mtime for path in (ROOT / "rigidfx").rglob("*.py"))
    for page in sorted((ROOT / "docs" / "tutorials").glob("*.md")):
        notebook = NOTEBOOKS / f"{page.stem}.ipynb"
        newest = max(code, page.stat().st_mtime)
        if not notebook.exists() or notebook.stat().st_mtime < newest:
            print(f"running the notebook of {page.name}", flush=True)
            run = [sys.executable, str(ROOT / "docs" / "notebooks.py"), str(page), str(notebook)]
            subprocess.run(run, env=env, check=True, stdout=subprocess.DEVNULL)  # gmsh's


def main() -> int:
    """Write the notebooks, then the site; the exit code of Sphinx."""
    path = os.pathsep.join(filter(None, [str(packages()), os.environ.get("PYTHONPATH", "")]))
    env = os.environ | {"PYTHONPATH": path}
    write_notebooks(env)
    sphinx = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q"]
    done = subprocess.run([*sphinx, "-c", "docs", ".", "out/docs"], cwd=ROOT, env=env, check=False)
    fine = done.returncode == 0
    print("the site is in out/docs/docs/index.html" if fine else "the site has faults")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
