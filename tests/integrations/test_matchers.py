"""Other matchers: networks in ONNX files, OpenCV's, functions; what is refused."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.matchers import OtherMatcher, load_matcher, onnx
from phasestereo.matchers.onnx import layout_of
from support import counterpart
from support.pairs import noise_pair

RNG = np.random.default_rng(2)
LEFT, RIGHT = RNG.integers(0, 256, (2, 70, 130, 3), dtype=np.uint8)

# Networks


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
    """Return the output of a network, and its inputs."""
    monkeypatch.setattr(onnx, "opened", lambda _path, _threads: network)
    return onnx.match_onnx(LEFT, RIGHT, 16, path="net.onnx"), network.fed


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
        Network((1, 2, "h", "w"), kind="tensor(int64)"),
        Network(*[(1, 1, "h", "w")] * 3),
        Network(),
    ],
)
def test_a_network_that_takes_no_pair_is_refused(network: Network) -> None:
    with pytest.raises(ValueError, match="^net.onnx: takes .*accepts inputs of rank 4"):
        layout_of(network, "net.onnx")


def test_a_pair_that_is_too_large_and_an_output_that_is_no_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(ValueError, match="takes 64 x 64 pixels, the pair has 130 x 70"):
        fed(Network((1, 2, 64, 64)), monkeypatch)
    network = Network((1, 2, "h", "w"))
    monkeypatch.setattr(network, "run", lambda *_: [np.zeros((1, 5))])
    with pytest.raises(ValueError, match=r"its first output is \(1, 5\), not a map of 70 x 130"):
        fed(network, monkeypatch)


def test_inputs_of_bytes_and_a_white_of_255(monkeypatch: pytest.MonkeyPatch) -> None:
    network = Network((1, 6, "h", "w"), kind="tensor(uint8)")
    _, given = fed(network, monkeypatch)
    assert given["in0"].dtype == np.uint8
    np.testing.assert_array_equal(given["in0"][0, 3:, :70, :130], np.moveaxis(RIGHT, 2, 0))

    network = Network((1, 6, "h", "w"), kind="tensor(float16)")
    monkeypatch.setattr(onnx, "opened", lambda _path, _threads: network)
    onnx.match_onnx(LEFT, RIGHT, 16, path="net.onnx", white=255)
    np.testing.assert_array_equal(network.fed["in0"][0, :3, :70, :130], np.moveaxis(LEFT, 2, 0))


def test_a_network_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*_: object) -> None:
        raise RuntimeError("shapes differ")

    network = Network((1, 2, "h", "w"))
    monkeypatch.setattr(network, "run", run)
    with pytest.raises(ValueError, match=r"^net.onnx: the network failed: shapes differ"):
        fed(network, monkeypatch)


@pytest.mark.parametrize(
    ("metadata", "options", "most"),
    [
        ({}, "", None),
        ({"max_disparity": "192"}, "", 192),
        ({}, ",max_disparity=121,white=255", 121),
    ],
)
def test_the_largest_disparity_comes_from_the_file_or_the_specification(
    metadata: dict[str, str], options: str, most: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    network: Any = Network((1, 2, "h", "w"))
    network.get_modelmeta = lambda: SimpleNamespace(custom_metadata_map=metadata)
    monkeypatch.setattr(onnx, "opened", lambda _path, _threads: network)
    loaded = load_matcher(f"onnx:folder,with/net.onnx{options}")
    assert (loaded.name, loaded.max_disparity) == ("onnx:net", most)
    loaded(LEFT, RIGHT)
    assert network.fed["in0"].max() == pytest.approx(255 if options else 1, rel=0.05)


def test_hitnet_answers_by_its_file_alone(data: Path) -> None:
    counterpart("onnxruntime")
    folder = data / "middlebury/scenes2001/venus"
    left, right = (ps.io.read_image(folder / name) for name in ("im2.ppm", "im6.ppm"))
    found = load_matcher(f"onnx:{data / 'rivals/hitnet_eth3d.onnx'}", threads=1)(left, right)
    truth = ps.io.read_image(folder / "disp2.pgm") / 8
    seen = truth > 0
    assert (np.abs(found - truth)[seen] > 1).mean() < 0.05


# OpenCV's

SHIFT = 7


def shifted(channels: int, dtype: type = np.uint8) -> tuple[Any, Any]:
    pair = [image.astype(dtype) for image in noise_pair(60, 120, SHIFT)]
    if channels == 3:
        pair = [np.stack([image, 255 - image, image // 2], -1) for image in pair]
    return pair[0], pair[1]


@pytest.mark.parametrize("spec", ["sgbm", "bm"])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_opencv_by_name(spec: str, channels: int, dtype: type) -> None:
    counterpart("cv2")
    found = load_matcher(spec)(*shifted(channels, dtype), 16)
    assert found.dtype == np.float32
    assert np.nanmean(np.abs(found[:, SHIFT:-8] - SHIFT) <= 0.5) > 0.95


@pytest.mark.parametrize("kind", ["StereoBM_create", "StereoSGBM_create"])
@pytest.mark.parametrize("channels", [1, 3])
def test_an_object_of_opencv(kind: str, channels: int) -> None:
    cv2 = counterpart("cv2")
    matcher = getattr(cv2, kind)(numDisparities=16, blockSize=9)
    found = load_matcher(matcher)(*shifted(channels))
    inside = found[8:-8, SHIFT + 8 : -8]
    assert np.abs(inside[np.isfinite(inside)] - SHIFT).max() <= 0.5
    assert np.isfinite(inside).mean() > 0.8
    assert not (found < 0).any(), "what is missing is NaN, not -1"


@pytest.mark.parametrize("gray", ["left", "right"])
def test_opencv_takes_a_gray_image_beside_a_color_one(gray: str) -> None:
    cv2 = counterpart("cv2")
    color = list(shifted(3))
    alone = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in color]
    color[gray == "right"] = alone[gray == "right"]
    for name in ("sgbm", "bm", "StereoBM_create", "StereoSGBM_create"):
        made = getattr(cv2, name)(numDisparities=16, blockSize=9) if "_" in name else name
        matcher = load_matcher(made)
        found, expected = (matcher(pair[0], pair[1], 16) for pair in (color, alone))
        np.testing.assert_array_equal(found, expected)


def test_our_stand_in_for_opencv_is_such_an_object() -> None:
    stereo = ps.opencv.StereoPhase_create(minDisparity=0, numDisparities=16)
    found = load_matcher(stereo)(*shifted(3))
    assert np.nanmedian(found) == pytest.approx(SHIFT, abs=0.1)


# Functions


def test_a_function_gets_the_images_as_they_are() -> None:
    seen: list[Any] = []

    def network(left: Any, right: Any) -> Any:
        seen.extend([left, right])
        return np.where(left > 50, np.inf, left).astype(np.float64)

    left, right = shifted(1, np.uint16)
    matcher = load_matcher(network)
    found = matcher(left[:, :, np.newaxis], right)
    np.testing.assert_array_equal(seen, [left, right])
    np.testing.assert_array_equal(found, np.where(left > 50, np.nan, left))
    assert (matcher.name, load_matcher(matcher)) == ("network", matcher)


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (np.zeros((5, 5)), ValueError, r"answer of f: got shape \(5, 5\); accepts \(70, 130\)"),
        (
            np.zeros((70, 130), complex),
            TypeError,
            "answer of f: got dtype complex128; accepts real",
        ),
        (None, TypeError, "answer of f: got NoneType"),
    ],
)
def test_an_answer_that_is_not_a_map_is_refused(
    answer: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        OtherMatcher("f", lambda *_: answer)(LEFT, RIGHT)


@pytest.mark.parametrize(
    ("matcher", "error", "message"),
    [
        (3, TypeError, "got int; accepts a specification"),
        ("", ValueError, "got ''; accepts sgbm, bm, and onnx:FILE.onnx"),
        ("onnx:", ValueError, "got 'onnx:'; accepts"),
        ("sgbm,white=1", ValueError, "got 'sgbm,white=1'; accepts"),
        ("onnx:a.onnx,speed=1", ValueError, "got 'onnx:a.onnx,speed=1'; accepts"),
        ("onnx:a.onnx,white=bright", ValueError, "got 'onnx:a.onnx,white=bright'; accepts an int"),
    ],
)
def test_what_is_not_a_matcher_is_refused(
    matcher: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^matcher: {message}"):
        load_matcher(matcher)


def test_files_that_are_not_networks_are_refused(tmp_path: Path) -> None:
    counterpart("onnxruntime")
    file = tmp_path / "damaged.onnx"
    with pytest.raises(FileNotFoundError, match="no such file"):
        load_matcher(f"onnx:{file}")
    file.write_bytes(b"no network")
    with pytest.raises(ValueError, match="onnxruntime cannot read it"):
        load_matcher(f"onnx:{file}")
