"""A power cut at any operation on files: what was flushed stays, of what was not, half is lost."""

from __future__ import annotations

import builtins
import io
import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import pytest


class PowerCutError(BaseException):
    """What every operation raises from the cut on: no `finally` fixes anything without power."""


class Power:
    """Counts the operations on files of a folder that change something, and ends at one of them.

    Parameters
    ----------
    folder
        The folder.
    last
        After how many operations the power goes; None: never.
    """

    def __init__(self, folder: Path, last: int | None) -> None:
        self.folder, self.last, self.count, self.gone = folder.resolve(), last, 0, False
        self._unflushed: dict[str, int] = {}  # and how many of their bytes are on the disk

    def operation(self, path: object) -> bool:
        """Count an operation; return whether the path is of the folder."""
        place = self._place(path)
        if place is None:
            return False

        if self.gone or self.count == self.last:
            self._go()
            raise PowerCutError(place)

        self.count += 1
        return True

    def wrote(self, path: object, kept: int = 0) -> None:
        """Take note of a file of which this many bytes are on the disk, and no more yet."""
        if place := self._place(path):
            self._unflushed.setdefault(place, kept)

    def flushed(self, number: int) -> None:
        """Take note of a file whose content is on the disk."""
        self._unflushed.pop(str(self._place(number)), None)

    def moved(self, path: object, other: object) -> None:
        """Take note of a file that has another name now."""
        if (place := self._place(path)) in self._unflushed:
            kept = self._unflushed.pop(str(place))
            self._unflushed[str(self._place(other))] = kept

    def _place(self, path: object) -> str | None:
        if isinstance(path, int):
            path = Path(f"/proc/self/fd/{path}").readlink()
        if not isinstance(path, str | os.PathLike):
            return None
        place = os.path.abspath(path)  # noqa: PTH100 -- links are not followed, nor need it exist
        return place if Path(place).is_relative_to(self.folder) else None

    def _go(self) -> None:
        if not self.gone:
            self.gone = True
            for path, kept in self._unflushed.items():
                if Path(path).is_file():
                    os.truncate(path, kept + max(0, Path(path).stat().st_size - kept) // 2)


@contextmanager
def cut(patch: pytest.MonkeyPatch, folder: Path, last: int | None = None) -> Iterator[Power]:
    """Have the power go after this many operations in a block; count them if it never does."""
    power = Power(folder, last)

    opening, replacing, flushing = io.open, os.replace, os.fsync

    def opened(path: Any, mode: str = "r", *args: Any, **options: Any) -> Any:
        if set(mode) & set("wxa+") and power.operation(path):
            is_longer = "a" in mode and Path(path).is_file()
            power.wrote(path, Path(path).stat().st_size if is_longer else 0)
        return opening(path, mode, *args, **options)

    def replaced(path: Any, other: Any, **options: Any) -> None:
        power.operation(other)
        power.moved(path, other)
        replacing(path, other, **options)

    def flushed(number: int) -> None:
        power.operation(number)
        flushing(number)
        power.flushed(number)

    with patch.context() as patched:
        for module in (io, builtins):
            patched.setattr(module, "open", opened)
        for name in ("unlink", "remove", "rmdir", "mkdir"):
            patched.setattr(os, name, _counted(power, getattr(os, name)))
        for name in ("replace", "rename"):
            patched.setattr(os, name, replaced)
        patched.setattr(os, "fsync", flushed)
        yield power


def _counted(power: Power, real: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of `os` on one path, as an operation."""

    def call(path: Any, *args: Any, **options: Any) -> Any:
        if options.get("dir_fd") is None:
            power.operation(path)
        elif power.gone:
            raise PowerCutError(path)
        return real(path, *args, **options)

    return call
