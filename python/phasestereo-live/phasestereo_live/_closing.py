"""The end of a ``with`` block, for what has a `close`."""

from __future__ import annotations

from typing import Self


class Closing:
    """Closes itself at the end of a ``with`` block, however that comes about."""

    def close(self) -> None:
        """Free what is held; every class has its own way."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
