"""The crates: what each may import, its floors, and the size of the interface."""

import re
import tomllib
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from support import ROOT

RUST = ROOT / "rust"
MOST_PUBLIC = 32  # types, traits and aliases at the root of the core
BELOW = {
    "match": {"libm", "ndarray", "phasestereo-leveled", "rayon", "thiserror"},
    "core": {"libm", "ndarray", "phasestereo-match", "rayon", "serde", "serde_json", "thiserror"}
    | {"image"},  # optional
}
FLOORS = {
    "match": "base choices settings image pair descriptor cost optimization refinement matcher",
    "core": "finding estimation rectification findings scales "
    "match_pair preparation verification video interface",
}
"""Folders of each crate, from the ground up. What is not among them, as ``lib``, may import all."""


def code(file: Path) -> str:
    """Return the code of a file without comments and unit tests."""
    text = file.read_text("utf-8").split("#[cfg(test)]\nmod tests")[0]
    return re.sub(r"//.*", "", text)


def files(crate: str) -> dict[str, Path]:
    """Return the files of a crate by their module paths."""
    source = RUST / crate / "src"
    found = sorted(source.rglob("*.rs"))
    return {"::".join(f.relative_to(source).with_suffix("").parts): f for f in found}


def uses(crate: str) -> dict[str, set[str]]:
    """Return, for each module, the modules of its crate that its code names."""
    there = files(crate)
    return {name: {*named(name, code(file), {*there})} - {name} for name, file in there.items()}


def named(module: str, text: str, there: set[str]) -> Iterator[str]:
    for path in re.findall(r"\b(?:crate|self|super)(?:::\w+)+(?:::\{[^;]*\})?", text):
        for start, *steps in (one.split("::") for one in leaves(re.sub(r"\s+", "", path))):
            above = {"crate": [], "self": module.split("::"), "super": module.split("::")[:-1]}
            parts = [*above[start], *steps]
            names = ("::".join(parts[:count]) for count in range(len(parts), 0, -1))
            yield from [name for name in names if name in there][:1]


def leaves(tree: str) -> list[str]:
    """Return the paths of a tree such as ``a::{b,c::{d,e}}``."""
    while found := re.search(r"([\w:]*)\{([^{}]*)\}", tree):
        inner = ",".join(found[1] + one for one in found[2].split(",") if one)
        tree = tree[: found.start()] + inner + tree[found.end() :]
    return tree.split(",")


@pytest.mark.parametrize("crate", FLOORS)
def test_folders_import_of_lower_floors(crate: str) -> None:
    floor = {name: number for number, name in enumerate(FLOORS[crate].split())}
    rooms = (
        (module.split("::")[0], other.split("::")[0])
        for module, others in uses(crate).items()
        for other in others
    )
    upward = {(crate, a, b) for a, b in rooms if a in floor and floor[a] < floor.get(b, -1)}
    assert upward == set()


@pytest.mark.parametrize("crate", BELOW)
def test_no_files_import_each_other(crate: str) -> None:
    """But for a module and its submodules, which are one."""
    graph = {
        module: {
            o
            for o in others
            if not (f"{o}::".startswith(f"{module}::") or module.startswith(f"{o}::"))
        }
        for module, others in uses(crate).items()
    }
    TopologicalSorter(graph).prepare()  # raises CycleError


def test_costs_are_named_in_their_table_alone() -> None:
    sites = {
        (crate, name)
        for crate in BELOW
        for name, f in files(crate).items()
        if "CostKind::" in code(f)
    }
    assert {name for _, name in sites} == {"cost", "settings", "settings::table"}


@pytest.mark.parametrize("crate", BELOW)
def test_a_crate_knows_those_below_it_alone(crate: str) -> None:
    manifest = tomllib.loads((RUST / crate / "Cargo.toml").read_text("utf-8"))
    assert set(manifest["dependencies"]) == BELOW[crate]

    sources = [file.read_text("utf-8") for file in files(crate).values()]
    assert len(sources) > 50
    assert not [text for text in sources if re.search(r"dead_code|extern \"C\"|pyo3", text)]


def test_nothing_but_its_own_crate_needs_a_gpu() -> None:
    manifests = {
        path.parent.name: tomllib.loads(path.read_text("utf-8")).get("dependencies", {})
        for path in RUST.glob("*/Cargo.toml")
    }
    assert {name for name, found in manifests.items() if "wgpu" in found} == {"gpu"}
    assert not [name for name, found in manifests.items() if "phasestereo-gpu" in str(found)]
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"]
    assert "rust/gpu" not in workspace["default-members"]


def test_the_interface_of_the_core_is_small() -> None:
    root = (RUST / "core" / "src" / "lib.rs").read_text("utf-8")
    exported = " ".join(re.findall(r"^pub use ([^;]+);", root, re.MULTILINE))
    names = re.findall(r"\b[A-Z]\w+", exported)

    assert {"Error", "Image", "Match", "Matcher", "Settings"} <= set(names)
    assert len(names) <= MOST_PUBLIC


def test_the_c_interface_is_made_of_the_interface_of_the_core() -> None:
    sources = [file.read_text("utf-8") for file in (RUST / "c/src").glob("*.rs")]
    assert not [text for text in sources if "internals" in text]
