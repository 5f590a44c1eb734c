"""Public names, aliases, and the sizes of the wheels and of the documentation.

What modules may import of each other is in pyproject.toml, ``tool.importlinter``, and checked by
`make lint`. Sizes are bounded 5 % above their values at the last release and set again at each
(RELEASING.md). Tests, the harness and the lines of Rust are not bounded. ``pytest -s`` prints the
figures.
"""

import ast
import platform
import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from phasestereo import _core
from support import ROOT

BOUNDS = {
    "own modules imported by a string": 0,
    "imports of what the package alone offers": 0,
    "aliases at the boundary": 7,
    "public names": 135,
    "statements of phasestereo": 7_260,
    "statements of phasestereo-gpu": 3,
    "statements of phasestereo-live": 4_360,
    "statements of phasestereo-large": 2_820,
    "words of documentation": 17_670,
}
EXTENSION = 8.0
"""Megabytes."""

PACKAGE = ROOT / "python/phasestereo"
WHEELS = {
    name: {path: ast.parse(path.read_text("utf-8")) for path in sorted(folder.rglob("*.py"))}
    for name in ("phasestereo", "phasestereo-gpu", "phasestereo-live", "phasestereo-large")
    for folder in [
        PACKAGE if name == PACKAGE.name else ROOT / "python" / name / name.replace("-", "_")
    ]
}
"""The modules of each wheel."""

MODULES = {path: tree for trees in WHEELS.values() for path, tree in trees.items()}


def by_a_string() -> list[str]:
    text = "\n".join(ast.unparse(tree) for tree in MODULES.values())
    return re.findall(r"(?:import_module|__import__)\(.*(?:phasestereo|__name__).*", text)


def of_the_package() -> list[str]:
    """Return imports from the package, which is above its modules, of what is not a module."""
    return [
        f"{path.name}: {name.name}"
        for path, tree in WHEELS["phasestereo"].items()
        if PACKAGE / "cli" not in path.parents and not path.name.startswith("__")
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "phasestereo"
        for name in node.names
        if not [*PACKAGE.glob(f"{name.name}.py*"), *PACKAGE.glob(f"{name.name}/")]
    ]


def statements(of: str) -> list[str]:
    """Return the statements of a wheel, docstrings left out."""
    return [
        type(node).__name__
        for tree in WHEELS[of].values()
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    ]


def aliases() -> list[str]:
    """Return the aliases of types in the stub of the core and in Rust."""
    stub = (ROOT / "python/phasestereo/_core.pyi").read_text("utf-8")
    imported = " ".join(re.findall(r"^from phasestereo\S* import (.+)", stub, re.MULTILINE))
    offered = "\n".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    found = re.findall(r"^(\w+): TypeAlias", stub, re.MULTILINE)
    found += [name for name in re.findall(r"\w+", imported) if f"\n{name}: TypeAlias" in offered]
    rust = "\n".join(path.read_text("utf-8") for path in ROOT.glob("rust/python/**/*.rs"))
    return found + re.findall(r"^(?:pub )?type (\w+).*=\s+\(", rust, re.MULTILINE)


def public_names() -> list[str]:
    """Return the names in ``__all__`` of the packages and of their folders."""
    return [
        f"{path.parent.name}.{name}"
        for path, tree in MODULES.items()
        if path.name == "__init__.py" and "cli" not in path.parts
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        for name in ast.literal_eval(node.value)
    ]


def words() -> list[str]:
    """Return the words of the documentation without its tables, headings, code and comments."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    text = "\n".join(page.read_text("utf-8") for page in pages)
    prose = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)
    return re.sub(r"^(?:\||#|:::).*", "", prose, flags=re.MULTILINE).split()


FIGURES: dict[str, Callable[[], list[str]]] = {
    "own modules imported by a string": by_a_string,
    "imports of what the package alone offers": of_the_package,
    "aliases at the boundary": aliases,
    "public names": public_names,
    **{f"statements of {name}": partial(statements, name) for name in WHEELS},
    "words of documentation": words,
}


@pytest.mark.parametrize("figure", BOUNDS)
def test_a_figure_is_within_its_bound(figure: str) -> None:
    found = FIGURES[figure]()
    print(f"{figure}: {len(found)}, at most {BOUNDS[figure]}")  # noqa: T201 -- for ``pytest -s``
    if len(found) > BOUNDS[figure]:
        which = ", ".join(found) if len(found) < 200 else "raise it if it is worth it"
        pytest.fail(f"{figure}: {len(found)}, at most {BOUNDS[figure]}: {which}", pytrace=False)


def test_the_extension_has_not_grown() -> None:
    """Of x86-64, where each kernel is compiled for most instruction sets."""
    if (sys.platform, platform.machine()) != ("linux", "x86_64") or _core.DEBUG_BUILD:
        pytest.skip("the bound is that of a release build for Linux on x86-64")
    assert Path(_core.__file__).stat().st_size / 1e6 <= EXTENSION
