"""The node of ROS 2 against stand-ins of the shape of rclpy: no ROS is needed here."""

from __future__ import annotations

import array
import importlib
import sys
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar
from xml.etree import ElementTree

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import Calibration
from support import ROOT, robots
from support.robots import ROS2, START

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

COLS, ROWS, COUNT = 96, 64, 16
PACKAGE = ROOT / "python/phasestereo-live/ros"


def message_class(kind: str) -> type:
    """Return a class of messages as rclpy has them: made without values, of known fields alone."""
    fields = [name for name in ROS2.types[kind].__dataclass_fields__ if name != "__msgtype__"]
    named = [name for name in fields if not name.isupper()]
    return type(kind.rsplit("/", maxsplit=1)[-1], (), {"__slots__": named})


class Node:
    """What a node is given and does."""

    given: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: dict[str, Any] = {}
        self.published: dict[str, list[Any]] = {}
        self.subscribed: dict[str, tuple[str, Any, Any]] = {}
        self.logged: list[str] = []

    def declare_parameter(self, name: str, default: Any) -> None:
        value = self.given.get(name, default)
        assert type(value) is type(default)  # as rclpy asks
        self.parameters[name] = value

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value=self.parameters[name])

    def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
        assert depth > 0
        sent = self.published.setdefault(topic, [])

        def publish(message: Any) -> None:
            assert type(message) is kind
            sent.append(message)

        return SimpleNamespace(publish=publish, get_subscription_count=lambda: 1)

    def create_subscription(self, kind: type, topic: str, heard: Any, qos: Any) -> None:
        self.subscribed[topic] = (kind.__name__, heard, qos)

    def get_logger(self) -> Any:
        def log(text: str, **_: Any) -> None:
            self.logged.append(text)

        return SimpleNamespace(warning=log, error=log)


