"""The structure of the package: figures that may fall, and grow on purpose alone.

Every import counts, inside functions and under ``TYPE_CHECKING``, too. That a package is imported
with each of its modules does not. ``pytest -s`` prints the figures.
"""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PACKAGE = Path(__file__).parent.parent / "python/phasestereo"

FLOORS = (
    "_core",  # in Rust
    "_closing _extras _images _interrupts _numbers _tables settings shapes temporal",
    "io metrics",  # files, scores
    "_opening",  # of images that a caller names the files of
    "rig",  # what is found out of a pair
    "rectification result",
    "bands matching stages",
    "verification views",  # what is made of a result
    "integrations",
    "batch outofcore viewer",  # many pairs, large ones, cameras
    "",  # the package itself, which names all of the interface
    "cli",
    "__main__",
)
"""Rooms, modules or folders, from the ground up: each imports of lower floors alone."""

BOUNDS = {
    "files in a circle of imports": 0,
    "imports of the same or a higher floor": 0,
    "own modules imported by a string": 0,
    "statements": 10_150,
    "public names": 124,
}


def modules() -> dict[str, ast.Module]:
    """Return the modules by their names within the package, packages by those of their folders."""
    found = {"_core": ast.Module([], [])}
    for path in sorted(PACKAGE.rglob("*.py")):
        *folders, name = path.relative_to(PACKAGE).with_suffix("").parts
        parts = folders if name == "__init__" else [*folders, name]
        found[".".join(parts)] = ast.parse(path.read_text("utf-8"))
    return found


MODULES = modules()


def imports(tree: ast.Module) -> Iterator[str]:
    """Yield what a module imports of the package; of ``from package import module`` the module."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{name.name}" for name in node.names]

        for name in names:
            top, _, inner = name.partition(".")
            if top == "phasestereo":
                yield inner if inner in MODULES else inner.rpartition(".")[0]


def room(module: str) -> str:
    """Return the room that a module is in: the one with the longest name."""
    rooms = " ".join(FLOORS).split()
    return max((one for one in rooms if f"{module}.".startswith(f"{one}.")), key=len, default="")


def floor(module: str) -> int:
    return next(n for n, rooms in enumerate(FLOORS) if room(module) in (rooms.split() or [""]))


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
        if room(name) != room(other) and floor(name) <= floor(other)
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


def statements() -> list[str]:
    """Return the module of each statement; a docstring is none."""
    return [
        name
        for name, tree in MODULES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    ]


def public_names() -> list[str]:
    """Return the names in ``__all__`` of the package and of its folders."""
    return [
        f"{module}.{name}"
        for module, tree in MODULES.items()
        if (PACKAGE / module.replace(".", "/")).is_dir() and "cli" not in module
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        for name in ast.literal_eval(node.value)
    ]


FIGURES: dict[str, Callable[[], list[str]]] = dict(
    zip(BOUNDS, (in_a_circle, not_down, by_a_string, statements, public_names), strict=True)
)


@pytest.mark.parametrize("figure", BOUNDS)
def test_the_structure_has_not_grown(figure: str) -> None:
    found = FIGURES[figure]()
    if len(found) > BOUNDS[figure]:
        which = ", ".join(found[:20]) if len(found) < 100 else "raise it if it is worth it"
        pytest.fail(f"{figure}: {len(found)}, at most {BOUNDS[figure]}: {which}", pytrace=False)

    print(f"{figure}: {len(found)}, at most {BOUNDS[figure]}")  # noqa: T201 -- for ``pytest -s``
