"""The plugin inside real Pandora: its sign, its borders and masks, and whole pipelines."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
import logging
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo_bench.datasets import Pair, find_scene
from phasestereo_bench.degradation import convolve, gaussian_psf
from phasestereo_bench.rendering import render_pair
from support import counterpart

pandora = counterpart("pandora")
plugin = counterpart("phasestereo_large.pandora")
xarray = counterpart("xarray")
rasterio = counterpart("rasterio")

Plane = NDArray[np.float32]

PLAIN = {
    "matching_cost_method": "phase",
    "neighborhood": 7,
    "frequencies": [2, 1],
    "noise_threshold": 0.0,
    "compensate_blur": False,
}
"""The codes of the paper, which need to know nothing of the images."""

CODES = ps.Settings.preset("paper")
NO_DATA, INVALID = 1, 2


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Keep the log of Pandora's state machine out of reports."""
    caplog.set_level(logging.ERROR)


@pytest.fixture(scope="module")
def rendered() -> Pair:
    return render_pair(3, height=120, width=180, num_disparities=24)


def gray(image: NDArray[Any]) -> Plane:
    planes = np.atleast_3d(image).astype(np.float32)
    if planes.shape[2] == 1:
        return planes[:, :, 0]
    mixed: Plane = planes @ np.array([0.299, 0.587, 0.114], np.float32)
    return mixed


def dataset(image: NDArray[Any], search: tuple[int, int], mask: NDArray[Any] | None = None) -> Any:
    """Return an image as Pandora reads it from a file."""
    dims = ("band_im", "row", "col")[-image.ndim :]

    rows, cols = image.shape[-2:]
    coords: dict[str, Any] = {"row": np.arange(rows), "col": np.arange(cols)}

    if image.ndim == 3:
        coords["band_im"] = ["r", "g", "b"]

    attrs = {"valid_pixels": 0, "no_data_mask": NO_DATA, "crs": None, "transform": None}
    found = xarray.Dataset({"im": (dims, image.astype(np.float32))}, coords, attrs)

    if mask is not None:
        found["msk"] = ("row", "col"), mask.astype(np.int16)

    return pandora.img_tools.add_disparity(found, list(search), window=None)


def volume(
    left: Any, right: Any, *, search: tuple[int, int] = (-10, 0), **cfg: Any
) -> NDArray[np.float32]:
    """Return the masked costs of a step as the state machine works them out."""
    step = pandora.matching_cost.AbstractMatchingCost(**{**PLAIN, **cfg})
    grids = left["disparity"].sel(band_disp="min").data, left["disparity"].sel(band_disp="max").data

    costs = step.allocate_cost_volume(left, grids)
    costs = pandora.criteria.validity_mask(left, right, costs)
    costs = step.compute_cost_volume(left, right, costs)
    step.cv_masked(left, right, costs, *grids)

    assert costs.coords["disp"].data[[0, -1]].tolist() == list(search)
    found: NDArray[np.float32] = costs["cost_volume"].data
    return found


def pipeline(step: dict[str, Any], **others: Any) -> dict[str, Any]:
    """Return a pipeline about a matching cost, cross-checked both ways."""
    steps = {
        "matching_cost": step,
        **others,
        "disparity": {"disparity_method": "wta", "invalid_disparity": "NaN"},
        "refinement": {"refinement_method": "vfit"},
        "filter": {"filter_method": "median", "filter_size": 3},
    }
    return {"pipeline": steps | {"validation": {"validation_method": "cross_checking_accurate"}}}


def run(pair: tuple[Plane, Plane], count: int, config: dict[str, Any]) -> Any:
    """Return the left result of a pipeline for Pandora's disparities -count to 0."""
    left, right = dataset(pair[0], (-count, 0)), dataset(pair[1], (0, count))
    machine = pandora.state_machine.PandoraMachine()
    labelled = [image.assign_coords(band_im=[None]) for image in (left, right)]
    checked = pandora.check_configuration.check_pipeline_section(config, *labelled, machine)
    return pandora.run(machine, left, right, checked)[0]


def bad(result: Any, pair: Pair) -> float:
    """Return the share of wrong pixels in percent, where every method has an estimate."""
    inner, border = np.zeros(pair.truth.shape, np.bool_), 10
    inner[border:-border, pair.num_disparities + border : -border] = True
    scored = inner & pair.masks["nonocc"]
    wrong = ~(np.abs(-result["disparity_map"].data - pair.truth) <= 1)
    return float(100 * wrong[scored].mean())


