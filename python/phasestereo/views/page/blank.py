"""The viewer without a result: the start of pages that show one result after another."""

from __future__ import annotations

from dataclasses import asdict
from importlib import resources
from typing import Any

import numpy as np

from phasestereo.result import Flag, Result
from phasestereo.settings import Settings
from phasestereo.views.page import facts, layers

_PARTS = "data", "stage", "viewer", "readout", "measure", "scene", "results"
"""Scripts shared with the report page, and the script that takes a result."""


def blank_viewer(*, truth: bool) -> dict[str, Any]:
    """Return all names in the templates of the viewer; ``truth``: whether a truth may be known."""
    disparity = np.zeros((4, 4), dtype=np.float32)
    flags = np.zeros((4, 4), dtype=np.uint16)
    flags.ravel()[: len(Flag)] = [flag.value for flag in Flag]
    result = Result(disparity, flags, disparity, Settings(), {}, uncertainty=disparity)

    known = disparity if truth else None
    maps = layers.layers_of(result, known)
    views = layers.views(maps)
    return {
        "views": views,
        "readout": facts.readout(result, known, exact=True, metric=True, gray=(False, False)),
        "left": None,
        "ends": None,
        "page": {
            "cols": 4,
            "rows": 4,
            "step": 1,
            "exact": True,
            "gray": {"left": False, "right": False},
            "views": views,
            "layers": [asdict(layer) for layer in maps],
            "flags": [],
            "kinds": [asdict(kind) for kind in layers.flag_kinds(flags)],
            "scene": {},
        },
    }


def viewer_script() -> str:
    """Return the script of such a page; the script that drives it follows."""
    folder = resources.files("phasestereo.views") / "templates"
    parts = "\n".join((folder / f"pair.{part}.js").read_text("utf-8") for part in _PARTS)
    return f'"use strict";\n{parts}const stage = new Stage(element("stage"), 4, 4);\n'
