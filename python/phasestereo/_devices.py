"""Devices that search instead of the processor: GPUs, through the package phasestereo-gpu."""

from __future__ import annotations

from typing import Protocol

from phasestereo._extras import require

ACCEPTS = "'auto', 'cpu', 'gpu' or a part of the name of an adapter"


class Device(Protocol):
    """The object to which the core hands its searches."""

    @property
    def name(self) -> str:
        """The name of the adapter."""

    @property
    def limits(self) -> tuple[int, int, int]:
        """Threads of a workgroup, bytes of the largest buffer, bytes of the largest volume."""

    def search(self, numbers: list[int], left: bytes, right: bytes, pixels: bytes) -> bytes:
        """Return the words that the kernels find for a task: 3 words of 4 bytes per pixel.

        Parameters
        ----------
        numbers
            The 20 numbers of the kernels' structure ``Task``.
        left, right
            The phase codes of the rows.
        pixels
            For each pixel, the jumps from its neighbors and its version of the right image.
        """


def opened(device: str) -> Device | None:
    """Open the device that searches instead of the processor; None: the processor searches.

    Parameters
    ----------
    device
        As `phasestereo.match` takes it.

    Raises
    ------
    TypeError
        If it is not a string.
    ValueError
        If no adapter has that name, or the adapter cannot be opened.
    ImportError
        If phasestereo-gpu is not installed; all values but "cpu" and "auto" need it.
    """
    if not isinstance(device, str):
        raise TypeError(f"device: got {type(device).__name__}; accepts {ACCEPTS}")
    if not device:
        raise ValueError(f"device: got ''; accepts {ACCEPTS}")
    if device == "cpu":
        return None
    try:
        gpus = require("phasestereo_gpu", extra="gpu")
        found: Device = gpus.Gpu(None if device in ("auto", "gpu") else device)
    except (ImportError, ValueError):
        if device == "auto":
            return None
        raise
    return found
