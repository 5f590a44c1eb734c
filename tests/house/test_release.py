"""What is published: extras, entry points, licenses, package pages, and the workflows."""

import re
import shutil
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from support import ROOT

URL = "https://example.org/somebody/phasestereo"
FOLDERS = {
    "phasestereo": ROOT,
    "phasestereo-gpu": ROOT / "python/phasestereo-gpu",
    "phasestereo-live": ROOT / "python/phasestereo-live",
    "phasestereo-large": ROOT / "python/phasestereo-large",
}
"""The folder of each distribution that is published."""

HARNESS = ROOT / "benches/harness"
PROJECTS: dict[str, Any] = {
    folder.name: tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    for folder in [*FOLDERS.values(), HARNESS]
}
EXTRAS: dict[str, list[str]] = PROJECTS[ROOT.name]["optional-dependencies"]
VERSION = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"]["package"]["version"]
TAGGED = "--tag", f"v{VERSION}"


def extras(name: str) -> set[str]:
    """Return an extra and those that it is made of."""
    inner = re.findall(r"phasestereo\[([\w,]+)\]", " ".join(EXTRAS[name]))
    return {name}.union(*(extras(one) for one in ",".join(inner).split(",") if one))


def test_all_is_everything_and_what_is_named_is_an_extra() -> None:
    assert extras("all") == EXTRAS.keys() - {"gpu"}

    files = [*ROOT.glob("python/**/*.py"), ROOT / "README.md", *ROOT.glob("docs/**/*.md")]
    text = "\n".join(path.read_text("utf-8") for path in files)
    named = re.findall(r"pip install '?(?:phasestereo|\.)\[([\w,]+)\]", text)
    required = re.findall(r'\brequire\([^()]*extra="(\w+)"\)', text)
    assert len(named) > 5
    assert len(required) > 5
    assert {*",".join(named).split(","), *required} <= EXTRAS.keys()


def test_entry_points_are_there() -> None:
    cli = pytest.importorskip("phasestereo.cli")
    groups = [project.get("entry-points", {}) for project in PROJECTS.values()]
    commands = {
        name: place for group in groups for name, place in group.get(cli.COMMANDS, {}).items()
    }
    assert commands.keys() == cli.OTHERS.keys()

    for place in [
        place for group in groups for points in group.values() for place in points.values()
    ]:
        module, _, name = place.partition(":")
        if not module.endswith("pandora"):  # tests/integrations/test_pandora.py loads it
            assert getattr(import_module(module), name) if name else import_module(module)


def test_licenses_are_there_and_the_harness_is_not_published() -> None:
    for folder in FOLDERS.values():
        assert (folder / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    assert "Private :: Do Not Upload" in PROJECTS[HARNESS.name]["classifiers"]

    lock = tomllib.loads((ROOT / "Cargo.lock").read_text("utf-8"))["package"]
    versions = {f"{crate['name']} {crate['version']}" for crate in lock}
    for file, some in [
        ("rust/python/LICENSES.txt", {"pyo3", "rayon", "ndarray"}),
        ("python/phasestereo-gpu/LICENSES.txt", {"pyo3", "rayon", "wgpu", "naga"}),
    ]:
        listed = (ROOT / file).read_text("utf-8")
        found = {*re.findall(r"^- (\S+ \S+)", listed, re.MULTILINE)}
        assert some <= {one.split()[0] for one in found}
        assert found <= versions, "make licenses"


def release(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Change a copy of what a release changes."""
    kept = [*ROOT.glob("*.toml"), *ROOT.glob("rust/*/Cargo.toml"), *ROOT.glob("rust/*/README.md")]
    pages = [place / name for place in FOLDERS.values() for name in ("pyproject.toml", "README.md")]
    for path in [*kept, *pages, ROOT / "LICENSE", ROOT / "CHANGELOG.md"]:
        copy = folder / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)

    changes = folder / "CHANGELOG.md"
    dated = changes.read_text("utf-8").replace("## Unreleased", f"## {VERSION} - 2026-12-01")
    changes.write_text(dated, "utf-8")
    return subprocess.run(  # noqa: S603  # our own script
        [sys.executable, str(ROOT / ".ci/release.py"), *arguments, f"{URL}/"],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("released")
    assert release(folder, *TAGGED).stderr == ""
    return folder


def test_a_tag_of_another_version_is_refused(tmp_path: Path) -> None:
    finished = release(tmp_path, "--tag", "v9.9.9")
    assert finished.returncode == 1
    assert finished.stderr.startswith("versions differ: {'the tag': '9.9.9', 'Cargo.toml': ")


@pytest.mark.parametrize("name", FOLDERS)
def test_a_package_page_has_addresses_of_files(released: Path, name: str) -> None:
    folder = released / FOLDERS[name].relative_to(ROOT)
    project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    page = (folder / "README.md").read_text("utf-8")
    addresses = [*project["urls"].values(), *re.findall(r"\]\(([^)]+)\)", page)]
    assert all(address.startswith("https://") for address in addresses)
    assert "pip install" in page
    assert "make demo" not in page

    for address in addresses:
        if address.startswith(f"{URL}/") and not address.endswith("/issues"):
            kind, tag, *parts = address.removeprefix(f"{URL}/").partition("#")[0].split("/")
            assert kind == ("raw" if parts[-1].endswith((".jpg", ".svg")) else "blob")
            assert tag == TAGGED[1]
            assert ROOT.joinpath(*parts).exists(), address


def test_a_published_crate_says_where_it_is_from(released: Path) -> None:
    manifest = tomllib.loads((released / "Cargo.toml").read_text("utf-8"))["workspace"]
    assert manifest["package"]["repository"] == URL
    ours = [need for need in manifest["dependencies"].values() if "path" in need]
    assert ours
    assert all(need["version"] == f"={VERSION}" for need in ours)
    for need in ours:
        crate = tomllib.loads((released / need["path"] / "Cargo.toml").read_text("utf-8"))
        assert crate["package"]["repository"] == {"workspace": True}
        assert (released / need["path"] / "LICENSE").is_file()


def test_workflows_pin_actions_and_run_what_is_there() -> None:
    targets = re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    for path in (ROOT / ".github/workflows").glob("*.yml"):
        text = path.read_text("utf-8")
        for used in re.findall(r"uses: (.+)", text):
            assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v\d\S*", used), (path, used)
        ran = re.findall(
            r"(?:python|run:|/io/|PREPARE:)\s*((?:tests|\.ci|benches|web)/[\w./]+)", text
        )
        assert [name for name in ran if not (ROOT / name).exists()] == []
        assert {*re.findall(r"(?:run: |\|\| |sh -c \")make ([a-z][\w-]+)", text)} <= {*targets}
