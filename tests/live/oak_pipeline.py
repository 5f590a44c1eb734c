"""Pipelines of DepthAI without a device, in a process of their own; what came out as JSON."""

from __future__ import annotations

import json
import sys
from datetime import timedelta
from typing import Any

import depthai as dai
import numpy as np
from numpy.typing import NDArray

from phasestereo.io import Calibration
from phasestereo_live.oak import StereoPhase

HEIGHT, WIDTH, SHIFT = 96, 200, 20
LEFT, RIGHT = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
RATE = 30
PATIENCE = timedelta(seconds=60)


def texture(number: int, channels: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(number)
    return rng.integers(0, 256, (HEIGHT, WIDTH + SHIFT, channels), np.uint8).squeeze()


class Host:
    """A pipeline of one node, and its queues."""

    def __init__(self, names: list[str], **options: Any) -> None:
        self.pipeline = dai.Pipeline(createImplicitDevice=False)
        self.node = self.pipeline.create(StereoPhase).build(num_disparities=40, **options)
        self.inputs = [side.createInputQueue() for side in (self.node.left, self.node.right)]
        self.outputs = {name: getattr(self.node, name).createOutputQueue() for name in names}

    def send(self, side: int, image: NDArray[np.uint8], number: int, late: float = 0) -> None:
        kinds = {2: dai.ImgFrame.Type.GRAY8, 3: dai.ImgFrame.Type.BGR888i}
        frame = dai.ImgFrame()
        frame.setCvFrame(np.ascontiguousarray(image), kinds[image.ndim])
        frame.setSequenceNum(number)
        frame.setInstanceNum(int((LEFT, RIGHT)[side].value))
        frame.setTimestamp(timedelta(seconds=number / RATE + late))
        self.inputs[side].send(frame)

    def send_pair(self, number: int, late: float = 0, channels: int = 1) -> None:
        wide = texture(number, channels)
        self.send(0, wide[:, :WIDTH], number)
        self.send(1, wide[:, SHIFT:], number, late)

    def get(self) -> dict[str, Any]:
        found = {name: queue.get(PATIENCE) for name, queue in self.outputs.items()}
        return {
            name: {
                "number": frame.getSequenceNum(),
                "seconds": frame.getTimestamp().total_seconds(),
                "socket": frame.getInstanceNum(),
                "type": frame.getType().name,
                "size": [frame.getHeight(), frame.getWidth()],
                "median": float(np.median(frame.getCvFrame()[20:-20, 60:-20])),
                "none": float(np.mean(frame.getFrame()[:, 40:] == 0)),
            }
            for name, frame in found.items()
        }

    def close(self) -> None:
        self.pipeline.stop()
        self.pipeline.wait()


def frames() -> dict[str, Any]:
    """Match 200 frames; a right one is lost, and another left one."""
    calibration = Calibration.from_focal(400, 5, width=WIDTH, height=HEIGHT, unit="cm")
    names = ["disparity", "depth", "confidenceMap", "syncedLeft", "syncedRight"]
    host = Host(names, calibration=calibration)
    host.pipeline.start()
    seen = []
    for number in range(200):
        wide = texture(number, 1)
        if number != 60:
            host.send(0, wide[:, :WIDTH], number)
        if number != 50:
            host.send(1, wide[:, SHIFT:], number, late=0.004)
        if number not in (50, 60):
            seen.append(host.get())
    host.close()
    return {"seen": seen, "frames": host.node.rig.frames, "events": len(host.node.rig.events)}


def raw() -> dict[str, Any]:
    """Rectify color frames by the calibration of a device: the right camera is turned by 0.01."""
    cos, sin = np.cos(0.01), np.sin(0.01)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])  # about the optical axis
    handler = dai.CalibrationHandler()
    # Of images of twice the size, of which the frames are a half.
    intrinsics: list[list[float]] = [[800, 0, WIDTH - 0.5], [0, 800, HEIGHT - 0.5], [0, 0, 1]]
    for socket in (LEFT, RIGHT):
        handler.setCameraIntrinsics(socket, intrinsics, dai.Size2f(2 * WIDTH, 2 * HEIGHT))
        handler.setDistortionCoefficients(socket, [0.0] * 14)
    handler.setCameraExtrinsics(LEFT, RIGHT, turn.tolist(), (turn @ [-5.0, 0, 0]).tolist())
    handler.setStereoLeft(LEFT, np.eye(3).tolist())
    handler.setStereoRight(RIGHT, np.eye(3).tolist())

    # What the turned camera sees of the plane at 1000 mm, whose texture has no more than 20 px.
    host = Host(["disparity", "depth", "rectifiedRight"], calibration=handler, keep="all")
    host.pipeline.start()
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    u, v = x - (WIDTH - 1) / 2, y - (HEIGHT - 1) / 2
    images = []
    for side in (0, 1):
        a = u if side == 0 else cos * u + sin * v + SHIFT
        b = v if side == 0 else -sin * u + cos * v
        waves = np.random.default_rng(0).uniform([0.1, 0, 0], [1, 6.3, 6.3], (30, 3))
        gray = sum(np.cos(f * (a * np.cos(t) + b * np.sin(t)) + p) for f, t, p in waves)
        images.append(
            np.repeat(np.clip(128 + 16 * gray, 0, 255)[:, :, None], 3, 2).astype(np.uint8)
        )
    for side in (0, 1):
        host.send(side, images[side], 0)
    seen = host.get()
    host.close()
    return {"seen": seen}


def failures() -> dict[str, Any]:
    """Go on after a pair that cannot be matched."""
    host = Host(["disparity"])
    host.pipeline.start()
    host.send(0, texture(0, 1)[:, :WIDTH], 0)
    host.send(1, texture(0, 1)[:1, :1], 0)
    host.send_pair(1, channels=3)
    seen = host.get()
    host.close()
    refused = []
    for options in ({"calibration": 3}, {"keep": "most"}, {"preset": "best"}):
        try:
            host.node.build(**options)
        except (TypeError, ValueError) as error:
            refused.append(str(error))
    return {"seen": seen, "refused": refused}


if __name__ == "__main__":
    job = {"frames": frames, "raw": raw, "failures": failures}[sys.argv[1]]
    print(f"\n{json.dumps(job())}")  # noqa: T201 -- what the test reads
