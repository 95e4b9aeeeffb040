"""A run that goes on from a checkpoint is the run that left it."""

import fcntl
import os
import shutil
import signal
from collections import OrderedDict
from contextlib import suppress
from fractions import Fraction
from functools import partial
from itertools import islice
from pathlib import Path
from pickle import UnpicklingError
from time import sleep

import h5py
import numpy as np
import parallel
import pytest
from memory import differences
from restart import balance
from restarted import DRAG, HELD, QUIET, SCENES, SINE, SOFT, bar, row, seen

import rigidfx as rf
from rigidfx.checkpoint.files import loaded
from rigidfx.command.pair import Pair

NO_WARNINGS = pytest.mark.filterwarnings("ignore::rigidfx.base.errors.RigidfxWarning")


LONG = "all wake", "grows", "pressed"
STEPS = dict.fromkeys(SCENES, 15) | dict.fromkeys(LONG, 35) | {"control": 70, "pair rests": 25}


ROUNDING = 1e-12  # relative: where arrays lie elsewhere, sums of shapes end in another digit


def parts(run):
    made = run.gi_frame.f_locals
    return parts(made["reports"]) if "reports" in made else [made["run"], made["looks"]]


@NO_WARNINGS
@pytest.mark.parametrize("name", SCENES)
def test_a_run_goes_on_bit_by_bit(name, tmp_path):
    """All that its objects know after the next step, and its reports to the end.

    To rounding, where bodies have shapes.
    """
    make, dt, t_end, more = SCENES[name]
    within = ROUNDING if more else 0.0
    steps = STEPS[name]
    checkpoint = rf.Checkpoint(tmp_path / "whole", steps=steps)
    whole = rf.simulate(make(), dt, t_end, checkpoint=checkpoint, **more)
    rows = []
    for report in whole:
        rows.append(row(report))
        if report.step == steps + 1:
            shutil.copytree(tmp_path / "whole", tmp_path / "cut")
            again = rf.resume(tmp_path / "cut", make())
            rest = [row(next(again))]
            assert differences(parts(whole), parts(again), within) == []
    rest += [row(report) for report in again]
    expected, rest = (
        np.nan_to_num(np.array(of, dtype=float), nan=-1.0) for of in (rows[steps + 1 :], rest)
    )
    sizes = np.abs(expected).max(axis=0)
    for group in (slice(8, 14), slice(14, 17), slice(17, 20)):  # energies, places, momenta
        sizes[group] = sizes[group].max()
    assert (np.abs(rest - expected) <= within * sizes).all()
    if name in ("grows", "all wake"):
        assert sum(r[4] for r in rows[: steps + 1]) > 0
        assert rest[:, 4].sum() > 0


@NO_WARNINGS
def test_checkpoints_change_no_run(tmp_path):
    """Bodies grow in the same steps, and digits differ by rounding."""
    make, dt, t_end, more = SCENES["grows"]
    given = None, rf.Checkpoint(tmp_path, steps=7)
    found = [[*rf.simulate(make(), dt, t_end, checkpoint=one, **more)] for one in given]
    switches = [[(e.t, e.kind, e.unknowns_after) for r in run for e in r.events] for run in found]
    assert switches[0] == switches[1]
    first, second = (np.array([r.probes["tip"] for r in run]) for run in found)
    assert np.abs(first - second).max() <= 1e-9 * np.abs(first).max()


@NO_WARNINGS
@pytest.mark.parallel
@pytest.mark.parametrize("name", ["grows", "joined"])
def test_other_ranks_go_on(name, tmp_path):
    """One rank begins, three go on, two end: rows and switches are those of one rank."""
    every, script = STEPS[name], Path(__file__).with_name("restarted.py")
    alone = np.array(seen(name, tmp_path / "alone", 10**6, every))
    (tmp_path / "cut").mkdir()
    rows = []
    for ranks, last in ((1, every), (3, 2 * every), (2, 10**6)):
        asked = name, str(tmp_path / "cut"), str(last), str(every)
        found = parallel.run(script, ranks, 300, *asked)
        rows += found if last > 10**5 else found[:-1]
    several = np.array(rows, dtype=float)
    assert (several[:, [0, 3, 4, 5]] == alone[:, [0, 3, 4, 5]]).all()
    for group in (slice(7, 8), slice(8, 14), slice(14, 17), slice(17, 20)):
        ours, whole = (np.nan_to_num(rows[:, group]) for rows in (several, alone))
        assert np.abs(ours - whole).max() <= 1e-9 * np.abs(whole).max()


def written(folder):
    """All files of a recorder but wall times and what a run says; what they hold."""
    out = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if name == "history.csv":
            lines = path.read_text().splitlines()
            out[name] = [line.rpartition(",")[0] for line in lines]
        elif path.suffix == ".vtkhdf":
            with h5py.File(path) as file:
                file.visititems(partial(_noted, out))
        elif path.is_file() and path.suffix not in (".rfx", ".txt", ".py"):
            out[name] = path.read_bytes()
    return out


