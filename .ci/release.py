"""Make a checkout ready for a release: package pages are read far from the repository.

python .ci/release.py [--tag TAG] [URL]

checks that all that is published has the version of the tag and that the changelog has it. Then it
writes the address of the repository (default: Source in pyproject.toml, the place to fill in) into
all that is published, makes the links of READMEs absolute, replaces the commands of a clone by
those of pip, and gives each published crate its license and the versions of our other crates. For
each release a copy of the repository is changed, never the repository.
"""

from __future__ import annotations

import argparse
import posixpath
import re
import shutil
import sys
import tomllib
from pathlib import Path

INSTALL = """```sh
pip install 'phasestereo[cli,report]'   # with the command line and pictures
pip install phasestereo                 # needs NumPy alone
```

"""
CLONE = re.compile(r"<!-- clone -->\n(.*?)<!-- /clone -->\n\n", re.DOTALL)
URLS = re.compile(r"\[project\.urls\]\n(?:.+\n)*")
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)]+)\)")


def check(root: Path, tag: str) -> None:
    """Exit unless the tag, the versions and the changelog agree."""
    version = workspace(root)["package"]["version"]
    found = {"the tag": tag.removeprefix("v"), "Cargo.toml": version}
    for path in sorted(root.glob("python/*/pyproject.toml")):
        text = path.read_text("utf-8")
        found[path.relative_to(root).as_posix()] = tomllib.loads(text)["project"]["version"]
        found |= {f"{path}: {one}": one for one in re.findall(r"phasestereo\S*==([\d.]+)", text)}
    if {*found.values()} != {version}:
        sys.exit(f"versions differ: {found}")

    heading = rf"^## {re.escape(version)} - \d{{4}}-\d\d-\d\d$"
    if not re.search(heading, (root / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE):
        sys.exit(f"CHANGELOG.md has no heading '## {version} - YYYY-MM-DD'")


def prepare(root: Path, url: str | None = None) -> None:
    """Change the files of a checkout."""
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    url = (url or project["urls"]["Source"]).rstrip("/")
    version = workspace(root)["package"]["version"]
    tag = f"v{version}"

    addresses = f"""[project.urls]
Source = "{url}"
Documentation = "{url}/blob/{tag}/docs/index.md"
Changelog = "{url}/blob/{tag}/CHANGELOG.md"
Issues = "{url}/issues"
"""
    for path in [root / "pyproject.toml", *root.glob("python/*/pyproject.toml")]:
        rest = URLS.sub("", path.read_text("utf-8"))
        path.write_text(f"{rest.rstrip()}\n\n{addresses}", "utf-8")

    for path in [root / "README.md", *root.glob("*/*/README.md")]:
        folder = path.parent.relative_to(root).as_posix()
        text = page(path.read_text("utf-8"))
        path.write_text(absolute(text, folder, url, tag), "utf-8")

    prepare_crates(root, url, version)


def prepare_crates(root: Path, url: str, version: str) -> None:
    """Give published crates an address, a license, and our crates that they need by version."""
    path = root / "Cargo.toml"
    text = path.read_text("utf-8").replace(
        "[workspace.package]\n", f'[workspace.package]\nrepository = "{url}"\n'
    )
    ours = r'^(phasestereo[\w-]* = \{ path = "[^"]+")(?:, version = "[^"]+")?'
    path.write_text(re.sub(ours, rf'\1, version = "={version}"', text, flags=re.MULTILINE), "utf-8")

    for manifest in root.glob("rust/*/Cargo.toml"):
        text = manifest.read_text("utf-8")
        if "publish = false" not in text:
            text = text.replace("[package]\n", "[package]\nrepository.workspace = true\n")
            manifest.write_text(text, "utf-8")
            if not (manifest.parent / "LICENSE").exists():
                shutil.copy(root / "LICENSE", manifest.parent)


def workspace(root: Path) -> dict[str, dict[str, str]]:
    """Return the table of the workspace in Cargo.toml."""
    found: dict[str, dict[str, str]] = tomllib.loads((root / "Cargo.toml").read_text("utf-8"))[
        "workspace"
    ]
    return found


def page(text: str) -> str:
    """Return a README whose first commands are those of a user without a clone."""
    return CLONE.sub("", CLONE.sub(INSTALL, text, count=1))


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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tag", help="of the release, such as v0.1.0")
    parser.add_argument("url", nargs="?")
    given = parser.parse_args()
    if given.tag:
        check(Path.cwd(), given.tag)
    prepare(Path.cwd(), given.url)
