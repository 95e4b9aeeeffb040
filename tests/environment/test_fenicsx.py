"""./fenicsx as its users call it.

Run by pytest, these calls are made where DOLFINx is already;
`python3 -m unittest discover -s tests/environment`, with any python3, makes them from the outside.
"""

import os
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

FENICSX = str(Path(__file__).resolve().parents[2] / "fenicsx")
SLEEPER = """
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
try:
    print("asleep", flush=True)
    for _ in range(600):
        time.sleep(0.1)
finally:
    print("cleaned", flush=True)
"""


def call(*args, **kwargs):
    return subprocess.run([FENICSX, *args], capture_output=True, text=True, check=False, **kwargs)


def outside(**variables):
    """The environment of a call that does not know where it is."""
    return {k: v for k, v in os.environ.items() if not k.startswith("RIGIDFX_")} | variables


class CommandTest(unittest.TestCase):
    def test_exit_code_and_streams(self):
        done = call("sh", "-c", "cat; echo err >&2; exit 42", input="through")
        assert (done.returncode, done.stdout, done.stderr) == (42, "through", "err\n")

    def test_unknown_command(self):
        assert call("no-such-command").returncode == 127

    def test_writes_where_it_is_called(self):
        with tempfile.TemporaryDirectory() as folder:
            done = call("sh", "-c", "echo here > file; pwd", cwd=folder)
            assert done.stdout.strip() == str(Path(folder).resolve())
            assert Path(folder, "file").read_text() == "here\n"

    def test_mpirun_is_silent(self):
        code = "from mpi4py import MPI; print(MPI.COMM_WORLD.allreduce(1))"
        for ranks in (1, 2, 3):
            done = call("mpirun", "-n", str(ranks), "python3", "-c", code)
            assert (done.returncode, done.stderr) == (0, "")
            assert "".join(done.stdout.split()) == ranks * str(ranks)

    def test_signals_reach_the_command(self):
        for number, code in ((signal.SIGTERM, 7), (signal.SIGINT, 130)):
            with subprocess.Popen(
                [FENICSX, "python3", "-c", SLEEPER],
                stdout=-1,
                stderr=-1,
                text=True,
                # A shell's background job ignores interrupts, and so would all it starts.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            ) as process:
                assert process.stdout.readline() == "asleep\n"
                process.send_signal(number)
                assert process.communicate(timeout=20)[0] == "cleaned\n"
            assert process.returncode in (code, -number)

    def test_killed_it_takes_its_processes_along(self):
        with subprocess.Popen([FENICSX, "python3", "-c", SLEEPER], stdout=-1) as process:
            process.stdout.readline()
            process.kill()
            assert process.communicate(timeout=20)[0] == b""  # nobody holds the pipe any more


class MessageTest(unittest.TestCase):
    def test_usage(self):
        assert call("--help").stdout.startswith("usage: ./fenicsx COMMAND")
        assert call().returncode == 2

    def test_unknown_debian(self):
        done = call("true", env=outside(RIGIDFX_DEBIAN="woody"))
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert "'woody'" in done.stderr

    def test_unknown_choice_of_the_wheel(self):
        for choice in (
            {"RIGIDFX_WHEEL": "maybe"},
            {"RIGIDFX_WHEEL": "yes", "RIGIDFX_DEBIAN": "sid"},
        ):
            done = call("true", env=outside(**choice))
            assert (done.returncode, done.stderr.count("\n")) == (1, 1)
            assert "RIGIDFX_WHEEL" in done.stderr

    def test_no_space_or_no_rights(self):
        with tempfile.TemporaryDirectory() as folder:
            for name, text in (("df", "echo 10"), ("sudo", "exit 1")):
                Path(folder, name).write_text(f"#!/bin/sh\n{text}\n")
                Path(folder, name).chmod(0o755)
            env = outside(RIGIDFX_DEBIAN="trixie", RIGIDFX_CACHE=folder + "/cache")
            env["PATH"] = folder + ":" + env["PATH"]
            done = call("true", env=env, stdin=subprocess.DEVNULL)
            assert done.returncode == 1
            wanted = "has 10 MB free" if os.getuid() == 0 else "with root rights"
            assert wanted in done.stderr.splitlines()[-1]
            assert not list(Path(folder).glob("cache/trixie-*[0-9]"))
            assert not list(Path(folder).glob("cache/*.tmp"))
