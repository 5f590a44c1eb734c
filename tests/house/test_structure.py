"""The structure of the distributions, and the sizes of the wheels and of the documentation.

Structure is fixed. Sizes are bounded 5 % above their values at the last release; the bounds are set
again at each release. Tests, the harness and the lines of Rust are not bounded.

Every import counts, inside functions and under ``TYPE_CHECKING``, too. That a package is imported
with each of its modules does not. ``pytest -s`` prints the figures.
"""

from __future__ import annotations

import ast
import platform
import re
import sys
from functools import partial
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from phasestereo import _core

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROOT = Path(__file__).parents[2]

DISTRIBUTIONS = {
    "phasestereo": "python",
    "phasestereo_live": "python/phasestereo-live",
    "phasestereo_large": "python/phasestereo-large",
    "phasestereo_bench": "benches/harness",
}
"""The folder of each package."""

BELOW = {
    "phasestereo": (),
    "phasestereo_live": ("phasestereo",),
    "phasestereo_large": ("phasestereo",),
    "phasestereo_bench": ("phasestereo", "phasestereo_live", "phasestereo_large"),
}
"""What each may import of the others."""

FLOORS = {
    "phasestereo": (
        "_core",  # in Rust
        "_extras _images _interrupts _numbers _tables settings shapes temporal",
        "io metrics",  # files, scores
        "_opening",  # of images that a caller names the files of
        "rig",  # what is found out of a pair
        "rectification result",
        "calibration known",  # by boards; of a pair, an earlier result too
        "matching stages",
        "opencv pandora rigs verification views",  # made of a result; stand-ins for matchers
        "walls",
        "",  # the package itself, which names all of the interface
        "cli",
        "__main__",
    ),
    "phasestereo_live": (
        "_closing",
        "video",
        "rerun ros viewer",  # where frames come from and go
        "cli",
        "",
    ),
    "phasestereo_large": (
        "locks processes records",
        "geotiff statistics zarr_folders",
        "bands windows xarray",
        "batch dask outofcore",
        "cli",
        "",
    ),
}
"""Rooms, modules or folders, from the ground up: each imports of lower floors alone."""

BOUNDS = {
    "files in a circle of imports": 0,
    "imports of the same or a higher floor": 0,
    "imports of another distribution than those below": 0,
    "own modules imported by a string": 0,
    "aliases at the boundary": 6,
    "public names": 120,
    "statements of phasestereo": 6_900,
    "statements of phasestereo_live": 2_400,
    "statements of phasestereo_large": 2_600,
    "words of documentation": 22_200,
}
"""The sizes are set again at each release, 5 % above the values of that day."""

WHEELS = ("phasestereo", "phasestereo_live", "phasestereo_large")

EXTENSION = 8.4
"""Megabytes."""


def modules() -> dict[str, ast.Module]:
    """Return the modules by their full names, packages by those of their folders."""
    found = {"phasestereo._core": ast.Module([], [])}
    for package, folder in DISTRIBUTIONS.items():
        for path in sorted((ROOT / folder / package).rglob("*.py")):
            *folders, name = path.relative_to(ROOT / folder).with_suffix("").parts
            parts = folders if name == "__init__" else [*folders, name]
            found[".".join(parts)] = ast.parse(path.read_text("utf-8"))
    return found


MODULES = modules()