def _noted(out, name, item):
    if isinstance(item, h5py.Dataset):
        out[name] = item[()].tobytes()


@NO_WARNINGS
def test_files_go_on_without_a_row_lost_or_doubled(tmp_path):
    """A run that fails twice, after steps and fields that no checkpoint knows."""
    make, dt, _, more = SCENES["all wake"]

    def run(folder, fails=(), resume=False):
        scene = make()
        steps = (
            rf.resume(folder, scene)
            if resume
            else rf.simulate(scene, dt, 3.2, checkpoint=rf.Checkpoint(folder, steps=13), **more)
        )
        form = {"format": "both", "interval": 0.3, "stress": False}
        with suppress(rf.StepError), rf.Recorder(scene, folder, **form) as recorder:
            for report in steps:
                recorder.write(report)
                if report.step in fails:
                    raise rf.StepError("a failure")  # the last fields are written
        steps.close()

    run(tmp_path / "whole")
    run(tmp_path / "cut", [44])
    run(tmp_path / "cut", [70], resume=True)
    run(tmp_path / "cut", resume=True)
    assert balance(tmp_path / "cut") <= 1e-10
    whole, cut = written(tmp_path / "whole"), written(tmp_path / "cut")
    assert whole.keys() == cut.keys()
    assert [name for name in whole if whole[name] != cut[name]] == []
    assert len(rf.read_fields(tmp_path / "cut").times) > 10
    scene = make()
    first = next(rf.simulate(scene, dt, 0.1))
    other = rf.Recorder(scene, tmp_path / "other", resume=True)
    with pytest.raises(rf.SceneError, match="resume=True goes on"), other:
        other.write(first)


@NO_WARNINGS
def test_a_pair_goes_on_with_all_its_reports(tmp_path):
    """Two runs side by side, as of the demos: after a signal, with what was noted before it."""
    make, dt, _, more = SCENES["grows"]

    def pair(folder, resume=False):
        kept = {"folder": folder, "resume": resume, "note": lambda r: r.strain_rate is not None}
        return Pair(make(), dt, 0.8, more["rigidify"], **kept)

    with pair(tmp_path / "whole") as whole:
        assert len(list(whole)) == 21
    with pair(tmp_path / "cut") as cut:
        steps = iter(cut)
        while next(steps).step < 12:
            pass
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(SystemExit):
            next(steps)
    with pair(tmp_path / "cut", resume=True) as again:
        assert [report.step for report in again] == [*range(13, 21)]
    assert again.notes == whole.notes
    for ours, theirs in ((again.adaptive, whole.adaptive), (again.flexible, whole.flexible)):
        one, other = (np.nan_to_num([row(r) for r in reports]) for reports in (ours, theirs))
        for group in (slice(7, 8), slice(8, 14), slice(14, 17), slice(17, 20)):
            off = np.abs(one[:, group] - other[:, group]).max()
            assert off <= 1e-9 * np.abs(other[:, group]).max()
        assert [r.bodies != () for r in ours] == [r.bodies != () for r in theirs]
    with pytest.raises(rf.SceneError, match="There is no checkpoint"):
        pair(tmp_path / "elsewhere", resume=True)


def test_the_newest_that_is_whole_goes_on(tmp_path):
    make, dt, t_end, _ = SCENES["damped"]
    *_, last = rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path, steps=8))
    assert last.current  # its fields are still to be written
    assert last.step == 20
    old, new = sorted(tmp_path.glob("*.rfx"))
    with pytest.warns(rf.RigidfxWarning, match=r"resume: the run in '.*' is over"):
        assert list(rf.resume(tmp_path, make())) == []
    new.write_bytes(new.read_bytes()[:-1])
    assert next(rf.resume(tmp_path, make())).step == 17
    old.write_bytes(b"nothing")
    with pytest.raises(rf.SceneError, match="only damaged ones"):
        rf.resume(tmp_path, make())
    with pytest.raises(rf.SceneError, match="there is none"):
        rf.resume(tmp_path / "elsewhere", make())


