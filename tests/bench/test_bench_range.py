"""The benchmark of the range: what its pairs show, and what it says of the range that is found."""

import numpy as np
import pytest

from phasestereo import SearchRange
from phasestereo_bench import ranges
from phasestereo_bench.datasets import Pair

pytest.importorskip("PIL")
ndimage = pytest.importorskip("scipy.ndimage")


def scene(seed: int) -> Pair:
    """Return a pair without truth, of blurred noise."""
    generator = np.random.default_rng(seed)
    noise = ndimage.gaussian_filter(generator.normal(size=(200, 260)), 1)
    image = np.clip(128 + 220 * noise, 0, 255).astype(np.uint8)
    return Pair(f"noise {seed}", image, image, None, None, {}, 64, None)


SCENES = [scene(1), scene(2), scene(3)]


@pytest.mark.parametrize("held", [False, True])
def test_an_object_is_where_its_disparity_says(*, held: bool) -> None:
    for made in ranges.constructions(SCENES, ["squares"], held=held):
        if "JPEG" in made.name or "noise" in made.name or "blurred" in made.name:
            continue
        (near,) = made.objects
        off = np.abs(made.left[:, int(near) :].astype(float) - made.right[:, : -int(near)])
        alike = ndimage.uniform_filter((off < 8).astype(float), 20).max()
        assert alike > 0.9, made.name


def test_pairs_are_the_same_every_time() -> None:
    first, second = (list(ranges.constructions(SCENES, ["poles", "same"])) for _ in range(2))
    assert [made.name for made in first] == [made.name for made in second]
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.left, other.left)
        np.testing.assert_array_equal(one.right, other.right)


def test_a_range_that_lacks_an_object_is_counted() -> None:
    made = ranges.Construction("near", "", SCENES[0].left, SCENES[0].right, 3, 45, (45,))
    trials = [ranges.Trial.of(made, SearchRange(0, count, "found")) for count in (20, 45, 46, 60)]
    assert [trial.outside for trial in trials] == [True, True, False, False]
    assert trials[-1].longer == pytest.approx(60 / 43)

    table = ranges.found_table(trials)
    mean = (20 + 45 + 46 + 60) / 4 / 43
    (row,) = table.rows
    assert [entry.text for entry in row] == ["near", "4", "2", "0", f"{mean:.2f}", "1.40"]
