"""Open a recording as a source of pairs: two topics, paired by time, and the cameras."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from phasestereo.io.files import StrPath
from phasestereo.io.rigs.cameras import Cameras, Matrix
from phasestereo.views.registering import ThirdCamera
from phasestereo_live.ros.bags import Bag, Item
from phasestereo_live.ros.images import decode_image
from phasestereo_live.ros.infos import RigGeometry, geometry_of, info_topics, third_camera
from phasestereo_live.ros.pairing import SIDES, Arrival, Header, paired
from phasestereo_live.ros.transforms import baseline_of, pose_between
from phasestereo_live.video.capture import Capture, CaptureSource, Pair, lost

TOLERANCE = 0.01
"""Largest difference between the stamps of a pair, s: less than half the time between frames."""

_IMAGES = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_INFO = "sensor_msgs/msg/CameraInfo"
_TRANSFORMS, _TRANSFORM = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/Transform"
_NAMES = (
    ("left", "right"), ("infra1", "infra2"), ("Infrared_1", "Infrared_2"), ("cam0", "cam1"),
    ("cam_l", "cam_r"), ("top", "bottom"),
)  # fmt: skip
"""Names that distinguish the topics of both cameras."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recording(CaptureSource[Pair]):
    """The pairs of a recording, for `phasestereo_live.stream`.

    Parameters
    ----------
    captures, close, length, rate, ahead
        As in a `CaptureSource`.
    topics
        The topics of the left and the right images.
    headers
        The header of each pair's left message, by the pair's number. Callers remove the ones they
        use.
    cameras
        The cameras that rectify the pairs, for ``stream(..., rectify=)``; None: the pairs are
        rectified already, or the cameras are unknown.
    q
        OpenCV's matrix Q of the rectified pairs, in m; None: unknown.
    note
        Remarks on the calibration; "" without remarks.
    third
        The third camera and the frame of its images; None: not requested.
    vertical
        Whether the right camera is below the left one, for ``stream(..., vertical=)``; None:
        unknown.
    """

    topics: tuple[str, str]
    headers: dict[int, Header]
    cameras: Cameras | None
    q: Matrix | None
    note: str
    third: tuple[ThirdCamera, str] | None = None
    vertical: bool | None = None


def open_recording(
    path: StrPath,
    left: str = "",
    right: str = "",
    *,
    camera_info: Sequence[str] | None = None,
    register: str = "",
    tolerance: float = TOLERANCE,
) -> Recording:
    """Open a recording of a robot, without ROS.

    Parameters
    ----------
    path
        An ``.mcap`` or ``.db3`` file, a folder of rosbag2, or a ``.bag`` of ROS 1.
    left, right
        Topics of the images: ``sensor_msgs/Image`` or ``CompressedImage``. Without both, the only
        two topics with a pair of names: left and right, infra1 and infra2, Infrared_1 and
        Infrared_2, cam0 and cam1, cam_l and cam_r, top and bottom.
    camera_info
        Topics of both cameras' ``sensor_msgs/CameraInfo``; None: ``camera_info`` beside the images,
        if it is there. Images on ``image_rect`` count as rectified; others are raw. If it omits the
        baseline, that comes from ``/tf_static``, or the transforms of RealSense's recordings.
    register
        Topic of the ``camera_info`` of a third camera, such as a color camera, to get depths in its
        frame: its pose comes from ``/tf_static`` or the transforms of RealSense's recordings. "":
        no third camera.
    tolerance
        Largest difference between the stamps of a pair, seconds, 0 or more. A frame without a
        partner counts as failed.

    Returns
    -------
    Recording
        For `phasestereo_live.stream`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not a recording, is cut short or has no such topic, or the cameras are not a
        calibrated pair; if the tolerance is negative.
    ImportError
        If the extra ``ros`` is not installed.
    """
    if not 0 <= tolerance < math.inf:
        raise ValueError(f"tolerance: got {tolerance}; accepts 0 or more seconds")
    if left == right and left:
        raise ValueError(f"right: got {right}, which is the left topic, too")

    bag = Bag(path)

    try:
        if not left and not right:
            left, right = _guessed(bag, path)
        count = min(
            _count(bag, path, name, topic) for name, topic in zip(SIDES, (left, right), strict=True)
        )
        geometry, note = _geometry(bag, (left, right), camera_info)
        third = _third(bag, left, camera_info, register) if register else None
    except BaseException:
        bag.close()
        raise

    # Reading a capture fills in its header, so each frame finds its own.
    headers: dict[int, Header] = {}
    captures = _captures(bag, (left, right), round(1e9 * tolerance), headers)

    def close() -> None:
        captures.close()
        bag.close()

    return Recording(
        captures=captures,
        close=close,
        length=count,
        ahead=True,
        topics=(left, right),
        headers=headers,
        cameras=geometry.cameras,
        q=geometry.q,
        note=note,
        third=third,
        vertical=geometry.vertical,
    )


