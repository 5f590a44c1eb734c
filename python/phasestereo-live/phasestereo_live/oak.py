"""A node of DepthAI 3 that replaces its ``StereoDepth`` and matches on the host.

stereo = pipeline.create(StereoPhase).build(left, right, calibration=calibration)
depth = stereo.depth.createOutputQueue()
"""

from __future__ import annotations

from typing import Any, Self, Unpack

import depthai as dai
import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import accept
from phasestereo.io import Calibration
from phasestereo.io.rigs.cameras import Cameras
from phasestereo.io.rigs.reading import CalibrationSource, cameras_of_files
from phasestereo.result import KEEPS, Keep, Result
from phasestereo.rigs import Rig
from phasestereo.settings import PresetName, SettingsOverrides
from phasestereo.temporal import TemporalFilter
from phasestereo_live.video.rectifying import Rectifier

__all__ = ["StereoPhase"]

SUBPIXELS = 32
"""Steps of ``disparity`` in one pixel: five fractional bits, the most that StereoDepth has."""

_TOLERANCE = 0.01  # s between the images of a pair, as in DepthAI's node Sync
_MOST = np.iinfo(np.uint16).max
_CONFIDENCE = np.iinfo(np.uint8).max
_MILLIMETERS = 1000.0  # in a meter
_FAILURES = OSError, TypeError, ValueError, MemoryError, RuntimeError
"""The errors that a match raises for a bad pair, not bugs of this module."""


class StereoPhase(dai.node.ThreadedHostNode):
    """Matches pairs of frames on the host, with the inputs and outputs of ``StereoDepth``.

    ===================  =======  ================================================================
    ``left``, ``right``  inputs   frames of 8 bits, gray or BGR
    ``disparity``        RAW16    thirty-seconds of a pixel, 0: no estimate
    ``depth``            RAW16    millimeters, 0: no depth; needs a calibration
    ``confidenceMap``    RAW8     0 to 255: the probability that a disparity is within 1 px
    ``rectifiedLeft``,   as they  the rectified frames; needs a calibration of the cameras
    ``rectifiedRight``   came
    ``syncedLeft``,      as they  the frames of the pair
    ``syncedRight``      came
    ===================  =======  ================================================================

    The node pairs frames by their time stamps, 10 ms apart at most; the outputs get the left
    frame's stamp. A `phasestereo.Rig` follows the cameras, and a `TemporalFilter` steadies the
    disparities. If a pair cannot be matched, the node logs an error and goes on to the next pair.
    """

    def __init__(self) -> None:
        super().__init__()
        self.left = self.createInput()
        self.right = self.createInput()
        self.disparity = self.createOutput()
        self.depth = self.createOutput()
        self.confidenceMap = self.createOutput()
        self.rectifiedLeft = self.createOutput()
        self.rectifiedRight = self.createOutput()
        self.syncedLeft = self.createOutput()
        self.syncedRight = self.createOutput()
        self.build()

    def build(
        self,
        left: dai.Node.Output | None = None,
        right: dai.Node.Output | None = None,
        *,
        calibration: dai.CalibrationHandler | CalibrationSource | Calibration | None = None,
        keep: Keep = "trusted",
        num_disparities: int | None = None,
        min_disparity: int = 0,
        preset: PresetName = "fast",
        threads: int | None = None,
        **overrides: Unpack[SettingsOverrides],
    ) -> Self:
        """Link cameras, and set how to match frames.

        Parameters
        ----------
        left, right
            Outputs of cameras to link to the inputs. None: the caller links them.
        calibration
            For raw frames, the device's, ``device.readCalibration()``, or any that
            `phasestereo.rectify` takes: the node rectifies the frames with it. For rectified
            frames, their `Calibration`. A baseline whose unit is not known counts as meters. None:
            frames are rectified already, and the node sends no depths.
        keep
            The disparities to send: "trusted", "checked" or "all", as in `Result.kept`.
        num_disparities, min_disparity, preset, threads, **overrides
            As in `phasestereo.Rig`.

        Returns
        -------
        StereoPhase
            The node itself.

        Raises
        ------
        TypeError, ValueError
            For a calibration of another kind, and as in `phasestereo.Rig`.
        """
        accept("keep", keep, KEEPS)

        self._given, self._rectifier = None, None
        if isinstance(calibration, Calibration):
            self._given = calibration
        elif calibration is not None:
            self._rectifier = Rectifier(_cameras(calibration), (None, None))
        self._keep: Keep = keep
        self._steady = TemporalFilter()
        self._rig = Rig(
            num_disparities=num_disparities,
            min_disparity=min_disparity,
            preset=preset,
            threads=threads,
            **overrides,
        )
        for output, own in ((left, self.left), (right, self.right)):
            if output is not None:
                output.link(own)
        return self

    @property
    def rig(self) -> Rig:
        """The rig, which learns about the cameras: events, health, the range of disparities."""
        return self._rig

    def run(self) -> None:
        """Match pairs until the pipeline ends; DepthAI calls it in a thread."""
        while self.isRunning():
            try:
                left, right = self._next_pair()
            except dai.MessageQueue.QueueException:
                return
            try:
                self._match(left, right)
            except _FAILURES as error:  # an error that left this thread would end the process
                self.error(f"frame {left.getSequenceNum()}: {error}")

    def _next_pair(self) -> tuple[dai.ImgFrame, dai.ImgFrame]:
        """Return the next two frames of the same time; skip frames without a partner."""
        left, right = self._next(self.left), self._next(self.right)
        while True:
            late = (left.getTimestamp() - right.getTimestamp()).total_seconds()
            if abs(late) <= _TOLERANCE:
                return left, right
            if late > 0:
                right = self._next(self.right)
            else:
                left = self._next(self.left)

    def _next(self, side: dai.Node.Input) -> dai.ImgFrame:
        while True:
            frame = side.get()
            if isinstance(frame, dai.ImgFrame):
                return frame
            self.error(f"got {type(frame).__name__}; accepts ImgFrame")

    def _match(self, left: dai.ImgFrame, right: dai.ImgFrame) -> None:
        self.syncedLeft.send(left)
        self.syncedRight.send(right)
        pair = _rgb(left), _rgb(right)
        masks, vertical = {}, None
        if self._rectifier is not None:
            pair = self._rectifier.pair(*pair)
            masks, vertical = self._rectifier.masks, self._rectifier.vertical
            self.rectifiedLeft.send(_frame(_bgr(pair[0]), left, left.getType()))
            self.rectifiedRight.send(_frame(_bgr(pair[1]), right, right.getType()))

        result = self._rig.match(*pair, **masks, temporal_filter=self._steady, vertical=vertical)
        self._send(result, left)

    def _send(self, result: Result, left: dai.ImgFrame) -> None:
        """Send the maps of a result, with the time of the left frame."""
        kept = result.kept(self._keep)
        shares = _words(result.disparity * SUBPIXELS, kept)
        self.disparity.send(_frame(shares, left, dai.ImgFrame.Type.RAW16))

        confidence = kept if result.confidence is None else result.confidence
        levels = np.rint(confidence * np.float32(_CONFIDENCE)).astype(np.uint8)
        self.confidenceMap.send(_frame(levels, left, dai.ImgFrame.Type.RAW8))

        found = None if self._rectifier is None else self._rectifier.found
        geometry = self._given if found is None else found.calibration
        if geometry is not None:
            depth = geometry.in_meters().depth(result.disparity) * np.float32(_MILLIMETERS)
            words = _words(depth, kept & np.isfinite(depth))
            self.depth.send(_frame(words, left, dai.ImgFrame.Type.RAW16))


