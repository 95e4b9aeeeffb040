"""Writers of a run's reports into files, and the ends of these files at a checkpoint."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol

from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same


class Writer(Protocol):
    """Writes reports into files of a folder."""

    @property
    def name(self) -> str:
        """The folder, from the root on; or another name."""
        ...

    def ends(self) -> Mapping[str, Any] | None:
        """Where its files end, and its memory; on rank 0, None elsewhere."""
        ...

    def complete(self) -> None:
        """Write what it has kept back for the end of a run. Collective."""
        ...


class Writers:
    """The writers of a run; each joins as it writes its first report.

    Attributes:
        goes_on: Whether the run goes on from a checkpoint.
    """

    remembered: ClassVar[Remembered] = same("ends", "_folder")

    def __init__(
        self,
        comm: MPI.Intracomm = MPI.COMM_SELF,
        folder: str | Path | None = None,
        before: str | Path | None = None,
    ) -> None:
        """Begin without any; folders are those of checkpoints, now and before. Collective."""
        self._joined: list[Writer] = []
        self._known: Mapping[str, Any] = {}
        self.goes_on = before is not None
        own = [None if place is None else os.path.realpath(place) for place in (folder, before)]
        self._own, self._before = comm.bcast(own)
        self._was: str | None = None

    def join(self, writer: Writer) -> None:
        """Add a writer."""
        if writer not in self._joined:
            self._joined.append(writer)

    def known(self, name: str) -> Any:
        """Where files of a writer ended at the checkpoint; None if it knows none.

        They may have moved together with the checkpoint.
        """
        if name not in self._known and self._was is not None and os.path.isabs(name):
            name = os.path.normpath(os.path.join(self._was, os.path.relpath(name, self._before)))
        return self._known.get(name)

    def complete(self) -> None:
        """Let each write what it has kept back for the end of a run. Collective."""
        for writer in self._joined:
            writer.complete()

    @property
    def ends(self) -> Mapping[str, Any]:
        """Where files end now, by name; on rank 0. To set it is to go on from there."""
        return {writer.name: writer.ends() for writer in self._joined}

    @ends.setter
    def ends(self, known: Mapping[str, Any]) -> None:
        self._known = known

    @property
    def _folder(self) -> str | None:
        """The folder of checkpoints; that of before once it is set."""
        return self._own

    @_folder.setter
    def _folder(self, was: str | None) -> None:
        self._was = was
