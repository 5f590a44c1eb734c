"""The output messages of a match, for recordings and nodes alike.

The caller passes the function that makes a message from a type and its fields:
`RecordingWriter.make`, or the one of a node.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import Map, as_pixels, as_rgb8
from phasestereo.io import Calibration
from phasestereo.result import Result
from phasestereo.rig.diagnosis import Diagnosis
from phasestereo.views.depths import YAW, Ranging, Selection, depths_of, ranging
from phasestereo.views.registering import ThirdCamera, register
from phasestereo_live.ros.images import encode_image
from phasestereo_live.ros.pairing import Header

Make = Callable[..., Any]

Depths = Literal["32FC1", "16UC1"]
DEPTHS: tuple[Depths, ...] = ("32FC1", "16UC1")
"""Encodings of depths (REP 118): m, not finite elsewhere; mm, 0 elsewhere."""

MAP_IMAGES = "confidence", "uncertainty"
"""Maps of a result to send as images of 32FC1 beside the disparities."""

REGISTERED = "near", "far", "confidence"
"""Maps of a third camera to send as images of 32FC1 beside its depths."""

_FLOAT32 = 7  # sensor_msgs/PointField
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
_MOST_MM = np.iinfo(np.uint16).max
_LEVELS = {"ok": 0, "note": 0, "warning": 1}  # diagnostic_msgs/DiagnosticStatus
_NUMBERS = {"range": "search", "swap": "search", "texture": "low_texture"}
"""Names of the numbers of a diagnosis, if they differ from the topic's name."""

_PLUMB_BOB = 5  # numbers of its distortion at most
_WHOLE, _PARTS = 1.0, 1 / 16  # pixels: the step of disparities; the usual step of subpixel ones


def header_of(make: Make, header: Header) -> Any:
    """Return a ``std_msgs/Header``."""
    seconds, nanoseconds = divmod(header.stamp, 10**9)
    stamp = make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=header.frame_id)


def image_of(make: Make, header: Header, array: NDArray[Any]) -> Any:
    """Return a ``sensor_msgs/Image`` of an array of the kinds in `encode_image`."""
    return make("sensor_msgs/msg/Image", header=header_of(make, header), **encode_image(array))


def disparity_image(
    make: Make, header: Header, result: Result, calibration: Calibration | None
) -> Any:
    """Return a ``stereo_msgs/DisparityImage``.

    Its disparities satisfy ``Z = f T / d``, as in ROS: if the principal points of the cameras
    differ, they and the ends of the range include ``doffs``. Pixels without an estimate are
    ``min_disparity - 1``. Without a calibration f and T are 0.

    Parameters
    ----------
    make
        Makes a message from a type and its fields.
    header
        The header of the left image.
    result
        The match; it knows its range.
    calibration
        The geometry of the rectified pair, the baseline in m; None: not known.
    """
    shift = 0.0 if calibration is None else calibration.doffs
    low, count = _range(result)

    # ROS has no `doffs`: Z = f T / d must hold for the sent disparities.
    found = result.disparity + np.float32(shift)
    found[~np.isfinite(result.disparity)] = np.float32(low + shift - 1)

    rows, cols = found.shape
    window = make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0,
        y_offset=0,
        height=rows,
        width=cols,
        do_rectify=False,
    )

    return make(
        "stereo_msgs/msg/DisparityImage",
        header=header_of(make, header),
        image=image_of(make, header, found),
        f=0.0 if calibration is None else float(calibration.focal),
        t=0.0 if calibration is None else float(calibration.baseline),
        valid_window=window,
        min_disparity=float(low + shift),
        max_disparity=float(low + count - 1 + shift),
        delta_d=_PARTS if result.settings.subpixel else _WHOLE,
    )


def _range(result: Result) -> tuple[int, int]:
    if result.search is None:
        raise ValueError("result: does not know which disparities were searched")
    return result.search.min_disparity, result.search.num_disparities


def camera_info(make: Make, header: Header, camera: Calibration | ThirdCamera) -> Any:
    """Return a ``sensor_msgs/CameraInfo``.

    Parameters
    ----------
    make, header
        As `disparity_image` takes them.
    camera
        The geometry of rectified images of this size, which gives the left camera, without
        distortion; or a third camera.
    """
    if isinstance(camera, Calibration):
        matrix, lens, model = np.array(camera.cam0), np.zeros(5), "plumb_bob"
    else:
        matrix = camera.matrix
        lens = np.zeros(5) if camera.distortion is None else camera.distortion
        usual = "plumb_bob" if len(lens) <= _PLUMB_BOB else "rational_polynomial"
        model = "equidistant" if camera.fisheye else usual
    matrices = {
        "d": lens,
        "k": matrix.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.column_stack([matrix, np.zeros(3)]).ravel(),
    }
    roi = make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0,
        y_offset=0,
        height=0,
        width=0,
        do_rectify=False,
    )
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header_of(make, header),
        height=camera.height,
        width=camera.width,
        distortion_model=model,
        binning_x=0,
        binning_y=0,
        roi=roi,
        **matrices,
    )


