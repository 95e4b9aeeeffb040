"""Leaves checkpoints of a run when and where a user states it, and brings a run back to one.

Ctrl-C, SIGTERM and SIGUSR1 end a run after the step that it is in. Of several runs that are open
the one that ends a step next does so. One whose loop was left by an error stays open until Python
frees it, and ends no step any more.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError, agree, on_rank_0
from rigidfx.base.inputs import path_of, positive, whole
from rigidfx.base.instants import longer
from rigidfx.base.log import tell
from rigidfx.base.remembered import Forgetful, joined, part_of, restore
from rigidfx.base.taken import difference, digest, taken
from rigidfx.checkpoint.files import Claim, dumped, loaded, newest, write
from rigidfx.run import Run
from rigidfx.scene.mesh_order import mesh_order, scene_hashes
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.switch.switch import Switch

ALL = signal.SIGINT, signal.SIGTERM, signal.SIGUSR1  # mpirun hands the last one on


@dataclass(frozen=True)
class Checkpoint:
    """A run leaves checkpoints in a folder, from which `resume` goes on.

    One more is written at the end of the run, and after Ctrl-C or a SIGTERM: the run completes its
    step and ends. A second Ctrl-C ends it at once. The newest two are kept.

    Attributes:
        folder: Where they are; that of a `Recorder`, say. It is made if it does not exist.
        every: Wall time from one to the next [s] ...
        steps: ... or the number of steps, if given ...
        time: ... or the simulated time, if given [s].
    """

    folder: str | Path
    every: float = 60.0
    steps: int | None = None
    time: float | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            SceneError: If the folder is no path, an interval is not positive, or two are given.
        """
        folder = path_of("Checkpoint", "folder", self.folder)
        object.__setattr__(self, "folder", str(folder))
        positive("Checkpoint", "every", self.every)
        if self.steps is not None:
            whole("Checkpoint", "steps", self.steps, least=1)
        if self.time is not None:
            positive("Checkpoint", "time", self.time)
        if self.steps is not None and self.time is not None:
            raise SceneError("Checkpoint: steps and time are both given. Name one of them.")


class Signals:
    """Signals that a run hears, as long as it is open."""

    _open: ClassVar[list[Signals]] = []
    _former: ClassVar[dict[int, Any]] = {}  # handlers before the first of them
    _heard: ClassVar[int | None] = None  # a signal that has come and has ended nothing yet
    _tells: ClassVar[bool] = True  # whether this process says what a signal does

    @property
    def heard(self) -> int:
        """Number of a signal that is to end a run, else 0."""
        return Signals._heard or 0

    def served(self) -> None:
        """Record that it ends this run."""
        Signals._heard = None

    def begin(self, tells: bool) -> None:
        """Hear signals that would end the process, in the main thread only; say so if it tells."""
        if threading.current_thread() is not threading.main_thread():
            return
        Signals._tells = tells
        self._open.append(self)
        for number in ALL:
            before = signal.getsignal(number)
            if before in (signal.SIG_DFL, signal.default_int_handler):
                self._former[number] = signal.signal(number, _hear)

    def end(self) -> None:
        """Hear them no more. One that has ended nothing is sent again, half a second later.

        While a generator is closed Python ignores all exceptions.
        """
        with suppress(ValueError):
            self._open.remove(self)
        if self._open:
            return
        while self._former:
            number, handler = self._former.popitem()
            if signal.getsignal(number) is _hear:
                signal.signal(number, handler)
        if heard := self.heard:
            self.served()
            threading.Timer(0.5, os.kill, (os.getpid(), heard)).start()


def _hear(number: int, frame: Any) -> None:
    """Tell a run to end after its step; at once if it was told before."""
    if Signals._heard:
        Signals._heard = None
        raise KeyboardInterrupt
    Signals._heard = number
    if Signals._tells:
        with suppress(OSError):
            os.write(2, b"\nrigidfx: the run ends after this step; once more ends it at once\n")


