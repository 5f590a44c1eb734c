"""A pair prepared for other matchers, and maps that come back: as our own match of the pair."""

from __future__ import annotations

import json
import pickle
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.matchers import load_matcher
from phasestereo.metrics import bad_pixels
from phasestereo.settings import resolve
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.rendering import render_pair
from phasestereo_bench.rigs.geometry import Misaligned
from support import counterpart
from support.pairs import noise_pair
from support.warping import moved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

    Image = NDArray[Any]
    Run = Callable[..., tuple[int, str, str]]

ndimage = counterpart("scipy.ndimage")


@pytest.fixture(scope="module")
def cones(data: Path) -> Pair:
    """Return a real scene whose rows correspond."""
    return find_scene(data / "middlebury", "cones").load()


def turned(pair: Pair) -> tuple[Image, Image]:
    made = Misaligned(turn=5)(pair, "right")
    return made.left, made.right


def blurred(image: Image, width: int = 11) -> Image:
    found: Image = ndimage.uniform_filter1d(image.astype(float), width, axis=1)
    return found.round().astype(np.uint8)


FAULTS: dict[str, Callable[[Pair], tuple[Image, Image]]] = {
    "sharp": lambda pair: (pair.left, pair.right),
    "rows": lambda pair: (pair.left, moved(pair.right, down=4)),
    "turned": turned,
    "negative": lambda pair: (pair.left, 255 - pair.right),
    "blurred": lambda pair: (blurred(pair.left), pair.right),
    "behind infinity": lambda pair: (pair.left[:, 30:].copy(), pair.right[:, :-30].copy()),
}


def gray(image: Image) -> Image:
    found: Image = np.rint(image @ [0.299, 0.587, 0.114]).astype(np.uint8)
    return found


def plain(whole: ps.Result, pair: ps.Prepared) -> ps.Result:
    """Match a prepared pair with the settings of a match, finding out nothing of it but noise."""
    found = whole.blur_compensation
    assert found is not None
    return ps.match(
        pair.left,
        pair.right,
        num_disparities=pair.num_disparities,
        settings=resolve(
            None,
            whole.settings,
            dict.fromkeys(("align_rows", "self_rectify", "compensate_blur", "scales"), False),
        ),
        known=ps.Known(
            blur_compensation=ps.BlurCompensation(noise=found.noise, smoothing=found.smoothing)
        ),
    )


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", ["gray", "color", "float"])
def test_a_plain_match_of_the_prepared_pair_comes_back_as_the_match(
    fault: str, kind: str, cones: Pair
) -> None:
    left, right = FAULTS[fault](cones)
    if kind != "color":
        dtype = np.float32 if kind == "float" else np.uint8
        left, right = gray(left).astype(dtype), gray(right).astype(dtype)
    whole = ps.match(left, right, scales=False, denoise=False)

    pair = ps.prepare(left, right, denoise=False)
    assert pair.left.dtype == pair.right.dtype == left.dtype
    assert pair.left.shape == pair.right.shape
    assert pair.left.ndim == left.ndim
    assert (pair.done == ()) == (fault == "sharp")

    back = pair.restore(plain(whole, pair).disparity)
    assert back.shape == whole.disparity.shape
    assert back.dtype == np.float32
    assert np.isfinite(back[whole.trusted]).mean() > 0.999
    off = np.abs(back - whole.disparity)[whole.trusted & np.isfinite(back)]
    if fault in ("sharp", "negative"):
        assert off.max() == 0
    elif fault == "blurred":
        # A match smooths its map by the image before it is blurred; bytes are rounded besides.
        assert np.median(off) < (0.02 if kind == "float" else 0.1)
    else:
        # Pixels of colors are rounded where those of gray values are; masks are not known.
        assert (off < 0.02).mean() > (0.6 if kind == "color" else 0.9)
        assert np.median(off) < 0.02


@pytest.mark.parametrize("fault", ["turned", "rows", "sharp"])
def test_the_map_that_a_match_has_of_the_prepared_pair_comes_back_as_its_result(
    fault: str, cones: Pair
) -> None:
    left, right = FAULTS[fault](cones)
    whole = ps.match(left, right)
    assert (whole.rectified is None) == (fault != "turned")
    of_pair = whole.disparity if whole.rectified is None else whole.rectified.disparity

    restored = ps.prepare(left, right).restore(of_pair)
    np.testing.assert_array_equal(np.isnan(restored), np.isnan(whole.disparity))
    np.testing.assert_allclose(restored, whole.disparity, atol=0.02)


