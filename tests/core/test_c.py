"""The C interface: programs made against its header get Python's maps, to the bit."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import Calibration, write_image
from phasestereo.settings import PresetName
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from support import ROOT
from support.c_programs import (
    BGR,
    BGRA,
    GRAY,
    INTERFACE,
    RGB,
    RGBA,
    SANITIZED,
    STRICT,
    Image,
    Pair,
    Program,
    _compiled,
    library as library,  # noqa: PLC0414 - a fixture
    needed,
    program as program,  # noqa: PLC0414 - a fixture
    run,
)
from support.rigs import SIZE, cv2, made_up, turned
from support.saved_rigs import with_raw_cameras

Change = Callable[[Image], Image]


@pytest.fixture(scope="module")
def pair() -> Pair:
    rendered = render_pair(3, height=120, width=160, num_disparities=48)
    return Degradation(disk_psf(3.0), noise=1.0)(rendered.left), rendered.right


def test_the_header_is_one_of_c_and_of_cpp(tmp_path: Path) -> None:
    compiler = needed(shutil.which("cc"), "no C compiler: apt-get install gcc")
    source = tmp_path / "header.c"
    source.write_text('#include "phasestereo.h"\n', encoding="utf-8")
    for language, standard in (("c", "c99"), ("c++", "c++11")):
        options = "-x", language, f"-std={standard}", *STRICT, f"-I{INTERFACE}", "-fsyntax-only"
        run(compiler, *options, source)


@pytest.mark.parametrize("preset", ["robust", "fast", "paper"])
def test_maps_are_those_of_python_to_the_bit(
    program: Program, pair: Pair, preset: PresetName
) -> None:
    expected = ps.match(*pair, preset=preset, num_disparities=48)
    said = program.same(pair, expected, preset=preset)
    assert (said["version"], said["threads"]) == ([ps.__version__], ["2"])
    assert int(said["memory"][0]) > pair[0].nbytes
    assert said["range"] == ["0", "48", "0"]


def test_what_is_found_is_what_python_finds(program: Program, pair: Pair) -> None:
    expected = ps.match(*pair)
    said = program.same(pair, expected, preset="robust", disparities=0)
    search, blur, alignment = expected.search, expected.blur, expected.alignment

    assert search.origin == "found"
    assert said["range"] == [str(search.min_disparity), str(search.num_disparities), "1"]

    assert (blur.blur.side, blur.blur.kind) == ("left", "disk")
    assert said["blur"][:2] == ["1", "2"]
    assert [float(value) for value in said["blur"][2:]] == [blur.blur.size, blur.certainty]
    assert tuple(map(float, said["noise"])) == blur.noise

    assert float(said["rows"][0]) == alignment.coefficients[0]


def test_findings_are_those_of_python_word_for_word(program: Program, pair: Pair) -> None:
    left, right = pair
    dim = left // 3, right
    _, lines, _ = program.run(dim, preset="robust", disparities=0)

    for call, expected in (("matched", ps.match(*dim)), ("checked", ps.check(*dim))):
        said = [line.removeprefix(f"{call} ") for line in lines if line.startswith(f"{call} ")]
        assert said == [f"{one.topic}|{one.severity}|{one.sentence}" for one in expected.findings]
        assert any(line.startswith("contrast|") and "is darker" in line for line in said)


def test_settings_are_read_from_text(program: Program, pair: Pair) -> None:
    expected = ps.match(*pair, num_disparities=48, median=0, min_confidence=0.25, lr_check=None)
    program.same(pair, expected, preset="settings")


@pytest.mark.parametrize("keep", ["trusted", "checked"])
def test_what_is_kept_is_that_of_python(program: Program, pair: Pair, keep: Any) -> None:
    expected = ps.match(*pair, num_disparities=48)
    kept = expected.kept(keep)
    assert 0.1 < kept.mean() < np.isfinite(expected.disparity).mean()
    names = "disparity", "uncertainty"
    maps: dict[str, Any] = {n: np.where(kept, getattr(expected, n), np.nan) for n in names}
    program.same(pair, replace(expected, **maps), preset=keep)


@pytest.mark.parametrize("preset", ["robust", "fast"])
def test_the_map_of_the_right_image_is_that_of_python(
    program: Program, pair: Pair, preset: PresetName
) -> None:
    expected = ps.match(*pair, preset=preset, right_map=True)
    assert expected.right is not None
    said = program.same(pair, expected.right, preset=preset, disparities=0, backward=True)
    search = expected.right.search
    assert said["range"][:2] == [str(search.min_disparity), str(search.num_disparities)]


@pytest.mark.parametrize("backward", [False, True])
def test_a_vertical_pair_is_that_of_python(program: Program, pair: Pair, *, backward: bool) -> None:
    left, right = _changed(pair, lambda image: np.rot90(image, -1))
    expected = ps.match(left, right, preset="fast", vertical=True, right_map=True)
    wanted = expected.right if backward else expected
    assert wanted is not None
    said = program.same((left, right), wanted, preset="vertical", disparities=0, backward=backward)
    assert said["vertical"] == ["1"]
    _, lines, _ = program.run(pair, preset="settings")
    assert "vertical 0" in lines


def _changed(pair: Pair, change: Change) -> Pair:
    left, right = (np.ascontiguousarray(change(image)) for image in pair)
    return left, right


@pytest.mark.parametrize(
    ("channels", "order"),
    [(RGBA, [0, 1, 2, 0]), (BGR, [2, 1, 0]), (BGRA, [2, 1, 0, 0])],
    ids=["rgba", "bgr", "bgra"],
)
def test_channels_are_taken_in_any_order(
    program: Program, pair: Pair, channels: int, order: list[int]
) -> None:
    given = _changed(pair, lambda image: image[:, :, order])
    # Zeros everywhere fill up four bytes; some of them are what shows nothing.
    for alpha in (0, 1):
        seen = np.ones(pair[0].shape[:2], bool)
        if len(order) == 4:
            seen[40:70, 100:140] = not alpha
            for image in given:
                image[..., 3] = alpha * seen
        expected = ps.match(
            *pair, preset="fast", num_disparities=48, left_mask=seen, right_mask=seen
        )
        program.same(given, expected, channels=channels)


def test_gray_and_16_bits_are_those_of_python(program: Program, pair: Pair) -> None:
    gray = _changed(pair, lambda image: image[:, :, 1])
    wide = _changed(pair, lambda image: image.astype(np.uint16) * 257)
    for given, channels in ((gray, GRAY), (wide, RGB)):
        expected = ps.match(*given, preset="fast", num_disparities=48)
        program.same(given, expected, channels=channels)


def test_rows_lie_any_number_of_bytes_apart(program: Program, pair: Pair) -> None:
    expected = ps.match(*pair, preset="fast", num_disparities=48)
    upside_down = _changed(pair, lambda image: image[::-1])
    program.same(upside_down, expected, stride=-pair[0][0].nbytes)
    padded = _changed(pair, lambda image: np.pad(image, ((0, 0), (0, 7), (0, 0))))
    program.same(padded, expected, size=pair[0].shape[:2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"preset": "sure"},
            "1 map: got a keep of 3; accepts PHASESTEREO_ALL, PHASESTEREO_TRUSTED",
        ),
        ({"preset": "best"}, "preset: got 'best'; accepts 'robust', 'paper', 'fast'"),
        ({"disparities": 161}, "1 num_disparities: got 161; accepts an integer from 1 to 160"),
        ({"disparities": -1}, "1 num_disparities: got -1; accepts an integer from 1 to 160"),
        ({"channels": 9}, "1 left: got channels 9; accepts PHASESTEREO_GRAY to _BGRA"),
        ({"size": (0, 160)}, "1 left: got 0 x 160 pixels; accepts at least one pixel"),
    ],
)
def test_what_is_not_acceptable_is_reported(
    program: Program, pair: Pair, options: dict[str, Any], message: str
) -> None:
    code, lines, _ = program.run(pair, **options)
    assert code == 1
    assert lines[0].startswith(message)


LATER = (
    r" *uint32_t vertical;\n",
    r" *double rows_sway;\n",
    r" *const uint8_t \*mask;\n",
    r" *ptrdiff_t mask_stride;\n",
    r" *float \*uncertainty;\n",
    r" *ptrdiff_t uncertainty_stride;\n",
    r" *uint8_t \*support;\n",
    r" *ptrdiff_t support_stride;\n",
    r" *uint32_t keep;\n",
)
"""Fields that an older header might not have had: the last ones of their structures."""


def test_a_program_made_with_an_older_smaller_header_works(library: str, tmp_path: Path) -> None:
    """And is refused strides, sizes and a matcher of another process that would harm it."""
    assert library
    header = (INTERFACE / "phasestereo.h").read_text("utf-8")
    for field in LATER:
        header, count = re.subn(field, "", header)
        assert count == 1
    (tmp_path / "phasestereo.h").write_text(header, "utf-8")

    done = run(_compiled("c_program_old", tmp_path, tmp_path), check=False)
    assert done.returncode == 0, f"{done.returncode}: {done.stdout[-1000:]} {done.stderr[-1000:]}"
    found, image, map_ = "1 found: got", "1 left: got", "1 map: got"
    near = "accepts at least {0}, or at most -{0}, and all of it in memory".format
    wanted = [
        "sizes 480 56",
        "disparity 5",
        f"{image} a stride of 0 bytes; {near(96)}",
        f"{image} a stride of 95 bytes; {near(96)}",
        f"{image} a stride of -1 bytes; {near(96)}",
        f"{image} a stride of 9223372036854775807 bytes; {near(96)}",
        f"{map_} a disparity_stride of 96 bytes; {near(384)}",
        f"{found} a struct_size of 0; accepts its sizeof: 496, and at least 8",
        f"{image} fields that version {ps.__version__} does not know; accepts zeros in them",
    ]
    assert done.stdout.splitlines()[:-1] == wanted
    assert done.stdout.splitlines()[-1].startswith("1 matcher: got one of process ")


# Raw pairs, and pairs of a rig


@dataclass(frozen=True)
class RigProgram:
    """A compiled program that works on the files of a folder, and what it wrote there."""

    path: Path
    folder: Path

    def run(self, work: str, images: dict[str, Image], *options: int) -> list[str]:
        for name, pixels in images.items():
            (self.folder / name).write_bytes(np.ascontiguousarray(pixels).tobytes())
        rows, cols = next(iter(images.values())).shape[:2]
        done = run(self.path, work, self.folder, str(cols), str(rows), *map(str, options))
        return done.stdout.splitlines()

    def written(self, name: str, dtype: Any, *shape: int) -> Image:
        return np.frombuffer((self.folder / name).read_bytes(), dtype).reshape(shape)

    def calibrated(self, rig: dict[str, Image]) -> None:
        """Write the numbers of a calibration."""
        distortions = [np.pad(rig[name], (0, 12 - rig[name].size)) for name in ("D1", "D2")]
        parts = rig["K1"], rig["K2"], *distortions, rig["R"], rig["T"]
        (self.folder / "calibration").write_bytes(b"".join(part.tobytes() for part in parts))


@pytest.fixture(scope="module")
def rig_path(library: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    assert library
    return _compiled("c_rig", INTERFACE, tmp_path_factory.mktemp("c_rig"))


@pytest.fixture
def rig_program(rig_path: Path, tmp_path: Path) -> RigProgram:
    return RigProgram(rig_path, tmp_path)


UNKNOWN = dict.fromkeys(("K1", "K2", "R"), np.zeros(9)) | dict.fromkeys(
    ("D1", "D2", "T"), np.zeros(3)
)
LINEAR, LANCZOS = range(2)


@pytest.mark.parametrize(
    ("channels", "dtype"), [(GRAY, np.uint8), (RGB, np.uint16), (BGRA, np.uint8)]
)
def test_a_calibration_rectifies_as_that_of_python_to_the_bit(
    rig_program: RigProgram, channels: int, dtype: Any
) -> None:
    (cols, rows), count = SIZE, (1, 3, 4, 3, 4)[channels]
    top = np.iinfo(dtype).max
    pair = np.random.default_rng(7).integers(0, top, (2, rows, cols, count), dtype, endpoint=True)
    if count == 4:
        pair[..., 3] |= 1  # all of it shows something
    kept = pair[..., {1: [0], 3: [0, 1, 2], 4: [2, 1, 0]}[count]]
    rig = made_up()
    expected = ps.rectify(kept[0], kept[1], rig)

    rig_program.calibrated(rig)
    images = dict(zip(("left", "right"), pair, strict=True))
    rig_program.run("rectify", images, channels, 8 * dtype(0).itemsize, LINEAR, *SIZE)

    row = cols * count * dtype(0).itemsize
    written = rig_program.written("pixels", np.uint8, 2, rows, row + 5)
    assert not written[..., row:].any()  # what is between the rows
    pixels = np.ascontiguousarray(written[..., :row]).view(dtype).reshape(pair.shape)
    left, right = pixels[0], pixels[1, ::-1]
    if count == 4:
        assert not pixels[..., 3].any()
        left, right = (image[..., [2, 1, 0]] for image in (left, right))
    np.testing.assert_array_equal(left, expected.left.reshape(left.shape))
    np.testing.assert_array_equal(right, expected.right.reshape(right.shape))

    masks = rig_program.written("masks", np.uint8, 2, rows, cols + 5)[..., :cols]
    np.testing.assert_array_equal(masks[0], expected.left_mask)
    np.testing.assert_array_equal(masks[1], expected.right_mask)
    np.testing.assert_allclose(rig_program.written("q", float, 4, 4), expected.Q, rtol=1e-12)

    matched = rig_program.written("disparity", np.float32, rows, cols)
    known = ps.match(
        expected.left,
        expected.right,
        left_mask=expected.left_mask,
        right_mask=expected.right_mask,
        preset="fast",
        num_disparities=16,
    )
    np.testing.assert_array_equal(matched, known.disparity)


@pytest.mark.parametrize(("interpolation", "name"), [(LINEAR, "linear"), (LANCZOS, "lanczos")])
def test_images_alone_rectify_as_in_python(
    rig_program: RigProgram, interpolation: int, name: Any
) -> None:
    size = rows, cols = 300, 400
    scene = render_pair(3, height=rows, width=cols, num_disparities=64)
    turn = cv2.getRotationMatrix2D((200, 150), 2.0, 1.0)
    right = cv2.warpAffine(scene.right, turn, (cols, rows), borderMode=cv2.BORDER_REFLECT)
    expected = ps.rectify(scene.left, right, interpolation=name)

    rig_program.calibrated(UNKNOWN)
    images = {"left": scene.left, "right": right}
    said = rig_program.run("rectify", images, RGB, 8, interpolation, cols, rows)
    assert tuple(said) == expected.sentences
    assert np.isnan(rig_program.written("q", float, 4, 4)).all()

    pixels = rig_program.written("pixels", np.uint8, 2, rows, 3 * cols + 5)[..., : 3 * cols]
    found = pixels[0].reshape(*size, 3), pixels[1, ::-1].reshape(*size, 3)
    masks = expected.left_mask, expected.right_mask
    for image, wanted, valid in zip(found, (expected.left, expected.right), masks, strict=True):
        off = np.abs(image.astype(int) - wanted)
        if interpolation == LINEAR:
            assert off.max() == 0
        else:
            assert off[valid].mean() < 0.5  # OpenCV reads at fewer places between two pixels


@pytest.mark.parametrize("by", [0.5, 1.5])
def test_a_right_image_of_another_size_is_rectified_as_in_python(
    rig_program: RigProgram, by: float
) -> None:
    rig, (cols, rows) = made_up(), SIZE
    own = round(by * cols), round(by * rows)
    rig["K2"] = np.array([[by, 0, by / 2 - 0.5], [0, by, by / 2 - 0.5], [0, 0, 1]]) @ rig["K2"]
    pixels = np.random.default_rng(7)
    left, right = (pixels.integers(0, 256, size[::-1], np.uint8) for size in (SIZE, own))
    expected = ps.rectify(left, right, rig)

    rig_program.calibrated(rig)
    rig_program.run("rectify", {"left": left, "right": right}, GRAY, 8, LINEAR, *own)
    written = rig_program.written("pixels", np.uint8, 2, rows, cols + 5)[..., :cols]
    np.testing.assert_array_equal(written[0], expected.left)
    np.testing.assert_array_equal(written[1, ::-1], expected.right)
    masks = rig_program.written("masks", np.uint8, 2, rows, cols + 5)[..., :cols]
    np.testing.assert_array_equal(masks[1], expected.right_mask)
    np.testing.assert_allclose(rig_program.written("q", float, 4, 4), expected.Q, rtol=1e-12)


def test_images_of_two_sizes_alone_rectify_as_in_python(rig_program: RigProgram) -> None:
    rows, cols = 300, 400
    scene = render_pair(3, height=rows, width=cols, num_disparities=64)
    turn = cv2.getRotationMatrix2D((200, 150), 2.0, 1.0)
    right = cv2.warpAffine(scene.right, turn, (cols, rows), borderMode=cv2.BORDER_REFLECT)
    half = cv2.resize(right, (cols // 2, rows // 2), interpolation=cv2.INTER_AREA)
    expected = ps.rectify(scene.left, half, interpolation="linear")

    rig_program.calibrated(UNKNOWN)
    images = {"left": scene.left, "right": half}
    said = rig_program.run("rectify", images, RGB, 8, LINEAR, cols // 2, rows // 2)
    assert tuple(said) == expected.sentences
    found = rig_program.written("pixels", np.uint8, 2, rows, 3 * cols + 5)[..., : 3 * cols]
    for image, wanted in ((found[0], expected.left), (found[1, ::-1], expected.right)):
        # K2 is brought to the size of the image and back: its last bits are rounded.
        off = np.abs(image.reshape(wanted.shape).astype(int) - wanted)
        assert np.count_nonzero(off) < 1e-3 * off.size


def test_frames_of_a_rig_are_those_of_python_to_the_bit(rig_program: RigProgram) -> None:
    rendered = render_pair(3, height=120, width=160, num_disparities=48)
    noise = np.random.default_rng(3)
    frames = [
        [
            np.clip(image + noise.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
            for image in (rendered.left, rendered.right)
        ]
        for _ in range(3)
    ]
    images = {f"left{n}": frame[0] for n, frame in enumerate(frames)}
    images |= {f"right{n}": frame[1] for n, frame in enumerate(frames)}
    rig_program.run("frames", images)

    rig, steady, saved = ps.Rig(preset="fast"), ps.TemporalFilter(), rig_program.folder / "saved"
    expected = []
    for frame in frames:
        rig.save(saved)
        result = rig.match(*frame, temporal_filter=steady)
        expected.append((result.disparity, result.temporal_support))

    size = rendered.left.shape[:2]
    planes = np.dtype([("disparity", np.float32, size), ("support", np.uint8, size)])
    for name in ("first", "again"):
        for found, wanted in zip(rig_program.written(name, planes, 3), expected, strict=True):
            np.testing.assert_array_equal(found["disparity"], wanted[0])
            np.testing.assert_array_equal(found["support"], wanted[1])
    assert expected[-1][1].max() == 3

    # Saved after two frames, and loaded for the third one.
    assert (rig_program.folder / "text").read_text("utf-8") == saved.read_text("utf-8")
    loaded = ps.Rig.load(saved, preset="fast").match(*frames[2]).disparity
    np.testing.assert_array_equal(rig_program.written("loaded", np.float32, *size), loaded)


def rectifying_rig(path: Path) -> str:
    """Return the text of a rig whose images are raw."""
    rig = ps.Rig(preset="robust")
    rendered = render_pair(3, height=120, width=160, num_disparities=48)
    rig.match(rendered.left, rendered.right)
    rig.save(path)

    return with_raw_cameras(path, (120, 160))


def test_what_a_rig_cannot_take_is_refused(rig_program: RigProgram) -> None:
    rig_program.calibrated(made_up())
    (rig_program.folder / "raw").write_text(rectifying_rig(rig_program.folder / "rig.txt"))
    said = rig_program.run("refuse", {"left": np.full((120, 160), 90, np.uint8)})

    null, pair = "got NULL; accepts a pointer", "translation: got one that leads to"
    wanted = [
        f"1 calibration: {null}",
        "1 calibration: got a struct_size of 0; accepts its sizeof:",
        f"1 rotation: {null}",
        f"1 {pair}",
        "1 rotation: got",
        "1 rectified: got a mask_stride of 159 bytes; accepts at least 160",
        "1 interpolation: got 2; accepts PHASESTEREO_LINEAR or PHASESTEREO_LANCZOS",
        f"1 calibration: {null}",
        f"1 matcher: {null}",
        f"1 rectified: {null}",
        "1 right: got 13 x 160 pixels; accepts up to 8 times as many or as few rows and columns",
        "1 left: got a mask_stride of 0 bytes; accepts at least 160",
        "1 calibration: got numbers by which no pixel is found; accepts finite ones",
        "1 left, right: got images that do not show how to rectify them",
        f"1 rig: {null}",
        f"1 rig: {null}",
        f"text: {null}",
        "rig: got 'a text whose checksum is another one'; accepts a saved rig",
        "text: got",
        "1 matcher: got one of process",
        "1 matcher: got one of process",
    ]
    assert len(said) == len(wanted)
    for line, start in zip(said, wanted, strict=True):
        assert line.startswith(start)


# Pairs for other matchers


@pytest.mark.parametrize(("channels", "most"), [(GRAY, 0), (RGB, 0), (RGB, 20)])
def test_a_prepared_pair_is_that_of_python_to_the_bit(
    library: str, pair: Pair, channels: int, most: int, tmp_path: Path
) -> None:
    assert library
    left, right = _changed(pair, lambda image: image[:, :, 1] if channels == GRAY else image)
    for name, image in (("left", left), ("right", right)):
        (tmp_path / name).write_bytes(image.tobytes())
    rows, cols = left.shape[:2]
    numbers = map(str, (cols, rows, channels, most))
    said = run(_compiled("c_prepare", INTERFACE, tmp_path), tmp_path, *numbers).stdout.splitlines()

    expected = ps.prepare(left, right, max_disparity=most or None)
    shape = expected.left.shape
    assert [line for line in said if line.startswith("done ")] == [
        f"done {sentence}" for sentence in expected.done
    ]
    assert f"disparities {expected.num_disparities}" in said
    assert f"size {shape[0]} {shape[1]} {channels} 8" in said
    for name, image in (("left", expected.left), ("right", expected.right)):
        found = np.fromfile(tmp_path / f"prepared_{name}", np.uint8).reshape(shape)
        np.testing.assert_array_equal(found, image)

    line = np.float32(3) + np.float32(0.01) * np.arange(shape[1], dtype=np.float32)
    restored = expected.restore(np.broadcast_to(line, shape[:2]))
    back = np.fromfile(tmp_path / "restored", np.float32).reshape(rows, cols)
    np.testing.assert_allclose(back, restored, atol=1e-5)
    assert "refused disparity: got 3 x 9 pixels; accepts that of the prepared" in "\n".join(said)
    assert "refused side: got 2; accepts 0, left, or 1, right" in said


# A third camera


@pytest.mark.parametrize("lens", [
    [], [-0.1, 0.02, 0.001, -0.002, 0.01], [0.05, -0.01, 0, 0],
], ids=["pinhole", "polynomial", "fisheye"])  # fmt: skip
def test_registered_depths_are_those_of_python_to_the_bit(
    library: str, pair: Pair, lens: list[float], tmp_path: Path
) -> None:
    assert library
    rows, cols = pair[0].shape[:2]
    focal, baseline = 256.0, 0.125
    rig = Calibration.from_focal(focal, baseline, width=cols, height=rows, unit="m")
    third = ps.ThirdCamera(
        matrix=np.array([[300.0, 0, 99.5], [0, 310, 79.5], [0, 0, 1]]),
        distortion=np.array(lens),
        rotation=turned(1.0, -2.0, 0.5),
        translation=np.array([-0.05, 0.01, 0.002]),
        width=200,
        height=160,
        fisheye=len(lens) == 4,
    )
    result = ps.match(*pair, num_disparities=48)
    near, far = ps.depth_interval(result, rig)[1:]
    depth = ps.depth_interval(result, rig)[0]
    expected = ps.register(result, rig, third)

    left = np.column_stack([rig.cam0, np.zeros(3)])
    right = np.column_stack([rig.cam1, [-focal * baseline, 0, 0]])
    parts = [left, right, third.matrix, np.pad(lens, (0, 14 - len(lens)))]
    parts += [third.rotation, third.translation]
    numbers = b"".join(np.ascontiguousarray(part, np.float64).tobytes() for part in parts)
    (tmp_path / "numbers").write_bytes(numbers)
    given = {"depth": depth, "near": near, "far": far, "confidence": result.confidence}
    for name, values in given.items():
        (tmp_path / name).write_bytes(np.ascontiguousarray(values, np.float32).tobytes())

    program = _compiled("c_register", INTERFACE, tmp_path)
    sizes = map(str, (cols, rows, third.width, third.height, int(third.fisheye)))
    said = run(program, tmp_path, *sizes).stdout.splitlines()
    found = {
        name: np.fromfile(tmp_path / f"r_{name}", kind).reshape(third.height, third.width)
        for name, kind in [
            *((name, np.float32) for name in given),
            ("source", np.int64), ("holes", np.uint8), ("occluded", np.uint8),
        ]
    }  # fmt: skip
    np.testing.assert_array_equal(found.pop("source"), expected.source)
    assert {*found} == {*expected.maps}
    for name, values in expected.maps.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert np.isfinite(expected.depth).mean() > 0.4
    assert [line.split(";")[0] for line in said] == [
        "refused camera: got 0 x 160 pixels",
        "refused calibration: got focal lengths 256 and 256, a distance of the cameras of 0",
        f"refused depths: got {cols} x {rows} values, or a depth that is NULL",
    ]


# The installed package


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which cargo-c has installed the library, quickly compiled."""
    tools = ROOT / "target/tools/bin"
    path = os.pathsep.join([str(tools), os.environ["PATH"]])
    needed(shutil.which("cargo-cinstall", path=path), "no cargo-c: make c")
    folder = tmp_path_factory.mktemp("prefix")
    command = "cargo", "cinstall", "--locked", "--package", "phasestereo-c", "--debug"
    places = f"--prefix={folder}", f"--libdir={folder}/lib", "--target-dir", ROOT / "target/c"
    done = run(*command, *places, check=False, cwd=ROOT, env=os.environ | {"PATH": path})
    assert done.returncode == 0, done.stderr[-1000:]
    return folder


