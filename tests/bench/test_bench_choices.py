"""Constants of the core, swept: which there are, and what is built and scored for each."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest
from test_bench_cases import plant

from phasestereo import _core
from phasestereo_bench.choices import (
    AS_IT_IS,
    Constant,
    build,
    find_constants,
    score,
    swept_table,
)
from support import Run

ROOT = Path(__file__).resolve().parents[2]

TABLE = """
choices! {
    /// Pixels.
    RADIUS: usize = 1_000, in "pixels", evidence "none";
    PAIR: (usize, usize) = (1, 3), in "pixels", evidence "none";
}
pub const SHARE: f32 = 0.25;
const SIDE: usize = 2 * RADIUS + 1;
#[cfg(test)]
const TESTED: usize = 3;
"""


def checkout(root: Path) -> Path:
    """Write what a build reads: two files of one crate, and what is copied beside them."""
    files = {
        "Cargo.toml": "[workspace]",
        "Cargo.lock": "",
        "rust/match/src/choices.rs": TABLE,
        "rust/core/src/scales.rs": "const SHARE: f64 = 0.5;\n",
        "python/phasestereo/__init__.py": "",
    }
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    return root


def test_constants_are_plain_numbers_by_names_of_their_own(tmp_path: Path) -> None:
    found = find_constants(checkout(tmp_path))

    assert [(one.name, one.value) for one in found] == [
        ("scales.rs:SHARE", "0.5"),
        ("RADIUS", "1_000"),
        ("choices.rs:SHARE", "0.25"),
    ]
    with pytest.raises(ValueError, match="source: got .*; accepts a checkout"):
        find_constants(tmp_path / "rust")


def test_the_core_has_constants() -> None:
    found = {one.name: one.value for one in find_constants(ROOT)}
    assert found["LEAST_BORDER"] == "0.004"
    assert len(found) > 100


def test_integers_stay_integers() -> None:
    side = Constant("SIDE", Path("a.rs"), "1_000", (0, 5))
    assert [side.scaled(factor) for factor in (0.5, 2, 1.0006)] == ["500", "2000", "1001"]
    assert Constant("SHARE", Path("a.rs"), "0.25", (0, 4)).scaled(2) == "0.5"
    with pytest.raises(ValueError, match=r"factor: got 1\.2; ONE = 1 stays the same"):
        Constant("ONE", Path("a.rs"), "1", (0, 1)).scaled(1.2)


def compiler(folder: Path, body: str) -> None:
    """Put a `cargo` into the path that runs a few lines of Python."""
    path = folder / "cargo"
    path.write_text(f"#!{sys.executable}\nimport pathlib, shutil, sys\n{body}\n", "utf-8")
    path.chmod(0o755)


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for cargo is a script")
def test_a_variant_has_its_own_value_and_the_next_one_has_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, work = checkout(tmp_path / "source"), tmp_path / "work"
    compiler(
        tmp_path,
        "target = pathlib.Path(sys.argv[-1]) / 'release'\n"
        "target.mkdir(parents=True, exist_ok=True)\n"
        "shutil.copy('rust/match/src/choices.rs', target / 'lib_core.so')",
    )
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    radius = next(one for one in find_constants(source) if one.name == "RADIUS")

    built = build(source, work, "choices.rs:RADIUS = 500", (radius, "500")) / "phasestereo"
    assert built.parent.name == "choices.rs_RADIUS_=_500"
    assert (built / "_core.abi3.so").read_text() == TABLE.replace("1_000", "500")
    assert (built / "__init__.py").exists()

    unchanged = work / "source" / "rust/core/src/scales.rs"
    os.utime(unchanged, (1, 1))
    own = work / "source" / "rust/match/src/choices.rs"
    os.utime(own, (1, 1))
    built = build(source, work, AS_IT_IS, None) / "phasestereo"
    assert (built / "_core.abi3.so").read_text() == TABLE
    # Cargo looks at times: what was put back is new, and what never changed is not.
    assert own.stat().st_mtime > 1
    assert unchanged.stat().st_mtime == 1

    compiler(tmp_path, "sys.exit('error: mismatched types')")
    with pytest.raises(RuntimeError, match="^as it is: error: mismatched types$"):
        build(source, work, AS_IT_IS, None)


def test_a_build_is_scored_in_a_process_of_its_own(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    package = tmp_path / "as_it_is"
    shutil.copytree(Path(_core.__file__).parent, package / "phasestereo")
    tree = plant(tmp_path / "data", "one")
    arguments = [str(tree), "--scene", "one", "--suite", "sharp", "--method", "fast"]

    first = score(package, arguments, tmp_path)
    assert first.keys() == {"sharp", "mean"}
    assert 0 <= first["mean"] < 5
    # Of another core, records are others.
    digest = sha256(Path(_core.__file__).read_bytes()).hexdigest()
    assert (tmp_path / f"as_it_is-{digest[:8]}.jsonl").exists()

    with pytest.raises(ValueError, match="output: got .*; accepts a folder without"):
        score(Path(f"a{os.pathsep}b") / "as_it_is", arguments, package.parent)
    arguments[2] = "two"
    with pytest.raises(RuntimeError, match="as_it_is: .*got 'two'"):
        score(package, arguments, tmp_path)


def test_the_command_lists_constants_and_refuses_others(run_bench: Callable[..., Run]) -> None:
    code, out, _ = run_bench("choices", "--source", ROOT)
    assert (code, "LEAST_BORDER" in out) == (0, True)

    for name, accepted in (
        ("MANY", "scales.rs:MANY"),
        ("LEAST_BORDR", "LEAST_BORDER"),
        ("?", "listed"),
    ):
        code, _, error = run_bench("choices", "--source", ROOT, "--constant", name)
        assert (code, f"--constant: got '{name}'; accepts" in error, accepted in error) == (
            2,
            True,
            True,
        )
    code, _, error = run_bench("choices")
    assert (code, "--source: got" in error) == (2, True)


def test_variants_are_shown_by_what_they_change() -> None:
    table = swept_table(
        {AS_IT_IS: {"sharp": 5.0, "mean": 6.0}, "A = 2": {"sharp": 4.9, "mean": 6.05}}
    )
    rows = [[entry.text for entry in row] for row in table.rows]
    assert rows == [["as it is", "5.00", "6.00"], ["A = 2", "-0.10", "+0.05"]]
