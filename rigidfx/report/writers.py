"""Writers of a run's reports into files, and the ends of these files at a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from rigidfx.base.remembered import Remembered, same

__all__ = ["Writer", "Writers"]


class Writer(Protocol):
    """Writes reports into files of a folder."""

    @property
    def name(self) -> str:
        """The folder."""
        ...

    def ends(self) -> Mapping[str, Any] | None:
        """Where its files end, and its memory; on rank 0, None elsewhere."""
        ...


class Writers:
    """The writers of a run; each joins as it writes its first report.

    Attributes:
        known: Where files ended at the checkpoint from which the run goes on, by folder.
    """

    remembered: ClassVar[Remembered] = same("ends")

    def __init__(self) -> None:
        """There are none."""
        self._joined: list[Writer] = []
        self.known: Mapping[str, Any] = {}

    def join(self, writer: Writer) -> None:
        """Have a writer among them."""
        if writer not in self._joined:
            self._joined.append(writer)

    @property
    def ends(self) -> Mapping[str, Any]:
        """Where files end now, by folder; on rank 0. To set it is to go on from there."""
        return {writer.name: writer.ends() for writer in self._joined}

    @ends.setter
    def ends(self, known: Mapping[str, Any]) -> None:
        self.known = known
