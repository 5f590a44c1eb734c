"""Every door for a path: public functions and commands that open or write what a caller names.

`found` lists them by their signatures, `DOORS` says how each is called. Run as a program, this
calls each with a file as it should be and with hostile ones, and prints a line of JSON for each
call: what was raised, seconds of the processor, and by how much resident memory grew.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import json
import os
import pkgutil
import resource
import shutil
import signal
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

import phasestereo as ps
import phasestereo_large.batch
import phasestereo_large.outofcore
import phasestereo_live.rgbd
import phasestereo_live.ros
import phasestereo_live.video
import phasestereo_live.viewer
from phasestereo import cli
from support import boards, sampled
from support.hostile import resident
from support.saved_rigs import with_raw_cameras

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

COUNT = 8
SEARCH = ("--num-disparities", str(COUNT), "--preset", "fast")
HANGING = 30.0  # seconds after which a call is interrupted, as by Ctrl-C
HOLE = 40 * 2**30  # bytes
MOST = 3 * 2**30  # bytes of addresses beyond those at the start

REFUSED = "missing", "fifo", "zero", "hole", "empty", "folder"
SPOILED = "truncated", "stretched", "mutated0", "mutated1", "mutated2"

# Annotations of parameters that are paths, or may be.
_KINDS = "StrPath", "PathLike", "Path", "ImageOrPath", "CalibrationSource", "Place"
_NOT_OPENED = {
    "phasestereo_large.batch.BatchReport", "phasestereo_large.batch.PairFiles",
    "phasestereo_large.outofcore.MapReport", "phasestereo.views.templating",
    "phasestereo_live.viewer.Display", "phasestereo_live.Stream", "phasestereo_live.Frame",
    "live --save-to", "live --preset", "live --left", "live --right", "live --camera-info",
    "live --frames", "live --register", "match --preset", "match --second", "match --device",
    "large --preset",
    "large --max-memory", "batch --preset", "batch --scheduler", "calibrate --board",
    "calibrate --charuco", "live --second",
    "rig test --preset", "rig test --limit", "rig test --wall", "asp --preset",
}  # fmt: skip
"""What holds paths, or has words of another kind."""

_REFUSING = {
    "phasestereo.rectify(others)", "rectify --images-from",
    "phasestereo_live.calibrate(left)", "phasestereo_live.calibrate(right)", "calibrate LEFT",
    "calibrate RIGHT", "rig test RIGHT", "rig test --rectify",
}  # fmt: skip
"""What opens so small a pair, and then refuses it."""


def found() -> set[str]:
    """Return the doors that signatures have: ``module.function(parameter)``, ``command option``."""
    names = {name for top in (ps, phasestereo_live, phasestereo_large) for name in _of_package(top)}
    return {name for name in names | {*_of_commands()} if not name.startswith((*_NOT_OPENED,))}


def _of_package(top: Any) -> Iterator[str]:
    modules = [top.__name__]
    modules += [one.name for one in pkgutil.walk_packages(top.__path__, f"{top.__name__}.")]
    seen: set[Any] = set()

    for module in modules:
        if ".cli" in module or module.endswith("__main__"):
            continue
        home = importlib.import_module(module)
        for name in getattr(home, "__all__", ()):
            for inner, function in _callables(name, getattr(home, name)):
                if function not in seen:
                    seen.add(function)
                    yield from (f"{module}.{inner}({one})" for one in _paths(function))


def _callables(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a function, or a class and its public methods."""
    if callable(value) and getattr(value, "__module__", "").startswith("phasestereo"):
        yield name, value
    if inspect.isclass(value):
        for method in vars(value):
            if not method.startswith("_") and inspect.isroutine(inner := getattr(value, method)):
                yield f"{name}.{method}", inner


def _paths(function: Any) -> list[str]:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    return [one.name for one in parameters if any(kind in str(one.annotation) for kind in _KINDS)]


def _of_commands() -> Iterator[str]:
    for command in cli.app:
        if not command.startswith("-") and command not in ("bench", "demo"):  # of the harness
            top = cli.app[command]
            below = {f"{command} {word}": top[word] for word in top if not word.startswith("-")}
            for words, app in (below or {command: top}).items():
                for one in app.assemble_argument_collection(parse_docstring=False):
                    if "Path" in str(one.hint) or "str" in str(one.hint):
                        yield f"{words} {one.name}"


