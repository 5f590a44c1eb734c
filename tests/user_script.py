"""A user's script: everything of the public API, as somebody with a type checker writes it.

The tests check it with ``mypy --strict`` against the package as installed; nobody runs it.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import xarray
from numpy.typing import NDArray

import phasestereo as ps
import phasestereo_large as large
import phasestereo_live as live
from phasestereo import opencv
from phasestereo.io import read_calibration, read_disparity, read_image, write_disparity
from phasestereo.views.page import write_pair_page
from phasestereo_large import batch, dask as dask_maps, outofcore, xarray as labeled
from phasestereo_large.geotiff import (
    GeoImage,
    Georeference,
    read_geotiff,
    read_geotiff_pair,
    write_geotiff,
)
from phasestereo_live import rerun, video

if TYPE_CHECKING:
    import dask.array

Image = NDArray[np.uint8]
Map = NDArray[np.float32]


def use(*_values: object) -> None:
    """Stand for what a user does with values."""


def matched(left: Image, right: Image) -> Map:
    """Match a pair by everything that says how."""
    mask = np.ones(left.shape[:2], dtype=bool)

    result: ps.Result = ps.match(
        left,
        right,
        num_disparities=64,
        min_disparity=-8,
        preset="robust",
        threads=2,
        left_mask=mask,
        right_mask=None,
        progress=lambda done, rows: use(done / rows),
        known=ps.Known(noise=(1.0, 2.0)),
        fill=False,
        p1=4.0,
        p2=16.0,
    )

    ps.release_memory()

    settings: ps.Settings = ps.PRESETS["paper"]
    matcher = ps.Matcher(settings=settings, threads=1)
    steady = ps.TemporalFilter()
    again = matcher.match(left, right, temporal_filter=steady)
    rig = ps.Rig(preset="fast", threads=1)
    rig.match(left, right)
    events: tuple[ps.Event, ...] = rig.events
    use(rig.health, [str(event) for event in events])
    seconds: float = sum(again.timings.values())
    use(again.settings.window, matcher.threads, seconds, again.temporal_support)

    return result.disparity


def all_of(result: ps.Result) -> NDArray[np.bool_]:
    """Ask a result for everything."""
    confidence: Map | None = result.confidence
    flags: NDArray[np.uint16] = result.flags

    if result.blur is not None:
        blur: ps.Blur = result.blur.blur
        use(blur.side, blur.kind, blur.size, blur.angle, result.blur.areas())

    if confidence is not None:
        use(float(confidence.mean()))

    search: ps.SearchRange | None = result.search
    rows: ps.Alignment | None = result.alignment
    rectified: ps.Rectified | None = result.rectified
    use(rectified)
    summary: ps.Summary | None = result.summary
    if search is not None:
        places: tuple[ps.LeftOut, ...] = search.left_out
        use(places, search.identical)
    if search is not None and rows is not None and summary is not None:
        use(search.origin, search.low + 1.0, rows.rms + rows.rotation, summary.flagged + 1.0)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ps.MatchWarning)
        use([found.sentence for found in result.findings])

    doubted: NDArray[np.bool_] = (flags & (ps.Flag.OCCLUDED | ps.Flag.MISMATCHED)) != 0
    return doubted


def verified(left: Image, right: Image, theirs: Map) -> Map:
    found: ps.Verification = ps.verify(left, right, theirs, threads=1)
    refuted: NDArray[np.bool_] = found.verdict == ps.Verdict.REFUTED
    use(found.refuted + found.supported + found.unknown, found.findings, found.result.search)
    use(found.picture())
    return np.where(refuted, found.better, theirs)


def prepared(left: Image, right: Image) -> Map:
    """Match by a network, and bring its map back."""
    network = ps.matchers.load_matcher("onnx:net.onnx", threads=1)
    pair: ps.Prepared = ps.prepare(left, right, max_disparity=network.max_disparity)
    use(pair.done, pair.findings)
    pair.restoration.save("back.json")
    back = ps.Restoration.load("back.json")
    return back.restore(network(pair.left, pair.right, pair.num_disparities), unit="pixels")


def diagnosed(left: Image, right: Image) -> ps.Diagnosis:
    """Ask what is wrong with a pair."""
    estimate: ps.BlurEstimate = ps.estimate_blur(left, right, num_disparities=64)
    found = ps.check(left, right)
    grave: list[ps.Finding] = [one for one in found.findings if one.severity == "warning"]
    use(estimate.certainty, len(grave))
    return found


def in_pieces(left: Image, right: Image) -> NDArray[np.uint16]:
    """Go the way of a match step by step."""
    use(ps.descriptor(left, neighborhood=9).dtype)
    versions = ps.BlurCompensation(noise=(1.0, 1.0), kernels=[(None, np.full((3, 3), 1 / 9))])
    costs = ps.cost_volume(
        left, right, num_disparities=64, known=ps.Known(blur_compensation=versions)
    )
    return ps.optimize(ps.aggregate(costs, window=7), p1=10, p2=40, optimizer="sgm")


def like_opencv(left: Image, right: Image) -> NDArray[np.int16]:
    """Use the matcher that stands in for OpenCV's."""
    stereo: opencv.StereoPhase = opencv.StereoPhase_create(
        minDisparity=0, numDisparities=64, blockSize=5, uniquenessRatio=10, preset="fast"
    )
    stereo.setSpeckleWindowSize(100)
    use(stereo.getNumDisparities() + 1, stereo.compute_right(left, right))

    disparity: NDArray[np.int16] = stereo.compute(left, right)
    use(
        opencv.createRightMatcher(stereo),
        opencv.createDisparityWLSFilter(stereo),
    )

    return disparity


