"""Pairs that are made, and digests of their matches, which are the same on every platform."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from phasestereo.result import Result

ROWS, COLS = 120, 160
DIGESTS = {
    ("sharp", "robust"): "35dcba0e6296e235c66d5713c0d4c2c7",
    ("sharp", "fast"): "32204870ff172e9b878cf479fc5a83c6",
    ("sharp", "paper"): "81fe2a05575f3b8f08df9f5c0ccc2174",
    ("defocus", "robust"): "8942208fa60a54dbbb6363fb53858873",
    ("defocus", "fast"): "d4b759e6cdcaf121ee4f44ef4ef693ad",
    ("defocus", "paper"): "4993b251a7192cb107794f2384a7d320",
    ("motion", "robust"): "bdeb4246e7627366faa09dcd21a9c236",
    ("noise", "robust"): "e732ee5f37b1592d8b3a8cae1583961c",
    ("rows", "robust"): "32dad6bceec1bfcc4a697808a69a5b06",
    ("floats", "robust"): "4ccaef9238c39d58d5102c99ea2e6a84",
}
"""Of disparities, flags, confidences and error bars, by pair and preset."""


def noise(rows: int, cols: int, seed: int) -> NDArray[np.int64]:
    """Return bytes of a hash of the place: NumPy's generators may change between versions."""
    y, x = np.indices((rows, cols)).astype(np.uint32)
    state = (y * np.uint32(73_856_093)) ^ (x * np.uint32(19_349_663)) ^ np.uint32(seed * 83_492_791)
    for _ in range(2):
        state = (state ^ (state >> np.uint32(15))) * np.uint32(0x2C1B_3C6D)
    top: NDArray[np.int64] = (state >> np.uint32(24)).astype(np.int64)
    return top


def box(image: NDArray[np.int64], rows: int, cols: int) -> NDArray[np.int64]:
    """Return means of so many rows and columns, in integers."""
    height, width = image.shape
    padded = np.pad(image, ((rows // 2,) * 2, (cols // 2,) * 2), mode="edge")
    total = np.zeros_like(image)
    for y, x in np.ndindex(rows, cols):
        total += padded[y : y + height, x : x + width]
    return total // (rows * cols)


def scene() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return a square 11 pixels in front of a wall at 5, with coarse and fine texture."""
    coarse = box(noise(ROWS, COLS + 32, 1), 7, 7) * 4 - 384
    texture = np.clip((coarse + noise(ROWS, COLS + 32, 2)) // 2, 0, 255)
    left, right = texture[:, :COLS].copy(), texture[:, 5 : COLS + 5].copy()

    front = np.clip(noise(50, 60, 3) // 2 + box(noise(50, 60, 4), 5, 5), 0, 255)
    left[35:85, 60:120], right[35:85, 49:109] = front, front
    return left, right


def pair(kind: str) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
    """Return the scene as two cameras of some rig take it."""
    left, right = scene()

    if kind == "defocus":
        left = box(box(left, 5, 5), 3, 3)
    elif kind == "motion":
        right = box(right, 1, 9)
    elif kind == "noise":
        left, right = (
            np.clip(view + (noise(ROWS, COLS, seed) - 128) // 12, 0, 255)
            for seed, view in enumerate((left, right), 5)
        )
    elif kind == "rows":
        right = np.roll(right, 1, axis=0)
    elif kind == "floats":
        color = np.stack([left, left // 2, 255 - left], axis=2)
        other = np.stack([right, right // 2, 255 - right], axis=2)
        return color.astype(np.float32) / 256, other.astype(np.float32) / 512

    return left.astype(np.uint8), right.astype(np.uint8)


def digest(result: Result) -> str:
    """Return the first half of the SHA-256 of all maps, little-endian as they are stored."""
    found = hashlib.sha256()
    for plane in (result.disparity, result.flags, result.confidence, result.uncertainty):
        if plane is not None:
            found.update(plane.astype(plane.dtype.newbyteorder("<")).tobytes())
    return found.hexdigest()[:32]
