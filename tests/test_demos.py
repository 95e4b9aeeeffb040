"""Every demo, short, on one rank and on two: its assertions hold and it leaves what it says.

A demo takes --short and --out FOLDER, asserts what has to hold, and leaves summary.json and
pictures in the folder. A new one is found by itself; SUMMARY may name what else it has to leave.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

ROOT = Path(__file__).resolve().parent.parent
DEMOS = sorted((ROOT / "demos").glob("*.py"))
BENCHMARKS = sorted((ROOT / "demos" / "benchmarks").glob("*.py"))
MPI_VARIABLES = ("OMPI_COMM", "OMPI_UNIVERSE", "OMPI_APP", "OMPI_NUM", "OMPI_FIRST", "OMPI_FILE",
                 "PMIX_", "PMI_", "PRTE_", "HYDRA_")  # fmt: skip

SUMMARY = {
    "accuracy_vs_time": {"choices", "base_error", "pareto_front", "runs", "wall_s", "ranks"},
    "tumbling_l": {
        "energy_drift",
        "angular_momentum_drift",
        "linear_momentum_relative",
        "steps",
        "newton_mean",
        "wall_per_step_s",
        "unknowns",
        "comparison",
    },
    "free_flying_body": {
        "unknowns_start",
        "unknowns_end",
        "first_rigid_time",
        "all_rigid_time",
        "release_time",
        "wall_adaptive_s",
        "wall_flexible_s",
        "time_ratio_window",
        "angular_momentum_drift",
        "energy_jump_cycle",
        "energy_deviation",
        "strain_energy_recovered",
    },
    "spatial_frame": {"tolerances", "multibody"},
}
BENCHMARK_SUMMARY = {
    "flexible_step": {"ratio_to_plain_dolfinx", "unknowns"},
    "observation": {"observed_to_plain", "freeze_in_steps", "release_in_steps", "unknowns"},
    "condensation": {
        "ratio_to_ideal",
        "newton_per_step",
        "ratio_to_flexible",
        "unknowns",
        "unknowns_reduced",
    },
}
FILES = {
    "accuracy_vs_time": ["accuracy_vs_time.csv", "accuracy_vs_time.json", "accuracy_vs_time.png"],
    "tumbling_l": ["history.csv", "fields.pvd", "histories.png", "shapes.png", "comparison.png"],
    "free_flying_body": [
        "history.csv",
        "events.csv",
        "fields.pvd",
        "energies.png",
        "angular_momentum.png",
        "evolution.png",
        "shapes.png",
    ],
    "spatial_frame": ["bodies.json", "energy_unknowns.png", "spectrum.png"],
}

pytestmark = [
    pytest.mark.demo,
    pytest.mark.slow,
    pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself"),
]


def run(demo, ranks, *arguments):
    """Run a demo as a reader would."""
    command = [sys.executable, str(demo), *map(str, arguments)]
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
    kept = {k: v for k, v in os.environ.items() if not k.startswith(MPI_VARIABLES)}
    process = subprocess.Popen(
        command, env=kept, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with process:
        try:
            out, err = process.communicate(timeout=600)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpirun ends its ranks
            out, err = process.communicate()
            pytest.fail(f"{demo.name} hangs\n{out}\n{err}")
    return process.returncode, f"{out}\n{err}"


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
@pytest.mark.parametrize("demo", DEMOS, ids=lambda demo: demo.stem)
def test_demo(tmp_path, demo, ranks):
    code, text = run(demo, ranks, "--short", "--out", tmp_path / "out")
    assert code == 0, text
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert SUMMARY.get(demo.stem, set()) <= set(summary)
    for name in FILES.get(demo.stem, []):
        assert (tmp_path / "out" / name).stat().st_size > 0
    pictures = list((tmp_path / "out").glob("*.png"))
    assert pictures
    assert all(picture.read_bytes().startswith(b"\x89PNG") for picture in pictures)


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda benchmark: benchmark.stem)
def test_benchmark(tmp_path, benchmark):
    """A benchmark's own assertions hold; its times mean nothing here."""
    code, text = run(benchmark, 1, "--short", "--out", tmp_path / "out")
    assert code == 0, text
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert BENCHMARK_SUMMARY.get(benchmark.stem, set()) <= set(summary)


@pytest.mark.parallel
@pytest.mark.parametrize("demo", DEMOS, ids=lambda demo: demo.stem)
def test_demo_fails_on_all_ranks_without_a_folder(tmp_path, demo):
    (tmp_path / "file").touch()
    code, text = run(demo, 2, "--short", "--out", tmp_path / "file")
    assert code not in (0, None)
    assert "OutputError" in text
