"""Warnings are shown to the one whose script it is, and come from a line of that script."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import pytest

SCRIPT = """
import logging
{before}
import rigidfx as rf

soft = rf.StVenantKirchhoff(E=1.0, nu=0.499, rho=1.0)
rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), soft)
"""


WHEEL = "dolfinx_solver, " if find_spec("dolfinx_solver") else ""  # is to be imported first


@pytest.mark.parametrize("before", ["", f"import {WHEEL}dolfinx"])
def test_a_warning_reaches_the_user(before, tmp_path):
    """FFCx gives all warnings to `logging`, where nobody hears them."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(before=before))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert f"{script}:7: RigidfxWarning: Scene: first-order cells lock" in done.stderr


def test_who_logs_warnings_finds_them_in_the_log(tmp_path):
    """A handler that somebody has made keeps them."""
    script = tmp_path / "script.py"
    own = "logging.basicConfig(format='in the log: %(message)s')"
    script.write_text(SCRIPT.format(before=f"{own}; logging.captureWarnings(True)"))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert f"in the log: {script}:7: RigidfxWarning" in done.stderr