def test_a_match_to_the_left_is_a_negative_disparity() -> None:
    scene = np.random.default_rng(0).normal(100, 20, (30, 60)).astype(np.float32)
    left, right = scene[:, :-5], scene[:, 5:]  # left x shows what right x - 5 shows
    result = run((left, right), 10, pipeline(PLAIN | {"window_size": 3}))
    found = result["disparity_map"].data[8:-8, 20:-8]
    np.testing.assert_allclose(found, -5, atol=0.3)


@pytest.mark.parametrize("window", [1, 5])
def test_a_cost_is_the_one_of_this_library_at_the_opposite_sign(
    rendered: Pair, window: int
) -> None:
    left, right = gray(rendered.left), gray(rendered.right)
    found = volume(dataset(left, (-10, 4)), dataset(right, (-4, 10)), search=(-10, 4),
                   window_size=window)  # fmt: skip

    bits = ps.cost_volume(left, right, min_disparity=-4, num_disparities=15, settings=CODES)
    mine = (ps.aggregate(bits, window=window, shiftable=False) / window**2)[:, :, ::-1]

    known = np.isfinite(found)
    border = (7 + window - 1) // 2
    np.testing.assert_array_equal(found[known], mine[known].astype(np.float32))

    columns = np.arange(left.shape[1])[:, None]
    matches = columns + np.arange(-10, 5)
    last = left.shape[1] - 1 - border
    inside = (columns >= border) & (columns <= last) & (matches >= border) & (matches <= last)

    expected = np.zeros_like(known)
    expected[border:-border] = inside
    np.testing.assert_array_equal(known, expected)


@pytest.mark.parametrize("subpix", [2, 4])
def test_costs_between_columns_are_those_of_the_image_that_pandora_interpolates(
    rendered: Pair, subpix: int
) -> None:
    left, right = gray(rendered.left), gray(rendered.right)

    views = dataset(left, (-10, 0)), dataset(right, (0, 10))
    whole, fine = volume(*views, window_size=1), volume(*views, window_size=1, subpix=subpix)
    np.testing.assert_array_equal(fine[:, :, ::subpix], whole)

    shifted = right.copy()
    shifted[:, :-1] += (right[:, 1:] - right[:, :-1]) / np.float32(subpix)
    mine = ps.cost_volume(left, shifted, num_disparities=11, settings=CODES)[:, :, ::-1]

    between = fine[:, :, 1::subpix]  # at -10 + 1/subpix, ... -1 + 1/subpix
    known = np.isfinite(between)
    assert known.mean() > 0.7

    # Pandora rounds its interpolation in another way, which may turn single bits.
    assert (between[known] == mine[:, :, :10][known]).mean() > 0.999


def test_pixels_without_data_reach_as_far_as_the_window(rendered: Pair) -> None:
    left, right = gray(rendered.left), gray(rendered.right)

    mask = np.zeros(left.shape)
    mask[40:60, 70:80] = NO_DATA

    holes = [np.where(mask == NO_DATA, value, left) for value in (-9999, 1e6)]
    views = [dataset(hole, (-10, 0), mask) for hole in holes]
    other = dataset(right, (0, 10))

    found = volume(views[0], other, window_size=3)
    reach = (7 + 3 - 1) // 2
    assert np.isnan(found[40 - reach : 60 + reach, 70 - reach : 80 + reach]).all()
    np.testing.assert_array_equal(found, volume(views[1], other, window_size=3))

    apart = volume(dataset(left, (-10, 0)), other, window_size=3)
    elsewhere = np.isfinite(found)
    np.testing.assert_allclose(found[elsewhere], apart[elsewhere], atol=0.5)
    assert elsewhere.sum() == np.isfinite(apart).sum() - (20 + 2 * reach) * (10 + 2 * reach) * 11


def test_masked_pixels_of_the_right_image_are_no_candidates(rendered: Pair) -> None:
    left, right = gray(rendered.left), gray(rendered.right)
    mask = np.zeros(right.shape)

    mask[50, 90] = INVALID
    found = volume(dataset(left, (-10, 0)), dataset(right, (0, 10), mask), window_size=3)
    apart = volume(dataset(left, (-10, 0)), dataset(right, (0, 10)), window_size=3)

    lost = np.argwhere(np.isnan(found) & np.isfinite(apart))
    assert {(row, col - 10 + disp) for row, col, disp in lost.tolist()} == {(50, 90)}
    assert len(lost) == 11


