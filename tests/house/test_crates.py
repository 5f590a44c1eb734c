"""The crates: the core stands alone, its interface is small, and the C interface is made of it."""

import re
import tomllib

from conftest import ROOT

RUST = ROOT / "rust"
MOST_PUBLIC = 25  # types, traits and aliases at the root of the core


def _uses(crate: str) -> dict[str, set[str]]:
    """Return the paths into the core's hidden module that each file of a crate names."""
    files = (RUST / crate / "src").glob("*.rs")
    path = re.compile(r"phasestereo::internals::(\w+(?:::\w+)*)")
    return {file.name: set(path.findall(file.read_text("utf-8"))) for file in files}


def test_the_core_knows_neither_python_nor_c() -> None:
    core = tomllib.loads((RUST / "core" / "Cargo.toml").read_text("utf-8"))

    assert set(core["dependencies"]) == {"libm", "ndarray", "rayon", "thiserror"}
    assert "features" not in core

    sources = [file.read_text("utf-8") for file in (RUST / "core" / "src").rglob("*.rs")]
    assert len(sources) > 80
    assert not [text for text in sources if re.search(r"dead_code|extern \"C\"|pyo3", text)]


def test_the_interface_of_the_core_is_small() -> None:
    root = (RUST / "core" / "src" / "lib.rs").read_text("utf-8")
    exported = " ".join(re.findall(r"^pub use ([^;]+);", root, re.MULTILINE))
    names = re.findall(r"\b[A-Z]\w+", exported)

    assert {"Error", "Image", "Match", "Matcher", "Settings"} <= set(names)
    assert len(names) <= MOST_PUBLIC


def test_the_c_interface_is_made_of_the_interface_of_the_core() -> None:
    hidden = {file: used for file, used in _uses("c").items() if used}

    # Estimates have more details than the interface tells.
    assert hidden.keys() <= {"found.rs", "images.rs"}
    assert hidden["images.rs"] == {"image::plane::zeroed"}
    assert all(used.startswith("rig::") for used in hidden["found.rs"])
