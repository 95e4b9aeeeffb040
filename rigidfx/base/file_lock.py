"""The lock of an open file: one process at a time has it, and it ends with the process."""

import fcntl


def lock(file: int, how: int = fcntl.LOCK_EX | fcntl.LOCK_NB) -> None:
    """Lock an open file until it is closed; raise `BlockingIOError` if it is locked already."""
    try:
        fcntl.flock(file, how)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks: better no lock than no run
        pass