class Synchronizer:
    """Keeps what it is made of."""

    def __init__(self, views: list[Any], *settings: float) -> None:
        self.views, self.settings = views, settings

    def registerCallback(self, callback: Any) -> None:  # noqa: N802 - its name in message_filters
        self.callback = callback


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Return a function that makes a node with some parameters."""
    modules = {
        name: ModuleType(name) for name in ("rclpy", "rclpy.executors", "rclpy.node", "rclpy.qos")
    }
    modules["rclpy.node"].Node = Node  # type: ignore[attr-defined]
    modules["rclpy.executors"].ExternalShutdownException = Exception  # type: ignore[attr-defined]
    for name in ("sensor_data", "system_default"):
        setattr(modules["rclpy.qos"], f"qos_profile_{name}", name)

    qos: Any = modules["rclpy.qos"]
    qos.DurabilityPolicy = SimpleNamespace(TRANSIENT_LOCAL="transient local")
    qos.QoSProfile = lambda depth, durability: (depth, durability)

    filters = modules["message_filters"] = ModuleType("message_filters")
    filters.Subscriber = lambda _, kind, topic, qos_profile: (kind, topic, qos_profile)  # type: ignore[attr-defined]
    filters.TimeSynchronizer = type("TimeSynchronizer", (Synchronizer,), {})  # type: ignore[attr-defined]
    filters.ApproximateTimeSynchronizer = type("ApproximateTimeSynchronizer", (Synchronizer,), {})  # type: ignore[attr-defined]

    for kind in ROS2.types:
        package, _, name = kind.split("/")
        home = modules.setdefault(f"{package}.msg", ModuleType(f"{package}.msg"))
        modules.setdefault(package, ModuleType(package))
        setattr(home, name, message_class(kind))

    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PACKAGE))
    monkeypatch.setattr(Node, "given", {})

    home = importlib.import_module("phasestereo_ros.node")

    def made(**parameters: Any) -> Any:
        Node.given = parameters
        return home.PhasestereoNode()

    yield made

    for name in ("phasestereo_ros.node", "phasestereo_ros"):
        sys.modules.pop(name, None)


def pair() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    scene = np.random.default_rng(0).integers(0, 256, (ROWS, COLS + 5, 3), np.uint8)
    return scene[:, :-5].copy(), scene[:, 5:].copy()


def arrivals() -> list[Any]:
    """Return images and camera_info of a pair as they arrive."""
    infos = robots.straight((COLS, ROWS), 80.0, 0.12)
    views = [robots.image(ROS2, START, view, "rgb8") for view in pair()]
    for view in views:
        view.data = array.array("B", view.data.tobytes())
    return [*views, *(robots.info(ROS2, (COLS, ROWS), info) for info in infos)]


def test_a_pair_is_matched_and_published(node: Callable[..., Any]) -> None:
    made = node(preset="fast", disparity_range=COUNT)
    made._synchronizer.callback(*arrivals())
    assert not made.logged

    (message,) = made.published["disparity"]

    settings: dict[str, Any] = {"preset": "fast", "fill": False, "lr_check": 1}
    result = ps.match(*pair(), num_disparities=COUNT, **settings)
    expected = np.where(np.isnan(result.disparity), -1, result.disparity)

    values = np.frombuffer(message.image.data, "<f4").reshape(ROWS, COLS)
    np.testing.assert_array_equal(values, expected)
    assert (message.f, message.t) == (80.0, pytest.approx(0.12))
    assert (message.header.stamp.sec, message.header.frame_id) == (START // 10**9, "left_optical")

    (cloud,) = made.published["points2"]
    depth = np.frombuffer(cloud.data, "<f4").reshape(-1, 4)[:, 2]
    known = ~np.isnan(result.disparity.ravel())

    (image,) = made.published["depth"]
    np.testing.assert_array_equal(np.frombuffer(image.data, "<f4"), depth)
    (info,) = made.published["camera_info"]
    assert list(info.k) == list(np.ravel(robots.straight((COLS, ROWS), 80.0, 0.12)[0]["K"]))
    assert (len(info.d), list(info.r)) == (5, list(np.eye(3).ravel()))
    assert list(info.p)[3::4] == [0, 0, 0]
    assert info.header.frame_id == image.header.frame_id == "left_optical"

    np.testing.assert_allclose(depth[known], 9.6 / expected.ravel()[known], rtol=1e-6)
    assert np.isnan(depth[~known]).all()


def meters(message: Any) -> NDArray[np.float32]:
    assert message.encoding == "32FC1"
    return np.frombuffer(message.data, "<f4").reshape(message.height, message.width)


def test_depths_and_points_of_blocks(node: Callable[..., Any]) -> None:
    made = node(preset="fast", disparity_range=COUNT, decimate=3)
    made.match(*arrivals())
    assert not made.logged
    assert {"depth", "points2"}.isdisjoint(made.published)
    (info,), (depth,) = made.published["decimated/camera_info"], made.published["decimated/depth"]
    rig = Calibration.from_focal(80.0, 0.12, width=COLS, height=ROWS, unit="m")
    assert (info.width, info.height) == (depth.width, depth.height) == (COLS // 3, ROWS // 3)
    np.testing.assert_allclose(np.reshape(info.k, (3, 3)), rig.decimated(3).cam0)

    settings: dict[str, Any] = {"preset": "fast", "fill": False, "lr_check": 1}
    result = ps.match(*pair(), num_disparities=COUNT, **settings)
    wanted = ps.depth_interval(result.disparity, rig, uncertainty=0 * result.disparity, decimate=3)
    np.testing.assert_array_equal(meters(depth), wanted.depth)
    (cloud,) = made.published["decimated/points2"]
    assert (cloud.width, cloud.height) == (COLS // 3, ROWS // 3)
    z = np.frombuffer(cloud.data, "<f4").reshape(-1, 4)[:, 2]
    np.testing.assert_array_equal(z, meters(depth).ravel())


def test_a_third_camera_is_followed(node: Callable[..., Any]) -> None:
    made = node(preset="fast", disparity_range=COUNT, register="/color/camera_info")
    color = robots.straight((60, 40), 50.0, 0.0)[0]
    info = robots.info(ROS2, (60, 40), color, frame="color_optical")
    kinds = {topic: (kind, qos) for topic, (kind, _, qos) in made.subscribed.items()}
    assert kinds == {
        "/tf_static": ("TFMessage", (100, "transient local")),
        "/color/camera_info": ("CameraInfo", "sensor_data"),
    }
    made.match(*arrivals())  # nothing is known of it yet
    assert not made.published["registered/depth"]
    made.subscribed["/color/camera_info"][1](info)
    made.match(*arrivals())
    assert made.logged == ["register: no transforms join 'left_optical' and 'color_optical'"]
    assert len(made.published["depth"]) == 2

    vector = SimpleNamespace(x=0.03, y=0.01, z=0.0)
    turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    link = SimpleNamespace(
        header=SimpleNamespace(frame_id="left_optical"), child_frame_id="color_optical",
        transform=SimpleNamespace(translation=vector, rotation=turn),
    )  # fmt: skip
    made.subscribed["/tf_static"][1](SimpleNamespace(transforms=[link]))
    made.match(*arrivals())
    settings: dict[str, Any] = {"preset": "fast", "fill": False, "lr_check": 1}
    result = ps.match(*pair(), num_disparities=COUNT, **settings)
    third = ps.ThirdCamera(
        matrix=color["K"], rotation=np.eye(3), translation=np.array([-0.03, -0.01, 0]), width=60,
        height=40,
    )  # fmt: skip
    rig = Calibration.from_focal(80.0, 0.12, width=COLS, height=ROWS, unit="m")
    (message,), (there,) = (
        made.published[f"registered/{name}"] for name in ("depth", "camera_info")
    )
    np.testing.assert_array_equal(meters(message), ps.register(result, rig, third).depth)
    assert np.isfinite(meters(message)).mean() > 0.5
    assert message.header.frame_id == there.header.frame_id == "color_optical"
    assert (there.k[0], there.width) == (50.0, 60)
    assert {name for name, sent in made.published.items() if sent} >= {"registered/depth"}


def test_cameras_one_above_the_other_are_matched_so(node: Callable[..., Any]) -> None:
    made = node(preset="fast", disparity_range=COUNT)
    views = [np.ascontiguousarray(np.rot90(view, -1)) for view in pair()]
    images = [robots.image(ROS2, START, view, "rgb8") for view in views]
    for message in images:
        message.data = array.array("B", message.data.tobytes())
    infos = robots.straight((ROWS, COLS), 80.0, 0.0)
    infos[1]["P"][1, 3] = -80.0 * 0.12
    made.match(*images, *(robots.info(ROS2, (ROWS, COLS), info) for info in infos))
    (depth,) = made.published["depth"]
    assert np.nanmedian(meters(depth)) == pytest.approx(80 * 0.12 / 5)
    assert np.isfinite(meters(depth)).mean() > 0.7


def test_diagnostics_come_once_a_second(node: Callable[..., Any]) -> None:
    made = node(preset="fast", disparity_range=COUNT)
    for _ in range(2):
        made.match(*arrivals())
    (message,) = made.published["/diagnostics"]
    levels = {status.name: status.level for status in message.status}
    assert levels["phasestereo: alignment"] == b"\0"
    assert set(levels.values()) <= {b"\0", b"\1"}


def test_topics_are_those_of_stereo_image_proc(node: Callable[..., Any]) -> None:
    exact = node()._synchronizer

    topics = [topic for _, topic, _ in exact.views]
    assert topics == [
        "left/image_rect",
        "right/image_rect",
        "left/camera_info",
        "right/camera_info",
    ]
    assert [qos for *_, qos in exact.views] == ["sensor_data"] * 4
    assert (type(exact).__name__, exact.settings) == ("TimeSynchronizer", (5,))

    near = node(approximate_sync=True, queue_size=9, use_system_default_qos=True)._synchronizer
    assert (type(near).__name__, near.settings) == ("ApproximateTimeSynchronizer", (9, 0.01))
    assert near.views[0][2] == "system_default"


def test_its_parameters_are_settings(node: Callable[..., Any]) -> None:
    made = node(
        correlation_window_size=7, uniqueness_ratio=15.0, speckle_size=100, speckle_range=2,
        disp12_max_diff=3, min_disparity=-4, P1=8.0,
    )  # fmt: skip

    search = made._search
    chosen = search.settings
    assert (chosen.window, chosen.uniqueness, chosen.lr_check) == (7, 15, 3)
    assert (chosen.speckle_size, chosen.speckle_range, chosen.fill) == (100, 2, False)
    assert (search.low, search.count) == (-4, 64)

    assert made.logged == ["without effect here: P1"]
    assert node()._search.settings.window == ps.PRESETS["robust"].window

    with pytest.raises(ValueError, match=r"^window: got 6"):
        node(correlation_window_size=6)


def test_a_pair_that_fails_is_logged(node: Callable[..., Any]) -> None:
    made = node(preset="fast", disparity_range=COUNT)
    left, right, *infos = arrivals()
    left.data = left.data[:-1]
    made.match(left, right, *infos)
    assert made.logged == ["image: cut short, it has 18431 bytes of 18432"]
    assert not made.published["disparity"]


def test_the_package_names_what_it_has() -> None:
    described = ElementTree.parse(PACKAGE / "package.xml").getroot()  # noqa: S314 - our own file

    setup = (PACKAGE / "setup.py").read_text("utf-8")
    name = described.findtext("name")
    assert f'NAME = "{name}"' in setup
    assert f'version="{described.findtext("version")}"' in setup
    assert (PACKAGE / f"resource/{name}").is_file()
    assert (PACKAGE / "launch/phasestereo.launch.py").is_file()

    needed = {element.text for element in described.iter("exec_depend")}
    source = (PACKAGE / "phasestereo_ros/node.py").read_text("utf-8")
    for module in ("rclpy", "message_filters", "sensor_msgs", "stereo_msgs", "diagnostic_msgs"):
        assert module in needed
        assert module in source
