"""The parts of the page "try it", put together for the documentation, or into a folder.

``python docs/try_page.py FOLDER`` writes it. Its viewer is the report page's: the same templates,
styles and scripts of the package, and the same colors.
"""

from __future__ import annotations

import sys
from pathlib import Path

import phasestereo
from phasestereo.views.page.blank import blank_viewer, viewer_script
from phasestereo.views.templating import render_page

WEB = Path(__file__).resolve().parent.parent / "web"

CORE = "phasestereo.wasm"
"""Built by ``make web``; without it the page says that there is no matcher."""


def contents() -> dict[str, bytes]:
    """Return the files of the page by name."""
    version = f"phasestereo {phasestereo.__version__}"
    index = render_page("index.html.j2", package=WEB, version=version, **blank_viewer(truth=True))
    beside = [*WEB.glob("*.js"), *WEB.glob(CORE)]
    files = {path.name: path.read_bytes() for path in sorted(beside)}
    return {"index.html": index.encode(), "viewer.js": viewer_script().encode(), **files}


def main(folder: Path) -> None:
    """Write the page into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents().items():
        (folder / name).write_bytes(content)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
