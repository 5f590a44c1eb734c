"""What the build of this documentation does besides its plug-ins: see `hooks` in mkdocs.yml.

Importing `pictures` here, beside this file, is what lets the examples of the pages import it. They
render their scenes, as a user would; the build renders each once.
"""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pictures  # the examples that the build runs ask for it, too
import try_page
from mkdocs.structure.files import File

from phasestereo_bench import rendering

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

rendering.render_pair = cache(rendering.render_pair)

ROOT_PAGES = ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
"""Documents in the folder above, which are pages, too."""


LIVE_PAGE = "live/pair.html"
"""Where the home page finds the report page of the demo's pair."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Link to the repository, where ``pyproject.toml`` names one."""
    text = (Path(config.docs_dir).parent / "pyproject.toml").read_text(encoding="utf-8")
    url = tomllib.loads(text)["project"]["urls"]["Source"]
    if "/OWNER/" not in url:  # which a release fills in
        config.repo_url, config.repo_name = url, config.site_name
    return config


def on_page_markdown(markdown: str, **_: object) -> str:
    """Lead links to names of ``api.md`` to whichever page of the interface describes them."""
    return re.sub(r"\]\((?:\.\./)?api\.md#([\w.]+)\)", r"][\1]", markdown)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the documents of the folder above, the live report page, and the page "try it"."""
    for name in ROOT_PAGES:
        text = (Path(config.docs_dir).parent / name).read_text(encoding="utf-8")
        page = re.sub(r"\]\(docs/", "](", text)
        page = re.sub(r"\]\(([A-Z]+\.md)", lambda link: link[0].lower(), page)
        files.append(File.generated(config, name.lower(), content=page))
    files.append(File.generated(config, LIVE_PAGE, content=pictures.live_page()))
    for name, content in try_page.contents().items():
        files.append(File.generated(config, f"try/{name}", content=content))
    return files
