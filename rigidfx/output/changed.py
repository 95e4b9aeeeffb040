"""The error where a file is not as it was at the checkpoint from which a run goes on."""

from __future__ import annotations

from errno import EIO
from pathlib import Path

__all__ = ["ChangedFile"]


class ChangedFile(OSError):
    """A file lacks content that a checkpoint tells of, or has another one."""

    def __init__(self, path: Path, why: str) -> None:
        """Name the file.

        Args:
            path: The file.
            why: What has changed, as the end of a sentence.
        """
        super().__init__(EIO, why, str(path))
