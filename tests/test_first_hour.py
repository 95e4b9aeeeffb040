"""What somebody meets first: names, words about a scene, refusals, and warnings of one's script."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import rigidfx as rf
from rigidfx.plot.curves import prefixed

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.0, rho=8000.0)
SOFT = rf.NeoHooke(E=1e6, nu=0.3, rho=1000.0)


def halves():
    domain = rf.box((0, 0, 0), (2, 1, 1), (4, 2, 2))
    domain = domain.with_cells("left", lambda x: x[0] < 1.01)
    return domain.with_cells("right", lambda x: x[0] > 0.99)


def test_package_shows_what_it_exports():
    assert set(dir(rf)) == {*rf.__all__, "__doc__", "__version__"}
    assert rf.__version__.count(".") == 2


def test_without_dolfinx_a_sentence_says_what_to_install():
    """Without the packages of its site (-S), this Python has no DOLFINx."""
    bare = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    root = Path(rf.__file__).parent.parent
    command = [sys.executable, "-S", "-c", "import rigidfx"]
    done = subprocess.run(command, cwd=root, env=bare, capture_output=True, text=True, check=False)
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ModuleNotFoundError: rigidfx needs DOLFINx 0.9 to 0.11, petsc4py")
    assert "'pip install dolfinx-solver-real'" in last


def test_scene_and_domain_have_a_line():
    scene = rf.Scene(halves(), {"left": STEEL, "right": SOFT}, [rf.Fixed("x0")])
    line = "<Scene: 16 hexahedra of order 1, 135 dofs, 2 materials, 1 effect>"
    assert repr(scene) == line
    assert repr(scene.domain).startswith("<Domain: 16 hexahedra; names: 'left' (cells), 'right'")


def test_description_has_mass_box_unknowns_and_waves(capsys):
    scene = rf.Scene(halves(), {"right": SOFT, "left": STEEL}, [rf.Fixed("x0")])
    text = scene.describe(dt=1e-4)
    assert capsys.readouterr().out == text + "\n"
    assert "9000 kg in a box of 0 … 2 × 0 … 1 × 0 … 1 m; 108 unknowns" in text
    assert "'left': StVenantKirchhoff" in text
    # √(E/ρ) = 5000 m/s; half a metre is a cell.
    assert "waves of 5e+03 m/s, which pass 1 cells in Δt = 0.0001 s" in text
    soft = (1e6 * 0.7 / (1.3 * 0.4) / 1000.0) ** 0.5
    assert f"waves of {soft:.3g} m/s" in text
    with pytest.raises(rf.SceneError, match="describe: dt must be"):
        scene.describe(dt=-1)


def test_clamped_parts_are_in_reports():
    scene = rf.Scene(halves(), SOFT, [rf.Rigid("left"), rf.Fixed("left")])
    report = next(rf.simulate(scene, 0.1, 0.1, progress=False))
    assert report.clamped == ("left",)
    assert not report.bodies


@pytest.mark.parametrize(
    ("largest", "factor", "name"),
    [
        *((2.1e8, 1e-6, "MPa"), (999.0, 1.0, "Pa"), (1e3, 1e-3, "kPa"), (4e-7, 1e9, "nPa")),
        *((0.0, 1.0, "Pa"), (float("nan"), 1.0, "Pa"), (3e14, 1e-12, "TPa")),
    ],
)
def test_units_take_prefixes(largest, factor, name):
    assert prefixed("Pa", largest) == (pytest.approx(factor), name)
    assert prefixed("1/s", largest) == (1.0, "1/s")


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
