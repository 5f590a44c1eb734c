"""Identifies HITNet's published ONNX file, and reads the licenses of other networks.

This package contains no weights: users give their path. `phasestereo.matchers.onnx` runs them.
"""

import hashlib
from functools import lru_cache
from pathlib import Path

from phasestereo.matchers.onnx import opened

HITNET_SHA256 = "5dcb177e76698e773c7c31404a5b62b08723f954016446c2d9765a78d1b8a3b9"
"""Digest of the ONNX file of HITNet's weights for ETH3D (Tankovich et al., CVPR 2021; Google
Research)."""


def require_hitnet(path: str) -> None:
    """Refuse any file but HITNet's.

    Raises
    ------
    OSError
        If there is no such file.
    ValueError
        If the file has another SHA-256.
    """
    digest = digest_of(path)
    if digest != HITNET_SHA256:
        raise ValueError(
            f"hitnet: {path} has the SHA-256 {digest}, not {HITNET_SHA256}, which the figures of "
            f"this benchmark are of; onnx:{path} takes any other network"
        )


def license_of(path: str) -> str:
    """Return a network's license from its file, or the first line of a license file beside it."""
    said = opened(path, threads=1).get_modelmeta().custom_metadata_map
    texts = (file.read_text("utf-8", "replace") for file in Path(path).parent.glob("LICENSE*"))
    lines = (line.strip() for text in texts for line in text.splitlines() if line.strip())
    return str(said.get("license") or next(lines, "not said: ask who trained it"))


@lru_cache(4)
def digest_of(path: str) -> str:
    """Return the SHA-256 of a file in hexadecimal digits; raise OSError if the file is missing."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