# Other matchers


@pytest.mark.parametrize(
    ("fault", "before", "after"), [("rows", 40, 12), ("turned", 50, 15), ("negative", 70, 14)]
)
def test_sgbm_matches_what_it_could_not(
    fault: str, before: float, after: float, data: Path
) -> None:
    counterpart("cv2")
    spoilt = {"rows": Misaligned(down=4), "turned": Misaligned(turn=5)}
    pair = find_scene(data / "middlebury", "cones").load()
    if fault in spoilt:
        pair = spoilt[fault](pair, "right")
    right = 255 - pair.right if fault == "negative" else pair.right
    sgbm = load_matcher("sgbm")

    def bad(disparity: Any) -> float:
        assert pair.truth is not None
        return bad_pixels(disparity, pair.truth, 1.0, mask=pair.masks["nonocc"])

    made = ps.prepare(pair.left, right)
    found = made.restore(sgbm(made.left, made.right, made.num_disparities))
    assert bad(sgbm(pair.left, right, pair.num_disparities)) > before
    assert bad(found) < after


def test_a_network_matches_what_it_could_not(data: Path) -> None:
    counterpart("onnxruntime")
    pair = Misaligned(down=4)(find_scene(data / "middlebury", "cones").load(), "right")
    hitnet = load_matcher(f"onnx:{data / 'rivals/hitnet_eth3d.onnx'}", threads=1)

    made = ps.prepare(pair.left, pair.right)
    maps = hitnet(pair.left, pair.right), made.restore(hitnet(made.left, made.right))
    assert pair.truth is not None
    raw, prepared = (
        bad_pixels(found, pair.truth, 1.0, mask=pair.masks["nonocc"]) for found in maps
    )
    assert raw > 40
    assert prepared < 10


# What is done and what is not


@pytest.fixture(scope="module")
def rendered() -> Pair:
    return render_pair(3, height=160, width=240, num_disparities=64)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [0, 1, 3, 4])
def test_a_pair_in_order_stays_as_it_is(rendered: Pair, dtype: type, channels: int) -> None:
    images: list[Image] = [image.astype(dtype) for image in (rendered.left, rendered.right)]
    if channels < 3:
        images = [image[:, :, 1:2] if channels else image[:, :, 1] for image in images]
    given = [np.dstack([image, image[:, :, :1]]) if channels == 4 else image for image in images]

    pair = ps.prepare(*given)
    assert pair.done == ()
    for image, made in zip(images, (pair.left, pair.right), strict=True):
        assert made.dtype == dtype
        np.testing.assert_array_equal(made, image)
    claims = np.random.default_rng(1).random(images[0].shape[:2], np.float32)
    claims[::3] = np.nan
    np.testing.assert_array_equal(pair.restore(claims), claims)


@pytest.mark.parametrize("side", [0, 1])
def test_alpha_that_hides_something_is_dropped_with_a_word(rendered: Pair, side: int) -> None:
    images: list[Image] = [rendered.left, rendered.right]
    alpha = np.full(images[side].shape[:2], 255, np.uint8)
    for hides in (False, True):
        alpha[40:80] *= not hides
        given = [
            np.dstack([image, alpha]) if k == side else image for k, image in enumerate(images)
        ]
        pair = ps.prepare(*given, num_disparities=64)
        assert [done for done in pair.done if done.startswith("alpha is dropped")] == (
            [pair.done[-1]] if hides else []
        )
        np.testing.assert_array_equal(pair.left, rendered.left)
        restored = pair.restore(np.ones(alpha.shape))
        np.testing.assert_array_equal(np.isnan(restored), (alpha == 0) & (side == 0))


def test_images_of_two_types_and_sizes_become_alike(rendered: Pair) -> None:
    right = np.repeat(np.repeat(rendered.right.astype(np.uint16) * 257, 2, axis=0), 2, axis=1)
    pair = ps.prepare(rendered.left, right)
    assert pair.right.dtype == np.uint8
    assert pair.right.shape == pair.left.shape
    assert np.abs(pair.right.astype(float) - rendered.right).mean() < 3
    assert [sentence.partition(" is ")[0] for sentence in pair.done[1:2]] == ["the right image"]
    assert "resampled from 480 x 320 to 240 x 160 pixels" in " ".join(pair.done)


