"""Plain words: phrases that documentation, docstrings, comments and messages avoid.

Rust and the tests are searched for the first ones alone; tests in Rust are not searched.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from support import ROOT

REFUSED = {
    r"\b[Rr]eturns? (?:what|how|where|which|who)\b": "name what is returned",
    r"(?<![Tt]here )\bis no (?!longer\b)": '"is not a", "invalid"',
    r"(?<![Tt]here )\bis none\b": '"invalid", "missing", "None"',
    r"\bso many\b": '"this many", or the name of the number',
    r"\bas many as\b": "name the number",
    r"(?<!\.)\btells?\b(?!\()": '"reports", "shows", "distinguishes"',
    r"\bmend(?:s|ed)?\b": '"fix"',
    r"\bmetres?\b|\bcolours?\b|\bgreys?\b(?!scale)": "American spelling",
}
REFUSED_BUT_IN_RUST = {
    r"\b(?:is|are) said\b": '"a finding reports", "the message names"',
    r"\blacks?\b": '"has no", "is missing"',
    r"\bknows? of\b": '"knows", "has"',
    r"\bfor want of\b": '"without"',
    r"\bstands? in\b": '"is in", "replaces"',
    r"\blikewise\b": '"the same", "in the same way"',
    r"\b(?:is|are|were|was) told\b|\bunless told\b": '"gets", "by default"',
}
FILES = [
    *ROOT.glob("*.md"),
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / "tests").rglob("*.py"),
    *(
        path
        for folder in ("python", "benches", "rust", "docs", "web")
        for suffix in ("py", "pyi", "rs", "h", "hpp", "j2", "js")
        for path in (ROOT / folder).rglob(f"*.{suffix}")
    ),
]


def lines() -> Iterator[tuple[str, int, str]]:
    for path in sorted(FILES):
        if not {"target", "dist"} & set(path.parts) and path != Path(__file__):
            for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
                yield path.relative_to(ROOT).as_posix(), number, line


@pytest.mark.parametrize("phrase", REFUSED | REFUSED_BUT_IN_RUST)
def test_no_text_has_a_phrase_that_a_plainer_one_replaces(phrase: str) -> None:
    search = re.compile(phrase).search
    found = [
        f"{path}:{number}: {line.strip()}"
        for path, number, line in lines()
        if search(line) and (phrase in REFUSED or not path.startswith(("rust/", "tests/")))
    ]
    if found:
        advice = (REFUSED | REFUSED_BUT_IN_RUST)[phrase]
        pytest.fail("\n".join([f"write {advice}:", *found]), pytrace=False)