def in_pictures(result: ps.Result, file: Path) -> None:
    """Draw a result."""
    _, axes = plt.subplots()
    ps.views.plot.disparity(result, axes, low=0, high=64)
    ps.views.plot.flags(result)
    ps.views.plot.confidence(result)
    ps.views.plot.histogram(result)

    if result.pair is not None:
        ps.views.plot.pair(result.pair, style="side by side")

    ps.views.plot.overview(result).savefig(file)


def on_a_page(left: Image, right: Image, folder: Path) -> None:
    """Show a result to whoever has a browser."""
    result = ps.match(left, right, num_disparities=64)
    write_pair_page(folder / "page.html", left, right, result, num_disparities=64, title="A pair")


def in_space(result: ps.Result, folder: Path) -> Map:
    """Turn disparities into depths and points."""
    rig = ps.io.Calibration.from_focal(700.0, 0.12, width=640, height=480)

    cloud: ps.PointCloud = ps.point_cloud(result, rig, mask=result.flags == 0, max_depth=9.0)
    ps.io.write_ply(folder / "cloud.ply", cloud)

    surface: ps.Mesh = ps.surface_mesh(result, rig, mask=result.flags == 0, max_step=0.5)
    ps.io.write_glb(folder / "surface.glb", surface)
    ps.io.write_depth(folder / "depth.png", rig.depth(result.disparity), unit="m")
    bars: ps.DepthInterval = ps.depth_interval(result, rig, anchor=(320, 240, 4.0))
    third = ps.ThirdCamera.of_pair("left_color.yaml", size=(1920, 1080))
    color: ps.Registered = ps.register(result, rig, third, keep="checked")
    use(color.depth, color.holes | color.occluded, color.picked(result.flags, missing=0))
    use(len(cloud), cloud.points.shape, cloud.colors, rig.q, bars.near, bars.far)

    return ps.io.read_depth(folder / "depth.png", unit="m")


def in_time(film: Path) -> int:
    """Match a video, write another one, and a recording."""
    failures: list[live.Failure] = []

    picture = video.FramePicture(low=0, high=64)
    frames: live.Stream = live.stream(
        film, num_disparities=64, preset="fast", layout="side-by-side", on_error=failures.append
    )

    with (
        frames,
        video.VideoWriter(film.with_suffix(".mp4")) as written,
        rerun.saving("recording.rrd") as recording,
    ):
        for frame in frames:
            one: live.Frame = frame
            written.write(picture(one), one.time)
            rerun.log_frame(one, recording=recording)
            use(one.index, one.result.disparity)

    return frames.failed + len(failures)