def test_gray_levels_of_the_right_image_become_those_of_the_left_one(rendered: Pair) -> None:
    dark = np.rint(255 * 0.5 * (rendered.right / 255.0) ** 1.3).astype(np.uint8)
    pair = ps.prepare(rendered.left, dark)
    assert pair.done[-1].startswith("gray levels of the right image become those of the left one: ")
    off = [np.abs(image.astype(float) - rendered.right).mean() for image in (dark, pair.right)]
    assert off[1] < 0.2 * off[0]
    np.testing.assert_array_equal(pair.left, rendered.left)


@pytest.mark.parametrize(("noise", "smooths"), [(8, False), (20, True)])
def test_much_noise_is_smoothed(rendered: Pair, noise: float, smooths: bool) -> None:  # noqa: FBT001
    rng = np.random.default_rng(5)
    noisy = [
        np.clip(image + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)
        for image in (rendered.left, rendered.right)
    ]
    pair = ps.prepare(*noisy)
    assert (pair.done == ("noise is smoothed in both images",)) == smooths
    if smooths:
        off = [np.std(image.astype(float) - rendered.left) for image in (noisy[0], pair.left)]
        assert off[1] < 0.7 * off[0]


def test_a_map_of_a_prepared_pair_is_judged_in_the_left_image_as_it_came(rendered: Pair) -> None:
    right = moved(rendered.right, down=4)
    shown = right.copy()
    pair = ps.prepare(rendered.left, shown)
    copy = pickle.loads(pickle.dumps(pair))  # noqa: S301
    truth = np.asarray(rendered.truth, np.float32)
    claims = truth.copy()
    claims[60:100, 80:140] += 6

    shown[:] = 0  # what was found of the pair holds, and nothing is looked for again
    judged = pair.judge(claims)
    whole = ps.verify(rendered.left, right, pair.restore(claims))
    for other in (judged, copy.judge(claims)):
        np.testing.assert_array_equal(other.confidence, whole.confidence)
        np.testing.assert_array_equal(other.verdict, whole.verdict)
    seen = rendered.masks["nonocc"] & np.isfinite(truth)
    wrong = np.zeros_like(seen)
    wrong[60:100, 80:140] = True
    assert judged.confidence[seen & wrong].mean() < 0.3
    assert judged.confidence[seen & ~wrong].mean() > 0.7

    with pytest.raises(ValueError, match="no pixel claims a disparity"):
        pair.judge(np.full_like(claims, np.nan))
    with pytest.raises(ValueError, match="accepts that of the prepared images"):
        pair.judge(claims[:90])
    with pytest.raises(ValueError, match=r"^unit: got none for a map of int16"):
        pair.judge(claims.astype(np.int16))


# Limits of other matchers


@pytest.mark.parametrize(
    ("most", "reduced"), [(None, False), (200, False), (45, False), (20, True)]
)
def test_disparities_fit_the_other_matcher(most: int | None, reduced: bool) -> None:  # noqa: FBT001
    left, right = noise_pair(120, 200, 24)
    options: dict[str, Any] = {"min_disparity": 20, "num_disparities": 40}
    options |= {"despike": False, "denoise": False}  # noise is what is to be matched
    pair = ps.prepare(left, right, max_disparity=most, **options)

    fits = most in (None, 200)
    assert (pair.done == ()) == fits
    assert any("reduced by 2" in sentence for sentence in pair.done) == reduced
    assert pair.num_disparities == {None: 60, 200: 60, 45: 40, 20: 21}[most]

    there = (24 if fits else 4) / (2 if reduced else 1)
    there_map = np.full(pair.left.shape[:2], there)
    restored = pair.restore(there_map)
    assert np.nanmax(np.abs(restored - 24)) < 1e-4
    assert np.isnan(restored).mean() == pytest.approx(0 if fits else 0.1)  # 20 columns of 200
    if not reduced:  # of noise, nothing is left
        found = ps.match(pair.left, pair.right, num_disparities=44, align_rows=False)
        assert np.nanmedian(found.disparity) == pytest.approx(there, abs=0.01)


