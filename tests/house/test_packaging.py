"""What an installed package brings and asks for: imports, extras, types, and the files of it."""

import ast
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Callable, Iterator
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import phasestereo as ps
import phasestereo_live as live
from conftest import ENVIRONMENT, ROOT, counterpart
from phasestereo._extras import require
from phasestereo.io import read_image
from phasestereo.views.picture import colorize
from phasestereo_large import dask as lazily
from phasestereo_large import geotiff
from phasestereo_large import xarray as labeled
from phasestereo_large.geotiff import Georeference, read_geotiff, write_geotiff
from phasestereo_live import rerun

PACKAGE = ROOT / "python/phasestereo"
FOLDERS = {
    "phasestereo": ROOT,
    "phasestereo-live": ROOT / "python/phasestereo-live",
    "phasestereo-large": ROOT / "python/phasestereo-large",
    "pandora-plugin-phasestereo": ROOT / "python/pandora-plugin-phasestereo",
    "phasestereo-bench": ROOT / "benches/harness",
}
"""The folder of each distribution, from the ground up."""

PROJECTS: dict[str, Any] = {
    name: tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    for name, folder in FOLDERS.items()
}
PACKAGES = {
    "phasestereo": PACKAGE,
    **{name: folder / name.replace("-", "_") for name, folder in FOLDERS.items() if folder != ROOT},
}
OTHERS = [name for name in FOLDERS if name != "phasestereo"]
PROJECT = PROJECTS["phasestereo"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
DISTRIBUTIONS = {
    "PIL": "pillow",
    "cv2": "opencv-contrib-python-headless",
    "pillow_heif": "pillow-heif",
    "rerun": "rerun-sdk",
    "yaml": "pyyaml",
}
"""What brings a module whose name is another."""

IMPORTED_FREELY = {
    "phasestereo/cli": "cli",
    "phasestereo_live/cli": "cli",
    "phasestereo_large/cli": "cli",
    "pandora_plugin_phasestereo": "pandora",
}
"""Parts of the package that are only imported when an extra is there, which they may use."""

DYNAMIC = {("phasestereo/io/raster.py", "module"): ["PIL"]}
"""Modules that `require` is given in a way that cannot be read from the source."""


# Imports


def run(
    *arguments: str, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run Python in a process of its own, from which this package can be imported."""
    return subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env=ENVIRONMENT | environment,
    )


def test_an_import_loads_numpy_and_nothing_else_from_outside() -> None:
    finished = run(
        "-W",
        "error",
        "-c",
        "import sys; before = set(sys.modules); import phasestereo\n"
        "print(*{name.partition('.')[0] for name in set(sys.modules) - before})",
    )

    assert (finished.returncode, finished.stderr) == (0, "")
    assert set(finished.stdout.split()) - sys.stdlib_module_names == {"numpy", "phasestereo"}


def test_an_import_loads_none_of_what_only_some_need() -> None:
    """Each of these takes as long to load as much of this package."""
    finished = run(
        "-c",
        "import sys, numpy; before = set(sys.modules); import phasestereo\n"
        "print(*set(sys.modules) - before)",
    )

    loaded = set(finished.stdout.split())
    assert (
        loaded & {"inspect", "importlib.metadata", "email", "json", "tomllib", "asyncio"} == set()
    )

    ours = {name.removeprefix("phasestereo.") for name in loaded}
    assert "_core" in ours
    others = {"cli", "io", "metrics", "opencv", "rectification", "stages", "views"}
    assert ours & (others | {"rig.diagnosis", "rig.estimation"}) == set()


@pytest.mark.parametrize("name", ps.__all__)
def test_what_is_imported_when_it_is_asked_for_is_there(name: str) -> None:
    assert name in dir(ps)
    assert getattr(ps, name) is not None


def test_a_name_that_is_not_there_is_reported() -> None:
    with pytest.raises(AttributeError, match=r"^module 'phasestereo' has no attribute 'mach'$"):
        ps.mach  # type: ignore[attr-defined]  # noqa: B018  # that is what is tested


# Dependencies


def test_the_installed_package_asks_for_numpy_alone() -> None:
    try:
        lines = metadata.requires("phasestereo") or []
    except metadata.PackageNotFoundError:
        pytest.skip("phasestereo is not installed, but on the path")
    asked = [Requirement(line) for line in lines]
    always = [one.name for one in asked if one.marker is None or one.marker.evaluate({"extra": ""})]
    assert always == ["numpy"]


def test_all_is_everything() -> None:
    assert brought("all") == {name for extra in EXTRAS for name in brought(extra)}


def brought(extra: str, of: str = "phasestereo") -> set[str]:
    """Return the distributions that an extra names, itself and by the extras it is made of."""
    return named(PROJECTS[of]["optional-dependencies"][extra])


def named(lines: list[str]) -> set[str]:
    """Return the distributions that requirements name; of ours those that they ask for."""
    names: set[str] = set()

    for asked in map(Requirement, lines):
        if asked.name in PROJECTS:
            names |= named(PROJECTS[asked.name]["dependencies"])
            names = names.union(*(brought(inner, asked.name) for inner in asked.extras))
        if asked.name != "phasestereo":
            names.add(canonicalize_name(asked.name))

    return names


def with_theirs(names: set[str]) -> set[str]:
    """Return distributions and all that these depend on, as far as they are installed."""
    known: set[str] = set()
    waiting = list(names)

    while waiting:
        name = waiting.pop()
        if name in known:
            continue
        known.add(name)

        try:
            lines = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue

        asked = [Requirement(line) for line in lines]
        needed = [one for one in asked if one.marker is None or one.marker.evaluate({"extra": ""})]
        waiting += [canonicalize_name(one.name) for one in needed]

    return known


# What the source asks for


def sources() -> Iterator[tuple[str, ast.Module]]:
    """Return every module of the product, by its path, as a syntax tree."""
    for name, package in PACKAGES.items():
        if name == "phasestereo-bench":  # which asks for all that it imports
            continue
        for path in sorted(package.rglob("*.py")):
            where = path.relative_to(package.parent).as_posix()
            yield where, ast.parse(path.read_text(encoding="utf-8"))


def asked_for() -> list[tuple[str, str, str]]:
    """Return path, module and extra of every `require` in the package."""
    return [
        (path, module, extra)
        for path, tree in sources()
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Name)
        and call.func.id == "require"
        for module, extra in _arguments(path, tree, call)
    ]


def _arguments(path: str, tree: ast.Module, call: ast.Call) -> list[tuple[str, str]]:
    """Return the modules and extras that a call may name: constants, or those of a loop."""
    module, extra = call.args[0], call.keywords[0].value

    if isinstance(module, ast.Constant) and isinstance(extra, ast.Constant):
        return [(str(module.value), str(extra.value))]

    assert isinstance(module, ast.Name), f"{path}:{call.lineno}: say what it needs by a constant"
    if (path, module.id) in DYNAMIC:
        names: Any = DYNAMIC[path, module.id]
    else:
        names = _looped(path, tree, call)

    if isinstance(names, dict):
        return list(names.items())

    assert isinstance(extra, ast.Constant)
    return [(name, str(extra.value)) for name in names]


def _looped(path: str, tree: ast.Module, call: ast.Call) -> Any:
    """Return what the loop around a call goes through: a literal, or a constant of the module."""
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For)]

    around = next((loop for loop in loops if call in ast.walk(loop)), None)
    assert around is not None, f"{path}:{call.lineno}: say what it needs by a constant"

    values = around.iter
    if isinstance(values, ast.Call) and isinstance(values.func, ast.Attribute):
        values = values.func.value  # of .items()
    if isinstance(values, ast.Name):
        values = next(
            node.value
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == values.id
        )

    return ast.literal_eval(values)


ASKED = asked_for()
INSTALLED = metadata.packages_distributions()


def test_the_source_was_read() -> None:
    found = {(module, extra) for _, module, extra in ASKED}
    assert {("PIL.Image", "io"), ("cyclopts", "cli"), ("cv2", "rectify")} <= found


@pytest.mark.parametrize(("module", "extra"), sorted({(m, e) for _, m, e in ASKED}))
def test_the_extra_that_is_named_brings_the_module(module: str, extra: str) -> None:
    top = module.partition(".")[0]
    wanted = canonicalize_name(DISTRIBUTIONS.get(top, top))
    assert wanted in with_theirs(brought(extra))
    installed = INSTALLED.get(top)
    assert installed is None or wanted in map(canonicalize_name, installed)


def hide(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make an installed package, and all of its modules, impossible to import."""
    top = module.partition(".")[0]
    loaded = [name for name in sys.modules if name == top or name.startswith(f"{top}.")]
    for name in {top, module, *loaded}:
        monkeypatch.setitem(sys.modules, name, None)


def test_an_error_inside_an_optional_package_is_not_taken_for_its_absence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_package.py").write_text("import nowhere_to_be_found\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="^No module named 'nowhere_to_be_found'$"):
        require("broken_package", extra="io")


def test_every_command_that_is_named_installs_something() -> None:
    files = [
        *(path for package in PACKAGES.values() for path in package.rglob("*.py")),
        ROOT / "README.md",
        *(ROOT / "docs").rglob("*.md"),
    ]

    named = {
        extra
        for path in files
        for extras in re.findall(r"pip install '?(?:phasestereo|\.)\[([\w,]+)\]", path.read_text())
        for extra in extras.split(",")
    }

    assert "io" in named
    assert named <= EXTRAS.keys()


def test_what_is_optional_is_never_imported_outright() -> None:
    ours = {"numpy", *sys.stdlib_module_names, *(package.name for package in PACKAGES.values())}

    freely = [
        f"{path}:{node.lineno}: {name}"
        for path, tree in sources()
        for node, name in _imports(tree)
        if name not in ours
        and canonicalize_name(DISTRIBUTIONS.get(name, name)) not in _allowed(path)
    ]

    assert freely == []


def _allowed(path: str) -> set[str]:
    extras = [extra for place, extra in IMPORTED_FREELY.items() if path.startswith(f"{place}/")]
    return with_theirs(set().union(*map(brought, extras)))


def _imports(tree: ast.AST) -> Iterator[tuple[ast.stmt, str]]:
    """Return the packages that are imported when code runs, not when it is type-checked."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for other in node.orelse:
                yield from _imports(other)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield node, alias.name.partition(".")[0]
        elif isinstance(node, ast.ImportFrom):
            yield node, (node.module or "phasestereo").partition(".")[0]
        else:
            yield from _imports(node)


# Missing extras, as users meet them


def _read(name: str) -> Callable[[Path], object]:
    def read(folder: Path) -> object:
        (folder / name).write_bytes({"a.png": b"\x89PNG\r\n\x1a\n", "a.tif": b"II*\0"}[name])
        return read_image(folder / name)

    return read


def _color(_: Path) -> object:
    return colorize(np.ones((8, 8), np.float32))


def _film(folder: Path) -> object:
    (folder / "video.mp4").touch()
    return live.stream(folder / "video.mp4", num_disparities=16)


def _record(folder: Path) -> object:
    with rerun.saving(folder / "recording.rrd") as recording:
        return recording


def _label(_: Path) -> object:
    return labeled.as_dataset(ps.match(*PAIR, num_disparities=8))


PAIR = np.zeros((2, 40, 60), np.uint8)
MAPS = {name: PAIR[0].astype("f4") for name in ("map1x", "map1y", "map2x", "map2y")}


CALLS = [
    ("PIL", "io", _read("a.png")),
    ("tifffile", "io", _read("a.tif")),
    ("matplotlib", "plot", _color),
    ("cv2", "live", lambda _: live.stream(0, num_disparities=16)),
    ("cv2", "rectify", lambda _: ps.rectify(PAIR[0], PAIR[1], MAPS)),
    ("av", "live", _film),
    ("rerun", "rerun", _record),
    ("rasterio", "geo", lambda folder: write_geotiff(folder / "out.tif", np.ones((8, 8), "f4"))),
    ("rasterio", "geo", lambda folder: read_geotiff(folder / "a.tif")),
    ("xarray", "geo", _label),
    ("dask", "dask", lambda _: lazily.match(PAIR[0], PAIR[1], num_disparities=8)),
]


@pytest.mark.parametrize(("module", "extra", "call"), CALLS)
def test_users_are_given_the_command_when_they_call_what_needs_it(
    module: str,
    extra: str,
    call: Callable[[Path], object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hide(module, monkeypatch)
    command = re.escape(f"it comes with: pip install 'phasestereo[{extra}]'")
    with pytest.raises(ImportError, match=rf"^{module}[.\w]* is not installed; {command}$"):
        call(tmp_path)


@pytest.mark.parametrize("module", ["cyclopts", "rich"])
def test_the_command_without_its_extra_says_how_to_get_it(module: str) -> None:
    finished = run("-c", f"import sys; sys.modules[{module!r}] = None\n{MAIN}", COLUMNS="200")
    message = f"{module} is not installed; it comes with: pip install 'phasestereo[cli]'"
    assert (finished.returncode, finished.stdout) == (1, "")
    assert finished.stderr == f"phasestereo: error: {message}\n"


def test_the_plugin_without_pandora_says_how_to_get_it() -> None:
    finished = run(
        "-c", "import sys; sys.modules['pandora'] = None\nimport pandora_plugin_phasestereo"
    )

    message = (
        "ImportError: pandora is not installed; it comes with: pip install 'phasestereo[pandora]'"
    )

    assert finished.returncode == 1
    assert finished.stderr.endswith(f"{message}\n")


MAIN = """
from phasestereo.__main__ import main
sys.argv = ["phasestereo", "--version"]
sys.exit(main())
"""


def test_the_command_with_its_extra_starts() -> None:
    counterpart("cyclopts")
    finished = run("-c", f"import sys\n{MAIN}")
    assert (finished.returncode, finished.stderr) == (0, "")
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*\n", finished.stdout)


# Distributions on top of the first one


@pytest.mark.parametrize("name", OTHERS)
def test_a_distribution_is_made_for_this_version_of_ours(name: str) -> None:
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"]
    core = workspace["package"]["version"]
    asked = [Requirement(line) for line in PROJECTS[name]["dependencies"]]
    ours = {one.name: str(one.specifier) for one in asked if one.name in PROJECTS}
    assert "phasestereo" in ours
    assert {PROJECTS[name]["version"], *ours.values()} == {core, f"=={core}"}


@pytest.mark.parametrize("name", OTHERS)
def test_a_distribution_asks_for_what_it_imports_of_ours(name: str) -> None:
    asked = {Requirement(line).name.replace("-", "_") for line in PROJECTS[name]["dependencies"]}
    imported = {
        found
        for path in PACKAGES[name].rglob("*.py")
        for _, found in _imports(ast.parse(path.read_text("utf-8")))
        if found != PACKAGES[name].name
    }
    assert imported & {package.name for package in PACKAGES.values()} <= asked


def test_the_harness_asks_for_what_it_imports() -> None:
    there = named(PROJECTS["phasestereo-bench"]["dependencies"])
    freely = {"numpy", *sys.stdlib_module_names, *(package.name for package in PACKAGES.values())}

    imported = {
        canonicalize_name(DISTRIBUTIONS.get(name, name))
        for path in PACKAGES["phasestereo-bench"].rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for _, name in _imports(ast.Module([node], []))
        if name not in freely
    }

    assert {"scipy", "cyclopts"} <= imported <= with_theirs(there)


@pytest.mark.parametrize(
    ("arguments", "requirement"),
    [
        (["live", "video.mp4", "--num-disparities", "16"], "'phasestereo[live]'"),
        (["batch", "pairs.csv", "-o", "maps"], "'phasestereo[batch]'"),
        (["large", "left.tif", "right.tif"], "'phasestereo[large]'"),
        (["demo"], "phasestereo-bench"),
        (["bench", "speed", "--pairs", "rendered"], "phasestereo-bench"),
    ],
)
def test_a_command_of_a_distribution_says_how_to_get_it_where_it_is_missing(
    arguments: list[str], requirement: str
) -> None:
    counterpart("cyclopts")
    finished = run("-c", f"{WITHOUT_OTHERS}sys.argv[1:] = {arguments}\nsys.exit(main())")
    message = f"this command is not installed; it comes with: pip install {requirement}"
    assert (finished.returncode, finished.stdout) == (1, "")
    assert finished.stderr == f"phasestereo: error: {message}\n"


def test_the_help_of_a_command_that_is_missing_says_how_to_get_it() -> None:
    counterpart("cyclopts")
    finished = run(
        "-c", f"{WITHOUT_OTHERS}sys.argv[1:] = ['live', '--help']\nsys.exit(main())", COLUMNS="200"
    )
    assert finished.returncode == 0
    assert "Not installed; it comes with: pip install 'phasestereo[live]'" in finished.stdout


def test_a_geotiff_is_not_read_without_its_distribution(tmp_path: Path) -> None:
    counterpart("rasterio")
    for name in ("left.tif", "right.tif"):
        write_geotiff(
            tmp_path / name, np.zeros((40, 60), np.uint8), like=Georeference(crs="EPSG:32631")
        )

    arguments = ["match", "left.tif", "right.tif", "--json"]
    code = f"{WITHOUT_OTHERS}sys.argv[1:] = {arguments}\nsys.exit(main())"
    finished = run("-c", code, cwd=tmp_path)
    assert (finished.returncode, finished.stdout) == (1, "")
    assert finished.stderr == (
        "phasestereo: error: left.tif is a GeoTIFF, whose masks and place count: phasestereo-large "
        "is not installed; it comes with: pip install 'phasestereo[geo]'\n"
    )


WITHOUT_OTHERS = """
import sys
from importlib import import_module, metadata
metadata.entry_points = lambda **_: ()
from phasestereo.__main__ import main
"""


def test_what_distributions_add_is_declared_and_there() -> None:
    cli = pytest.importorskip("phasestereo.cli")
    formats = pytest.importorskip("phasestereo.io.formats")

    groups = [project.get("entry-points", {}) for project in PROJECTS.values()]
    commands = [point for group in groups for point in group.get(cli.COMMANDS, {}).items()]
    assert sorted(name for name, _ in commands) == sorted(cli.OTHERS)
    for _, place in commands:
        module, _, name = place.partition(":")
        assert callable(getattr(import_module(module), name))

    (declared,) = [group[formats.FORMATS] for group in groups if formats.FORMATS in group]
    assert set(declared) == {"geotiff"}
    assert import_module(declared["geotiff"]) is geotiff


# Types


WRONG = """

import numpy as np

import phasestereo as ps
import phasestereo_live as live

image = np.zeros((40, 60), np.uint8)
ps.match(image)  # wrong: no right image
result = ps.match(image, image, num_disparities=16)
print(result.disparities)  # wrong: no such field
result.disparity = result.disparity  # wrong: it is frozen
ps.Matcher(preset=3)  # wrong: a preset is a name
ps.Settings(optimizer="best")  # wrong: no such optimizer
ps.io.read_picture("left.png")  # wrong: no such function
text: str = ps.estimate_blur(image, image, num_disparities=16)  # wrong: it is an estimate
"""
"""What a type checker must not let pass: each line marked so."""


@pytest.fixture(scope="module")
def complaints(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return what mypy has against the scripts of a user who has installed the package."""
    counterpart("mypy")
    folder = tmp_path_factory.mktemp("user")

    shutil.copy(ROOT / "tests/user_script.py", folder / "right.py")
    (folder / "wrong.py").write_text(WRONG)

    options = "--strict", "--no-error-summary", "--config-file=", f"--cache-dir={folder / 'cache'}"
    finished = run("-m", "mypy", *options, "right.py", "wrong.py", cwd=folder)

    assert finished.stderr == ""
    return finished.stdout.splitlines()


def test_a_script_that_uses_all_of_the_interface_type_checks(complaints: list[str]) -> None:
    assert [line for line in complaints if not line.startswith("wrong.py")] == []


def test_a_script_that_is_wrong_does_not(complaints: list[str]) -> None:
    wanted = [n for n, line in enumerate(WRONG.splitlines(), 1) if "# wrong" in line]
    errors = [re.match(r"wrong\.py:(\d+): error", line) for line in complaints]
    assert [int(found[1]) for found in errors if found] == wanted


def test_the_script_names_all_of_the_interface() -> None:
    tree = ast.parse((ROOT / "tests/user_script.py").read_text())
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "ps"
    }
    assert set(ps.__all__) <= used