def on_the_ground(folder: Path) -> xarray.Dataset:
    """Match georeferenced images, and labeled ones."""
    place = Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000, 0, -0.5, 4800000))

    left, right = read_geotiff_pair(folder / "left.tif", folder / "right.tif")
    one: GeoImage = read_geotiff(folder / "left.tif", bands=[3, 2, 1])

    result = ps.match(left.image, right.image, left_mask=left.mask, num_disparities=64)
    write_geotiff(folder / "disparity.tif", result.disparity, like=left)
    write_geotiff(folder / "all.tif", {"disparity": result.disparity}, like=place)
    use(one.georeference.crs, labeled.as_dataset(result))

    arrays = (xarray.DataArray(view.image, dims=("y", "x")) for view in (left, right))
    return labeled.match(*arrays, num_disparities=64, window=7)


def beyond_memory(
    folder: Path, left: Image, right: Image, lazy: tuple[dask.array.Array, dask.array.Array]
) -> int:
    """Match a pair a band at a time: by itself, from file to file, lazily."""

    def read(first: int, last: int) -> tuple[Image, Image, None, None]:
        return left[first:last], right[first:last], None, None

    known: large.PairStatistics = large.pair_statistics(
        read, (left.shape[0], left.shape[1]), num_disparities=64
    )
    known.save(folder / "statistics.npz")

    around: int = large.halo(known.settings, known.blur_compensation)
    use(around, large.match_rows(read, known, 128, 256, threads=1).flags)

    report = outofcore.match(
        folder / "left.tif",
        folder / "right.tif",
        folder / "out.tif",
        num_disparities=64,
        max_memory="2GB",
    )

    use(report.seconds, dask_maps.match(*lazy, num_disparities=64))

    pairs = batch.read_pairs(folder / "pairs.csv", num_disparities=64)
    return len(batch.run(pairs, folder / "maps", preset="fast").failed)


def raw(folder: Path, left: Image, right: Image) -> ps.Result:
    """Rectify raw pairs, by a calibration and by what they show."""
    known: ps.Rectification = ps.rectify(left, right, folder / "stereo.yml", alpha=0)

    found = ps.rectify("left.png", folder / "right.png", others=[(left, right)])
    found.save(folder / "rig.npz")
    again = ps.Rectification.load(folder / "rig.npz")

    both: tuple[Image, Image] = again.apply(left, right)
    use(known.Q, known.maps, known.error, found.sentences, both)
    use(ps.match("left.png", folder / "right.png", num_disparities=64), ps.io.read_pair("a.mpo"))

    rig: live.StereoCalibration = live.calibrate(folder / "boards", board="9x6", square=0.025)
    rig.save(folder / "calibration.yaml")
    use(rig.advice, rig.depth_error([1.0]).total, ps.rectify(left, right, rig.matrices))

    for frame in live.stream("video.mp4", num_disparities=64, rectify=known):
        use(frame.result)

    return ps.match(
        known.left,
        known.right,
        num_disparities=64,
        left_mask=known.left_mask,
        right_mask=known.right_mask,
    )


def in_files(name: str) -> float:
    """Read and write the formats of the field."""
    folder = Path(name)

    left = read_image(folder / "left.png")
    right = ps.io.read_image(f"{name}/right.png")

    disparity = ps.match(left, right, num_disparities=64).disparity
    write_disparity(folder / "out.pfm", disparity)
    truth = read_disparity(folder / "truth.pfm")
    depth: Map = read_calibration(folder / "calib.txt").depth(disparity)

    picture: Image = ps.views.picture.colorize(disparity, low=0, high=64)
    use(depth.shape, picture.shape)
    return ps.metrics.bad_pixels(disparity, truth, 1.0)


def scored(left: Image, right: Image, truth: Map) -> ps.metrics.Score | None:
    """Score a match of a pair whose disparities are known."""
    result = ps.match(left, right, num_disparities=64)
    use(ps.metrics.middlebury_v2(result.disparity, (truth, {"all": np.isfinite(truth)})))
    if result.confidence is None:
        return None
    area: float = ps.metrics.roc_area(result.confidence, result.disparity, truth)
    use(area)
    return ps.metrics.score(result.disparity, truth)