def test_a_limit_that_nothing_fits_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^max_disparity: got 0; accepts 1 or more"):
        ps.prepare(*noise_pair(60, 90, 5), max_disparity=0)
    with pytest.raises(TypeError, match=r"^max_disparity: got float"):
        ps.prepare(*noise_pair(60, 90, 5), max_disparity=1.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^max_disparity: got 1; accepts at least one in 64 of"):
        ps.prepare(*noise_pair(60, 300, 5), max_disparity=1, num_disparities=300)


# Maps of all kinds


@pytest.fixture(scope="module")
def made(rendered: Pair) -> ps.Prepared:
    """Return a pair whose map comes back from a smaller, moved image."""
    return ps.prepare(
        rendered.left, rendered.right, max_disparity=20, num_disparities=60, min_disparity=-8
    )


def test_units_sizes_and_gaps(made: ps.Prepared) -> None:
    rows, cols = made.restoration.prepared_size
    whole = np.random.default_rng(4).integers(0, 300, (rows, cols)).astype(np.int16)
    pixels = np.where(whole % 7 == 0, np.nan, whole / 16)
    sixteenths = np.where(whole % 7 == 0, -16, whole).astype(np.int16)

    expected = made.restore(pixels)
    assert expected.shape == made.restoration.size == (160, 240)
    np.testing.assert_array_equal(made.restore(np.asfortranarray(pixels)), expected)
    np.testing.assert_array_equal(made.restore(sixteenths, unit="sixteenths"), expected)
    np.testing.assert_array_equal(made.restore(np.where(pixels > 0, pixels, np.inf)), expected)
    assert 0.7 < np.isfinite(expected).mean() < 0.95

    flat = made.restore(np.full((rows, cols), 5.0))
    np.testing.assert_allclose(made.restore(np.full((rows // 2, cols // 2), 2.5)), flat, atol=0.1)


@pytest.mark.parametrize(
    ("disparity", "unit", "error", "message"),
    [
        (np.zeros((3, 9)), None, ValueError, "disparity: got 3 x 9 pixels; accepts that of the"),
        (np.zeros(5), None, ValueError, r"disparity: got shape \(5,\); accepts \(H, W\)"),
        (np.zeros((2, 2), bool), None, TypeError, "disparity: got dtype bool"),
        (np.zeros((2, 2), np.int16), None, ValueError, "unit: got none for a map of int16"),
        (np.zeros((2, 2)), "px", ValueError, "unit: got 'px'; accepts pixels, sixteenths or None"),
        ("map", None, TypeError, "disparity: got str; accepts an array"),
    ],
)
def test_what_is_not_a_map_of_the_pair_is_refused(
    made: ps.Prepared, disparity: Any, unit: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        made.restore(disparity, unit=unit)


def test_the_way_back_is_saved_and_pickled(cones: Pair, tmp_path: Path) -> None:
    pair = ps.prepare(*FAULTS["turned"](cones))
    claims = np.random.default_rng(2).uniform(1, 60, pair.left.shape[:2])
    expected = pair.restore(claims)
    assert np.isnan(expected).any()

    pair.restoration.save(tmp_path / "back.json")
    loaded = ps.Restoration.load(tmp_path / "back.json")
    np.testing.assert_array_equal(loaded.restore(claims), expected)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(pair)).restore(claims), expected)  # noqa: S301
    assert repr(loaded) == "<Restoration from 450x375 to 450x375>"

    (tmp_path / "other.json").write_text("phasestereo back 1\n{}")
    with pytest.raises(ValueError, match="other.json: back: got 'missing field"):
        ps.Restoration.load(tmp_path / "other.json")


# The command line


def test_the_commands_write_what_python_returns(
    rendered: Pair, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    left, right = rendered.left[:, 12:], rendered.right[:, :-12]
    ps.io.write_image("left.png", left)
    ps.io.write_image("right.png", np.ascontiguousarray(right))
    command = ["prepare", "left.png", "right.png", "-o", "l.png", "r.png", "--back", "back.json"]
    code, out, err = run(*command, "--max-disparity", 25)
    assert (code, err) == (0, "")

    pair = ps.prepare("left.png", "right.png", max_disparity=25)
    assert out.splitlines() == [
        *pair.done,
        f"disparities from 0 to {pair.num_disparities - 1} px",
    ]
    np.testing.assert_array_equal(ps.io.read_image("l.png"), pair.left)
    np.testing.assert_array_equal(ps.io.read_image("r.png"), pair.right)

    claims = np.random.default_rng(3).uniform(0, 20, pair.left.shape[:2]).astype(np.float32)
    ps.io.write_disparity("map.pfm", claims)
    code, out, err = run("restore", "map.pfm", "--back", "back.json", "-o", "out.pfm")
    assert (code, err) == (0, "")
    assert out.endswith("of the pixels have a disparity\n")
    np.testing.assert_array_equal(ps.io.read_disparity("out.pfm"), pair.restore(claims))

    # As OpenCV has them; a PNG is not in KITTI's format then.
    sixteenths = (16 * claims).astype(np.int16)
    sixteenths[::3] = -16
    unsigned = sixteenths.clip(0).astype(np.uint16)
    np.save("signed.npy", sixteenths)
    np.save("unsigned.npy", unsigned)
    ps.io.write_image("unsigned.png", unsigned)
    ps.io.write_disparity("floats.pfm", sixteenths.astype(np.float32))
    counterpart("cv2").imwrite("signed.tif", sixteenths)
    for name in ("signed.npy", "signed.tif", "floats.pfm", "unsigned.npy", "unsigned.png"):
        command = ["restore", name, "--back", "back.json", "-o", "out.npy"]
        code, _, err = run(*command, "--unit", "sixteenths")
        assert (code, err) == (0, "")
        expected = unsigned if "unsigned" in name else sixteenths
        np.testing.assert_array_equal(np.load("out.npy"), pair.restore(expected, unit="sixteenths"))
    for name in ("signed.npy", "signed.tif"):
        code, _, err = run("restore", name, "--back", "back.json", "-o", "out.npy")
        assert code == 1
        assert "this is int16" in err
        assert "sixteenths of a pixel by their unit" in err


def test_the_command_warns_of_what_spoils_the_pair(
    rendered: Pair, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ps.io.write_image("upper.png", np.rot90(rendered.left, -1))
    ps.io.write_image("lower.png", np.rot90(rendered.right, -1))
    code, out, err = run("prepare", "upper.png", "lower.png", "--json")
    warned = [each for each in json.loads(out)["findings"] if each["severity"] == "warning"]
    assert (code, len(err.splitlines())) == (0, len(warned))
    assert "warning: one camera seems to be above the other" in err
    assert "match with --vertical, the upper image first" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["prepare", "l.png", "r.png"], "nothing to do: give -o LEFT RIGHT, --back or --json"),
        (
            ["prepare", "l.png", "r.png", "--back", "r.png"],
            "--back: r.png is an input or another output",
        ),
        (
            ["prepare", "l.png", "r.png", "--json", "--max-disparity", "0"],
            "--max-disparity: got 0; accepts 1 or more",
        ),
        (
            ["prepare", "l.png", "r.png", "-o", "a.png", "b.exr", "--back", "c.json"],
            "--output: path must end in one of .png",
        ),
        (
            ["restore", "l.png", "--back", "r.png", "-o", "a.exr"],
            "--output: path of a disparity map must end in",
        ),
        (
            ["restore", "l.png", "--back", "r.png", "-o", "l.png"],
            "--output: l.png is an input or another output",
        ),
    ],
)
def test_wrong_commands_are_refused(
    words: list[str], message: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("l.png", "r.png"):
        ps.io.write_image(name, np.zeros((60, 60), np.uint8))
    before = sorted(tmp_path.iterdir())
    code, _, err = run(*words)
    assert code == 2
    assert f"error: {message}" in err
    assert sorted(tmp_path.iterdir()) == before


def test_other_files_are_named(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    for name in ("l.png", "r.png"):
        ps.io.write_image(name, rng.integers(0, 256, (60, 90), np.uint8))
    ps.io.write_disparity("map.pfm", np.ones((60, 90), np.float32))
    code, _, err = run("restore", "map.pfm", "--back", "l.png", "-o", "out.pfm")
    assert code == 1
    assert "l.png: back: got" in err

    code, _, err = run("prepare", "l.png", "r.png", "--back", "back.json")  # not a pair
    assert code == 0
    assert err.startswith("phasestereo: warning: ")
    assert "prepare.py" not in err
