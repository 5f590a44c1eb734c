"""Make a checkout ready for a release: package pages are read far from the repository.

python .ci/release.py [URL]

writes the address of the repository (default: Source in pyproject.toml, the place to fill in) into
all that is published, makes the links of READMEs absolute, and puts ``pip install`` before the
commands of a clone. For each release a copy of the repository is changed, never the repository.
"""

from __future__ import annotations

import posixpath
import re
import sys
import tomllib
from pathlib import Path

INSTALL = """```sh
pip install phasestereo                # needs NumPy alone
pip install 'phasestereo[cli,report]'    # with the command line and pictures
```

From a clone of [the repository]({url}):
"""
CLONE = re.compile(r"<!-- clone -->\n(.*?)<!-- /clone -->\n\n", re.DOTALL)
URLS = re.compile(r"\[project\.urls\]\n(?:.+\n)*")
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)]+)\)")


def prepare(root: Path, url: str | None = None) -> None:
    """Change the files of a checkout."""
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    workspace = tomllib.loads((root / "Cargo.toml").read_text("utf-8"))["workspace"]
    url = (url or project["urls"]["Source"]).rstrip("/")
    tag = f"v{workspace['package']['version']}"

    addresses = f"""[project.urls]
Source = "{url}"
Documentation = "{url}/blob/{tag}/docs/index.md"
Changelog = "{url}/blob/{tag}/CHANGELOG.md"
Issues = "{url}/issues"
"""
    for path in [root / "pyproject.toml", *root.glob("*/*/pyproject.toml")]:
        rest = URLS.sub("", path.read_text("utf-8"))
        path.write_text(f"{rest.rstrip()}\n\n{addresses}", "utf-8")

    for path, section, line in [
        (root / "Cargo.toml", "[workspace.package]\n", f'repository = "{url}"\n'),
        *(
            (path, "[package]\n", "repository.workspace = true\n")
            for path in sorted(root.glob("rust/*/Cargo.toml"))
        ),
    ]:
        text = path.read_text("utf-8")
        path.write_text(text.replace(section, section + line), "utf-8")

    for path in [root / "README.md", *root.glob("*/*/README.md")]:
        folder = path.parent.relative_to(root).as_posix()
        text = page(path.read_text("utf-8"), url)
        path.write_text(absolute(text, folder, url, tag), "utf-8")


def page(text: str, url: str) -> str:
    """Return a README whose first commands are those of a user without a clone."""
    first = CLONE.sub(lambda found: f"{INSTALL.format(url=url)}\n{found[1]}\n", text, count=1)
    return CLONE.sub("", first)


def absolute(text: str, folder: str, url: str, tag: str) -> str:
    """Return a README with its links as addresses: pages, and the bytes of pictures."""

    def link(found: re.Match[str]) -> str:
        mark, words, target = found.groups()
        if "://" in target or target.startswith("#"):
            return found[0]
        path = posixpath.normpath(posixpath.join(folder, target))
        return f"{mark}[{words}]({url}/{'raw' if mark else 'blob'}/{tag}/{path})"

    return LINK.sub(link, text)


if __name__ == "__main__":
    prepare(Path.cwd(), *sys.argv[1:])