@pytest.mark.parametrize("compensate_blur", [False, True])
def test_images_without_any_data_have_no_costs(rendered: Pair, *, compensate_blur: bool) -> None:
    left = gray(rendered.left)

    nothing = dataset(np.full_like(left, np.nan), (0, 10), np.full(left.shape, NO_DATA))
    found = volume(
        dataset(left, (-10, 0)),
        nothing,
        window_size=3,
        compensate_blur=compensate_blur,
        noise_threshold=0.5,
    )

    assert np.isnan(found).all()


def test_disparities_beyond_the_image_have_no_costs(rendered: Pair) -> None:
    left, right = gray(rendered.left)[:, :40], gray(rendered.right)[:, :40]
    found = volume(dataset(left, (-60, 50)), dataset(right, (-50, 60)), search=(-60, 50),
                   window_size=1, compensate_blur=True)  # fmt: skip
    known = np.flatnonzero(np.isfinite(found).any(axis=(0, 1))) - 60
    assert [known[0], known[-1]] == [6 - 33, 33 - 6]  # borders of 6 pixels, in columns 0 to 39


def test_one_band_of_several_is_matched(rendered: Pair) -> None:
    planes = [np.moveaxis(image, 2, 0) for image in (rendered.left, rendered.right)]
    found = volume(dataset(planes[0], (-10, 0)), dataset(planes[1], (0, 10)), band="g", subpix=2)
    one = volume(dataset(planes[0][1], (-10, 0)), dataset(planes[1][1], (0, 10)), subpix=2)
    np.testing.assert_array_equal(found, one)


def test_tiles_have_the_costs_of_the_whole(rendered: Pair) -> None:
    left, right = np.rint(gray(rendered.left)), np.rint(gray(rendered.right))

    for image in (left, right):  # whose floats then have one range, of which codes depend a little
        image[40:48, 60:68] = np.tile([[0, 255], [255, 0]], (4, 4))

    views = dataset(left, (-10, 0)), dataset(right, (0, 10))
    whole = volume(*views)
    found = volume(*(view.isel(row=slice(10, 80), col=slice(20, 110)) for view in views))

    known = np.isfinite(found)
    assert known.mean() > 0.6
    np.testing.assert_array_equal(found[known], whole[10:80, 20:110][known])


def test_the_window_that_pandora_sees_is_all_that_a_cost_rests_on() -> None:
    step = pandora.matching_cost.AbstractMatchingCost(**PLAIN, window_size=5)
    assert step.margins.astuple() == (5, 5, 5, 5)
    evened = pandora.matching_cost.AbstractMatchingCost(**PLAIN | {"compensate_blur": True})
    assert evened.margins.astuple() == (8, 8, 8, 8)
    assert step.cfg["window_size"] == 5  # what the user said


def test_defaults_are_filled_in_and_can_be_saved() -> None:
    step = pandora.matching_cost.AbstractMatchingCost(matching_cost_method="phase")
    assert json.loads(json.dumps(step.cfg)) == {
        "matching_cost_method": "phase",
        "window_size": 5,
        "neighborhood": 3,
        "taper": "uniform",
        "frequencies": [1, 1],
        "power": 1,
        "bits": 2,
        "noise_threshold": 0.5,
        "compensate_blur": True,
        "subpix": 1,
        "band": None,
        "step": 1,
    }