def test_what_is_installed_is_found_by_pkg_config_and_linked_by_its_soname(
    prefix: Path, tmp_path: Path
) -> None:
    tool = needed(shutil.which("pkg-config"), "no pkg-config: apt-get install pkg-config")
    compiler = needed(shutil.which("cc"), "no C compiler: apt-get install gcc")
    asked = tool, "--cflags", "--libs", "phasestereo"
    there = os.environ | {"PKG_CONFIG_PATH": f"{prefix}/lib/pkgconfig"}
    flags = run(*asked, env=there).stdout.split()
    source = tmp_path / "version.c"
    source.write_text(
        "#include <stdio.h>\n#include <phasestereo.h>\n"
        "int main(void) { return puts(phasestereo_version()) < 0; }\n"
    )

    run(compiler, source, *flags, "-o", tmp_path / "version")
    found = os.environ | {"LD_LIBRARY_PATH": f"{prefix}/lib"}
    assert run(tmp_path / "version", env=found).stdout == f"{ps.__version__}\n"
    series = ".".join(ps.__version__.split(".")[:2])
    (prefix / "lib/libphasestereo.so").unlink()  # what only compilers read
    assert run(tmp_path / "version", env=found).stdout == f"{ps.__version__}\n"
    assert (prefix / f"lib/libphasestereo.so.{series}").exists()
    (prefix / "lib/libphasestereo.so").symlink_to(f"libphasestereo.so.{series}")


