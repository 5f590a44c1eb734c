"""Sweeps constants of the core: builds the core with other values of one, and scores it."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path
from statistics import fmean

from phasestereo_bench.report.cells import METRIC, METRICS
from phasestereo_bench.report.results import read_results
from phasestereo_bench.report.tables import Table, means

AS_IT_IS = "as it is"
"""The variant with all of its values unchanged."""

_CRATES = "rust/match/src", "rust/core/src"
_BUILT = "Cargo.toml", "Cargo.lock", "rust"
_LIBRARIES = "lib_core.so", "lib_core.dylib", "_core.dll"

# A constant, or an entry in a table of constants, with one plain number as its value.
_CONSTANT = re.compile(
    r"^\s*(?:pub(?:\(\w+\))? )?(?:const )?(?P<name>[A-Z][A-Z0-9_]+): "
    r"(?P<type>f32|f64|[iu](?:8|16|32|64|size)) = (?P<value>-?[\d_]+(?:\.\d+)?)(?=[;,])",
    re.MULTILINE,
)


@dataclass(frozen=True, slots=True)
class Constant:
    """A numeric constant of the core.

    Attributes
    ----------
    name
        Its name, or "module.rs:NAME" if several files have a constant of that name.
    path
        Its file, below the root of the source.
    value
        Value in the file.
    place
        The first character of the value in the file, and the one after the last.
    """

    name: str
    path: Path
    value: str
    place: tuple[int, int]

    def scaled(self, factor: float) -> str:
        """Return a multiple of the value as Rust writes it; of an integer, the nearest other one.

        Raises
        ------
        ValueError
            If no other integer is near.
        """
        number = self.value.replace("_", "")
        if "." in number:
            return repr(float(number) * factor)

        scaled = round(int(number) * factor)
        if scaled == int(number):
            raise ValueError(f"factor: got {factor:g}; {self.name} = {self.value} stays the same")
        return str(scaled)


def find_constants(source: Path) -> list[Constant]:
    """Return the constants of the core with one plain number as value, by file and place.

    Parameters
    ----------
    source
        A checkout of this repository.

    Raises
    ------
    ValueError
        If the folder is not such a checkout.
    """
    found = []
    for path in sorted(path for crate in _CRATES for path in (source / crate).rglob("*.rs")):
        text = path.read_text("utf-8").partition("#[cfg(test)]")[0]
        found += [
            Constant(match["name"], path.relative_to(source), match["value"], match.span("value"))
            for match in _CONSTANT.finditer(text)
        ]
    if not found:
        raise ValueError(f"source: got {source}; accepts a checkout of phasestereo")

    names = [constant.name for constant in found]
    return [
        constant
        if names.count(constant.name) == 1
        else Constant(
            f"{constant.path.name}:{constant.name}", constant.path, constant.value, constant.place
        )
        for constant in found
    ]


def choose(constants: Iterable[Constant], names: Sequence[str]) -> list[Constant]:
    """Return the constants of these names.

    Raises
    ------
    ValueError
        If a name is unknown; the message names constants of several files, or with similar names.
    """
    known = {one.name: one for one in constants}
    for name in names:
        if name not in known:
            same = [other for other in known if other.endswith(f":{name}")]
            near = same or get_close_matches(name, known)
            accepts = ", ".join(near) or "a name that is listed without it"
            raise ValueError(f"constant: got {name!r}; accepts {accepts}")
    return [known[name] for name in names]


def constants_table(constants: Iterable[Constant]) -> Table:
    """Return the table of names, values and files of constants."""
    rows = [(one.name, one.value, str(one.path)) for one in constants]
    return Table.of(("constant", "value", "file"), rows, labels=3)


def build(source: Path, work: Path, label: str, change: tuple[Constant, str] | None) -> Path:
    """Build the core with another value of a constant.

    Parameters
    ----------
    source
        The checkout.
    work
        Folder for a copy of the source, compiled files, and packages; it is kept, so each further
        build compiles only the files that depend on the constant.
    label
        Name of the variant.
    change
        The constant, and its value in Rust; None: no change.

    Returns
    -------
    Path
        A folder with the package `phasestereo`, to put into the path of Python.

    Raises
    ------
    RuntimeError
        If the compilation fails; the message has the first error of the compiler.
    OSError
        If cargo is not installed, or a file cannot be read or written.
    """
    changed = {}
    if change is not None:
        constant, value = change
        start, end = constant.place
        text = (source / constant.path).read_text("utf-8")
        changed[constant.path] = (text[:start] + value + text[end:]).encode()
    _copy_source(source, work / "source", changed)

    target = work / "target"
    options = (
        "--release",
        "--locked",
        "--package",
        "phasestereo-python",
        "--target-dir",
        str(target.resolve()),
    )
    done = subprocess.run(  # noqa: S603 - the arguments are ours
        ("cargo", "build", "--quiet", *options),  # noqa: S607 - cargo from the user's path
        cwd=work / "source",
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        errors = (line for line in done.stderr.splitlines() if line.startswith("error"))
        raise RuntimeError(f"{label}: {next(errors, done.stderr.strip())}")

    # Python splits its path at colons.
    package = work / "packages" / re.sub(r"[^\w.=-]", "_", label)
    without = shutil.ignore_patterns("_core.*.so", "_core*.pyd", "__pycache__")
    shutil.copytree(
        source / "python" / "phasestereo",
        package / "phasestereo",
        ignore=without,
        dirs_exist_ok=True,
    )
    library = next(path for name in _LIBRARIES if (path := target / "release" / name).exists())
    extension = "_core.pyd" if library.suffix == ".dll" else "_core.abi3.so"
    shutil.copy2(library, package / "phasestereo" / extension)
    return package


def _copy_source(source: Path, copy: Path, changed: Mapping[Path, bytes]) -> None:
    """Write changed files of the source to the copy; the times of other files stay the same."""
    paths = [source / name for name in _BUILT]
    files = [path for root in paths for path in (root.rglob("*") if root.is_dir() else [root])]
    for path in files:
        if path.is_file():
            name = path.relative_to(source)
            contents = changed.get(name) or path.read_bytes()
            own = copy / name
            if not own.exists() or own.read_bytes() != contents:
                own.parent.mkdir(parents=True, exist_ok=True)
                own.write_bytes(contents)


def score(package: Path, arguments: Sequence[str], output: Path) -> dict[str, float]:
    """Score a variant of the core in its own process.

    Parameters
    ----------
    package
        The result of `build`.
    arguments
        Arguments of ``phasestereo bench middlebury``, with one method.
    output
        Folder for the records; the package and its contents give the file its name.

    Returns
    -------
    dict
        The mean of `METRIC` over the scenes, by degradation, %; and over all degradations, "mean".

    Raises
    ------
    ValueError
        If the folder cannot be in the path of Python.
    RuntimeError
        If the benchmark fails; the message has the last line that it printed.
    """
    if os.pathsep in str(package):
        raise ValueError(
            f"output: got {output}; accepts a folder without {os.pathsep!r} in its path"
        )
    names = (package / "phasestereo").glob("_core.*")
    extension = next(path for path in names if path.suffix in {".so", ".pyd"})
    records = output / f"{package.name}-{sha256(extension.read_bytes()).hexdigest()[:8]}.jsonl"
    paths = [str(package), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(  # noqa: S603 - the arguments are checked by the command
        [
            sys.executable,
            "-m",
            "phasestereo",
            "bench",
            "middlebury",
            *arguments,
            "-o",
            str(records),
        ],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"{package.name}: {['', *done.stderr.strip().splitlines()][-1]}")

    results = read_results([records])
    found = {
        name: next(iter(means(results, METRIC, [name]).values.values()))
        for name in results.degradations
    }
    return found | {"mean": fmean(found.values())}


def swept_table(scores: Mapping[str, Mapping[str, float]]) -> Table:
    """Return the scores of variants by degradation; below the first row, differences from it."""
    first = scores[AS_IT_IS]
    rows = [
        [
            label,
            *(
                f"{own[name]:.2f}" if label == AS_IT_IS else f"{own[name] - first[name]:+.2f}"
                for name in first
            ),
        ]
        for label, own in scores.items()
    ]
    return Table.of((METRICS[METRIC].label, *first), rows)
