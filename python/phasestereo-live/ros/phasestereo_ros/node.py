"""A node in the place of ``stereo_image_proc``: its topics, its parameters, its messages.

It subscribes to ``left/image_rect``, ``left/camera_info``, ``right/image_rect`` and
``right/camera_info``, and publishes ``disparity`` (``stereo_msgs/DisparityImage``), ``points2``
(``sensor_msgs/PointCloud2``), ``depth``, ``confidence`` and ``uncertainty`` (``sensor_msgs/Image``,
32FC1), the ``camera_info`` of these, and, once a second, ``/diagnostics``. With ``decimate`` depths
and points are below ``decimated``; with ``register``, the topic of a third camera's
``camera_info``, its view is below ``registered``. All that is done with images is done by
phasestereo, as for recordings.
"""

from __future__ import annotations

import array
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import message_filters
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    qos_profile_sensor_data,
    qos_profile_system_default,
)
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from phasestereo import Rig, check
from phasestereo.io import Calibration
from phasestereo.settings import resolve
from phasestereo.views.depths import Selection
from phasestereo_live.ros import Header
from phasestereo_live.ros.images import decode_image
from phasestereo_live.ros.infos import geometry_of, third_camera
from phasestereo_live.ros.messages import (
    MAP_IMAGES,
    REGISTERED,
    camera_info,
    diagnostics,
    disparity_image,
    image_of,
    in_space,
    registered,
)
from phasestereo_live.ros.transforms import pose_between

if TYPE_CHECKING:
    from collections.abc import Mapping, Set

    from numpy.typing import NDArray

    from phasestereo import Result, Settings

TOPICS = "left/image_rect", "right/image_rect"
INFOS = "left/camera_info", "right/camera_info"
COUNTED: dict[str, Any] = {
    "preset": "robust",
    "approximate_sync": False,
    "approximate_sync_tolerance_seconds": 0.01,
    "queue_size": 5,
    "use_system_default_qos": False,
    "min_disparity": 0,
    "disparity_range": 64,
    "correlation_window_size": 0,
    "disp12_max_diff": 1,
    "uniqueness_ratio": 0.0,
    "speckle_size": 0,
    "speckle_range": 4,
    "keep": "trusted",
    "min_depth": 0.0,
    "max_depth": 0.0,
    "decimate": 1,
    "register": "",
}
"""Parameters that count, and their defaults; sizes of 0 are those of the preset, and depths of 0
leave the range open."""
IGNORED: dict[str, Any] = {
    "stereo_algorithm": 0,
    "sgbm_mode": 0,
    "full_dp": False,
    "prefilter_size": 9,
    "prefilter_cap": 31,
    "texture_threshold": 10,
    "P1": 200.0,
    "P2": 400.0,
}
"""Parameters of ``stereo_image_proc`` without a meaning here, so that its files load."""

_SECOND = 10**9  # ns


@dataclass(frozen=True)
class Search:
    """What parameters mean: the disparities, and how they are searched."""

    low: int
    count: int
    settings: Settings
    selection: Selection


def search_of(values: Mapping[str, Any]) -> Search:
    """Return the settings of the parameters.

    Raises
    ------
    ValueError
        If a value is out of its range; the message begins with the setting's name.
    """
    window, speckles = values["correlation_window_size"], values["speckle_size"]
    chosen: dict[str, Any] = {"fill": False, "uniqueness": round(values["uniqueness_ratio"])}
    chosen["lr_check"] = max(1, values["disp12_max_diff"])
    if window > 0:
        chosen["window"] = window
    if speckles > 0:
        chosen |= {"speckle_size": speckles, "speckle_range": values["speckle_range"]}
    settings = resolve(values["preset"], None, chosen)
    selection = Selection(
        keep=values["keep"],
        min_depth=values["min_depth"] or None,
        max_depth=values["max_depth"] or None,
        decimate=values["decimate"],
    )
    return Search(values["min_disparity"], values["disparity_range"], settings, selection)


def make(kind: str, **fields: Any) -> Any:
    """Make a message of a type such as ``"sensor_msgs/msg/Image"``, as rclpy wants its fields."""
    package, _, name = kind.split("/")
    message = getattr(import_module(f"{package}.msg"), name)()
    for field, value in fields.items():
        if isinstance(value, np.ndarray):
            code = "B" if value.dtype == np.uint8 else "d"
            setattr(message, field, array.array(code, value.tobytes()))
        elif kind == "diagnostic_msgs/msg/DiagnosticStatus" and field == "level":
            setattr(message, field, bytes([value]))
        else:
            setattr(message, field, value)
    return message