def test_other_scenes_meshes_and_versions_are_refused(tmp_path, monkeypatch):
    make, dt, t_end, _ = SCENES["damped"]
    list(rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path)))
    finer = rf.Scene(rf.box((0, 0, 0), (8, 1, 1), (17, 1, 1)), SOFT, [rf.Fixed("x0")])
    for other, found in (
        (bar(rf.Fixed("x0")), r"effects\[1\] \(Traction\) differs"),
        (make(mass="consistent"), "mass differs"),
        (finer, "the mesh differs"),
    ):
        with pytest.raises(rf.SceneError, match=found):
            rf.resume(tmp_path, other)
    with pytest.raises(rf.SceneError, match="dt is not what the run had"):
        rf.resume(tmp_path, make(), dt=0.02)
    for given, found in (
        ({"t_end": t_end / 2}, r"t_end = 0.5 s is before the checkpoint, which is at t = 1 s"),
        ({"t_end": "late"}, "resume: t_end must be a finite number"),
        ({"checkpoint": "out"}, "resume: checkpoint must be a Checkpoint"),
    ):
        with pytest.raises(rf.SceneError, match=found):
            rf.resume(tmp_path, make(), **given)
    assert [r.step for r in rf.resume(tmp_path, make(), t_end=t_end + 2 * dt)] == [21, 22]
    monkeypatch.setattr(rf, "__version__", "0.0.1")
    with pytest.raises(rf.SceneError, match=r"written by rigidfx .*, this is 0.0.1"):
        rf.resume(tmp_path, make())


def test_functions_have_to_be_given_again(tmp_path):
    rule = rf.StrainRate(0.003, 0.4, release=rf.Release(when=lambda report: False))
    scene = partial(bar, HELD, SINE, DRAG)
    left = rf.Checkpoint(tmp_path, steps=3)
    list(rf.simulate(scene(), 0.02, 0.1, rigidify=rule, checkpoint=left))
    with pytest.raises(rf.SceneError, match="rigidify holds a function"):
        rf.resume(tmp_path, scene())
    assert list(rf.resume(tmp_path, scene(), rigidify=rule, t_end=0.14))[-1].step == 7


@NO_WARNINGS
def test_what_cannot_be_kept_is_refused_at_the_start(tmp_path, monkeypatch):
    make = SCENES["named"][0]
    monkeypatch.delattr("rigidfx.decide.rules.RateRule.remembered")
    with pytest.raises(rf.SceneError, match="RateRule does not say what it remembers"):
        rf.simulate(make(), 0.1, 1.0, rigidify=QUIET, checkpoint=rf.Checkpoint(tmp_path))


@pytest.mark.usefixtures("hears")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_leaves_a_checkpoint(number, tmp_path):
    make, dt, t_end, _ = SCENES["damped"]
    left = rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path / "left"))
    next(left)  # open, as one whose loop was left by an error
    run = rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path))
    while next(run).step < 7:
        pass
    os.kill(os.getpid(), number)
    with pytest.raises(KeyboardInterrupt if number == signal.SIGINT else SystemExit):
        next(run)
    assert next(rf.resume(tmp_path, make())).step == 8


def test_a_set_of_as_many_other_facets_is_another_scene(tmp_path):
    def made(end):
        bar = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_facets("held", lambda x: x[0] == end)
        return rf.Scene(bar, SOFT, [rf.Fixed("held"), rf.Gravity()])

    kept = rf.Checkpoint(tmp_path, steps=1)
    list(rf.simulate(made(0.0), 0.1, 0.2, checkpoint=kept, progress=False))
    with pytest.raises(rf.SceneError, match="the set 'held' differs"):
        rf.resume(tmp_path, made(4.0), t_end=0.3)


def test_a_checkpoint_makes_nothing_of_other_packages():
    """Not by a module of this one, either, that has it under a dotted name."""
    module, name = b"rigidfx.base.c_library", b"subprocess.Popen"
    text = [b"\x8c" + bytes([len(word)]) + word for word in (module, name)]
    with pytest.raises(UnpicklingError, match="nothing that a checkpoint holds"):
        loaded(b"\x80\x05" + b"".join(text) + b"\x93.")


def test_a_recorder_that_is_closed_hinders_no_checkpoint(tmp_path):
    scene = bar()
    steps = rf.simulate(
        scene, 0.1, 0.5, checkpoint=rf.Checkpoint(tmp_path, steps=2), progress=False
    )
    with rf.Recorder(scene, tmp_path, stress=False) as recorder:
        recorder.write(next(steps))
    assert len(list(steps)) == 5


def test_a_run_that_is_over_has_its_last_fields_with_its_last_checkpoint(tmp_path):
    """It has them even if it is killed before its recorder is closed: `resume` has no step more."""
    scene = bar()
    left = rf.Checkpoint(tmp_path, steps=4)
    recorder = rf.Recorder(scene, tmp_path, every=4, stress=False)
    for report in rf.simulate(scene, 0.1, 0.6, checkpoint=left, progress=False):
        recorder.write(report)
    assert rf.read_fields(tmp_path).times == pytest.approx([0, 0.4, 0.6])
    recorder.close()
    longer = rf.resume(tmp_path, scene, t_end=0.8, progress=False)
    with rf.Recorder(scene, tmp_path, every=4, stress=False) as recorder:
        for report in longer:
            recorder.write(report)
    assert rf.read_fields(tmp_path).times == pytest.approx([0, 0.4, 0.8])


