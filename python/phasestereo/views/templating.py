"""Self-contained HTML pages: one file each, without other files or a network.

A page is a Jinja2 template (the extra ``report``) on top of ``base.html.j2``, which holds the
style; the caller supplies the content.
"""

from __future__ import annotations

import base64
import mimetypes
from importlib import resources
from pathlib import Path
from typing import Any

from phasestereo._extras import require
from phasestereo.io.files import StrPath, suffix


def check_page_path(path: StrPath) -> None:
    """Raise a ValueError for a file without the suffix of a page."""
    if suffix(path) not in (".html", ".htm"):
        raise ValueError(f"path must end in .html or .htm, got {suffix(path)!r}")


def render_page(template: str, *, package: str | Path = "phasestereo.views", **context: Any) -> str:
    """Render a template.

    Parameters
    ----------
    template
        Name of its file in the folder ``templates`` of the package.
    package
        Its package, or its folder. Templates of any package can use those of this one.
    **context
        All names that the template refers to. Text is escaped; the filter ``embedded`` turns the
        path of an image into the image itself, as `data_uri` does; the function ``source`` returns
        a file of our folder ``templates`` unchanged, such as a script.

    Returns
    -------
    str
        The page.

    Raises
    ------
    ImportError
        If Jinja2 is not installed.
    OSError
        If an image cannot be read.
    """
    jinja2 = require("jinja2", extra="report")
    own = jinja2.FileSystemLoader if isinstance(package, Path) else jinja2.PackageLoader
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([own(package), jinja2.PackageLoader("phasestereo.views")]),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )

    environment.filters["embedded"] = data_uri
    environment.globals["source"] = _source
    return environment.get_template(template).render(context)


def _source(name: str) -> Any:
    """Return a file of the templates' folder unchanged, marked as markup."""
    text = (resources.files("phasestereo.views") / "templates" / name).read_text("utf-8")
    return require("markupsafe", extra="report").Markup(text)


def data_uri(path: str | Path) -> str:
    """Return a whole file as a data URI; its suffix gives its media type.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If the suffix is unknown.
    """
    media_type, _ = mimetypes.guess_type(Path(path).name)
    if media_type is None:
        raise ValueError(f"path: got {path}; accepts files whose suffix gives their media type")

    return f"data:{media_type};base64,{base64.b64encode(Path(path).read_bytes()).decode()}"
