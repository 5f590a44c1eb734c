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
from phasestereo_bench.networks import layout_of
from support import counterpart

Run = Callable[..., tuple[int, str, str]]

RNG = np.random.default_rng(2)
LEFT, RIGHT = RNG.integers(0, 256, (2, 70, 130, 3), dtype=np.uint8)


class Network:
    """What onnxruntime makes of a file, as far as it is used: it answers the mean of its inputs."""

    def __init__(self, *shapes: tuple[Any, ...], kind: str = "tensor(float)") -> None:
        self.inputs = [
            SimpleNamespace(name=f"in{number}", shape=list(shape), type=kind)
            for number, shape in enumerate(shapes)
        ]
        self.fed: dict[str, Any] = {}

    def get_inputs(self) -> list[Any]:
        return self.inputs

    def run(self, _outputs: None, fed: dict[str, Any]) -> list[Any]:
        self.fed = fed
        first = fed["in0"]
        last = first.shape[3] in (1, 2, 3, 6) and first.shape[1] not in (1, 2, 3, 6)
        return [first.mean(axis=3 if last else 1, keepdims=True)]


def fed(network: Network, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, dict[str, Any]]:
    """Return what comes out of a network, and what it was given."""
    monkeypatch.setattr(networks, "_session", lambda _path: network)
    return networks.match_onnx(LEFT, RIGHT, 16, path="net.onnx"), network.fed


GRAY_LEFT, GRAY_RIGHT = (
    (image @ np.array([0.299, 0.587, 0.114]) / 255).astype(np.float32) for image in (LEFT, RIGHT)
)
COLOR = [np.moveaxis(image / 255, 2, 0) for image in (LEFT, RIGHT)]


@pytest.mark.parametrize(
    ("shapes", "expected"),
    [
        ([(1, 2, "h", "w")], [np.stack([GRAY_LEFT, GRAY_RIGHT])]),
        ([("b", 6, None, None)], [np.concatenate(COLOR)]),
        ([(1, 1, "h", "w")] * 2, [GRAY_LEFT[np.newaxis], GRAY_RIGHT[np.newaxis]]),
        ([(1, 3, 128, 192)] * 2, COLOR),
    ],
)
@pytest.mark.parametrize("last", [False, True])
def test_a_network_gets_what_its_inputs_ask_for(
    shapes: list[tuple[Any, ...]],
    expected: list[Any],
    last: bool,  # noqa: FBT001 - a parameter of the test
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if last:
        shapes = [(batch, *size, channels) for batch, channels, *size in shapes]

    answer, given = fed(Network(*shapes), monkeypatch)
    assert list(given) == [f"in{number}" for number in range(len(shapes))]

    for batch, wanted in zip(given.values(), expected, strict=True):
        planes = np.moveaxis(batch[0], 2, 0) if last else batch[0]
        assert batch.dtype == np.float32
        assert planes.shape[1:] == (128, 192)  # the next multiples of 64
        np.testing.assert_allclose(planes[:, :70, :130], wanted, atol=1e-6)
        np.testing.assert_array_equal(planes[:, 100, :], planes[:, 69, :])  # its edge, repeated

    assert answer.shape == (70, 130)
    np.testing.assert_allclose(answer, expected[0].mean(axis=0), atol=1e-6)


@pytest.mark.parametrize(
    "network",
    [
        Network((1, 4, "h", "w")),
        Network(("h", "w")),
        Network((1, 3, "h", "w")),
        Network((1, 2, "h", "w"), kind="tensor(uint8)"),
        Network(*[(1, 1, "h", "w")] * 3),
        Network(),
    ],
)
def test_a_network_that_takes_no_pair_is_refused(network: Network) -> None:
    with pytest.raises(ValueError, match="^net.onnx: takes .*accepts float32 inputs of rank 4"):
        layout_of(network, "net.onnx")


def test_a_pair_that_is_too_large_and_an_output_that_is_no_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(ValueError, match="takes 64 x 64 pixels, the pair has 130 x 70"):
        fed(Network((1, 2, 64, 64)), monkeypatch)
    network = Network((1, 2, "h", "w"))
    monkeypatch.setattr(network, "run", lambda *_: [np.zeros((1, 5))])
    with pytest.raises(ValueError, match=r"its first output is \(1, 5\), no map of 70 x 130"):
        fed(network, monkeypatch)


# HITNet


def test_another_file_is_refused_by_its_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(networks, "runtime", lambda: None)

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
    assert "./benches/harness[onnx]" in err
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
    monkeypatch.setattr(networks, "_session", lambda _path: session)
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
