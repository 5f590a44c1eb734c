from collections.abc import Sequence
from typing import Final, final

__version__: Final[str]

def adapters() -> list[tuple[str, str, str, str]]:
    """Return the adapters of this machine, those first that are tried first.

    Each is its name, its kind ("discrete", "integrated", "virtual", "other" or "cpu", a software
    driver, which is used by its name alone), its interface ("vulkan" or "metal") and its driver.
    """

@final
class Gpu:
    """An open adapter, in the process that opened it. Any number of threads may use one.

    ``Gpu(name)`` opens the first adapter whose name contains the text, ``Gpu(None)`` the first one
    that is not a software driver; a ValueError names the adapters.
    """

    def __new__(cls, name: str | None) -> Gpu: ...
    @property
    def name(self) -> str:
        """The name of the adapter."""
    @property
    def limits(self) -> tuple[int, int, int]:
        """Threads of a workgroup, bytes of the largest buffer, bytes of the largest volume."""
    def search(self, numbers: Sequence[int], left: bytes, right: bytes, pixels: bytes) -> bytes:
        """Return the words that the kernels find for a task of phasestereo.

        A ValueError refuses sizes that are not those of the bytes. A RuntimeError says that the
        device has failed, or was opened before this process was forked: it stays so.
        """