def ranged_depth(
    result: Result, calibration: Calibration, selection: Selection | None = None
) -> Map:
    """Return depths as REP 117 and REP 118 define them, float32 (H, W).

    +Inf is too far: possibly infinite, beyond ``max_depth``, or at the smallest searched disparity.
    -Inf is too near: nearer than ``min_depth``, or at the largest searched disparity. NaN is
    unknown: the estimate is missing or not kept.

    Parameters
    ----------
    result
        The match.
    calibration
        The geometry of the rectified pair.
    selection
        Which estimates to keep; None: the trusted ones. Depths have the size of the image, for any
        ``decimate``.
    """
    chosen = selection or Selection()
    geometry = _ranging(result, calibration)
    depth = depths_of(result, geometry, Selection(keep=chosen.keep), finite=False).depth

    kept = result.kept(chosen.keep)
    far = np.isposinf(depth)
    if chosen.max_depth is not None:
        far |= depth > chosen.max_depth
    near = np.zeros_like(kept) if chosen.min_depth is None else depth < chosen.min_depth
    if result.search is not None:
        low, count = _range(result)
        far |= kept & (result.disparity <= low)
        near |= kept & (result.disparity >= low + count - 1)
    depth[far] = np.inf
    depth[near] = -np.inf
    return depth


def _ranging(result: Result, calibration: Calibration) -> Ranging:
    bars = result.uncertainty
    return ranging(result.disparity, calibration, uncertainty=bars, yaw=YAW, anchor=None)


def in_space(
    make: Make,
    header: Header,
    result: Result,
    calibration: Calibration,
    left: NDArray[Any],
    *,
    kinds: Collection[str] = ("depth", "points"),
    encoding: str = DEPTHS[0],
    selection: Selection | None = None,
) -> dict[str, Any]:
    """Return depths and points under the names of their topics.

    With ``selection.decimate``, one pixel for each block, they are under ``decimated``, with the
    ``camera_info`` of images of that size.

    Parameters
    ----------
    make, header
        As `disparity_image` takes them.
    result
        The match.
    calibration
        The geometry of the rectified pair, the baseline in m.
    left
        The left image, for the colors.
    kinds
        "depth", "points", or both.
    encoding
        The encoding of the depths, one of `DEPTHS`.
    selection
        Which estimates to keep; None: the trusted ones.

    Raises
    ------
    ValueError
        If the image is smaller than a block.
    """
    chosen, space, found = selection or Selection(), "", {}
    depth = ranged_depth(result, calibration, chosen)
    if chosen.decimate > 1:
        blocks = replace(chosen, min_depth=None, max_depth=None)
        thin = depths_of(result, _ranging(result, calibration), blocks, finite=False)
        depth, left, calibration = thin.picked(depth), thin.picked(left), thin.calibration
        space = "decimated/"
        found[f"{space}camera_info"] = camera_info(make, header, calibration)
    if "points" in kinds:
        found[f"{space}points2"] = point_cloud2(make, header, depth, calibration, left)
    if "depth" in kinds:
        found[f"{space}depth"] = depth_image(make, header, depth, encoding)
    return found


def registered(
    make: Make,
    header: Header,
    result: Result,
    calibration: Calibration,
    camera: ThirdCamera,
    *,
    encoding: str = DEPTHS[0],
    selection: Selection | None = None,
) -> dict[str, Any]:
    """Return the view of a third camera under the names of its topics, in ``registered``.

    Parameters
    ----------
    make
        As in `disparity_image`.
    header
        The stamp of the left image, and the frame of the third camera.
    result, calibration, encoding, selection
        As in `in_space`; ``decimate`` has no effect.
    camera
        The third camera.
    """
    chosen = selection or Selection()
    maps = register(
        result,
        calibration,
        camera,
        keep=chosen.keep,
        min_depth=chosen.min_depth,
        max_depth=chosen.max_depth,
    ).maps
    found = {"camera_info": camera_info(make, header, camera)}
    found["depth"] = depth_image(make, header, maps["depth"], encoding)
    for name in REGISTERED:
        if name in maps:
            found[name] = image_of(make, header, maps[name])
    return {f"registered/{name}": message for name, message in found.items()}


