"""A matcher in OpenCV's FileStorage; the C++ header reads and writes the same format."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

NAME = "StereoMatcher.Phase"
"""The mark of an object of this kind in a file."""

STORED = (
    "minDisparity",
    "numDisparities",
    "blockSize",
    "P1",
    "P2",
    "disp12MaxDiff",
    "preFilterCap",
    "uniquenessRatio",
    "speckleWindowSize",
    "speckleRange",
    "mode",
)
"""The stored parameters: those of ``StereoSGBM``."""

_WORDS = {"none": None, "true": True, "false": False}  # as C++ may have them


def as_text(settings: Mapping[str, Any]) -> str:
    """Return settings as ``median=0; fill=True``: one string, whose words no parser interprets."""
    return "; ".join(f"{name}={value}" for name, value in settings.items())


def from_node(node: Any) -> tuple[dict[str, int], str | None, dict[str, Any] | None]:
    """Return the parameters, the preset and the settings in a ``cv2.FileNode``.

    Raises
    ------
    ValueError
        If the node is not that of a `StereoPhase`.
    """
    kind = node.getNode("name").string() if node.isMap() else ""
    if kind != NAME:
        raise ValueError(f"fn: got an object {kind!r}; accepts one of {NAME!r}")

    found = {name: node.getNode(name) for name in (*STORED, "preset", "settings")}
    there = {name: one for name, one in found.items() if not one.empty()}
    values = {name: int(there[name].real()) for name in STORED if name in there}
    preset = there["preset"].string() if "preset" in there else None
    settings = _settings(there["settings"].string()) if "settings" in there else None
    return values, preset, settings


def _settings(text: str) -> dict[str, Any]:
    parts = (part.partition("=") for part in text.split(";") if part.strip())
    return {name.strip(): as_value(value.strip()) for name, _, value in parts}


def as_value(text: str) -> Any:
    """Return a number, a pair, a boolean or None as such, any other word unchanged."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
