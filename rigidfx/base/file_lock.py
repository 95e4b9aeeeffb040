"""The lock of an open file: one process at a time has it, and it ends with the process."""

from __future__ import annotations

import fcntl


def lock(file: int) -> None:
    """Lock a file until it is closed, however its process ends.

    Args:
        file: Number of the open file.

    Raises:
        BlockingIOError: If it is locked already, here or in another process.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks: better no lock than no run
        pass