@pytest.mark.parametrize(
    ("wrong", "kind", "message"),
    [
        ({"neighborhood": 4}, ValueError, "neighborhood.*4"),
        ({"window_size": 6}, ValueError, "window.*6"),
        ({"frequencies": [3, 1], "neighborhood": 5}, ValueError, "frequencies"),
        ({"bits": "two"}, TypeError, "bits"),
        ({"compensate_blur": 1.5}, TypeError, "compensate_blur"),
        ({"neighbourhood": 7}, Exception, "neighbourhood"),
        ({"subpix": 3}, Exception, "subpix"),
    ],
)
def test_wrong_parameters_are_refused_by_name(
    wrong: dict[str, Any], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        pandora.matching_cost.AbstractMatchingCost(matching_cost_method="phase", **wrong)


def test_other_methods_are_left_as_they_were() -> None:
    pandora.matching_cost.AbstractMatchingCost(**PLAIN)
    census = pandora.matching_cost.AbstractMatchingCost(matching_cost_method="census")
    assert "neighborhood" not in census.cfg


@pytest.mark.parametrize("validation", ["cross_checking_accurate", "cross_checking_fast"])
def test_a_whole_pipeline_finds_a_rendered_scene(rendered: Pair, validation: str) -> None:
    step = {"matching_cost_method": "phase", "subpix": 2}
    config = pipeline(
        step,
        aggregation={"aggregation_method": "cbca"},
        cost_volume_confidence={"confidence_method": "ambiguity"},
    )
    config["pipeline"]["validation"]["validation_method"] = validation

    result = run((gray(rendered.left), gray(rendered.right)), rendered.num_disparities, config)
    assert bad(result, rendered) < 12

    occluded = 2**8 | 2**9  # Pandora's bits for occlusions and mismatches
    assert ((result["validity_mask"].data & occluded) != 0).any()


@pytest.mark.parametrize(("sigma", "share"), [(0.0, 0.8), (2.0, 0.4)])
def test_real_pairs_come_out_better_than_with_census(
    data: Path, sigma: float, share: float
) -> None:
    pair = find_scene(data / "middlebury", "tsukuba").load()
    left, right = gray(pair.left), gray(pair.right)

    if sigma:
        right = convolve(right, gaussian_psf(sigma)).astype(np.float32)

    count = pair.num_disparities
    census = {"matching_cost_method": "census", "window_size": 11}
    phase = {"matching_cost_method": "phase", "window_size": 9}

    wrong = [bad(run((left, right), count, pipeline(step)), pair) for step in (phase, census)]
    assert wrong[0] < share * wrong[1]


def test_semiglobal_matching_takes_the_costs(rendered: Pair) -> None:
    pytest.importorskip("pandora_plugin_libsgm")  # no extra of ours, but what CARS always has
    pandora.import_plugin()
    penalty = {"P1": 4, "P2": 16, "p2_method": "constant", "penalty_method": "sgm_penalty"}
    step = {"optimization_method": "sgm", "overcounting": False, "penalty": penalty}
    config = pipeline({"matching_cost_method": "phase"}, optimization=step)
    result = run((gray(rendered.left), gray(rendered.right)), rendered.num_disparities, config)
    assert bad(result, rendered) < 8


def test_the_command_runs_from_files(rendered: Pair, tmp_path: Path) -> None:
    for name, image in (("left", rendered.left), ("right", rendered.right)):
        shape = {"height": image.shape[0], "width": image.shape[1], "count": 1}

        transform = rasterio.Affine(0.5, 0, 500000, 0, -0.5, 4800000)
        with rasterio.open(
            tmp_path / f"{name}.tif", "w", dtype="float32", crs="EPSG:32631", transform=transform,
            **shape,
        ) as file:  # fmt: skip
            file.write(gray(image), 1)

    config = pipeline({"matching_cost_method": "phase", "frequencies": [1, 1]})
    config["input"] = {
        "left": {"img": str(tmp_path / "left.tif"), "disp": [-24, 0]},
        "right": {"img": str(tmp_path / "right.tif")},
    }

    (tmp_path / "config.json").write_text(json.dumps(config))
    pandora.main(str(tmp_path / "config.json"), str(tmp_path / "out"), verbose=False)

    with rasterio.open(tmp_path / "out" / "left_disparity.tif") as file:
        disparity = file.read(1)
        assert file.crs.to_epsg() == 32631

    nonocc = rendered.masks["nonocc"][10:-10, 34:-10]
    error = np.abs(-disparity - rendered.truth)[10:-10, 34:-10][nonocc]
    assert np.nanmedian(error) < 0.3


def test_pandora_finds_the_plugin_once_installed() -> None:
    try:
        installed = metadata.distribution("phasestereo-large")
    except metadata.PackageNotFoundError:
        pytest.skip("it is on the path, not installed: its entry points are not known")
    points = installed.entry_points.select(group="pandora.plugin")
    assert [point.load() for point in points] == [plugin.PhaseCost]


@pytest.fixture(autouse=True, scope="module")
def shared_schema() -> Iterator[None]:
    """Take back what other methods write into the schema that they all share."""
    schema = dict(pandora.matching_cost.AbstractMatchingCost.schema)
    yield
    pandora.matching_cost.AbstractMatchingCost.schema = schema