def _cameras(
    calibration: dai.CalibrationHandler | CalibrationSource,
) -> CalibrationSource | Cameras:
    """Return the cameras in the form that a `Rectifier` takes."""
    if isinstance(calibration, dai.CalibrationHandler):
        return cameras_of_files([calibration.eepromToJson()], "calibration")
    return calibration


def _words(values: NDArray[np.float32], kept: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Return rounded values, 0 where the value is missing or does not fit 16 bits."""
    with np.errstate(invalid="ignore"):
        rounded = np.rint(values)
        held = kept & (rounded > 0) & (rounded <= _MOST)
    return np.where(held, rounded, 0).astype(np.uint16)


def _rgb(frame: dai.ImgFrame) -> NDArray[Any]:
    pixels: NDArray[Any] = frame.getCvFrame()
    return _bgr(pixels)


def _bgr(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image with its color channels, if it has them, in the opposite order."""
    return image if image.ndim == 2 else image[:, :, ::-1]


def _frame(image: NDArray[Any], like: dai.ImgFrame, kind: dai.ImgFrame.Type) -> dai.ImgFrame:
    """Return a frame with the time, the number and the camera of another one."""
    frame = dai.ImgFrame()
    frame.setTimestamp(like.getTimestamp())
    frame.setTimestampDevice(like.getTimestampDevice())
    frame.setSequenceNum(like.getSequenceNum())
    frame.setInstanceNum(like.getInstanceNum())
    # setCvFrame would turn 16 bits into half floats in DepthAI 3.0.
    height, width, *_ = image.shape
    frame.setType(kind)
    frame.setSize(width, height)
    frame.setStride(image.nbytes // height)
    data: Any = np.ascontiguousarray(image).view(np.uint8).ravel()
    frame.setData(data)
    return frame