class PhasestereoNode(Node):  # type: ignore[misc]  # rclpy has no types
    """Matches synchronized pairs of rectified images."""

    def __init__(self, **options: Any) -> None:
        super().__init__("phasestereo_node", **options)
        for name, default in (COUNTED | IGNORED).items():
            self.declare_parameter(name, default)
        values = {name: self.get_parameter(name).value for name in COUNTED}
        unused = [name for name in IGNORED if self.get_parameter(name).value != IGNORED[name]]
        if unused:
            self.get_logger().warning(f"without effect here: {', '.join(unused)}")
        self._search = search_of(values)
        self._rig = Rig(
            min_disparity=self._search.low,
            num_disparities=self._search.count,
            settings=self._search.settings,
        )
        self._diagnosed: int | None = None
        self._disparity = self.create_publisher(DisparityImage, "disparity", 1)
        self._maps = {name: self.create_publisher(Image, name, 1) for name in MAP_IMAGES}
        self._info = self.create_publisher(CameraInfo, "camera_info", 1)
        space = "decimated/" if self._search.selection.decimate > 1 else ""
        kinds = {f"{space}depth": Image, f"{space}points2": PointCloud2}
        if space:
            kinds[f"{space}camera_info"] = CameraInfo
        self._third: Any = None  # the last camera_info of the third camera
        self._transforms: dict[str, tuple[str, str, Any]] = {}
        if values["register"]:
            kinds |= {f"registered/{name}": Image for name in ("depth", *REGISTERED)}
            kinds["registered/camera_info"] = CameraInfo
            self._listen(values["register"])
        self._spatial = {name: self.create_publisher(kind, name, 1) for name, kind in kinds.items()}
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._subscribe(values)

    def _subscribe(self, values: Mapping[str, Any]) -> None:
        is_default = values["use_system_default_qos"]
        qos = qos_profile_system_default if is_default else qos_profile_sensor_data
        wanted = [(Image, TOPICS), (CameraInfo, INFOS)]
        views = [
            message_filters.Subscriber(self, kind, topic, qos_profile=qos)
            for kind, topics in wanted
            for topic in topics
        ]
        if values["approximate_sync"]:
            slop = values["approximate_sync_tolerance_seconds"]
            self._synchronizer = message_filters.ApproximateTimeSynchronizer(
                views, values["queue_size"], slop
            )
        else:
            self._synchronizer = message_filters.TimeSynchronizer(views, values["queue_size"])
        self._synchronizer.registerCallback(self.match)

    def _listen(self, topic: str) -> None:
        """Follow the camera_info of a third camera, and where everything is."""
        kind = getattr(import_module("tf2_msgs.msg"), "TFMessage")  # noqa: B009 - a type of ROS
        kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(kind, "/tf_static", self._place, kept)
        self.create_subscription(CameraInfo, topic, self._see, qos_profile_sensor_data)

    def _place(self, message: Any) -> None:
        for one in message.transforms:
            found = one.header.frame_id, one.child_frame_id, one.transform
            self._transforms[one.child_frame_id] = found

    def _see(self, message: Any) -> None:
        self._third = message

    def match(self, left: Any, right: Any, left_info: Any, right_info: Any) -> None:
        """Match a pair and publish what is subscribed to; a pair that fails is logged."""
        try:
            self._publish(left, right, left_info, right_info)
        except (ValueError, TypeError) as error:
            self.get_logger().error(str(error), throttle_duration_sec=1.0)

    def _publish(self, left: Any, right: Any, left_info: Any, right_info: Any) -> None:
        stamp = _SECOND * left.header.stamp.sec + left.header.stamp.nanosec
        header = Header(stamp, left.header.frame_id)
        images = decode_image(left), decode_image(right)
        rows, cols = images[0].shape[:2]
        rig = geometry_of(left_info, right_info, TOPICS, (cols, rows))
        known = None
        if rig.q is not None:
            known = Calibration.from_q(rig.q, width=cols, height=rows, unit="m")
        result = self._rig.match(*images, vertical=rig.vertical)
        self._disparity.publish(disparity_image(make, header, result, known))
        for name, publisher in self._maps.items():
            values = result.maps.get(name)
            if values is not None and publisher.get_subscription_count():
                publisher.publish(image_of(make, header, values))
        if known is not None:
            self._info.publish(camera_info(make, header, known))
            self._publish_depths(header, result, known, images[0], left_info)
        if self._diagnosed is None or not 0 <= stamp - self._diagnosed < _SECOND:
            self._diagnosed = stamp
            self._diagnostics.publish(diagnostics(make, header, check(*images, self_rectify=False)))

    def _publish_depths(
        self,
        header: Header,
        result: Result,
        known: Calibration,
        left: NDArray[Any],
        left_info: Any,
    ) -> None:
        """Publish what is subscribed to of depths and points."""
        wanted = {name for name, one in self._spatial.items() if one.get_subscription_count()}
        chosen, ends = self._search.selection, {"depth": "depth", "points2": "points"}
        own = [name.split("/")[-1] for name in wanted if not name.startswith("registered/")]
        if own:
            kinds = [ends[name] for name in own if name in ends]
            self._send(
                in_space(make, header, result, known, left, kinds=kinds, selection=chosen), wanted
            )
        if self._third is not None and any(name.startswith("registered/") for name in wanted):
            frames = left_info.header.frame_id, self._third.header.frame_id
            pose = pose_between(self._transforms.values(), *frames)
            if pose is None:
                raise ValueError(f"register: no transforms join {frames[0]!r} and {frames[1]!r}")
            camera = third_camera(self._third, left_info, pose)
            there = Header(header.stamp, frames[1])
            self._send(registered(make, there, result, known, camera, selection=chosen), wanted)

    def _send(self, messages: Mapping[str, Any], wanted: Set[str]) -> None:
        for name in wanted & messages.keys():
            self._spatial[name].publish(messages[name])


def main() -> None:
    """Run the node until it is stopped."""
    rclpy.init()
    node = PhasestereoNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # how nodes are stopped
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
