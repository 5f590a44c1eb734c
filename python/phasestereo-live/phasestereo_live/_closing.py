"""A ``with`` block for classes that have a `close`."""

from __future__ import annotations

from typing import Self


class Closing:
    """Closes itself at the end of a ``with`` block, also after an error."""

    def close(self) -> None:
        """Free all resources; every class does it in its own way."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
