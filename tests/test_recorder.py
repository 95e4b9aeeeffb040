"""Whose folder it is, which reports go there, and what happens where the disk is full."""

import logging
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.log import tell

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="one rank is enough")

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)


def make_scene(cells=(2, 1, 1), domain=None):
    domain = domain or rf.box((0, 0, 0), (2, 1, 1), cells)
    return rf.Scene(domain, MATERIAL, [rf.InitialVelocity(linear=(1.0, 0.0, 0.0))])


def run(scene, t_end=0.5):
    return rf.simulate(scene, 0.1, t_end, progress=False)


# Old reports -----------------------------------------------------------------------------------


def test_fields_of_a_report_that_the_run_has_left_behind_are_not_made_up(tmp_path):
    """Only every other report is written; the last of them is not the last of the run."""
    scene = make_scene()
    with rf.Recorder(scene, tmp_path, every=3) as recorder:
        for report in run(scene):
            if report.step % 2 == 0:
                recorder.write(report)
    assert rf.read_history(recorder.history)["step"].tolist() == [0, 2, 4]
    assert recorder.series.read_text().count("DataSet") == 1  # at t = 0


def test_a_report_whose_state_a_step_in_vain_has_changed_says_so():
    """Time is the same, but what was released ahead of the step is no longer in the state."""
    scene = make_scene()
    report = next(rf.simulate(scene, 0.1, 0.5))
    state = report.state
    state.group(state.bodies)
    assert report.t == state.t
    assert not report.current
    with pytest.raises(rf.SceneError, match="the run has gone on"):
        _ = report.state


def test_intervals_are_met_late_in_a_run(tmp_path):
    """A tolerance for times that is a part of them would there be several steps long."""
    late, dt = 2.0**16, 2.0**-20  # s
    scene = make_scene()
    with rf.Recorder(scene, tmp_path, interval=4 * dt) as recorder:
        for report in rf.simulate(scene, {0.0: late, late: dt}, late + 12 * dt):
            recorder.write(report)
    times = [float(t) for t in re.findall('timestep="([^"]*)"', recorder.series.read_text())]
    assert [(t - late) / dt for t in times if t >= late] == [0.0, 4.0, 8.0, 12.0]


# One recorder for a folder ---------------------------------------------------------------------


def test_a_folder_is_free_again_after_close(tmp_path):
    scene = make_scene()
    first = rf.Recorder(scene, tmp_path)
    first.close()
    with rf.Recorder(scene, tmp_path) as second:
        second.write(next(run(scene)))
    with pytest.raises(rf.OutputError, match="is closed"):
        first.write(next(run(scene)))
    assert rf.read_history(second.history)["step"].tolist() == [0]


def test_a_recorder_that_could_not_be_made_keeps_no_lock(tmp_path):
    scene = make_scene()
    (tmp_path / "fields").write_text("in the way")
    with pytest.raises(rf.OutputError, match="in the way"):
        rf.Recorder(scene, tmp_path)
    (tmp_path / "fields").unlink()
    rf.Recorder(scene, tmp_path).close()


HOLDS = """
import sys, time
import test_recorder as t
import rigidfx as rf
recorder = rf.Recorder(t.make_scene(), sys.argv[1])
print("holds", flush=True)
time.sleep(600)
"""


def test_the_lock_of_another_process_ends_with_it(tmp_path):
    scene = make_scene()
    path = str(Path(__file__).parent)
    with subprocess.Popen(
        [sys.executable, "-c", f"import sys; sys.path.append({path!r})\n{HOLDS}", str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout.readline() == "holds\n"
            with pytest.raises(rf.OutputError, match="another recorder"):
                rf.Recorder(scene, tmp_path)
        finally:
            process.send_signal(signal.SIGKILL)
    rf.Recorder(scene, tmp_path).close()


# A full disk -----------------------------------------------------------------------------------


def test_a_full_disk_is_told_by_the_recorders_own_error(tmp_path):
    """Not by that of a file that is closed; and what was written before stays whole."""
    scene = make_scene()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.raises(rf.OutputError, match="check the space left"):  # noqa: PT012, SIM117
        with rf.Recorder(scene, tmp_path, every=100) as recorder:
            for report in run(scene):
                recorder.write(report)
                if report.step == 3:
                    size = recorder.history.stat().st_size
                    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert recorder.history.read_bytes().endswith(b"\r\n")
    history = rf.read_history(recorder.history)
    np.testing.assert_array_equal(history["step"], [0, 1, 2, 3])


def test_a_log_that_cannot_be_written_is_told_once(tmp_path, capfd):
    """Not by a traceback of logging for each line that it says."""
    scene = make_scene()
    recorder = rf.Recorder(scene, tmp_path)
    (handler,) = logging.getLogger("rigidfx").handlers
    os.dup2(os.open("/dev/full", os.O_WRONLY), handler.stream.fileno())
    tell(scene.comm, "one line")
    tell(scene.comm, "another")
    with pytest.raises(rf.OutputError, match="No space left on device"):
        recorder.close()
    assert "Traceback" not in capfd.readouterr().err