# Supply chain


def test_every_action_of_a_workflow_is_named_by_the_hash_of_a_commit() -> None:
    for path in (ROOT / ".github/workflows").glob("*.yml"):
        for line in path.read_text("utf-8").splitlines():
            if "uses:" in line:
                assert re.search(r"uses: [\w./-]+@[0-9a-f]{40} # v\d", line), (path, line)


# A release


URL = "https://example.org/somebody/phasestereo"


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of what a release changes, changed by it."""
    folder = tmp_path_factory.mktemp("released")
    kept = [ROOT / "Cargo.toml", *ROOT.glob("rust/*/Cargo.toml"), *ROOT.glob("rust/*/README.md")]
    for path in kept + [place / name for place in FOLDERS.values() for name in PAGE]:
        copy = folder / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)

    finished = run(str(ROOT / ".ci/release.py"), f"{URL}/", cwd=folder)
    assert (finished.returncode, finished.stderr) == (0, "")
    return folder


PAGE = "pyproject.toml", "README.md"


@pytest.mark.parametrize("name", FOLDERS)
def test_a_package_page_has_addresses_alone_and_they_are_of_files(
    released: Path, name: str
) -> None:
    folder = released / FOLDERS[name].relative_to(ROOT)
    project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    addresses = project["urls"].values()
    links = re.findall(r"\]\(([^)]+)\)", (folder / "README.md").read_text("utf-8"))
    assert all(link.startswith("https://") for link in [*addresses, *links])

    for link in [*addresses, *links]:
        if link.startswith(f"{URL}/") and not link.endswith("/issues"):
            kind, tag, *parts = link.removeprefix(f"{URL}/").partition("#")[0].split("/")
            picture = parts[-1].endswith((".jpg", ".svg"))
            assert (kind, tag) == ("raw" if picture else "blob", "v0.1.0")
            assert ROOT.joinpath(*parts).is_file(), link


def test_a_package_page_begins_with_pip_and_its_crate_says_where_it_is_from(released: Path) -> None:
    page = (released / "README.md").read_text("utf-8")
    blocks = re.findall(r"```sh\n(.+)", page)
    assert [line.split()[:2] for line in blocks[:2]] == [["pip", "install"], ["make", "demo"]]
    assert "pip install ." not in page

    manifest = tomllib.loads((released / "Cargo.toml").read_text("utf-8"))
    assert manifest["workspace"]["package"]["repository"] == URL
    manifest = tomllib.loads((released / "rust/core/Cargo.toml").read_text("utf-8"))
    assert manifest["package"]["repository"] == {"workspace": True}


def test_what_workflows_run_is_there() -> None:
    """Of files in the repository, and of targets of make."""
    targets = re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)

    for path in (ROOT / ".github/workflows").glob("*.yml"):
        text = path.read_text("utf-8")
        ran = re.findall(r"(?:python|run:|/io/)\s*((?:tests|\.ci|benches|web)/[\w./]+)", text)
        assert [name for name in ran if not (ROOT / name).exists()] == []
        assert {*re.findall(r"run: make ([\w-]+)", text)} <= {*targets}


# Files


def test_everything_beside_the_code_is_in_the_source_distribution(tmp_path: Path) -> None:
    maturin = shutil.which("maturin", path=Path(sys.executable).parent) or shutil.which("maturin")
    if maturin is None or shutil.which("cargo") is None:
        pytest.skip("maturin or cargo is not installed")

    subprocess.run(  # noqa: S603  # our own build tool
        [maturin, "sdist", "--out", str(tmp_path)], cwd=ROOT, check=True, capture_output=True
    )

    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}

    there = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob("*") if _is_kept(path)}
    assert {f"python/phasestereo/{name}" for name in ("py.typed", "_core.pyi")} <= there
    assert any(name.endswith(".j2") for name in there)
    assert there <= names

    assert {"LICENSE", "README.md", "Cargo.lock", "rust/core/src/lib.rs", "pyproject.toml"} <= names
    assert not [name for name in names if name.endswith((".so", ".pyd"))]
    modules = [name for name in names if name.startswith("python/")]
    assert all(name.startswith("python/phasestereo/") for name in modules)


def _is_kept(path: Path) -> bool:
    built = path.suffix in (".pyc", ".so", ".pyd") or "__pycache__" in path.parts
    return path.is_file() and not built
