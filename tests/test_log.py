"""What a run says of itself: by Python's logging, on standard error, and in a file."""

import logging
import os
import re
from itertools import count

import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base import form_cache, log
from rigidfx.base.crowding import crowded
from rigidfx.base.warning import warn
from rigidfx.flexible import kernels
from rigidfx.report import account

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)


def run(folder, verbose=None):
    scene = rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), MATERIAL)
    criterion = rf.StrainRate(1.0, 0.2, wake="none")
    with rf.Recorder(scene, folder, stress=False) as recorder:
        how = {"rigidify": criterion, "progress": False, "verbose": verbose}
        for report in rf.simulate(scene, 0.1, 0.5, **how):
            recorder.write(report)


def test_log_file_and_last_line(tmp_path, capsys):
    """Nothing on standard error where that is ruled out; the file has a line for each switch."""
    run(tmp_path / "run", verbose=False)
    assert "rigidfx" not in capsys.readouterr().err
    lines = (tmp_path / "run" / "log.txt").read_text(encoding="utf-8").splitlines()
    assert any("<Scene: 4 hexahedra of order 1, 60 dofs" in line for line in lines)
    assert any("60 unknowns, to t = 0.5 s" in line for line in lines)
    assert any("freeze (part 1): 60 → 6 unknowns" in line for line in lines)
    last = lines[-1]
    assert "done at t = 0.5 s: 5 steps" in last
    assert "1 switches, rigid: 'part 1' of 4 cells, 6 unknowns" in last
    assert last.endswith("run")
    assert not logging.getLogger("rigidfx").handlers


def test_log_file_has_the_warnings(tmp_path):
    """Of an open recorder, also where a filter hides or raises them; names that are wrong, too."""
    effects = [rf.Fixed("x0"), rf.Contact("z0", against=rf.Plane((0, 0, -1), (0, 0, 1)))]
    scene = rf.Scene(
        rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), MATERIAL, effects, probes={"tip": (2, 1, 1)}
    )
    with rf.Recorder(scene, tmp_path) as recorder:
        for report in rf.simulate(scene, 0.1, 0.1):
            recorder.write(report)
            if report.step == 0:
                with pytest.raises(KeyError, match="'x0' from the first step on"):
                    report.reactions["x0"]
            for name in ("reactions", "touches", "probes", "stresses"):
                with pytest.raises(KeyError, match=f"report.{name} has no 'x'; its names are '"):
                    getattr(report, name)["x"]
        with pytest.raises(rf.RigidfxWarning):
            warn(scene.comm, "doubtful")
    assert "warning: doubtful\n" in (tmp_path / "log.txt").read_text(encoding="utf-8")


def test_a_first_run_says_what_it_compiles(tmp_path, monkeypatch, capsys):
    """In one line, also where nobody sees a terminal; a second run has nothing to compile."""
    options = kernels.jit_options() | {
        "cache_dir": str(tmp_path),
        "cffi_extra_compile_args": ["-O0"],
    }
    monkeypatch.setattr(kernels, "jit_options", lambda: options)
    monkeypatch.setattr(form_cache, "ANNOUNCED", set())
    monkeypatch.setattr(form_cache, "FOUND", {})
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), MATERIAL)
    for expected in (1, 0):
        list(rf.simulate(scene, 0.1, 0.1))
        told = [s for s in capsys.readouterr().err.splitlines() if s.startswith("rigidfx: ")]
        assert len(told) == expected
        assert not told or "the forms of hexahedra of order 1, once for all" in told[0]
        assert not told or re.search(r"about \d+ to \d+ s$", told[0])


def test_what_is_compiled_without_a_run_is_told(capsys):
    """Before modes are there, say; a run that is to be silent is."""
    log.announce("compiling")
    assert capsys.readouterr().err == "rigidfx: compiling\n"
    for verbose, told in ((False, ""), (None, "rigidfx: compiling\n")):
        with log.heard(MPI.COMM_SELF, verbose):
            log.announce("compiling")
        assert capsys.readouterr().err == told


