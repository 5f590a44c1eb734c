"""Guides: every finding has its place in the troubleshooting, and the walk to a cloud runs."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import write_image
from support import ROOT, Run, counterpart
from support.documentation import commands

CORE = ROOT / "rust" / "core" / "src"
LEAST = 4  # words of a literal that a reader sees
SAYING = [
    *(CORE / "findings" / f"{name}.rs" for name in ("pair", "outcome", "rectified")),
    CORE / "verification" / "findings.rs",
    *(CORE / "video" / f"{name}.rs" for name in ("rig", "frames")),
]
"""The files that make sentences."""


def sentences() -> list[str]:
    """Return the string literals of the core that findings and events are made of."""
    found = []
    for path in SAYING:
        code = path.read_text("utf-8").split("#[cfg(test)]")[0]
        code = re.sub(r"^\s*//.*$", "", code, flags=re.MULTILINE)
        for literal in re.findall(r'"((?:[^"\\]|\\.)*)"', code, re.DOTALL):
            text = re.sub(r"\\\n\s*", "", literal)
            if len(text.split()) >= LEAST:
                found.append(text)
    return found


def key(sentence: str) -> str:
    """Return the longest part of a sentence that holds no number or name of a pair."""
    return max(re.split(r"\{[^}]*\}", sentence), key=len).strip(" ,;:%()")


def test_every_sentence_of_the_core_has_its_place_in_the_troubleshooting() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
    said = sentences()
    assert len(said) >= 50
    missing = [sentence for sentence in said if key(sentence) not in page]
    assert missing == []


def test_the_walk_to_a_cloud_runs_and_its_depths_are_true(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("cv2", "yaml", "PIL", "cyclopts", "jinja2"):
        counterpart(module)
    from support import boards  # noqa: PLC0415  # needs OpenCV

    monkeypatch.chdir(tmp_path)
    (tmp_path / "boards").mkdir()
    for number, pair in enumerate(boards.pairs(boards.chessboard(9, 6), 12, 0.025)):
        stem = tmp_path / "boards" / f"pair-{number:06}"  # as the page of `live` saves them
        for side, image in zip(("left", "right"), pair, strict=True):
            write_image(f"{stem}-{side}.png", image)
        Path(f"{stem}.html").write_text("a report")

    # A wall with texture that stands parallel to the left image.
    wall = np.random.default_rng(3).integers(20, 235, (400, 400), np.uint8)
    for name, image in zip(
        ("left.png", "right.png"), boards.pairs(wall, 1, 0.2, tilted=0)[0], strict=True
    ):
        write_image(tmp_path / name, image)

    steps = [words for words in commands(ROOT / "docs" / "two-cameras.md") if words[0] != "pip"]
    assert [words[0] for words in steps] == ["live", "calibrate", "rectify", "check", "match"]
    pytest.importorskip("phasestereo.cli").app.parse_args(steps[0], exit_on_error=False)
    for words in steps[1:]:  # the first needs cameras
        code, _, err = run(*words)
        assert code == 0, f"{shlex.join(words)}: {err[-500:]}"

    with np.load(tmp_path / "depth.npz") as saved:
        depth, near, far = (saved[name] for name in ("depth", "near", "far"))
    distance = boards.poses(1)[0][1][2]
    known = np.isfinite(depth) & (depth > 0)
    assert known.mean() > 0.7
    assert np.median(depth[known]) == pytest.approx(distance, rel=0.02)
    assert np.mean((near <= distance * 1.01) & (distance * 0.99 <= far)) > 0.7
    assert len(ps.io.read_image(tmp_path / "l.png")) == boards.SIZE[1]
    assert (tmp_path / "cloud.ply").stat().st_size > 1_000_000
    assert "<html" in (tmp_path / "page.html").read_text("utf-8")