def imports(tree: ast.Module) -> Iterator[str]:
    """Yield what a module imports of ours; of ``from package import module`` the module."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{name.name}" for name in node.names]

        for name in names:
            if package(name) in DISTRIBUTIONS:
                yield name if name in MODULES else name.rpartition(".")[0]


def package(module: str) -> str:
    return module.partition(".")[0]


def room(module: str) -> str:
    """Return the room of its package that a module is in: the one with the longest name."""
    top, _, inner = module.partition(".")
    rooms = " ".join(FLOORS[top]).split()
    return max((one for one in rooms if f"{inner}.".startswith(f"{one}.")), key=len, default="")


def floor(module: str) -> int:
    floors = enumerate(FLOORS[package(module)])
    return next(n for n, rooms in floors if room(module) in (rooms.split() or [""]))


def in_a_circle() -> list[str]:
    try:
        TopologicalSorter({name: {*imports(tree)} for name, tree in MODULES.items()}).prepare()
    except CycleError as error:
        return list(error.args[1])[1:]
    return []


def not_down() -> list[str]:
    return [
        f"{name} -> {other}"
        for name, tree in MODULES.items()
        for other in imports(tree)
        if package(name) == package(other) in FLOORS
        and room(name) != room(other)
        and floor(name) <= floor(other)
    ]


def not_below() -> list[str]:
    return [
        f"{name} -> {other}"
        for name, tree in MODULES.items()
        for other in imports(tree)
        if package(other) not in (package(name), *BELOW[package(name)])
    ]


def by_a_string() -> list[str]:
    return [
        f"{name}:{node.lineno}"
        for name, tree in MODULES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).endswith(("import_module", "__import__"))
        and ("phasestereo" in ast.unparse(node) or "__name__" in ast.unparse(node))
    ]


def statements(of: str) -> list[str]:
    """Return the module of each statement of a distribution; a docstring is none."""
    return [
        name
        for name, tree in MODULES.items()
        if package(name) == of
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    ]


def at_the_boundary() -> list[str]:
    """Return the aliases of types that the stub of the core has and imports, and those in Rust."""
    stub = ast.parse((ROOT / "python/phasestereo/_core.pyi").read_text("utf-8"))
    named = [
        f"{module}.{alias}"
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for module, tree in ((node.module, MODULES.get(str(node.module), stub)),)
        for alias in aliases(tree) & {name.name for name in node.names}
    ]
    rust = "\n".join(lines("rust/python", "*.rs"))
    tuples = re.findall(r"^(?:pub )?type (\w+).*=\s+\(", rust, re.MULTILINE)
    return [*aliases(stub), *named, *tuples]


def aliases(tree: ast.Module) -> set[str]:
    found = (node for node in tree.body if isinstance(node, ast.AnnAssign))
    return {ast.unparse(a.target) for a in found if ast.unparse(a.annotation) == "TypeAlias"}


def public_names() -> list[str]:
    """Return the names in ``__all__`` of the packages and of their folders, but for the harness."""
    return [
        f"{module}.{name}"
        for module, tree in MODULES.items()
        if package(module) in FLOORS and ".cli" not in module and is_folder(module)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        for name in ast.literal_eval(node.value)
    ]


def is_folder(module: str) -> bool:
    return (ROOT / DISTRIBUTIONS[package(module)] / module.replace(".", "/")).is_dir()


def words() -> list[str]:
    """Return the words of the documentation, without its tables, code and comments."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    texts = (page.read_text("utf-8") for page in pages)
    prose = (re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL) for text in texts)

    return [
        word
        for text in prose
        for line in text.splitlines()
        if not line.startswith(("|", "#", ":::"))
        for word in line.split()
    ]


def lines(folder: str, pattern: str) -> list[str]:
    """Return the lines of the files of a folder that are not empty."""
    files = sorted((ROOT / folder).rglob(pattern))
    every = (line for file in files for line in file.read_text("utf-8").splitlines())
    return [line for line in every if line.strip()]


FIGURES: dict[str, Callable[[], list[str]]] = {
    "files in a circle of imports": in_a_circle,
    "imports of the same or a higher floor": not_down,
    "imports of another distribution than those below": not_below,
    "own modules imported by a string": by_a_string,
    **{f"statements of {name}": partial(statements, name) for name in WHEELS},
    "aliases at the boundary": at_the_boundary,
    "public names": public_names,
    "words of documentation": words,
}


@pytest.mark.parametrize("figure", BOUNDS)
def test_a_figure_is_within_its_bound(figure: str) -> None:
    found = FIGURES[figure]()
    if len(found) > BOUNDS[figure]:
        which = ", ".join(found[:20]) if len(found) < 100 else "raise it if it is worth it"
        pytest.fail(f"{figure}: {len(found)}, at most {BOUNDS[figure]}: {which}", pytrace=False)

    print(f"{figure}: {len(found)}, at most {BOUNDS[figure]}")  # noqa: T201 -- for ``pytest -s``


def test_the_extension_has_not_grown() -> None:
    """Of x86-64, where each kernel is compiled for most instruction sets."""
    if (sys.platform, platform.machine()) != ("linux", "x86_64") or _core.DEBUG_BUILD:
        pytest.skip("the bound is that of a release build for Linux on x86-64")

    size = Path(_core.__file__).stat().st_size / 1e6
    print(f"extension: {size:.2f} MB, at most {EXTENSION}")  # noqa: T201 -- for ``pytest -s``
    assert size <= EXTENSION


def test_every_module_that_is_imported_is_there() -> None:
    """A type checker may find those of an older installation, too."""
    missing = [
        f"{name} -> {other}"
        for name, tree in MODULES.items()
        for other in imports(tree)
        if other not in MODULES
    ]
    assert missing == []
