"""Stereo photographs: both views in one picture, or two pictures in one file."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import io
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo.io import read_image, read_pair, write_image
from phasestereo.io.pair import Photograph, read_photograph
from support import Run, counterpart

image = counterpart("PIL.Image")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # noise is matched here

RNG = np.random.default_rng(0)
LEFT, RIGHT = RNG.integers(0, 256, (2, 40, 60, 3), np.uint8)


def write_mpo(path: Path, *pictures: Any) -> None:
    first, *others = (image.fromarray(picture) for picture in pictures)
    first.save(path, format="MPO", save_all=True, append_images=others, quality=95)


@pytest.mark.parametrize(("layout", "axis"), [("side-by-side", 1), ("top-bottom", 0)])
@pytest.mark.parametrize("suffix", [".png", ".tif", ".npy"])
def test_halves_of_a_picture(tmp_path: Path, layout: Any, axis: int, suffix: str) -> None:
    write_image(tmp_path / f"both{suffix}", np.concatenate([LEFT, RIGHT], axis))
    left, right = read_pair(tmp_path / f"both{suffix}", layout)
    np.testing.assert_array_equal(left, LEFT)
    np.testing.assert_array_equal(right, RIGHT)


@pytest.mark.parametrize(("layout", "axis"), [("side-by-side", 1), ("top-bottom", 0)])
def test_the_line_in_the_middle_of_an_odd_picture_is_left_out(
    tmp_path: Path, layout: Any, axis: int
) -> None:
    seam = np.zeros_like(LEFT.take([0], axis))
    write_image(tmp_path / "odd.png", np.concatenate([LEFT, seam, RIGHT], axis))
    left, right = read_pair(tmp_path / "odd.png", layout)
    np.testing.assert_array_equal(left, LEFT)
    np.testing.assert_array_equal(right, RIGHT)


def test_an_anaglyph_has_the_left_view_in_red(tmp_path: Path) -> None:
    write_image(tmp_path / "both.png", np.dstack([LEFT[..., 0], RIGHT[..., 1], RIGHT[..., 2]]))
    left, right = read_pair(tmp_path / "both.png", "anaglyph")
    np.testing.assert_array_equal(left, LEFT[..., 0])
    np.testing.assert_array_equal(right, RIGHT[..., 1])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize(("layout", "axis"), [("half-side-by-side", 1), ("half-top-bottom", 0)])
def test_views_that_were_squeezed_are_widened_to_where_their_pixels_were(
    tmp_path: Path, layout: Any, axis: int, dtype: type
) -> None:
    """A slope stays what it is, but at its ends: every center is where it was."""
    slope: Any = np.add.outer(np.arange(0, 160, 4), np.arange(0, 80, 2)).astype(dtype)
    pairs = slope.reshape(20, 2, 40).mean(1) if axis == 0 else slope.reshape(40, 20, 2).mean(2)
    write_image(tmp_path / "half.npy", np.concatenate([pairs, pairs], axis).astype(dtype))
    inner = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
    for view in read_pair(tmp_path / "half.npy", layout):
        assert (view.shape, view.dtype) == (slope.shape, slope.dtype)
        assert np.abs(view[inner].astype(float) - slope[inner]).max() <= (dtype != np.float32)


def test_depths_of_squeezed_views_are_those_of_whole_ones(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2 = counterpart("cv2")
    monkeypatch.chdir(tmp_path)
    scene = cv2.GaussianBlur(RNG.integers(0, 256, (120, 260), np.uint8), (0, 0), 2)
    scene = cv2.normalize(scene, None, 0, 255, cv2.NORM_MINMAX)
    whole = scene[:, :240], scene[:, 20:]
    halves = [view.reshape(120, 120, 2).mean(2).astype(np.uint8) for view in whole]
    geometry = "--focal", 300, "--baseline", 0.1, "--num-disparities", 48, "--depth", "z.npy"
    for layout, views in (("side-by-side", whole), ("half-side-by-side", halves)):
        write_image("both.png", np.hstack(views))
        code, _, err = run("match", "both.png", "--layout", layout, *geometry)
        assert code == 0, err
        depth = np.load("z.npy")
        assert depth.shape == (120, 240)
        assert np.nanmedian(depth) == pytest.approx(1.5, rel=0.01)


# Spatial photographs


def heic(views: list[Any], group: list[int] | None, kind: bytes = b"ster") -> bytes:
    """Return a HEIC file of images, and a group of them, which pillow-heif does not write."""
    heif = counterpart("pillow_heif").HeifFile()
    for view in views:
        heif.add_frombytes("RGB", view.shape[1::-1], view.tobytes())
    file = io.BytesIO()
    heif.save(file, quality=-1, chroma=444)
    content = bytearray(file.getvalue())
    if group is None:
        return bytes(content)

    entities = b"".join(struct.pack(">I", number) for number in group)
    inner = struct.pack(">I4sIII", 20 + len(entities), kind, 0, 99, len(group)) + entities
    box = struct.pack(">I4s", 8 + len(inner), b"grpl") + inner

    # It is the last box of ``meta``; what comes behind that moves.
    start = content.index(b"meta") - 4
    (length,) = struct.unpack_from(">I", content, start)
    struct.pack_into(">I", content, start, length + len(box))
    table = content.index(b"iloc") + 8
    assert content[table : table + 2] == b"\x44\x40"  # of 4 bytes: offsets, lengths, bases
    (count,) = struct.unpack_from(">H", content, table + 2)
    for place in range(table + 4, table + 4 + 18 * count, 18):
        (base,) = struct.unpack_from(">I", content, place + 4)
        struct.pack_into(">I", content, place + 4, base + len(box))
    end = start + length
    return bytes(content[:end]) + box + bytes(content[end:])


LEVELS = [np.full((64, 96, 3), level, np.uint8) for level in (40, 120, 200)]


@pytest.mark.parametrize(("count", "group"), [(2, (1, 2)), (2, (2, 1)), (3, (3, 1))])
def test_the_group_of_a_spatial_photograph_says_which_view_is_the_left_one(
    tmp_path: Path, count: int, group: tuple[int, int]
) -> None:
    (tmp_path / "both.heic").write_bytes(heic(LEVELS[:count], [*group]))
    for view, number in zip(read_pair(tmp_path / "both.heic"), group, strict=True):
        assert view.shape == (64, 96, 3)
        assert np.abs(view.astype(int) - LEVELS[number - 1]).max() < 3


def test_what_is_no_spatial_photograph(tmp_path: Path) -> None:
    path = tmp_path / "some.heic"
    for content, message in (
        (heic(LEVELS[:1], None), "layout: got None for .*some.heic, and no right image"),
        (heic(LEVELS[:2], [1, 2], b"altr"), "holds 2 images, and only one can be meant"),
        (heic(LEVELS, [1, 2, 3]), "some.heic: .*exactly two images"),
        (heic([LEVELS[0], LEVELS[1][:32]], [1, 2]), r"pictures of \(64, 96\) and \(32, 96\)"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=message):
            read_pair(path)
    path.write_bytes(heic(LEVELS[:2], [1, 2]))
    with pytest.raises(ValueError, match="holds 2 images, and only one .*read_pair"):
        read_image(path)


def test_the_focal_length_of_a_spatial_photograph_is_known(
    run: Callable[..., Run], tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counterpart("pillow_heif")
    found = read_photograph(data / "real_pairs/heic/both.HEIC")
    assert found.focal == pytest.approx(1525.4446)
    left, right = (np.ascontiguousarray(view[1000:1200, 1000:1300]) for view in found[:2])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "phasestereo.cli.pairing.read_photograph", lambda *_: Photograph(left, right, found.focal)
    )
    code, out, err = run("match", "a.heic", "--baseline", 0.0637, "--unit", "m", "--depth", "z.npy")
    assert code == 0, err
    assert "baseline 0.0637, and depths, in m; focal length 1525.44 px" in out
    monkeypatch.setattr(
        "phasestereo.cli.pairing.read_photograph", lambda *_: Photograph(left, right)
    )
    code, _, err = run("match", "a.heic", "--baseline", 0.0637, "--unit", "m", "--depth", "z.npy")
    assert (code, "--baseline: has no effect without --focal" in err) == (2, True)


@pytest.mark.parametrize("count", [2, 3])
def test_the_first_two_pictures_of_a_file(tmp_path: Path, count: int) -> None:
    path = tmp_path / "photo.jpg"  # its name does not matter
    views = [np.full_like(LEFT, level) for level in (40, 90, 200)]
    write_mpo(path, *views[:count])
    left, right = read_pair(path)
    for found, given in zip((left, right), views[:2], strict=True):
        assert found.shape == given.shape
        assert np.abs(found.astype(int) - given).mean() < 3


def test_a_second_picture_that_claims_more_than_the_file_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "photo.mpo"
    write_mpo(path, LEFT, LEFT)
    head, size, tail = path.read_bytes().rpartition(LEFT.shape[0].to_bytes(2, "big") + b"\0\x3c")
    path.write_bytes(head + (9000).to_bytes(2, "big") * (len(size) // 2) + tail)
    with pytest.raises(ValueError, match=r"photo\.mpo: the header asks for 243000000 bytes of"):
        read_pair(path)


def test_what_is_no_stereo_photograph(tmp_path: Path) -> None:
    write_image(tmp_path / "one.png", LEFT)
    write_image(tmp_path / "one.jpg", LEFT)

    for name in ("one.png", "one.jpg"):
        with pytest.raises(ValueError, match=rf"^layout: got None for .*{name}.*; accepts "):
            read_pair(tmp_path / name)

    (tmp_path / "text.pdf").write_text("no picture", encoding="utf-8")
    with pytest.raises(ValueError, match=r"text\.pdf") as refusal:
        read_pair(tmp_path / "text.pdf")
    assert "layout" not in str(refusal.value)

    with pytest.raises(ValueError, match="^layout: got 'both'; accepts 'side-by-side'"):
        read_pair(tmp_path / "one.png", "both")  # type: ignore[arg-type]

    write_image(tmp_path / "thin.png", LEFT[:, :1])
    with pytest.raises(ValueError, match="^layout: 'side-by-side' needs two columns or more"):
        read_pair(tmp_path / "thin.png", "side-by-side")

    write_image(tmp_path / "gray.png", LEFT[..., 0])
    with pytest.raises(ValueError, match="^layout: 'anaglyph' needs colors, got 60 x 40 pixels"):
        read_pair(tmp_path / "gray.png", "anaglyph")

    write_mpo(tmp_path / "unlike.mpo", LEFT, RIGHT[:20])
    with pytest.raises(ValueError, match=r"unlike\.mpo: pictures of \(40, 60\) and \(20, 60\)"):
        read_pair(tmp_path / "unlike.mpo")

    write_mpo(tmp_path / "pair.mpo", LEFT, RIGHT)
    with pytest.raises(ValueError, match=r"pair\.mpo: the file holds 2 images, .*read_pair"):
        read_image(tmp_path / "pair.mpo")

    with pytest.raises(FileNotFoundError):
        read_pair(tmp_path / "nowhere.mpo")


def test_a_photograph_that_is_cut_short(tmp_path: Path) -> None:
    write_mpo(tmp_path / "photo.mpo", LEFT, RIGHT)
    content = (tmp_path / "photo.mpo").read_bytes()
    for length in range(3, len(content), 211):
        (tmp_path / "cut.mpo").write_bytes(content[:length])
        with pytest.raises(ValueError, match=r"cut\.mpo"):
            read_pair(tmp_path / "cut.mpo")


# Paths in place of images


@pytest.fixture
def paths(tmp_path: Path) -> tuple[str, Path]:
    scene = RNG.integers(0, 256, (80, 126), np.uint8)
    write_image(tmp_path / "left.png", scene[:, :-6])
    write_image(tmp_path / "right.png", scene[:, 6:])
    return str(tmp_path / "left.png"), tmp_path / "right.png"


def test_what_a_geotiff_leaves_out_is_masked_for_paths_too(tmp_path: Path) -> None:
    rasterio = counterpart("rasterio")
    scene = RNG.integers(1, 2000, (80, 126), np.uint16)
    left, right = scene[:, :-6].copy(), scene[:, 6:]
    left[:, :30] = 0
    for name, view in (("left.tif", left), ("right.tif", right)):
        profile = {"driver": "GTiff", "height": 80, "width": 120, "count": 1, "dtype": "uint16"}
        with rasterio.open(tmp_path / name, "w", nodata=0, **profile) as file:
            file.write(view, 1)

    paths = tmp_path / "left.tif", tmp_path / "right.tif"
    valid = left > 0
    expected = ps.match(left, right, num_disparities=16, left_mask=valid)
    result = ps.match(*paths, num_disparities=16)
    np.testing.assert_array_equal(result.disparity, expected.disparity)
    assert np.isnan(result.disparity[~valid]).all()

    # A mask that is given counts beside it.
    more = np.ones_like(valid)
    more[:9] = False
    both = ps.match(*paths, num_disparities=16, left_mask=more)
    assert np.isnan(both.disparity[~(valid & more)]).all()
    judged = ps.verify(*paths, result.disparity)
    assert judged.findings == ps.verify(left, right, result.disparity, left_mask=valid).findings
    assert str(ps.check(*paths)) != str(ps.check(left, right))


def test_paths_stand_for_images(paths: tuple[str, Path]) -> None:
    images = read_image(paths[0]), read_image(paths[1])
    expected = ps.match(*images, num_disparities=16)
    matcher = ps.Matcher()

    for given in (paths, (images[0], paths[1])):
        for result in (
            ps.match(*given, num_disparities=16),
            matcher.match(*given, num_disparities=16),
        ):
            np.testing.assert_array_equal(result.disparity, expected.disparity)
            for kept, image in zip(result.pair, images, strict=True):
                np.testing.assert_array_equal(kept, image)

    assert str(ps.check(*paths)) == str(ps.check(*images))
    assert str(ps.estimate_blur(*paths)) == str(ps.estimate_blur(*images))

    [frame] = live.stream([paths], num_disparities=16)
    np.testing.assert_array_equal(frame.result.disparity, expected.disparity)
