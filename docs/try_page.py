"""The page "try it": what it is made of, put together for the documentation, or into a folder.

``python docs/try_page.py FOLDER`` writes it. Its viewer is the report page's: the same templates,
styles and scripts of the package, and the same colors.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

import phasestereo
from phasestereo.result import Flag, Result
from phasestereo.settings import Settings
from phasestereo.views.page import facts, layers
from phasestereo.views.templating import render_page

WEB = Path(__file__).resolve().parent.parent / "web"
SCRIPTS = "data", "stage", "viewer", "readout", "measure", "scene"
"""Parts of the viewer that the report page has, too; it fills its maps by others."""

CORE = "phasestereo.wasm"
"""Built by ``make web``; without it the page says that there is no matcher."""


def contents() -> dict[str, bytes]:
    """Return the files of the page by name."""
    templates = resources.files("phasestereo.views") / "templates"
    viewer = "\n".join((templates / f"pair.{part}.js").read_text("utf-8") for part in SCRIPTS)
    page = {
        "index.html": _index(),
        "viewer.js": f'"use strict";\n{viewer}const stage = new Stage(element("stage"), 4, 3);\n',
    }
    files = {name: text.encode() for name, text in page.items()}
    beside = [*WEB.glob("*.js"), *WEB.glob(CORE)]
    return files | {path.name: path.read_bytes() for path in sorted(beside)}


def _index() -> str:
    """Return the page itself: the viewer is described as that of a match of two rendered images."""
    result = _any_result()
    truth = result.disparity
    maps = layers.layers_of(result, truth)
    views = layers.views(maps)
    readout = facts.readout(result, truth, exact=True, metric=True, gray=(False, False))
    page: dict[str, Any] = {
        "cols": 4,
        "rows": 3,
        "step": 1,
        "exact": True,
        "gray": {"left": False, "right": False},
        "views": views,
        "layers": [asdict(layer) for layer in maps],
        "flags": [],
        "kinds": [asdict(kind) for kind in layers.flag_kinds(result.flags)],
        "scene": {},
    }
    return render_page(
        "index.html.j2",
        package=WEB,
        own_style=(WEB / "style.css").read_text(encoding="utf-8"),
        version=f"phasestereo {phasestereo.__version__}",
        views=views,
        readout=readout,
        left=None,
        ends=None,
        page=page,
    )


def _any_result() -> Result:
    """Return a result that has every map and every flag, so that the page knows of all."""
    disparity = np.zeros((3, 4), dtype=np.float32)
    flags = np.zeros((3, 4), dtype=np.uint16)
    flags.ravel()[: len(Flag)] = [flag.value for flag in Flag]
    return Result(disparity, flags, disparity, Settings(), {}, uncertainty=disparity)


def main(folder: Path) -> None:
    """Write the page into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents().items():
        (folder / name).write_bytes(content)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