def _guessed(bag: Bag, path: StrPath) -> tuple[str, str]:
    """Return the two topics of images that only `_NAMES` distinguish.

    Raises
    ------
    ValueError
        If no pair exists, or several do.
    """
    images = [topic for topic, (kind, _) in bag.topics.items() if kind in _IMAGES]
    pairs = [
        (left, right)
        for one, other in _NAMES
        for left in images
        if one in left and (right := left.replace(one, other)) in images
    ]
    whole = {left for left, _ in pairs}
    # If a recording has images twice, the uncompressed ones count.
    pairs = [(a, b) for a, b in pairs if a.removesuffix("/compressed") not in whole - {a}]
    if len(pairs) == 1:
        return pairs[0]

    raise ValueError(
        f"left and right: got no topics; accepts two of {os.fspath(path)}: "
        f"{', '.join(images) or 'there are no images in it'}"
    )


def _count(bag: Bag, path: StrPath, name: str, topic: str) -> int:
    """Return the number of images of a topic."""
    kind, count = bag.topics.get(topic, ("", 0))
    if kind not in _IMAGES:
        found = [each for each, (kind, _) in bag.topics.items() if kind in _IMAGES]
        raise ValueError(
            f"{name}: got {topic!r}, not a topic of images in {os.fspath(path)}; accepts "
            f"{', '.join(found) or 'none: there are no images in it'}"
        )

    return count


def _geometry(
    bag: Bag, topics: tuple[str, str], given: Sequence[str] | None
) -> tuple[RigGeometry, str]:
    """Return the cameras' calibration, and remarks on it."""
    names = tuple(given) if given is not None else _beside(bag, topics)
    missing = [name for name in names if bag.topics.get(name, ("", 0))[0] != _INFO]
    if missing and given is not None:
        raise ValueError(f"camera_info: got {missing[0]!r}, not a topic of camera_info")
    if missing or len(names) != 2:
        said = f"no {' or '.join(missing)}: frames count as rectified, and there are no depths"
        return RigGeometry(None, None), said

    # Cameras do not change within a recording: the first message of each counts.
    found = _firsts(bag, names, lambda message: message)
    if len(found) < len(set(names)):
        raise ValueError(f"camera_info: {' and '.join(names)} have no message")
    left, right = (found[name] for name in names)

    images = _firsts(bag, topics, lambda message: decode_image(message).shape)
    sizes = {(cols, rows) for rows, cols, *_ in images.values()}
    size = sizes.pop() if len(sizes) == 1 else None
    geometry = geometry_of(left, right, topics, size)
    if geometry.q is None:
        frames = left.header.frame_id, right.header.frame_id
        baseline = baseline_of(_pose(bag, topics, frames))
        geometry = geometry_of(left, right, topics, size, baseline)

    way = "frames are rectified by" if geometry.cameras else "frames are rectified; geometry of"
    notes = [f"{way} {names[0]} and {names[1]}", *geometry.notes]
    if geometry.q is None:
        notes.append("no baseline in camera_info or /tf_static: there are no depths")
    return geometry, "; ".join(notes)


def _beside(bag: Bag, topics: tuple[str, str]) -> tuple[str, ...]:
    """Return the topics of ``camera_info`` for both images: the actual or the expected ones."""
    places = [info_topics(topic) for topic in topics]
    return next(
        (both for both in zip(*places, strict=True) if all(one in bag.topics for one in both)),
        tuple(place[0] for place in places),
    )