def recorded(folder, scene, steps, last=10**6, **more):
    """Have a run's reports written up to a step; how many rows there are then."""
    with rf.Recorder(scene, folder, stress=False, **more) as recorder:
        for report in steps:
            recorder.write(report)
            if report.step == last:
                break
    steps.close()
    return len(rf.read_history(folder)["t"])


def test_nothing_goes_on_with_the_run_before(tmp_path):
    """A run that ends before its first checkpoint, in the folder of another one."""
    make, dt, t_end, _ = SCENES["damped"]

    def begun(every):
        kept = rf.Checkpoint(tmp_path, steps=every)
        return rf.simulate(scene, dt, t_end, checkpoint=kept, progress=False)

    scene = make()
    assert recorded(tmp_path, scene, begun(3), last=10) == 11
    assert recorded(tmp_path, scene, begun(100), last=12) == 13
    with pytest.raises(rf.SceneError, match="none of the run that began there last"):
        rf.resume(tmp_path, make())
    (tmp_path / "former-000003.rfx").rename(tmp_path / "checkpoint-000003.rfx")
    with pytest.raises(rf.OutputError, match="rows that were there are gone"):
        recorded(tmp_path, scene, rf.resume(tmp_path, scene))
    assert recorded(tmp_path, scene, begun(3), last=10) == 11
    assert not list(tmp_path.glob("former-*"))


def test_a_folder_is_of_one_run(tmp_path):
    make, dt, t_end, _ = SCENES["damped"]
    run = rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path, steps=2))
    while next(run).step < 5:
        pass
    again = rf.resume(tmp_path, make())  # as after an error in the loop's body
    assert next(again).step == 5
    next(run)
    with pytest.raises(rf.OutputError, match="another run has the folder"):
        next(run)
    assert next(again).step == 6
    again.close()
    with (tmp_path / "checkpoint.lock").open("ab") as other:  # as of another process
        fcntl.flock(other, fcntl.LOCK_EX)
        for begin in (
            lambda: rf.resume(tmp_path, make()),
            lambda: rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path)),
        ):
            with pytest.raises(rf.OutputError, match="another run has the folder"):
                begin()


def test_a_recorder_knows_by_itself_that_a_run_goes_on(tmp_path, monkeypatch):
    """In a folder that was moved, named from elsewhere; elsewhere it spoils no results."""
    make, dt, t_end, _ = SCENES["damped"]
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    scene = make()
    left = rf.Checkpoint("out/run", steps=3)
    recorded("out/run", scene, rf.simulate(scene, dt, t_end, checkpoint=left), last=7)
    assert recorded("other", scene, rf.simulate(scene, dt, t_end), last=5) == 6
    moved = tmp_path / "moved"
    shutil.copytree("out/run", moved)
    with pytest.raises(rf.SceneError, match="does not know 'other'"):
        recorded("other", scene, rf.resume(moved, scene))
    assert len(rf.read_history("other")["t"]) == 6
    assert recorded(moved, scene, rf.resume(moved, scene)) == 21
    assert recorded("other", scene, rf.resume("out/run", scene), resume=False) == 14
    (moved / "fields.pvd").write_bytes(b"")
    with pytest.raises(rf.OutputError, match="times that were there are gone"):
        recorded(moved, scene, rf.resume(moved, scene, t_end=2 * t_end))


@pytest.mark.parametrize(
    ("dt", "t_end", "again"),
    [
        (1, Fraction(5, 2), {"dt": 1.0, "t_end": 3}),
        ({0: 1, 1: Fraction(1, 2)}, 2.5, {"dt": {0.0: 1.0, 1.0: 0.5}}),
        (rf.StepControl(0.1, largest=1), 2, {"dt": rf.StepControl(0.1, largest=1.0), "t_end": 2}),
    ],
)
def test_numbers_of_any_kind_are_kept(dt, t_end, again, tmp_path):
    options = OrderedDict(ksp_type="gmres")
    kept = rf.Checkpoint(tmp_path, steps=1)
    run = rf.simulate(bar(HELD), dt, t_end, checkpoint=kept, petsc_options=options)
    list(islice(run, 3))
    run.close()
    list(rf.resume(tmp_path, bar(HELD), **again))


@pytest.mark.usefixtures("hears")
def test_a_signal_is_not_lost_where_a_run_is_left(tmp_path):
    """In the body of a loop that is then left: no step is there to end after."""
    make, dt, t_end, _ = SCENES["damped"]
    for report in rf.simulate(make(), dt, t_end, checkpoint=rf.Checkpoint(tmp_path)):
        if report.step == 3:
            os.kill(os.getpid(), signal.SIGINT)
            break
    with pytest.raises(KeyboardInterrupt):
        sleep(5)
