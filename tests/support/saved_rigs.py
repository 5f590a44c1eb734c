"""Saved rigs that tests change."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def with_raw_cameras(path: Path, size: tuple[int, int]) -> str:
    """Return the text of a saved rig as if its images of this size were raw."""
    state = json.loads(path.read_text("utf-8").split("\n")[1])
    numbers: dict[str, Any] = {"numbers": [0.0] * 14, "spreads": [0.1] * 14}
    cameras = numbers | {"size": list(size), "shifts": [[0.0, 0.0], [0.0, 0.0]]}
    found: dict[str, Any] = dict.fromkeys(("rows", "rms", "error", "moved"), 0.1)
    found |= {"cameras": cameras, "matches": [90, 80], "blocks": 70, "disparities": [1.0, 2.0, 3.0]}
    found |= {"pairs": 1, "is_inverted": False, "distortion": [[0.0, 1.0], [0.0, 1.0]]}
    state["geometry"]["cameras"] = {"rectification": found, "size": list(size)}

    return sealed(json.dumps(state))


def sealed(body: str) -> str:
    """Return the text of a saved rig with a checksum that is right."""
    digest = 0xCBF29CE484222325  # FNV-1a
    for byte in body.encode():
        digest = (digest ^ byte) * 0x100000001B3 % 2**64
    return f"phasestereo rig 2 {digest:016x}\n{body}\n"