def _firsts(bag: Bag, topics: Sequence[str], of: Callable[[Any], Any]) -> dict[str, Any]:
    """Return a value from the first readable message of each topic."""
    found: dict[str, Any] = {}
    for item in bag.items(topics):
        if item.topic not in found:
            with suppress(ValueError):
                found[item.topic] = of(item.read())
        if len(found) == len(set(topics)):
            break
    return found


def _third(
    bag: Bag, left: str, given: Sequence[str] | None, register: str
) -> tuple[ThirdCamera, str]:
    """Return a third camera, from its ``camera_info`` and transforms, and its images' frame."""
    if bag.topics.get(register, ("", 0))[0] != _INFO:
        raise ValueError(f"register: got {register!r}, not a topic of camera_info")
    first = (
        given[0]
        if given
        else next((one for one in info_topics(left) if one in bag.topics), register)
    )
    found = _firsts(bag, (first, register), lambda message: message)
    if first == register or len(found) < 2:
        raise ValueError(f"register: no camera_info beside {left}, or none in {register}")
    messages = found[first], found[register]
    frames = messages[0].header.frame_id, messages[1].header.frame_id
    image = f"{register.rpartition('/info/')[0]}/image/data"
    pose = _pose(bag, (left, image), frames)
    if pose is None:
        raise ValueError(f"register: no transforms join {frames[0]!r} and {frames[1]!r}")
    return third_camera(messages[1], messages[0], pose), frames[1]


def _pose(bag: Bag, topics: tuple[str, str], frames: tuple[str, str]) -> Matrix | None:
    """Return the pose of the second camera in the first one from transforms, or None."""
    static = [name for name, (kind, _) in bag.topics.items() if kind == _TRANSFORMS]
    transforms = [
        (one.header.frame_id, one.child_frame_id, one.transform)
        for item in bag.items([name for name in static if name.endswith("tf_static")])
        for one in item.read().transforms
    ]
    found = pose_between(transforms, *frames)
    if found is not None:
        return found

    # RealSense's .bag has a transform beside each stream, from a reference stream to it.
    beside = [topic.rpartition("/image/")[0] + "/tf/" for topic in topics]
    names = {
        name: side
        for name, (kind, _) in bag.topics.items()
        for side, place in zip(SIDES, beside, strict=True)
        if kind == _TRANSFORM and name.startswith(place)
    }
    single = [(names[item.topic], "reference", item.read()) for item in bag.items(list(names))]
    return pose_between(single, *SIDES)


def _captures(
    bag: Bag, topics: tuple[str, str], tolerance: int, headers: dict[int, Header]
) -> Generator[Capture[Pair]]:
    start: int | None = None
    for index, (header, both) in enumerate(paired(_arrivals(bag, topics), tolerance)):
        start = header.stamp if start is None else start
        time = (header.stamp - start) / 1e9

        if isinstance(both, Exception):
            yield lost(index, time, both)
        else:
            headers[index] = header
            yield Capture(index, time, partial(_decoded, *both))


def _arrivals(bag: Bag, topics: tuple[str, str]) -> Iterator[Arrival]:
    """Yield the recorded messages; a damaged file ends with its error."""
    last = Header(0, "")
    try:
        for item in bag.items(topics):
            arrival = _arrival(item, topics.index(item.topic))
            last = arrival.header
            yield arrival
    except (OSError, ValueError) as error:
        yield Arrival(0, last, error)


def _arrival(item: Item, side: int) -> Arrival:
    try:
        message = item.read()
    except ValueError as error:
        return Arrival(side, Header(item.time, ""), error)

    stamp = 10**9 * message.header.stamp.sec + message.header.stamp.nanosec
    return Arrival(side, Header(stamp or item.time, message.header.frame_id), message)


def _decoded(left: Any, right: Any) -> Pair:
    images = []
    for side, message in zip(SIDES, (left, right), strict=True):
        try:
            images.append(decode_image(message))
        except ValueError as error:
            raise ValueError(f"{side}: {error}") from error

    return images[0], images[1]
