"""The map of the right image: that of the exchanged, mirrored pair, mirrored back."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.settings import PresetName
from phasestereo_bench.rendering import render_pair
from support.pairs import noise_pair

Image = NDArray[Any]
RENDERED = render_pair(3, height=120, width=160, num_disparities=48)
PAIR = RENDERED.left, RENDERED.right


def same(found: ps.Result, expected: ps.Result, change: Any) -> None:
    """Hold maps to those of another match, changed."""
    assert found.maps.keys() == expected.maps.keys()
    for name, values in found.maps.items():
        np.testing.assert_array_equal(values, change(expected.maps[name]), name)
    assert found.findings == expected.findings
    assert str(found.search) == str(expected.search)


def mirrored(image: Image) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


@pytest.mark.parametrize("preset", ["robust", "fast", "paper"])
@pytest.mark.parametrize("count", [48, None])
def test_it_is_the_match_of_the_exchanged_mirrored_pair(
    preset: PresetName, count: int | None
) -> None:
    left, right = PAIR
    masks: dict[str, Any] = {"left_mask": left[..., 0] > 20, "right_mask": right[..., 0] > 30}
    found = ps.match(left, right, preset=preset, num_disparities=count, right_map=True, **masks)
    expected = ps.match(
        mirrored(right),
        mirrored(left),
        preset=preset,
        num_disparities=count,
        left_mask=mirrored(masks["right_mask"]),
        right_mask=mirrored(masks["left_mask"]),
    )
    same(found.right, expected, lambda values: values[:, ::-1])
    same(found, ps.match(left, right, preset=preset, num_disparities=count, **masks), np.asarray)
    assert found.right.pair[0] is right
    assert found.right.right is None


def test_both_maps_lead_to_each_other() -> None:
    pair = render_pair(2, height=240, width=320, num_disparities=60)
    found = ps.match(pair.left, pair.right, num_disparities=60, right_map=True)
    rows, columns = np.nonzero(pair.masks["nonocc"] & found.trusted)
    partners = np.rint(columns - pair.truth[rows, columns]).astype(int)
    back = found.right.disparity[rows, partners] - pair.truth[rows, columns]
    assert np.mean(np.abs(back) > 1) < 0.04  # of the left map: 0.03
    assert rows.size > 0.8 * found.disparity.size


def test_cameras_one_above_the_other_and_images_of_two_sizes() -> None:
    left, right = PAIR
    found = ps.match(
        np.rot90(left, -1), np.rot90(right, -1), num_disparities=48, right_map=True, vertical=True
    )
    expected = ps.match(left, right, num_disparities=48, right_map=True)
    same(found.right, expected.right, lambda values: np.rot90(values, -1))

    small = np.ascontiguousarray(right[::2, ::2])
    found = ps.match(left, small, num_disparities=48, right_map=True, preset="fast")
    expected = ps.match(mirrored(small), mirrored(left), num_disparities=48, preset="fast")
    same(found.right, expected, lambda values: values[:, ::-1])
    assert found.right.disparity.shape == small.shape[:2]


def test_noise_is_exchanged_and_kernels_are_refused() -> None:
    left, right = (image.astype(np.float32) for image in noise_pair(60, 90, 7)[:2])
    options: dict[str, Any] = {"num_disparities": 16, "noise_threshold": 2.0}
    known = ps.Known(noise=(1.0, 6.0))
    found = ps.match(left, right, known=known, right_map=True, **options)
    other = ps.Known(noise=(6.0, 1.0))
    expected = ps.match(mirrored(right), mirrored(left), known=other, **options)
    same(found.right, expected, lambda values: values[:, ::-1])

    known = ps.Known(blur_compensation=ps.BlurCompensation(noise=(1.0, 1.0)))
    with pytest.raises(ValueError, match=r"^known.blur_compensation: got .* accepts None here"):
        ps.match(left, right, known=known, right_map=True, **options)


def test_progress_is_of_both_and_a_pickle_has_both() -> None:
    calls: list[tuple[int, int]] = []
    found = ps.match(
        *PAIR,
        num_disparities=48,
        preset="fast",
        right_map=True,
        progress=lambda *c: calls.append(c),
    )
    assert calls == sorted(calls)
    assert calls[-1] == (240, 240)
    assert {rows for _, rows in calls} == {240}

    copy = pickle.loads(pickle.dumps(found))  # noqa: S301 -- our own
    np.testing.assert_array_equal(copy.right.disparity, found.right.disparity)
    assert copy.right.pair is None