# How each door is called


def run(*words: object) -> None:
    """Run a command; what it refuses is raised."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = cli.run([str(word) for word in words])
    if code:
        raise (ValueError if code in (1, 2, 3) else RuntimeError)(said.getvalue().strip())


def first(frames: Any) -> None:
    """Match one frame of a stream; what fails in it is raised."""
    with frames:
        next(frames, None)


def into_folder(call: Callable[[Path], Any], name: str, others: Path, path: Path) -> None:
    """Call a reader of folders with one in which a file, wherever, is that of the path."""
    folder = others.parents[1] / f"{path.stem}.of{next(_NUMBERS)}"
    shutil.copytree(others, folder)
    (folder / name).unlink()
    (folder / name).symlink_to(path)
    call(folder)


_NUMBERS = iter(range(1_000_000))


class Samples:
    """Files as they should be, in a folder; each of these is a door's, by the door's name."""

    def __init__(self, folder: Path) -> None:
        self.home = folder / "sound"
        self.home.mkdir()
        scene = np.random.default_rng(0).integers(0, 256, (48, 72), np.uint8)
        self.left, self.right = scene[:, :64].copy(), scene[:, 3:67].copy()
        self.result = ps.match(self.left, self.right, num_disparities=COUNT, preset="fast")

        self._write_images()
        self._write_geometry()
        self._write_lists()
        self._write_moving()

    def __truediv__(self, name: str) -> Path:
        return self.home / name

    def _write_images(self) -> None:
        ps.io.write_image(self / "left.png", self.left)
        ps.io.write_image(self / "right.png", self.right)
        ps.io.write_image(self / "mask.png", np.full((48, 64), 255, np.uint8))
        ps.io.write_image(self / "both.png", np.hstack([self.left, self.right]))
        ps.io.write_disparity(self / "map.pfm", self.result.disparity)
        for name, image in (("left", self.left), ("right", self.right)):
            ps.io.write_image(self / f"{name}.npy", image)
            ps.io.write_image(self / f"{name}.tif", image)
        ps.io.write_image(self / "mask.npy", np.full((48, 64), 255, np.uint8))
        zarr.create_array(self / "left.zarr", data=self.left, chunks=self.left.shape)
        for name in ("depth.npy", "depth.bin"):
            ps.io.write_depth(self / name, np.ones((48, 64), np.float32))

    def _write_geometry(self) -> None:
        camera = "[60 0 32; 0 60 24; 0 0 1]"
        lines = [f"cam0={camera}", f"cam1={camera}", "doffs=0", "baseline=9", "width=64"]
        (self / "calib.txt").write_text("\n".join([*lines, "height=48"]))
        q: list[list[float]] = [[1, 0, 0, -32], [0, 1, 0, -24], [0, 0, 0, 60], [0, 0, 1 / 9, 0]]
        np.savetxt(self / "q.txt", q)

        k, distortion = np.array([[60, 0, 32], [0, 60, 24], [0, 0, 1.0]]), np.zeros(5)
        rig = {"K1": k, "D1": distortion, "K2": k, "D2": distortion}
        rig |= {"R": np.eye(3), "T": np.array([-9.0, 0, 0])}
        np.savez(self / "rig.npz", allow_pickle=False, **rig)
        text = (f"{name}: {np.asarray(value).tolist()}" for name, value in rig.items())
        (self / "rig.yml").write_text("\n".join(text))
        ps.rectify(self.left, self.right, rig).save(self / "rectification.npz")
        learned = ps.Rig(num_disparities=COUNT)
        learned.match(self.left, self.right)
        learned.save(self / "learned.txt")
        ps.prepare(self.left, self.right).restoration.save(self / "back.json")
        # Its images need no rectification, and those of cameras that are to be exported do.
        raw = with_raw_cameras(self / "learned.txt", (48, 64))
        (self / "learned.txt").write_text(raw)

        def read(start: int, end: int) -> Any:
            return self.left[start:end], self.right[start:end], None, None

        (self / "boards").mkdir()
        for number, views in enumerate(boards.pairs(boards.chessboard(9, 6), 6)):
            for side, image in zip("LR", views, strict=True):
                ps.io.write_image(self / "boards" / f"{number}_{side}.png", image)

        gathered = phasestereo_large.pair_statistics(read, (48, 64), num_disparities=COUNT)
        gathered.save(self / "statistics.npz")

    def _write_lists(self) -> None:
        (self / "pairs.csv").write_text("left,right\nleft.png,right.png\n")
        pairs = phasestereo_large.batch.read_pairs(self / "pairs.csv", num_disparities=COUNT)
        report = phasestereo_large.batch.run(pairs, self / "batch", workers=1, preset="fast")
        shutil.copy(report.manifest, self / "manifest.jsonl")
        (self / "tls.pem").write_text("-----BEGIN CERTIFICATE-----")

    def _write_moving(self) -> None:
        from phasestereo_live.ros.images import encode_image  # noqa: PLC0415 - with what it needs

        with phasestereo_live.video.VideoWriter(self / "video.mkv") as video:
            for _ in range(2):
                video.write(np.dstack([np.hstack([self.left, self.right])] * 3))

        for name in ("bag.mcap", "bag.bag", "bag.db3"):
            with phasestereo_live.ros.RecordingWriter(self / name) as bag:
                stamp = bag.make("builtin_interfaces/msg/Time", sec=1, nanosec=0)
                header = bag.make("std_msgs/msg/Header", stamp=stamp, frame_id="")
                for topic, image in (("/left", self.left), ("/right", self.right)):
                    fields = encode_image(image)
                    message = bag.make("sensor_msgs/msg/Image", header=header, **fields)
                    bag.write(topic, 10**9, message)


def doors(of: Samples) -> dict[str, list[tuple[str, Callable[[Path], Any]]]]:  # noqa: PLR0915 -- a table
    """Return of each door the names of a sample and how a path is handed over; "" is written."""
    search: dict[str, Any] = {"num_disparities": COUNT, "preset": "fast"}
    left, right = of / "left.png", of / "right.png"
    rig: dict[str, Any] = dict(np.load(of / "rig.npz"))
    apply = ps.Rectification.load(of / "rectification.npz").apply
    large, batch, live = phasestereo_large.outofcore, phasestereo_large.batch, phasestereo_live
    calibrations = "rig.npz", "rig.yml", "rectification.npz"
    table: dict[str, list[tuple[str, Callable[[Path], Any]]]] = {}

    def add(name: str, samples: str, call: Callable[[Path], Any]) -> None:
        table.setdefault(name, []).extend((sample, call) for sample in samples.split())

    pairs: dict[str, Callable[..., Any]] = {
        "Matcher.match": partial(ps.Matcher(preset="fast").match, num_disparities=COUNT),
        "Rectification.apply": apply,
        "Rig.match": ps.Rig(num_disparities=COUNT, preset="fast").match,
        "check": ps.check,
        "estimate_blur": ps.estimate_blur,
        "match": partial(ps.match, **search),
        "prepare": partial(ps.prepare, num_disparities=COUNT),
        "rectify": lambda a, b: ps.rectify(a, b, rig),
        "verify": lambda a, b: ps.verify(a, b, of.result.disparity),
    }
    for name, call in pairs.items():
        add(f"phasestereo.{name}(left)", "left.png", partial(_first, call, right))
        add(f"phasestereo.{name}(right)", "right.png", partial(_second, call, left))
    for sample in calibrations:
        add("phasestereo.rectify(calibration)", sample, lambda p: ps.rectify(left, right, p))
    add("phasestereo.rectify(others)", "left.png",
        lambda p: ps.rectify(left, right, others=[(p, right)]))  # fmt: skip
    add("phasestereo_live.calibrate(left)", "video.mkv", live.calibrate)
    add("phasestereo_live.calibrate(right)", "video.mkv", partial(live.calibrate, of / "video.mkv"))
    add("phasestereo.ThirdCamera.of_pair(calibration)", "rig.npz rig.yml",
        partial(ps.ThirdCamera.of_pair, size=(64, 48)))  # fmt: skip
    add("phasestereo.Rectification.load(path)", "rectification.npz", ps.Rectification.load)
    add("phasestereo.Restoration.load(path)", "back.json", ps.Restoration.load)
    add("phasestereo.Restoration.save(path)", ">a.json",
        ps.Restoration.load(of / "back.json").save)  # fmt: skip
    add("phasestereo.Rig.load(path)", "learned.txt", ps.Rig.load)
    add("phasestereo.Rig.save(path)", ">a.txt", ps.Rig.load(of / "learned.txt").save)
    add("phasestereo.Rig.export(path)", ">a.yaml", ps.Rig.load(of / "learned.txt").export)

    readers = {"calibration": "calib.txt", "depth": "depth.npy depth.bin", "disparity": "map.pfm"}
    readers |= {"image": "left.png map.pfm depth.npy", "pfm": "map.pfm"}
    for name, sample in readers.items():
        add(f"phasestereo.io.read_{name}(path)", sample, getattr(ps.io, f"read_{name}"))
    add("phasestereo.io.read_truth(path)", "left.png", partial(ps.io.read_truth, scale=1))
    add("phasestereo.io.read_pair(path)", "both.png",
        partial(ps.io.read_pair, layout="side-by-side"))  # fmt: skip

    cloud = ps.point_cloud(of.result, ps.io.read_calibration(of / "calib.txt"), image=of.left)
    mesh = ps.surface_mesh(of.result, ps.io.read_calibration(of / "calib.txt"), image=of.left)
    flat = of.result.disparity
    add("phasestereo.io.write_depth(path)", ">a.npy", lambda p: ps.io.write_depth(p, flat))
    add("phasestereo.io.write_disparity(path)", ">a.npy", lambda p: ps.io.write_disparity(p, flat))
    add("phasestereo.io.write_glb(path)", ">a.glb", lambda p: ps.io.write_glb(p, mesh))
    add("phasestereo.io.write_image(path)", ">a.png", lambda p: ps.io.write_image(p, of.left))
    add("phasestereo.io.write_maps(path)", ">a.npz", lambda p: ps.io.write_maps(p, of.result.maps))
    add("phasestereo.io.write_pfm(path)", ">a.pfm", lambda p: ps.io.write_pfm(p, flat))
    add("phasestereo.io.write_ply(path)", ">a.ply", lambda p: ps.io.write_ply(p, cloud))
    saved = ps.Rectification.load(of / "rectification.npz")
    add("phasestereo.Rectification.save(path)", ">a.npz", saved.save)
    write_page = importlib.import_module("phasestereo.views.page").write_pair_page
    add("phasestereo.views.page.write_pair_page(path)", ">a.html",
        lambda p: write_page(p, of.left, of.right, of.result))  # fmt: skip

    calibrated = calibration(rig)
    add("phasestereo_live.StereoCalibration.save(path)", ">a.yaml", calibrated.save)
    write_calibration = importlib.import_module("phasestereo_live.calibration.page")
    add("phasestereo_live.calibration.page.write_calibration_page(path)", ">a.html",
        lambda p: write_calibration.write_calibration_page(p, calibrated))  # fmt: skip

    add("phasestereo_live.stream(source)", "video.mkv", lambda p: first(live.stream(p, **search)))
    add("phasestereo_live.stream(right)", "video.mkv",
        lambda p: first(live.stream(of / "video.mkv", p, **search)))  # fmt: skip
    add("phasestereo_live.oak.StereoPhase.build(calibration)", "rig.npz", oak_calibration)
    add("phasestereo_live.stream(rectify)", "rig.npz", lambda p: first(
        live.stream(of / "video.mkv", rectify=p, **search)))  # fmt: skip
    opened = partial(_close, live.ros.open_recording, left="/left", right="/right")
    add("phasestereo_live.ros.open_recording(path)", "bag.mcap bag.bag bag.db3/bag.db3", opened)
    add("phasestereo_live.ros.open_recording(path)", "bag.db3/metadata.yaml",
        partial(into_folder, opened, "metadata.yaml", of / "bag.db3"))  # fmt: skip
    add("phasestereo_live.ros.open_recording(path)", "bag.db3/bag.db3",
        partial(into_folder, opened, "bag.db3", of / "bag.db3"))  # fmt: skip
    add("phasestereo_live.rgbd.RgbdWriter(folder)", ">a", live.rgbd.RgbdWriter)
    add("phasestereo_live.ros.RecordingWriter(path)", ">a.mcap", live.ros.RecordingWriter)
    add("phasestereo_live.video.VideoWriter(path)", ">a.mkv", live.video.VideoWriter)
    saving = importlib.import_module("phasestereo_live.rerun").saving
    add("phasestereo_live.rerun.saving(path)", ">a.rrd", lambda p: saving(p).__enter__())
    with live.viewer.Server(live.viewer.Display(ps.PRESETS["fast"], COUNT, of.home)) as server:
        add("phasestereo_live.viewer.Server.write_link(path)", ">a.html", server.write_link)

    statistics = phasestereo_large.bands.load(of / "statistics.npz")
    add("phasestereo_large.PairStatistics.save(path)", ">a.npz", statistics.save)
    add("phasestereo_large.bands.load(path)", "statistics.npz", phasestereo_large.bands.load)
    add("phasestereo_large.batch.read_manifest(path)", "manifest.jsonl", batch.read_manifest)
    add("phasestereo_large.batch.read_pairs(source)", "pairs.csv", batch.read_pairs)
    add("phasestereo_large.batch.run(folder)", ">a", lambda p: batch.run([], p))
    for name in ("ca", "cert", "key"):
        rest = dict.fromkeys(("ca", "cert", "key"), of / "tls.pem")
        add(f"phasestereo_large.batch.encryption({name})", "tls.pem",
            partial(_keyword, batch.encryption, rest, name))  # fmt: skip

    given = {
        "left": of / "left.npy",
        "right": of / "right.npy",
        "output": of / "o.npy",
        **search,
        "max_memory": "1GB",
    }
    for name in ("zarr.json", "c/0/0"):
        add("phasestereo_large.outofcore.match(left)", f"left.zarr/{name}",
            partial(into_folder, partial(_keyword, large.match, given, "left"), name,
                    of / "left.zarr"))  # fmt: skip

    for name, sample in {
        "left": "left.npy left.tif", "right": "right.npy right.tif", "left_mask": "mask.npy",
        "right_mask": "mask.npy", "output": ">a.npy", "flags_output": ">a.npy",
        "confidence_output": ">a.npy", "uncertainty_output": ">a.npy",
    }.items():  # fmt: skip
        more = {"confidence": True} if name[:4] in ("conf", "unce") else {}
        add(f"phasestereo_large.outofcore.match({name})", sample,
            partial(_keyword, large.match, given | more, name))  # fmt: skip

    _add_commands(add, of)
    return table


def calibration(rig: dict[str, Any]) -> phasestereo_live.StereoCalibration:
    """Return a calibration that has been made of one view."""
    corners = np.ones((4, 2))
    view = phasestereo_live.calibration.BoardView(
        names=("", ""), ids=np.arange(4), left=corners, right=corners, used=True, error=1.0
    )
    cells = np.zeros((6, 8), np.int64)
    shaped = rig | {"D1": rig["D1"].reshape(1, -1), "D2": rig["D2"].reshape(1, -1)}
    return phasestereo_live.StereoCalibration(
        **shaped | {"T": rig["T"].reshape(3, 1)}, size=(64, 48), unit="m", board="",
        views=(view,), error=1.0, rows=1.0, held_out=None, covariance=1e-6 * np.eye(24),
        coverage=(cells, cells), advice=(),
    )  # fmt: skip


def _add_commands(add: Callable[..., None], of: Samples) -> None:
    """Add the commands' options: what is written begins with ``>``."""
    left, right, calib = of / "left.png", of / "right.png", of / "calib.txt"
    pair = left, right, "--json", *SEARCH
    sure, known = (*pair, "--confidence"), ("--json", "--calibration", of / "rig.npz")
    memory = "--max-memory", "1GB", *SEARCH
    big = of / "left.npy", of / "right.npy", *memory
    out = "-o", of / "o.npy"
    asp = "asp", "-r", -COUNT, "-R", 0, "--preset", "fast"
    loose = [word for name in ("rows", "error", "wrong") for word in ("--limit", f"{name}=99")]

    lines: dict[str, tuple[str, tuple[object, ...]]] = {
        "match LEFT": ("left.png", ("match", ..., right, "--json", *SEARCH)),
        "match RIGHT": ("right.png", ("match", left, ..., "--json", *SEARCH)),
        "match --rectify": ("rig.npz", ("match", *pair, "--rectify", ...)),
        "match --left-mask": ("mask.png", ("match", *pair, "--left-mask", ...)),
        "match --right-mask": ("mask.png", ("match", *pair, "--right-mask", ...)),
        "match --output": (">a.npy", ("match", *pair, "-o", ...)),
        "match --flags-output": (">a.npy", ("match", *pair, "--flags-output", ...)),
        "match --confidence-output": (">a.npy", ("match", *sure, "--confidence-output", ...)),
        "match --uncertainty-output": (">a.npy", ("match", *sure, "--uncertainty-output", ...)),
        "match --color": (">a.png", ("match", *pair, "--color", ...)),
        "match --ply": (">a.ply", ("match", *pair, "--calib", calib, "--ply", ...)),
        "match --mesh": (">a.glb", ("match", *pair, "--calib", calib, "--mesh", ...)),
        "match --depth": (">a.npy", ("match", *pair, "--calib", calib, "--depth", ...)),
        "match --report": (">a.html", ("match", *pair, "--report", ...)),
        "match --calib": ("calib.txt q.txt", (
            "match", *pair, "--depth", of / "d.npy", "--calib", ...,
        )),
        "match --register": ("rig.npz", (
            "match", *pair, "--depth", of / "d.npy", "--calib", calib, "--register-size", "64,48",
            "--register", ...,
        )),
        "match --truth": ("map.pfm", ("match", *pair, "--truth", ...)),
        "match --truth-mask": (
            "mask.png", ("match", *pair, "--truth", of / "map.pfm", "--truth-mask", ...)
        ),
        "check LEFT": ("left.png", ("check", ..., right)),
        "check RIGHT": ("right.png", ("check", left, ...)),
        "check --blur-map": (">a.png", ("check", left, right, "--blur-map", ...)),
        "verify LEFT": ("left.png", ("verify", ..., right, of / "map.pfm")),
        "verify RIGHT": ("right.png", ("verify", left, ..., of / "map.pfm")),
        "verify DISPARITY": ("map.pfm", ("verify", left, right, ...)),
        "verify --picture": (">a.png", ("verify", left, right, of / "map.pfm", "--picture", ...)),
        "verify --better": (">a.npy", ("verify", left, right, of / "map.pfm", "--better", ...)),
        "verify --verdict": (">a.png", ("verify", left, right, of / "map.pfm", "--verdict", ...)),
        "prepare LEFT": ("left.png", ("prepare", ..., right, "--json")),
        "prepare RIGHT": ("right.png", ("prepare", left, ..., "--json")),
        "prepare --output": (">a.png", ("prepare", left, right, "-o", ..., of / "r.png")),
        "prepare --back": (">a.json", ("prepare", left, right, "--back", ...)),
        "restore DISPARITY": (
            "map.pfm", ("restore", ..., "--back", of / "back.json", "-o", of / "d.npy")
        ),
        "restore --back": (
            "back.json", ("restore", of / "map.pfm", "--back", ..., "-o", of / "d.npy")
        ),
        "restore --output": (
            ">a.npy", ("restore", of / "map.pfm", "--back", of / "back.json", "-o", ...)
        ),
        "rectify LEFT": ("left.png", ("rectify", ..., right, *known)),
        "rectify RIGHT": ("right.png", ("rectify", left, ..., *known)),
        "rectify --calibration": ("rig.npz rig.yml", ("rectify", left, right, *known[:2], ...)),
        "rectify --images-from": (
            "left.png", ("rectify", left, right, "--json", "--images-from", ..., right)
        ),
        "rectify --output": (
            ">a.png", ("rectify", left, right, *known, "-o", ..., of / "r.png")
        ),
        "rectify --masks": (
            ">a.png",
            ("rectify", left, right, "--calibration", of / "rig.npz", "-o", of / "l.png",
             of / "r.png", "--masks", ..., of / "m.png"),
        ),
        "rectify --save": (">a.npz", ("rectify", left, right, *known, "--save", ...)),
        "calibrate LEFT": ("video.mkv", ("calibrate", ...)),
        "calibrate RIGHT": ("video.mkv", ("calibrate", of / "video.mkv", ...)),
        "calibrate --output": (">a.yaml", ("calibrate", of / "boards", "-o", ...)),
        "calibrate --page": (">a.html", ("calibrate", of / "boards", "--page", ...)),
        "try --output": (">a.html", ("try", "--no-show", "-o", ...)),
        "rig test FRAMES": ("learned.txt", ("rig", "test", ..., *loose)),
        "rig test RIGHT": ("learned.txt", ("rig", "test", of / "boards", ...)),
        "rig test --rectify": ("learned.txt", ("rig", "test", of / "boards", "--rectify", ...)),
        "rig test --save": (">a.txt", ("rig", "test", of / "learned.txt", *loose, "--save", ...)),
        "live SOURCE": ("video.mkv bag.mcap bag.bag", ("live", ..., "--json", *SEARCH)),
        "live RIGHT": ("video.mkv", ("live", of / "video.mkv", ..., "--json", *SEARCH)),
        "live --rectify": (
            "rig.npz", ("live", of / "video.mkv", "--json", "--rectify", ..., *SEARCH)
        ),
        "live --output": (">a.mkv", ("live", of / "video.mkv", "-o", ..., *SEARCH)),
        "live --rerun": (">a.rrd", ("live", of / "video.mkv", "--rerun", ..., *SEARCH)),
        "live --rgbd": (
            ">a", ("live", of / "video.mkv", "--calib", calib, "--rgbd", ..., *SEARCH)
        ),
        "live --calib": (
            "calib.txt",
            ("live", of / "video.mkv", "--rerun", of / "o.rrd", "--calib", ..., *SEARCH),
        ),
        "batch SOURCE": ("pairs.csv", ("batch", ..., "-o", of / "batch", *SEARCH)),
        "batch --output": (">a", ("batch", of / "pairs.csv", "-o", ..., *SEARCH)),
        **{
            f"batch --tls-{name}": ("tls.pem", (
                "batch", of / "pairs.csv", "-o", of / "batch", "--scheduler", "tls://127.0.0.1:9",
                *(word for other in ("ca", "cert", "key") for word in
                  (f"--tls-{other}", ... if other == name else of / "tls.pem")), *SEARCH,
            ))
            for name in ("ca", "cert", "key")
        },
        "asp LEFT": ("left.tif", (*asp, ..., of / "right.tif", of / "asp.tif")),
        "asp RIGHT": ("right.tif", (*asp, of / "left.tif", ..., of / "asp.tif")),
        "asp OUTPUT": (">a.tif", (*asp, of / "left.tif", of / "right.tif", ...)),
        "large LEFT": ("left.npy", ("large", ..., of / "right.npy", *out, *memory)),
        "large RIGHT": ("right.npy", ("large", of / "left.npy", ..., *out, *memory)),
        "large --output": (">a.npy", ("large", *big, "-o", ...)),
        "large --flags-output": (">a.npy", ("large", *big, *out, "--flags-output", ...)),
        "large --confidence-output": (
            ">a.npy", ("large", *big, *out, "--confidence", "--confidence-output", ...)
        ),
        "large --uncertainty-output": (
            ">a.npy", ("large", *big, *out, "--confidence", "--uncertainty-output", ...)
        ),
        "large --left-mask": ("mask.npy", ("large", *big, *out, "--left-mask", ...)),
        "large --right-mask": ("mask.npy", ("large", *big, *out, "--right-mask", ...)),
    }  # fmt: skip

    for name, (samples, words) in lines.items():
        add(name, samples, partial(_command, words))


