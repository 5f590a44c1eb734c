"""Folders that one run at a time works in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def locked(path: Path, filelock: Any) -> Iterator[None]:
    """Hold a lock, which the system frees when the process ends, however it does.

    Parameters
    ----------
    path
        Its file; the folder is made if it is not there.
    filelock
        The module of this name, which the caller's extra brings.

    Raises
    ------
    OSError
        If another run holds it, or the folder cannot be made.
    """
    while True:
        path.parent.mkdir(exist_ok=True)
        lock = filelock.FileLock(path)
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout as error:
            raise OSError(
                f"{path.parent}: another run is at work there; wait for its end"
            ) from error
        except FileNotFoundError:
            continue  # the run before removed the folder just now

        # The run before may have removed the folder between the two: then the lock is of no file.
        if path.exists():
            break
        lock.release()

    with lock:
        lock.release()  # `with` has taken it once more
        yield