def depth_image(make: Make, header: Header, depth: Map, encoding: str) -> Any:
    """Return depths as a ``sensor_msgs/Image``.

    Parameters
    ----------
    make, header
        As `disparity_image` takes them.
    depth
        float32 (H, W), m, from `ranged_depth`.
    encoding
        One of `DEPTHS`. In mm, pixels without a depth, or of 65.535 m and more, are 0.
    """
    if encoding == "32FC1":
        return image_of(make, header, depth)

    millimetres = np.rint(1000 * depth.astype(np.float64))
    held = np.isfinite(millimetres) & (millimetres <= _MOST_MM)
    return image_of(make, header, np.where(held, millimetres, 0).astype(np.uint16))


def point_cloud2(
    make: Make, header: Header, depth: Map, calibration: Calibration, left: NDArray[Any]
) -> Any:
    """Return a ``sensor_msgs/PointCloud2`` with one point per pixel.

    By REP 117, a point is NaN if it is unknown, and infinite if the scene is beyond the range:
    along its ray if too far away, against it if too near.

    Its fields are those of ``stereo_image_proc``: x, y, z in m (X to the right, Y down, Z forward,
    as in an optical frame) and rgb.

    Parameters
    ----------
    make, header
        As `disparity_image` takes them.
    depth
        float32 (H, W), m, from `ranged_depth`.
    calibration
        The geometry of the pair.
    left
        The left image, for the colors.
    """
    (fx, _, cx), (_, fy, cy), _ = calibration.cam0
    rows, cols = depth.shape

    points = np.empty((rows, cols), _POINT)
    z = depth.astype(np.float64)
    rays = (np.arange(cols) - cx) / fx, (np.arange(rows)[:, np.newaxis] - cy) / fy
    for name, ray in zip(("x", "y"), rays, strict=True):
        # A ray along an axis stays on it: zero times infinity is zero here.
        points[name] = ray * np.where(ray == 0, 1.0, z)
        points[name][np.isnan(z)] = np.nan
    points["z"] = z

    # Colors are packed as 0x00RRGGBB.
    red, green, blue = np.moveaxis(as_rgb8(as_pixels(left, "left")).astype(np.uint32), 2, 0)
    points["rgb"] = red << 16 | green << 8 | blue

    fields = [
        make("sensor_msgs/msg/PointField", name=name, offset=4 * place, datatype=_FLOAT32, count=1)
        for place, name in enumerate(("x", "y", "z", "rgb"))
    ]

    return make(
        "sensor_msgs/msg/PointCloud2",
        header=header_of(make, header),
        height=rows,
        width=cols,
        fields=fields,
        is_bigendian=False,
        point_step=_POINT.itemsize,
        row_step=_POINT.itemsize * cols,
        data=points.reshape(-1).view(np.uint8),
        is_dense=False,
    )


def diagnostics(make: Make, header: Header, diagnosis: Diagnosis) -> Any:
    """Return a ``diagnostic_msgs/DiagnosticArray``: one status per topic of `phasestereo.check`.

    Parameters
    ----------
    make, header
        As `disparity_image` takes them.
    diagnosis
        The findings about the pair: blur, rows ("alignment"), exposure ("contrast", "saturation"),
        noise, texture.
    """
    topics = dict.fromkeys(found.topic for found in diagnosis.findings)
    numbers = diagnosis.as_dict()

    return make(
        "diagnostic_msgs/msg/DiagnosticArray",
        header=header_of(make, header),
        status=[
            _status(make, diagnosis, topic, numbers.get(_NUMBERS.get(topic, topic)))
            for topic in topics
        ],
    )


def _status(make: Make, diagnosis: Diagnosis, topic: str, numbers: Any) -> Any:
    found = [one for one in diagnosis.findings if one.topic == topic]
    values = [
        make("diagnostic_msgs/msg/KeyValue", key=key, value=f"{value:.6g}")
        for key, value in _flat(numbers)
    ]

    return make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=max(_LEVELS[one.severity] for one in found),
        name=f"phasestereo: {topic}",
        message="; ".join(one.sentence for one in found),
        hardware_id="",
        values=values,
    )


def _flat(value: Any, name: str = "") -> list[tuple[str, float]]:
    """Return the numbers of nested mappings under names such as left.bright; leave out lists."""
    if isinstance(value, dict):
        parts = [_flat(inner, f"{name}.{key}".strip(".")) for key, inner in value.items()]
        return [pair for part in parts for pair in part]
    return [(name, float(value))] if isinstance(value, int | float) else []
