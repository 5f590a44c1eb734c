"""Lock a folder, so that only one run at a time works in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def locked(path: Path, filelock: Any) -> Iterator[None]:
    """Hold a lock; the system frees it when the process ends for any reason.

    Parameters
    ----------
    path
        Its file; the function makes the folder if necessary.
    filelock
        The module of this name, from the caller's extra.

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
            continue  # the earlier run removed the folder just now

        # The earlier run may have removed the folder in between: then no file has this lock.
        if path.exists():
            break
        lock.release()

    with lock:
        lock.release()  # `with` took it once more
        yield
