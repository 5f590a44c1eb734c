"""Write what other files repeat of the table of settings in Rust: ``make settings``.

That is the fields of Python's class and their description, and the rows of the glossary. With
``--check`` nothing is written: it fails where a file is not as the built core has it.
"""

from __future__ import annotations

import json
import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "phasestereo"

PARAMETERS = re.compile(r"(?<=\n    Parameters\n    ----------\n).*?(?=\n    Raises\n)", re.DOTALL)
FIELDS = re.compile(r"(?<=by ``make settings``.\n).*?(?=\n\n    def )", re.DOTALL)
OVERRIDES = re.compile(r"(?<=of ``make settings``:\n).*?(?=\n\n\n)", re.DOTALL)
NAMES = re.compile(r"(?<=\nPresetName = Literal\[).*?(?=\]\n)")
ROWS = re.compile(r"(?<=\n\n)\| setting \|.*?(?=\n\n)", re.DOTALL)


def main() -> None:
    """Write the files, or name those that are out of date."""
    core = import_core()
    outdated = []
    for path, pieces in {
        PACKAGE / "settings.py": {
            PARAMETERS: parameters(core),
            FIELDS: fields(core),
            OVERRIDES: overrides(core),
            NAMES: ", ".join(map(literal, core.PRESETS)),
        },
        ROOT / "docs" / "glossary.md": {ROWS: rows(core)},
    }.items():
        text = written = path.read_text("utf-8")
        for place, piece in pieces.items():
            try:
                before, after = place.split(written)
            except ValueError:
                sys.exit(f"{path}: not one place to write to: {place.pattern}")
            written = before + piece + after

        if written != text:
            outdated.append(str(path.relative_to(ROOT)))
            if "--check" not in sys.argv:
                path.write_text(written, "utf-8")

    if outdated and "--check" in sys.argv:
        sys.exit(f"{', '.join(outdated)}: not as the table of settings says; run make settings")


def import_core() -> ModuleType:
    """Import the extension by itself: the package cannot be imported while a field is missing."""
    [path] = (path for path in PACKAGE.glob("_core.*") if path.suffix in (".so", ".pyd"))
    spec = spec_from_file_location("phasestereo._core", path)
    if spec is None or spec.loader is None:
        sys.exit(f"{path}: no extension module")

    core = module_from_spec(spec)
    spec.loader.exec_module(core)
    return core


def parameters(core: ModuleType) -> str:
    """Return the parameters of the class as its docstring describes them."""
    lines = []
    for setting in core.SETTINGS:
        default, *others = ((name, of[setting.name]) for name, of in presets(core).items())
        differing = ", ".join(f"{name} `{value}`" for name, value in others if value != default[1])
        last = f"Default `{default[1]}`" + (f" ({differing})." if differing else ".")

        lines += [f"    {setting.name}", wrapped(f"{setting.text} {last}", " " * 8)]
        if setting.choices:
            listed = (f'- `"{word}"`: {meaning}' for word, meaning in setting.choices)
            lines += ["", *(wrapped(line, " " * 8, "  ") for line in listed)]
    return "\n".join(lines) + "\n"


def wrapped(text: str, indent: str, hanging: str = "") -> str:
    """Return a paragraph in lines of the docstring, whose code stands between two backticks."""
    return fill(
        text.replace("`", "``"),
        100,
        initial_indent=indent,
        subsequent_indent=indent + hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )


def fields(core: ModuleType) -> str:
    """Return the fields of the class with their types and defaults."""
    default = presets(core)["robust"]
    return "\n".join(
        f"    {setting.name}: {setting.annotation} = {default[setting.name]}"
        for setting in core.SETTINGS
    )


def overrides(core: ModuleType) -> str:
    """Return the fields with their types alone."""
    return "\n".join(f"    {setting.name}: {setting.annotation}" for setting in core.SETTINGS)


def rows(core: ModuleType) -> str:
    """Return the rows of the glossary: a sentence on each setting, and its value in each preset."""
    columns = ["setting", "meaning", *(f"`{name}`" for name in core.PRESETS)]
    lines = [columns, ["---"] * len(columns)]
    for setting in core.SETTINGS:
        values = (f"`{of[setting.name]}`" for of in presets(core).values())
        lines.append([f"`{setting.name}`", setting.summary, *values])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def presets(core: ModuleType) -> dict[str, dict[str, str]]:
    """Return the settings of each preset as Python writes them."""
    return {
        name: {setting: literal(value) for setting, value in core.preset(name).items()}
        for name in core.PRESETS
    }


def literal(value: object) -> str:
    """Return a value as the formatter leaves it."""
    return json.dumps(value) if isinstance(value, str) else repr(value)


if __name__ == "__main__":
    main()
