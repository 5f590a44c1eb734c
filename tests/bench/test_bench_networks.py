"""Networks and programs as methods: what they take, what is refused, what is left out."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_bench_cases import plant

import phasestereo as ps
from phasestereo_bench import method, networks
from phasestereo_bench.datasets import find_scene, find_scenes
from support import counterpart

Run = Callable[..., tuple[int, str, str]]

RNG = np.random.default_rng(2)
LEFT, RIGHT = RNG.integers(0, 256, (2, 70, 130, 3), dtype=np.uint8)


# HITNet


def test_another_file_is_refused_by_its_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", SimpleNamespace())
    other = tmp_path / "other.onnx"
    other.write_bytes(b"no network")

    with pytest.raises(ValueError, match=f"^hitnet: {other} has the SHA-256 [0-9a-f]{{64}}, not"):
        method(f"hitnet:{other}")

    with pytest.raises(FileNotFoundError):
        method(f"hitnet:{tmp_path / 'none.onnx'}")

    with pytest.raises(ValueError, match="accepts hitnet:FILE.onnx"):
        method("hitnet")


def test_without_onnxruntime_a_sentence_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    monkeypatch.chdir(tmp_path)
    root = plant(tmp_path, "one")

    command = ["bench", "middlebury", root, "--suite", "sharp", "--method", "fast"]
    code, out, err = run(*command, "--hitnet", "hitnet.onnx", "--workers", 0)

    message = "left out, hitnet: onnxruntime is not installed; it comes with: pip install"
    assert (code, err.count(message)) == (0, 1)
    assert "phasestereo[onnx]" in err
    assert "fast" in out

    with pytest.raises(ImportError, match="^onnxruntime is not installed"):
        method("onnx:any.onnx")


def test_a_file_that_is_no_network(tmp_path: Path) -> None:
    counterpart("onnxruntime")
    file = tmp_path / "damaged.onnx"
    file.write_bytes(b"no network")
    with pytest.raises(ValueError, match="damaged.onnx: onnxruntime cannot read it"):
        method(f"onnx:{file}").match(LEFT, RIGHT, 16)


@pytest.mark.parametrize(("inside", "expected"), [({}, "Beside"), ({"license": "MIT"}, "MIT")])
def test_the_license_of_a_network_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: dict[str, str], expected: str
) -> None:
    (tmp_path / "LICENSE.txt").write_text("\n Beside \nmore")
    session = SimpleNamespace(get_modelmeta=lambda: SimpleNamespace(custom_metadata_map=inside))
    monkeypatch.setattr(networks, "opened", lambda _path, threads: session)  # noqa: ARG005
    assert networks.license_of(str(tmp_path / "net.onnx")) == expected


def test_hitnet_is_as_good_as_it_was_measured(data: Path) -> None:
    counterpart("onnxruntime")

    pair = find_scene(data / "middlebury", "venus").load()

    entrant = method(f"hitnet:{data / 'rivals/hitnet_eth3d.onnx'}")
    assert entrant.name == "hitnet"
    license_ = "not said: ask who trained it"
    assert entrant.settings == {"sha256": networks.HITNET_SHA256, "license": license_}

    disparity: Any = entrant.match(pair.left, pair.right, 1)
    bad = ps.metrics.bad_pixels(disparity, pair.truth, 1.0, pair.masks["nonocc"])
    assert bad == pytest.approx(0.4, abs=0.1)


def test_mccnn_finds_disparities(data: Path) -> None:
    pytest.importorskip("mc_cnn")  # not on CI: its OpenCV would replace ours
    counterpart("c_libsgm")
    pair = find_scene(data / "middlebury", "cones").load()
    disparity: Any = method("mccnn").match(pair.left, pair.right, pair.num_disparities)
    bad = ps.metrics.bad_pixels(disparity, pair.truth, 1.0, pair.masks["nonocc"])
    assert bad == pytest.approx(5.3, abs=0.3)


def test_without_its_package_mccnn_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("mc_cnn", "mc_cnn.run"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match="pip install --no-deps mccnn$"):
        method("mccnn")
    with pytest.raises(ValueError, match="mccnn takes no settings"):
        method("mccnn:fast")


# Programs


def test_a_program_takes_files_and_writes_one(tmp_path: Path) -> None:
    script = tmp_path / "mine.py"
    script.write_text(
        "import sys, numpy as np\n"
        "from phasestereo.io import read_image, write_disparity\n"
        "left, right = map(read_image, sys.argv[1:3])\n"
        "level = left[0, 0, 0] + right[0, 0, 0] / 256 + int(sys.argv[3])\n"
        "write_disparity(sys.argv[4], np.full(left.shape[:2], level, np.float32))\n"
    )

    line = f"{sys.executable} {script} {{left}} {{right}} {{num_disparities}} {{output}}"
    entrant = method(f"program:{line}")
    disparity: Any = entrant.match(LEFT, RIGHT, 16)

    assert entrant.name.startswith("program:python")
    assert disparity.shape == LEFT.shape[:2]
    assert disparity[0, 0] == LEFT[0, 0, 0] + RIGHT[0, 0, 0] / 256 + 16


def test_programs_that_fail_say_why(tmp_path: Path) -> None:
    line = f"{sys.executable} -c \"raise SystemExit('no license')\" {{left}} {{right}} {{output}}"
    with pytest.raises(ValueError, match="exit code 1: no license"):
        method(f"program:{line}").match(LEFT, RIGHT, 16)

    with pytest.raises(ValueError, match=r"without \{right\} and \{output\}"):
        method("program:mine {left}")

    missing = tmp_path / "none"
    with pytest.raises(FileNotFoundError):
        method(f"program:{missing} {{left}} {{right}} {{output}}").match(LEFT, RIGHT, 16)


# Ours, nothing given


def test_the_range_may_be_left_to_the_match(tmp_path: Path) -> None:
    pair = find_scenes(plant(tmp_path, "one"))[0].load()
    entrant = method("robust:num_disparities=auto")
    disparity, _ = entrant.match(pair.left, pair.right, 1)
    direct = ps.match(pair.left, pair.right, threads=1)
    np.testing.assert_array_equal(disparity, direct.disparity)
    with pytest.raises(ValueError, match="num_disparities: got 16; accepts auto alone"):
        method("robust:num_disparities=16")