def test_the_examples_build_from_find_package_and_run_under_sanitizers(
    prefix: Path, pair: Pair, tmp_path: Path
) -> None:
    cmake = needed(shutil.which("cmake"), "no cmake: apt-get install cmake")
    build, source = tmp_path / "build", INTERFACE / "example"
    flags = f"-DCMAKE_CXX_FLAGS={' '.join(SANITIZED)}", f"-DCMAKE_PREFIX_PATH={prefix}"
    run(cmake, "-S", source, "-B", build, *flags)
    run(cmake, "--build", build)

    assert run(build / "shift").stdout.splitlines()[-1] == "disparity 7"
    assert run(build / "register").stdout == "box 80 pixels wide, 20 behind it\n"

    needed(build / "match", "no headers of OpenCV: apt-get install libopencv-dev")
    for name, image in zip(("left", "right"), pair, strict=True):
        write_image(tmp_path / f"{name}.png", image)
    files = [tmp_path / name for name in ("left.png", "right.png", "map.tiff")]
    # What the libraries that OpenCV loads keep to their end is not ours.
    quiet = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
    assert run(build / "match", *files, "48", env=quiet).stdout == "disparities 0 to 47\n"

    written = pytest.importorskip("tifffile").imread(files[2])
    np.testing.assert_array_equal(written, ps.match(*pair, num_disparities=48).disparity)


def test_the_package_of_cmake_has_the_version_of_the_library() -> None:
    text = (INTERFACE / "cmake/phasestereo-config-version.cmake").read_text("utf-8")
    assert f'set(PACKAGE_VERSION "{ps.__version__}")' in text
