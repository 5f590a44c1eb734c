"""HITNet's ONNX file as it was published, and the licenses of others.

No weights come with this package: they are given by path. `phasestereo.matchers.onnx` runs them.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from phasestereo.matchers.onnx import opened

HITNET_SHA256 = "5dcb177e76698e773c7c31404a5b62b08723f954016446c2d9765a78d1b8a3b9"
"""Of the ONNX file of HITNet's weights for ETH3D (Tankovich et al., CVPR 2021; Google Research)."""


def require_hitnet(path: str) -> None:
    """Refuse any file but HITNet's.

    Raises
    ------
    OSError
        If there is no such file.
    ValueError
        If its SHA-256 is another one.
    """
    digest = digest_of(path)
    if digest != HITNET_SHA256:
        raise ValueError(
            f"hitnet: {path} has the SHA-256 {digest}, not {HITNET_SHA256}, which the figures of "
            f"this benchmark are of; onnx:{path} takes any other network"
        )


def license_of(path: str) -> str:
    """Return the license of a network: what its file says, or the first line of one beside it."""
    said = opened(path, threads=1).get_modelmeta().custom_metadata_map
    texts = (file.read_text("utf-8", "replace") for file in Path(path).parent.glob("LICENSE*"))
    lines = (line.strip() for text in texts for line in text.splitlines() if line.strip())
    return str(said.get("license") or next(lines, "not said: ask who trained it"))


@lru_cache(4)
def digest_of(path: str) -> str:
    """Return the SHA-256 of a file, as hexadecimal digits; OSError if it is missing."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
