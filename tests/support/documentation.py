"""The documentation as the tests read it: pages, and the code blocks in them."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from support import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

_BLOCK = re.compile(r"^( *)```(\w+)([^\n]*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"\s+#.*$")


@dataclass(frozen=True, slots=True)
class CodeBlock:
    """A block of code: its language, what follows that on its first line, its text and line."""

    language: str
    options: str
    text: str
    line: int

    @property
    def runs(self) -> bool:
        """Whether it is meant to run as it stands; those marked ``exec`` run during the build."""
        return "not run" not in self.options and "exec=" not in self.options


def blocks(page: Path, language: str) -> list[CodeBlock]:
    """Return the blocks of a page in a language."""
    text = page.read_text(encoding="utf-8")
    return [
        CodeBlock(found[2], found[3], found[4], text.count("\n", 0, found.start()) + 2)
        for found in _BLOCK.finditer(text)
        if found[2] == language
    ]


def example(page: str, module: str) -> str:
    """Return the block of Python of a page that imports a module."""
    found = (block.text for block in blocks(ROOT / page, "python"))
    (text,) = (text for text in found if f"import {module}" in text and "StereoPhase" not in text)
    return text


def commands(page: Path) -> list[list[str]]:
    """Return the arguments of every command line ``phasestereo ...`` of a page."""
    lines = (
        _COMMENT.sub("", line)
        for block in blocks(page, "sh")
        for line in block.text.replace("\\\n", " ").splitlines()
    )
    split = (shlex.split(line) for line in lines if "not run" not in line)
    return [words[1:] for words in split if words[:1] == ["phasestereo"]]


def name(page: Path) -> str:
    """Return the path of a page below the root."""
    return page.relative_to(ROOT).as_posix()