def test_verbose_says_it_on_standard_error(tmp_path, capsys):
    run(tmp_path / "run", verbose=True)
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("rigidfx: done at t = 0.5 s")
    with pytest.raises(rf.SceneError, match="verbose must be True, False or None"):
        run(tmp_path, verbose=3)


def test_a_long_run_says_once_a_minute_where_it_is(tmp_path, capsys, monkeypatch):
    """Also in a pipe, and in log.txt; not where that is ruled out."""
    clock = count(0.0, 30.0)  # s; each step looks at it once
    monkeypatch.setattr(account, "perf_counter", lambda: next(clock))
    for verbose, told in ((None, 2), (False, 0)):
        run(tmp_path / "run", verbose)
        pattern = (
            r"rigidfx: t = 0\.\d of 0\.5 s \(\d\d%\) after 0:0\d:\d\d: step \d, \d+ unknowns, about"
        )
        assert len(re.findall(pattern, capsys.readouterr().err)) == told
        assert "of 0.5 s (" in (tmp_path / "run" / "log.txt").read_text(encoding="utf-8")


def test_load_steps_say_where_they_are(capsys, monkeypatch):
    clock = count(0.0, 30.0)  # s
    monkeypatch.setattr(account, "perf_counter", lambda: next(clock))
    pulled = [rf.Fixed("x0"), rf.Traction("x1", (10.0, 0.0, 0.0))]
    scene = rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), MATERIAL, pulled)
    list(rf.static(scene, 5))
    assert capsys.readouterr().err.count(" of 1 s (") == 2


def test_runs_in_one_loop_are_done_together(caplog):
    """The first that is over ends the loop; the other one is at its end as well."""
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), MATERIAL)
    with caplog.at_level(logging.INFO, "rigidfx"):
        for _ in zip(*(rf.simulate(scene, 0.1, 0.2) for _ in range(2)), strict=False):
            pass
    assert caplog.text.count("done at t = 0.2 s") == 2
    assert "stopped" not in caplog.text


def test_what_stopped_is_told(tmp_path, caplog):
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), MATERIAL)
    with caplog.at_level(logging.INFO, "rigidfx"):
        steps = rf.simulate(scene, 0.1, 0.5, progress=False)
        next(steps)
        steps.close()
    assert "stopped at t = 0 s: 0 steps" in caplog.text


@pytest.mark.parametrize(
    ("cores", "told"),
    [
        ([{0}, {1}], ""),  # each bound to one
        ([{0, 1}, {0, 1}], ""),
        ([{0, 1}] * 3, "3 ranks share 2 cores: "),
        ([{3}, {3}], "2 ranks share 1 core: "),
    ],
)
def test_cores_that_ranks_share(cores, told):
    assert crowded(cores).startswith(told)
    assert bool(crowded(cores)) == bool(told)


@pytest.mark.parallel
def test_a_run_says_that_its_ranks_share_a_core():
    """Once, before it compiles."""
    lines = parallel.run(__file__, 2, 60)
    assert [line for line in lines if "ranks share 1 core" in line] == lines[:1]


if __name__ == "__main__":
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {MPI.COMM_WORLD.bcast(min(own))})
    heard: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: heard.append(record.getMessage())  # type: ignore[method-assign]
    with log.hearing(handler):
        box = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
        list(rf.simulate(rf.Scene(box, MATERIAL), 0.1, 0.1, verbose=False))
    os.sched_setaffinity(0, own)
    parallel.report(heard)


def test_a_bar_ends_where_the_run_does(capsys):
    """Steps of 0.001 and 0.009 s add up to more than 0.01 s by rounding: tqdm had warned."""
    bar = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1))
    push = rf.Traction("x1", (1.0, 0, 0), until=0.001)
    scene = rf.Scene(bar, rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1e3), [rf.Fixed("x0"), push])
    *_, last = rf.simulate(scene, dt=1.0, t_end=0.01, progress=True, verbose=False)
    assert last.t == 0.01
    assert "100%" in capsys.readouterr().err
