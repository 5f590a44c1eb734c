"""Rectification from the images alone, held against what the cameras really are."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo_bench.rendering import render_pair
from support import counterpart
from support.rigs import EXACT, Lens, cv2, euroc, euroc_frames, of_opencv, row_errors, turned

counterpart("scipy")

HEIGHT, WIDTH, FOCAL = 300, 400, 400.0
PLAIN = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
SHIFTS = np.array([8, 20, 40, 60]) / FOCAL


@pytest.fixture(scope="module")
def scene() -> tuple[Any, Any]:
    """Return a rendered pair whose rows correspond, as cameras without distortion see it."""
    pair = render_pair(3, height=HEIGHT, width=WIDTH, num_disparities=64)
    return pair.left, pair.right


def lens(*degrees: float, focal: float = 1.0, k1: float = 0.0, down: float = 0.0) -> Lens:
    k = np.diag([focal, focal, 1.0]) @ PLAIN
    k[:2, 2] = PLAIN[:2, 2]
    k[1, 2] += down
    return Lens(k, np.array([k1, 0, 0, 0.0]), turned(*degrees) if degrees else np.eye(3))


def seen_by(image: Any, camera: Lens) -> Any:
    """Return the view of another camera at the same place."""
    undo = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    points = np.stack([x.ravel(), y.ravel()], axis=1)[:, np.newaxis]
    places = undo(points, camera.k, camera.d, R=camera.r, P=PLAIN, criteria=EXACT)
    maps = places.reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    border = cv2.BORDER_REFLECT
    return cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4, borderMode=border)


RIGS = {
    "rows that correspond": (lens(), lens()),
    "30 rows off": (lens(), lens(down=30)),
    "turned by 3 degrees": (lens(), lens(0, 0, 3)),
    "turned about all axes": (lens(1, -1, 2), lens(-1, 2, -2)),
    "focal lengths 5 % apart": (lens(), lens(focal=1.05)),
    "distorted": (lens(k1=-0.2), lens(1, 0, 1, k1=-0.2)),
    "all of it": (lens(1, -2, 2, k1=-0.1), lens(-1, 2, -2, focal=1.03, k1=-0.11, down=10)),
}


@pytest.mark.parametrize("name", RIGS)
def test_rows_correspond_whatever_the_cameras(scene: tuple[Any, Any], name: str) -> None:
    left, right = RIGS[name]
    found = ps.rectify(seen_by(scene[0], left), seen_by(scene[1], right))

    errors = row_errors(found.maps, left, right, SHIFTS)
    assert errors.size > 1000
    assert np.sqrt(np.mean(errors**2)) < 0.25

    assert found.error < 0.3
    assert found.Q is None
    assert found.left_mask.mean() > 0.8


def test_raw_frames_of_euroc(data: Path) -> None:
    rig = euroc(data)
    made = of_opencv(rig, (752, 480))
    left, right = (Lens(rig[f"K{n}"], rig[f"D{n}"], made[f"R{n}"]) for n in "12")
    shifts = np.linspace(14, 46, 5) / made["P1"][0, 0]

    frames = euroc_frames(data)
    for pair in frames:
        found = ps.rectify(*pair)
        errors = row_errors(found.maps, left, right, shifts)
        assert errors.size > 5000
        assert np.sqrt(np.mean(errors**2)) < 0.3  # the calibration itself leaves 0.15

        diagnosis = ps.check(found.left, found.right)
        grave = {each.topic for each in diagnosis.findings if each.severity != "ok"}
        assert grave & {"blur", "alignment", "swap", "range"} == set()

    together = ps.rectify(*frames[0], others=frames[1:3])
    errors = row_errors(together.maps, left, right, shifts)
    assert np.sqrt(np.mean(errors**2)) < 0.25
    assert together.error < 0.15
    assert "of 3 pairs" in together.sentences[0]


def test_raw_frames_of_a_cheap_rig(data: Path) -> None:
    folder = data / "rigs/stereopi"
    for number in ("02", "10", "18", "26"):
        raw = [ps.io.read_image(folder / f"{side}_{number}.png") for side in ("left", "right")]
        found = ps.rectify(*(folder / f"{side}_{number}.png" for side in ("left", "right")))
        before, after = corner_rows(*raw), corner_rows(found.left, found.right)
        assert after < 0.25
        assert after < before / 2


def corner_rows(left: Any, right: Any) -> float:
    """Return by how many rows the corners of a chessboard differ, root mean square."""
    places = []
    for image in (left, right):
        gray = cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_RGB2GRAY)
        there, corners = cv2.findChessboardCorners(gray, (9, 6))
        assert there
        refined = cv2.cornerSubPix(gray, corners, (4, 4), (-1, -1), (3, 40, 0.01)).reshape(-1, 2)
        places.append(refined if refined[0, 0] < refined[-1, 0] else refined[::-1])

    return float(np.sqrt(np.mean((places[0] - places[1])[:, 1] ** 2)))


def test_types_of_pixels_and_contrast_hardly_matter(scene: tuple[Any, Any]) -> None:
    left, right = RIGS["all of it"]
    raw = seen_by(scene[0], left), seen_by(scene[1], right)

    for pair in (
        [image.astype(np.uint16) * 16 for image in raw],
        [image.astype(np.float32) / 255 for image in raw],
        [(image * gain).astype(np.uint8) for image, gain in zip(raw, (0.4, 0.9), strict=True)],
    ):
        found = ps.rectify(*pair)
        assert "negative" not in " ".join(found.sentences)
        assert found.left.dtype == pair[0].dtype
        assert np.sqrt(np.mean(row_errors(found.maps, left, right, SHIFTS) ** 2)) < 0.3


def test_a_negative_is_known(scene: tuple[Any, Any]) -> None:
    left, right = RIGS["all of it"]
    found = ps.rectify(255 - seen_by(scene[0], left), seen_by(scene[1], right))
    assert found.sentences[-1] == "the right image seems to be a negative of the left one"
    assert np.sqrt(np.mean(row_errors(found.maps, left, right, SHIFTS) ** 2)) < 0.3


def test_what_was_found_is_said(scene: tuple[Any, Any]) -> None:
    left, right = RIGS["distorted"]
    found = ps.rectify(seen_by(scene[0], left), seen_by(scene[1], right))

    said = " ".join(found.sentences)
    assert "rows were " in said
    assert "disparities are about " in said
    assert "the lenses distort, by " in said
    assert "(barrel): that is corrected, as far as rows show it" in said
    assert "swapped" not in said
    assert repr(found).startswith("<Rectification 400x300 from images, rows to 0.")

    swapped = ps.rectify(seen_by(scene[1], right), seen_by(scene[0], left))
    assert "all disparities are negative" in swapped.sentences[-1]


def test_toed_in_cameras_are_told_from_exchanged_ones(scene: tuple[Any, Any]) -> None:
    left, right = seen_by(scene[0], lens(0, 5, 0)), seen_by(scene[1], lens(0, -5, 0))
    found = {one.topic: one for one in ps.check(left, right).findings}["swap"]
    assert "toed in" in found.sentence
    assert found.severity == "note"

    straight = ps.rectify(left, right)
    assert "the cameras are toed in: columns were moved by" in straight.sentences[-1]
    search = ps.check(straight.left, straight.right).search
    assert search is not None
    assert not search.swapped
    assert search.high > -2 * search.low


def test_disparities_stay_about_as_they_were(scene: tuple[Any, Any]) -> None:
    found = ps.rectify(*scene)
    shift = np.array([part[0].mean() for part in found.maps]) - (WIDTH - 1) / 2
    assert np.abs(shift).max() < 3


NOISE: Any = np.random.default_rng(0).integers(0, 256, (2, HEIGHT, WIDTH), np.uint8)


@pytest.mark.parametrize(
    "kind", ["noise", "black", "tiny", "one pixel", "unrelated", "upside down"]
)
def test_what_tells_nothing_is_refused_with_the_reason(scene: tuple[Any, Any], kind: str) -> None:
    other = render_pair(7, height=HEIGHT, width=WIDTH, num_disparities=64)
    pair = {
        "noise": NOISE,
        "black": np.zeros_like(NOISE),
        "tiny": [image[:20, :20] for image in scene],
        "one pixel": [image[:1, :1] for image in scene],
        "unrelated": (scene[0], other.right),
        "upside down": (scene[0], scene[1][::-1, ::-1]),
    }[kind]

    with pytest.raises(ValueError, match=r"^left, right: got images .*; accepts ") as raised:
        ps.rectify(*pair)
    assert "\n" not in str(raised.value)


def test_other_pairs_help_and_must_be_of_one_size(scene: tuple[Any, Any]) -> None:
    left, right = RIGS["all of it"]
    pair = seen_by(scene[0], left), seen_by(scene[1], right)
    found = ps.rectify(*NOISE, others=[pair])
    assert np.sqrt(np.mean(row_errors(found.maps, left, right, SHIFTS) ** 2)) < 0.3
    with pytest.raises(ValueError, match="^others: got pairs of another size; accepts"):
        ps.rectify(*pair, others=[(pair[0][:, 1:], pair[1][:, 1:])])


def test_a_stream_rectifies_itself(scene: tuple[Any, Any]) -> None:
    left, right = RIGS["turned by 3 degrees"]
    pair = seen_by(scene[0], left), seen_by(scene[1], right)
    failures: list[live.Failure] = []
    with live.stream(
        [tuple(NOISE), pair, pair], num_disparities=64, preset="fast", rectify="auto",

        on_error=failures.append,
    ) as stream:  # fmt: skip
        frames = list(stream)
    assert [failure.index for failure in failures] == [0]  # it shows nothing

    expected = ps.rectify(*pair)
    assert len(frames) == 2
    for frame in frames:
        np.testing.assert_array_equal(frame.left, expected.left)
        np.testing.assert_array_equal(frame.right, expected.right)
