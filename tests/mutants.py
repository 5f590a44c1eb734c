"""Change the core one place at a time, and require that the Rust tests notice nearly all of it.

    python tests/mutants.py [options of cargo-mutants]

runs cargo-mutants as .cargo/mutants.toml says, prints the changes that no test noticed, and fails
if these are more than one in twenty. A survivor gets a test, or a line with a reason in that file.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOUND = ROOT / "target" / "mutants.out"
LEAST = 0.95
"""Of the changes that compile, the share that has to be noticed; a test that never ends has."""

FINISHED = 0, 2, 3
"""What cargo-mutants ends with: all noticed, some not, some without an end."""


def main() -> None:
    options = ["--package", "phasestereo", "--output", str(FOUND.parent)]
    command = ["cargo", "mutants", *options, *sys.argv[1:]]
    # What is compiled again and again is compiled quickly.
    quickly = {"CARGO_PROFILE_TEST_OPT_LEVEL": "1", "CARGO_PROFILE_TEST_DEBUG": "0"}
    environment = os.environ | quickly
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False)  # noqa: S603 -- as given
    if done.returncode not in FINISHED:
        sys.exit(f"cargo-mutants ended with {done.returncode}")

    share, survivors = judged(json.loads((FOUND / "outcomes.json").read_text("utf-8")))
    for survivor in survivors:
        print(f"not noticed: {survivor}")  # noqa: T201
    print(f"noticed: {share:.1%}, at least {LEAST:.0%}")  # noqa: T201
    sys.exit(share < LEAST)


def judged(found: dict[str, Any]) -> tuple[float, list[str]]:
    """Return the share of changes that tests noticed, and the others by their names."""
    noticed = found["caught"] + found["timeout"]
    if noticed + found["missed"] == 0:
        sys.exit("nothing was changed")

    survivors = [
        one["scenario"]["Mutant"]["name"]
        for one in found["outcomes"]
        if one["summary"] == "MissedMutant"
    ]
    return noticed / (noticed + found["missed"]), survivors


if __name__ == "__main__":
    main()