def _first(call: Callable[..., Any], other: Path, path: Path) -> Any:
    return call(path, other)


def _second(call: Callable[..., Any], other: Path, path: Path) -> Any:
    return call(other, path)


def _keyword(call: Callable[..., Any], others: dict[str, Any], name: str, path: Path) -> Any:
    return call(**(others | {name: path}))


def _close(call: Callable[..., Any], path: Path, **more: Any) -> None:
    source = call(path, **more)
    for capture in source.captures:
        capture.take()
    source.close()


def oak_calibration(path: Path) -> None:
    """Give a calibration to a node without a device."""
    import depthai as dai  # noqa: PLC0415 - it prints as it is loaded

    from phasestereo_live.oak import StereoPhase  # noqa: PLC0415

    with dai.Pipeline(createImplicitDevice=False) as pipeline:
        pipeline.create(StereoPhase).build(calibration=path)


def _command(words: tuple[object, ...], path: Path) -> None:
    topics = ("--left", "/left", "--right", "/right") if path.suffix in (".mcap", ".bag") else ()
    run(*(path if word is ... else word for word in words), *topics)


# Hostile files


def spoil(kind: str, path: Path, content: bytes) -> None:
    """Make a file of a hostile kind; content is what it should have."""
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "zero":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes(_spoiled(kind, content))
    if kind in ("hole", "stretched"):
        os.truncate(path, HOLE)