@dataclass(frozen=True)
class Kept:
    """Content of a checkpoint."""

    step: int  # number of its step
    t: float  # time at its end [s]
    # Each argument of the run: its hash, and its bytes; None if no file can hold these
    call: Mapping[str, tuple[str, bytes | None]]
    state: Sequence[Any]  # memory of the state and the switch
    memory: Sequence[Any]  # memory of all other parts

    def given_again(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """The arguments of a run that goes on; those that are not given again are None.

        It raises a `SceneError` if one has to be given, or is another one.
        """
        out = {}
        for name, (known, data) in self.call.items():
            value = given.get(name)
            if value is None and data is None:
                raise SceneError(
                    f"resume: {name} holds a function, or a class of your own, which no file "
                    f"keeps. Give it again: resume(…, {name}=…)."
                )
            if value is not None and digest(taken(value)) != known:
                raise SceneError(
                    f"resume: {name} is not what the run had. Leave it out, or give the same."
                )
            out[name] = loaded(data) if value is None and data is not None else value
        return out

    def bring_back(self, state: State, switch: Switch) -> None:
        """Restore a state and its division, which the switch binds. Collective."""
        restore([state, switch], self.state, mesh_order(switch.scene))
        switch.again()

    def remember(self, run: Run, looks: Sequence[Any]) -> None:
        """Restore all else: the parts of the run, and the readers of its reports. Collective."""
        run.stepper.show()
        restore([run, looks], self.memory, mesh_order(run.stepper.scene))


def read(folder: Path, scene: Scene) -> Kept:
    """The newest checkpoint of a folder, as rank 0 names it. Collective.

    It raises a `SceneError` on every rank, if there is none, or it is of another version or scene,
    and an `OutputError`, if it cannot be read.
    """
    head, data, path = on_rank_0(scene.comm, lambda: newest(folder))
    changed = difference(head["scene"], scene_hashes(scene))
    if changed is not None:
        raise SceneError(
            f"resume: '{path}' was written for another scene: {changed} differs. Give the scene "
            "that the run had; of functions none can be compared."
        )
    try:
        kept: Kept = loaded(data)
    except Exception as error:  # of whatever class a record is that has changed
        raise SceneError(
            f"resume: '{path}' was written by another version of rigidfx ({error}). Resume with "
            "that version, or run anew."
        ) from None
    tell(scene.comm, f"goes on from '{path}': step {kept.step}, t = {kept.t:g} s")
    return kept


class Keeper:
    """Leaves checkpoints; a context manager that hears signals."""

    def __init__(
        self,
        run: Run,
        looks: Sequence[Any],
        checkpoint: Checkpoint,
        call: Mapping[str, Any],
        kept: Kept | None,
        before: Path | None,
    ) -> None:
        """Refuse a run that no checkpoint keeps, or a folder that takes none; have it. Collective.

        The last of `looks` are the writers of files. A run that goes on does so from `kept`, of the
        folder `before`. A `SceneError` on every rank
        names a class that does not name its memory, an `OutputError` a folder that takes no files.
        """
        scene = run.stepper.scene
        self._run, self._looks, self._comm, self._given = run, looks, scene.comm, checkpoint
        *_, self._writers = looks
        self._step, self._t = (0, 0.0) if kept is None else (kept.step, kept.t)
        self._order, self._scene = mesh_order(scene), scene_hashes(scene)
        plain = {name: taken(value) for name, value in call.items()}
        self._call = {name: (digest(value), dumped(value)) for name, value in plain.items()}
        self._began, self._signals = perf_counter(), Signals()
        self._before = before
        self._claim: Claim | None = None
        problem = None
        try:
            part_of([run.stepper.state, run.switch, run, looks], self._order)
        except Forgetful as error:
            problem = (
                f"Checkpoint: {error} does not say what it remembers (`remembered`), so that no "
                "checkpoint can keep it. Leave the checkpoint out, or give that class the field."
            )
        agree(self._comm, problem)
        self._on_disk(self._have)

    def _have(self, folder: Path) -> None:
        """Make the folder, on rank 0."""
        before = self._before
        goes_on = before is not None and folder.exists() and before.samefile(folder)
        self._claim = Claim(folder, goes_on=goes_on)

    def look(self, step: int, t: float, over: bool) -> None:
        """Leave a checkpoint of the last step, which ended at t [s], if one is due. Collective.

        On every rank it raises an `OutputError`, if it cannot be written; a `KeyboardInterrupt`
        after Ctrl-C on any; and a `SystemExit` after a SIGTERM or SIGUSR1.
        """
        due, heard = self._due(step, t, over)
        if (due or heard) and step > self._step:
            state = self._run.stepper.state
            last = state.snapshot() if over else None
            kept = self._kept(step, t)
            if last is not None:  # nothing follows, and the last report may still be asked
                state.restore(last)
                self._writers.complete()  # behind the ends of files that are kept
            self._leave(kept)
        if heard:
            self._signals.served()
        if heard == signal.SIGINT:
            raise KeyboardInterrupt(f"a checkpoint of step {step} is in '{self._given.folder}'")
        if heard:
            raise SystemExit(128 + heard)

    def _due(self, step: int, t: float, over: bool) -> tuple[bool, int]:
        """Whether a checkpoint is due, and which signal was heard. Collective."""
        given = self._given
        due = over
        if given.steps is not None:
            due |= step - self._step >= given.steps
        elif given.time is not None:
            count = round(self._t / given.time)
            due |= not longer((count + (not longer(count * given.time, self._t))) * given.time, t)
        elif self._comm.rank == 0:
            due |= perf_counter() - self._began >= given.every
        found = np.array([self._signals.heard, int(due)])
        self._comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        return bool(found[1]), int(found[0])

    def _kept(self, step: int, t: float) -> Kept:
        """Content of a checkpoint of a step that ended at t [s]. Collective."""
        run = self._run
        state = self._gathered(run.stepper.state, run.switch)
        run.switch.again()
        return Kept(step, t, self._call, state, self._gathered(run, self._looks))

    def _leave(self, kept: Kept) -> None:
        def write_next(folder: Path) -> None:
            if self._claim is not None:
                self._claim.check()
            write(folder, {"scene": self._scene, "step": kept.step, "t": kept.t}, kept)

        self._on_disk(write_next)
        self._step, self._t, self._began = kept.step, kept.t, perf_counter()

    def _on_disk(self, action: Callable[[Path], object]) -> None:
        """Do something in the folder on rank 0; raise its errors on all ranks. Collective."""
        folder = Path(self._given.folder)

        def problem(error: Exception) -> str:
            return _problem(folder, error, self._claim is not None)

        on_rank_0(self._comm, lambda: action(folder), problem)

    def _gathered(self, *owners: Any) -> Any:
        """All that objects remember, on rank 0. Collective."""
        parts = self._comm.gather(part_of(owners, self._order))
        return None if parts is None else joined(parts)

    def __enter__(self) -> Keeper:
        """Hear signals that would end the process."""
        self._signals.begin(tells=self._comm.rank == 0)
        return self

    def __exit__(self, *of_error: object) -> None:
        """Hear them no more, and let other runs have the folder."""
        if self._claim is not None:
            self._claim.close()
        self._signals.end()


def _problem(folder: Path, error: Exception, begun: bool) -> str:
    """The message where a checkpoint cannot be written."""
    if isinstance(error, BlockingIOError):
        return (
            f"Checkpoint: another run has the folder '{folder}'. Wait for its end, end it, or name "
            "another folder."
        )
    if begun and isinstance(error, FileNotFoundError) and not folder.exists():
        return (
            f"Checkpoint: the folder '{folder}' is gone since the run began, with its checkpoints. "
            "Bring it back and go on with `resume`, or run anew into a folder that stays."
        )
    said = getattr(error, "strerror", None) or error
    return (
        f"Checkpoint: cannot write to the folder '{folder}' ({said}). Earlier checkpoints are as "
        "they were. Check the space left there, or name a folder that you may write to."
    )