def _spoiled(kind: str, content: bytes) -> bytes:
    if kind == "truncated":
        return content[: len(content) // 2]
    if kind == "stretched":
        return content
    if not kind.startswith("mutated"):
        return b""

    random = np.random.default_rng(int(kind.removeprefix("mutated")))
    changed = bytearray(content)
    for place in random.integers(0, len(content), max(4, len(content) // 100)):
        changed[place] = random.integers(0, 256)
    return bytes(changed)


def kinds_of(sample: str) -> tuple[str, ...]:
    """Return the arguments to try a door with; old files are replaced."""
    if sample.startswith(">"):
        return ("fifo", "zero", "folder") if Path(sample).suffix else ("fifo", "zero", "empty")
    # Of a video that is cut short there is what there is; FFmpeg looks for more in what follows.
    return REFUSED + (SPOILED[2:] if sample.endswith(".mkv") else SPOILED)


def _interrupted(*_: object) -> None:
    raise KeyboardInterrupt(f"hangs for {HANGING} s")


def outcome(call: Callable[[Path], Any], path: Path) -> dict[str, Any]:
    """Return the outcome of a call."""
    Path("/proc/self/clear_refs").write_text("5", "ascii")  # the most is that from now on
    before, started = resident("VmRSS"), time.process_time()
    raised, refused = "", True
    signal.setitimer(signal.ITIMER_REAL, HANGING)
    try:
        call(path)
    except BaseException as error:  # noqa: BLE001 -- whatever it is, it is recorded
        raised = f"{type(error).__name__}: {error}"
        refused = isinstance(error, OSError | ValueError)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)

    seconds, grown = time.process_time() - started, resident("VmHWM") - before
    return {"raised": raised[:2000], "refused": refused, "seconds": seconds, "bytes": grown}


def main(folder: Path) -> None:
    """Try each door, and say what came of it."""
    os.chdir(folder)
    samples = Samples(folder)
    addresses = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (addresses + MOST, -1))
    signal.signal(signal.SIGALRM, _interrupted)

    table, signed = doors(samples), found()
    listed = {"unlisted": sorted(signed - {*table}), "gone": sorted({*table} - signed)}
    print(json.dumps(listed), flush=True)  # noqa: T201

    every = [(door, each) for door, ways in table.items() for each in ways]
    for number, (door, (sample, call)) in enumerate(sampled(every)):
        name = Path(sample.removeprefix(">"))
        sound = samples / sample if sample[0] != ">" else folder / f"sound{number}{name.suffix}"
        tried = [("sound", sound)] if door not in _REFUSING else []
        for kind in kinds_of(sample) if tried else REFUSED:
            path = folder / f"{kind}-{number}{name.suffix}"
            spoil(kind, path, b"" if sample[0] == ">" else sound.read_bytes())
            tried.append((kind, path))

        for kind, path in tried:
            is_fill = kind == "missing" and sample.endswith("/c/0/0")  # as Zarr has it
            must = kind in REFUSED and not is_fill
            came = {"door": door, "kind": kind, "file": path.name, "must": must}
            came |= outcome(call, path)
            print(json.dumps(came), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]))
