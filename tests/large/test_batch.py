"""Batches of pairs: real worker processes, real kills, and what is found when a run goes on."""

from __future__ import annotations

import errno
import gc
import json
import logging
import os
import pickle
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import read_disparity, read_image, write_image
from phasestereo.result import LAYERS
from phasestereo_large.batch import (
    PairFiles,
    Record,
    read_manifest,
    read_pairs,
    run,
    running as running_module,
)
from phasestereo_large.batch.cluster import share
from phasestereo_large.batch.manifest import Manifest
from phasestereo_large.batch.work import FullDiskError, Order, match_files
from phasestereo_large.geotiff import Georeference, read_geotiff, write_geotiff
from support import ENVIRONMENT, counterpart
from support.batch_tasks import sleepily

distributed = counterpart("distributed")
counterpart("filelock")
cli = counterpart("phasestereo.cli")

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support import Run

pytestmark = [
    # Sockets and pipes of worker processes are closed some time after these have ended.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

COUNT = 32
FAST = {"preset": "fast", "num_disparities": COUNT}


def scene(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return two views of noise, of which a part is nearer than the rest."""
    noise = np.random.default_rng(seed).integers(0, 256, (60, 130, 3), dtype=np.uint8)
    left, right = noise[:, 30:120], noise[:, 34:124].copy()
    right[20:40, 10:50] = left[20:40, 22 + seed : 62 + seed]
    return left, right


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of six pairs, left0.png and right0.png and so on."""
    folder = tmp_path_factory.mktemp("images")
    for seed in range(6):
        for side, image in zip(("left", "right"), scene(seed), strict=True):
            write_image(folder / f"{side}{seed}.png", image)
    return folder


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Return a cluster of two worker processes of one thread each."""
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster


@pytest.fixture
def pairs(images: Path) -> list[PairFiles]:
    return read_pairs(images, num_disparities=COUNT)


@pytest.fixture
def matching(cluster: Any) -> Callable[..., Any]:
    """Return a function that runs a batch on the cluster."""

    def matching(pairs: list[PairFiles], folder: Path, **options: Any) -> Any:
        options = {"preset": "fast", "scheduler": cluster.scheduler_address} | options
        return run(pairs, folder, **options)

    return matching


def expected(pair: PairFiles, **options: Any) -> np.ndarray:
    images = read_image(pair.left), read_image(pair.right)
    return ps.match(*images, num_disparities=COUNT, **({"preset": "fast"} | options)).disparity


def assert_all_there(pairs: list[PairFiles], folder: Path, suffix: str = ".tif") -> None:
    for pair in pairs:
        found = read_disparity(folder / f"{pair.name}{suffix}")
        np.testing.assert_array_equal(found, expected(pair))


def states(folder: Path) -> dict[str, str]:
    return {name: each.state for name, each in read_manifest(folder / "manifest.jsonl").items()}


# Lists and folders


def save_list(folder: Path, text: str) -> Path:
    path = folder / "pairs.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_list_says_all_that_can_be_said_of_a_pair(tmp_path: Path) -> None:
    path = save_list(
        tmp_path,
        "left, right, name, num_disparities, min_disparity, left_mask, right_mask\n"
        "a/1.png, b/1.png, first, 64, -8, masks/1.png,\n"
        f"a/2.png, {tmp_path}/b/2.png,,,,,\n",
    )

    first, second = read_pairs(path, num_disparities=16, min_disparity=2)

    assert first == PairFiles(
        name="first",
        left=tmp_path / "a/1.png",
        right=tmp_path / "b/1.png",
        num_disparities=64,
        min_disparity=-8,
        left_mask=tmp_path / "masks/1.png",
    )

    assert (second.name, second.num_disparities, second.min_disparity) == ("2", 16, 2)
    assert second.right == tmp_path / "b/2.png"
    assert second.files == [tmp_path / "a/2.png", tmp_path / "b/2.png"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "got columns none; accepts left and right"),
        ("left,right\n", "there is no pair in it"),
        ("left,wrong\na,b\n", "got columns 'left', 'wrong'; accepts left and right"),
        ("left;right\na;b\n", "got columns 'left;right'; accepts left and .* with commas between"),
        ("left,right,left\na,b,c\n", "got columns 'left', 'right', 'left'; accepts"),
        ("left,right\na,b,c\n", "line 2: got 3 fields; accepts 2"),
        ("left,right\na\n", "line 2: got 1 fields; accepts 2"),
        ("left,right\na,\n", "line 2: right is missing"),
        ("left,right,num_disparities\na,b,1\nc,d,many\n", "line 3: 'num_disparities': got 'many'"),
        (
            "left,right,min_disparity\na,b,1.5\n",
            "line 2: 'min_disparity': got '1.5'; accepts an int",
        ),
        ("left,right\nx/im0.png,b\ny/im0.png,c\n", "got name 'im0' for .*y/im0.png and for .*x/im"),
        ("left,right,name\na,b,A\nc,d,a\n", "got name 'a' for"),
        ("left,right,name\na,b,../a\n", "got name '../a'; accepts the name of a file"),
        ("left,right,name\na,b,.a\n", "got name '.a'; accepts the name of a file"),
        ('left,right,name\na,b,"a\nb"\n', "got name 'a.nb'; accepts the name of a file"),
        ("left,right,name\na,b,a\0b\n", "got name 'a.x00b'; accepts the name of a file"),
        (f"left,right,name\na,b,{'a' * 201}\n", "accepts the name of a file .* 200 bytes"),
        (
            "left,right,name\na,b,one.Flags\nc,d,One\n",
            "got name 'one.Flags', as the flags of another pair are called",
        ),
        ('left,right\n"a,b\n', "not a list in CSV"),
        ("left,right\n\xe9,b\n", "not a list in CSV and UTF-8"),
    ],
)
def test_a_list_that_is_wrong_is_named_by_its_line(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ValueError, match=message):
        read_pairs(path, num_disparities=8)


def test_a_folder_without_pairs_is_answered_by_what_a_batch_takes(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    with pytest.raises(ValueError, match=r"nor images named left.*; list the pairs in a CSV file"):
        read_pairs(tmp_path)


def test_a_list_as_spreadsheets_and_people_write_it(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    path.write_bytes(b"\xef\xbb\xbf\r\nleft , right \r\n\r\na.png,b.png\r\n\r\n")
    (pair,) = read_pairs(path, num_disparities=16)
    assert (pair.left, pair.right) == (tmp_path / "a.png", tmp_path / "b.png")


def test_nobody_need_say_how_many_disparities(tmp_path: Path, images: Path) -> None:
    assert read_pairs(save_list(tmp_path, "left,right\na,b\n"))[0].num_disparities is None
    assert {pair.num_disparities for pair in read_pairs(images)} == {None}
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene/im0.png").touch()
    assert [pair.num_disparities for pair in read_pairs(tmp_path)] == [None]


def test_scenes_as_middlebury_has_them(tmp_path: Path) -> None:
    for name, ndisp in (("b", "ndisp=70\n"), ("a", None)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "im0.png").touch()
        if ndisp:
            cameras = "cam0=[100 0 5; 0 100 5; 0 0 1]\ncam1=[100 0 5; 0 100 5; 0 0 1]\n"
            rest = "doffs=0\nbaseline=1\nwidth=10\nheight=10\n"
            (tmp_path / name / "calib.txt").write_text(cameras + rest + ndisp)

    found = read_pairs(tmp_path, num_disparities=30)
    assert [(pair.name, pair.num_disparities) for pair in found] == [("a", 30), ("b", 70)]
    assert found[1].right == tmp_path / "b/im1.png"


def test_views_in_subfolders_are_paired_by_name(tmp_path: Path) -> None:
    for name in ("left/10.png", "left/9.png", "right/9.png", "right/10.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()

    found = read_pairs(tmp_path, num_disparities=30, min_disparity=-3)
    assert [(pair.name, pair.left.name, pair.right.name) for pair in found] == [
        ("9", "9.png", "9.png"),
        ("10", "10.png", "10.png"),
    ]

    assert {(pair.num_disparities, pair.min_disparity) for pair in found} == {(30, -3)}


# What a worker does


def order(folder: Path, **changes: Any) -> Order:
    settings = ps.PRESETS["fast"]
    plain = Order(settings=settings, folder=folder, suffix=".tif", layers=(), threads=1)
    return replace(plain, **changes)


def test_a_pair_of_geotiffs_keeps_its_place_and_its_masks(tmp_path: Path) -> None:
    counterpart("rasterio")
    place = Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000, 0, -0.5, 4800000))
    views = [image[:40, :60].mean(axis=2, dtype=np.float32) for image in scene(0)]
    views[0][:5] = np.nan

    for name, view in zip(("left.tif", "right.tif"), views, strict=True):
        write_geotiff(tmp_path / name, view, like=place)

    mask = np.full((40, 60), 255, np.uint8)
    mask[-4:] = 0
    write_image(tmp_path / "mask.png", mask)

    pair = PairFiles(
        name="a",
        left=tmp_path / "left.tif",
        right=tmp_path / "right.tif",
        num_disparities=16,
        left_mask=tmp_path / "mask.png",
    )

    work = order(tmp_path, settings=ps.PRESETS["paper"], layers=LAYERS)
    record = match_files(pair, work, "recipe")
    assert (record.state, record.reason, record.width, record.height) == ("done", None, 60, 40)

    valid = (mask > 0) & ~np.isnan(views[0])
    wanted = ps.match(*views, num_disparities=16, left_mask=valid, preset="paper")

    for name in ("disparity", *LAYERS):
        found = read_geotiff(tmp_path / ("a.tif" if name == "disparity" else f"a.{name}.tif"))
        np.testing.assert_array_equal(found.image, getattr(wanted, name))
        assert found.georeference.crs == "EPSG:32631"

    assert record.estimated == pytest.approx(valid.mean(), abs=1e-6)
    assert record.files is not None
    assert {name: (tmp_path / name).stat().st_size for name in record.files} == record.files


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, r"/it.png: No such file or directory$"),
        ("cut", r"/it.png: .*truncated"),
        ("text", r"/it.png: not an image of a known format"),
        ("size", r"^right: got 3 x 4 pixels; accepts up to 8 times"),
        ("a\0.png", r"^embedded null byte$"),
    ],
)
def test_what_is_wrong_with_a_pair_is_recorded(
    content: str | None, reason: str, tmp_path: Path, pairs: list[PairFiles]
) -> None:
    path = tmp_path / "it.png"
    whole = pairs[0].right.read_bytes()
    if content == "size":
        write_image(path, np.zeros((3, 4, 3), np.uint8))
    elif content in ("cut", "text"):
        path.write_bytes(whole[: len(whole) // 2] if content == "cut" else b"text")
    elif content is not None:
        path = tmp_path / content

    pair, work = replace(pairs[0], right=path), order(tmp_path)
    record = match_files(pair, work, work.recipe(pair))

    assert record.state == "failed"
    assert re.search(reason, str(record.reason))
    assert not (tmp_path / "left0.tif").exists()


def test_a_bug_in_a_pair_is_recorded_with_its_place(
    tmp_path: Path, pairs: list[PairFiles], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phasestereo_large.batch.work.match_silently", lambda *_, **__: 1 / 0)
    record = match_files(pairs[0], order(tmp_path), "recipe")
    assert record.state == "failed"
    assert str(record.reason).startswith("ZeroDivisionError('division by zero') in ")
    assert "test_batch.py, line " in str(record.reason)


def test_a_worker_of_another_version_that_came_late_matches_nothing(
    tmp_path: Path, pairs: list[PairFiles]
) -> None:
    record = match_files(pairs[0], order(tmp_path, version="99.0"), "recipe")
    message = f"the worker has phasestereo {ps.__version__}; accepts 99.0"
    assert (record.state, record.reason) == ("failed", message)


FULL = """
import resource, signal, sys
from pathlib import Path
import phasestereo as ps
from phasestereo_large.batch import read_pairs
from phasestereo_large.batch.work import Order, match_files
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
pair = read_pairs(Path(sys.argv[1]), num_disparities=32)[0]
order = Order(settings=ps.PRESETS["fast"], folder=Path(sys.argv[2]), suffix=".tif", layers=(),
              threads=1)
print(match_files(pair, order, "recipe").reason)
"""


def test_a_disk_that_is_full_is_reported_and_leaves_nothing(images: Path, tmp_path: Path) -> None:
    counterpart("resource")

    finished = subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, "-c", FULL, str(images), str(tmp_path)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )

    message = (
        rf"{tmp_path}/left0.tif cannot be written: .*(File too large|requested and \d+ written)"
    )
    assert re.match(message, finished.stdout)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "free", "is_full"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), 10**9, True),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), 10**9, True),
        (OSError("8100 requested and 512 written"), 100, True),
        (OSError("8100 requested and 512 written"), 10**9, False),
        (PermissionError(errno.EACCES, "Permission denied"), 10**9, False),
    ],
)
def test_a_full_disk_is_more_than_a_failed_pair(  # noqa: PLR0917 -- pytest names them
    pairs: list[PairFiles],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: OSError,
    free: int,
    is_full: bool,  # noqa: FBT001 -- a parameter of a test
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("phasestereo_large.batch.work.write_map", fail)
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free))
    reason = f"left0.tif cannot be written: {error.strerror or error}"

    if is_full:
        with pytest.raises(FullDiskError, match=re.escape(reason)) as caught:
            match_files(pairs[0], order(tmp_path), "recipe")
        assert type(pickle.loads(pickle.dumps(caught.value))) is FullDiskError  # noqa: S301  # ours
    else:
        assert reason in str(match_files(pairs[0], order(tmp_path), "recipe").reason)


# Runs


def test_a_run_gives_the_bits_of_single_matches(
    pairs: list[PairFiles], matching: Callable[..., Any], tmp_path: Path
) -> None:
    reported = []

    report = matching(pairs, tmp_path / "out", progress=lambda *now: reported.append(now))
    assert (report.pairs, report.done, report.skipped, report.failed) == (6, 6, 0, [])
    assert_all_there(pairs, tmp_path / "out")
    assert reported == [(number, 6) for number in range(1, 7)]

    records = read_manifest(report.manifest)
    assert list(records) == [pair.name for pair in pairs]
    assert len({record.worker for record in records.values()}) == 2
    assert report.manifest.read_bytes().count(b"\n") == 6


def test_a_rerun_does_what_is_missing_or_has_changed_and_nothing_else(
    pairs: list[PairFiles], matching: Callable[..., Any], tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    copies = [tmp_path / "left.png", tmp_path / "right.png"]

    for copy, path in zip(copies, (pairs[0].left, pairs[0].right), strict=True):
        copy.write_bytes(path.read_bytes())
    pairs = [replace(pairs[0], left=copies[0], right=copies[1]), *pairs[1:4]]
    matching(pairs, folder)

    def written() -> dict[str, int]:
        return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.tif")}

    before = written()
    assert matching(pairs, folder).skipped == 4
    assert written() == before

    (folder / "left1.tif").unlink()
    (folder / "left2.tif").write_bytes(b"short")
    os.utime(copies[0], (1, 1))

    report = matching(pairs, folder)
    assert (report.done, report.skipped) == (3, 1)

    after = written()
    assert {name for name in after if after[name] == before[name]} == {"left3.tif"}
    assert_all_there(pairs, folder)

    assert matching(pairs, folder, window=5).done == 4
    assert matching([replace(pair, min_disparity=1) for pair in pairs], folder).done == 4
    assert matching(pairs, folder, suffix=".pfm").done == 4
    assert_all_there(pairs, folder, ".pfm")


def test_pairs_that_fail_are_tried_again_recorded_and_tried_by_the_next_run(
    pairs: list[PairFiles], matching: Callable[..., Any], tmp_path: Path
) -> None:
    late = tmp_path / "late.png"
    wrong = [replace(pairs[0], right=late), *pairs[1:3]]
    heard: list[Record] = []

    report = matching(wrong, tmp_path / "out", retries=2, on_failure=heard.append)
    assert (report.done, [record.name for record in report.failed]) == (2, ["left0"])
    assert heard == report.failed
    assert heard[0].attempts == 3
    assert heard[0].reason == f"{late}: No such file or directory"
    assert states(tmp_path / "out") == {"left0": "failed", "left1": "done", "left2": "done"}

    late.write_bytes(pairs[0].right.read_bytes())
    report = matching(wrong, tmp_path / "out")
    assert (report.done, report.skipped, report.failed) == (1, 2, [])
    assert_all_there(pairs[:3], tmp_path / "out")


def _slowly(pair: PairFiles, work: Order, recipe: str) -> Record:
    """Match a pair, and show by a file that it is being done."""
    (work.folder / f"{pair.name}.{os.getpid()}.begun").touch()
    time.sleep(0.3)
    return match_files(pair, work, recipe)


def test_a_worker_that_is_killed_half_way_changes_nothing(
    cluster: Any,
    pairs: list[PairFiles],
    matching: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(running_module, "match_files", _slowly)
    folder = tmp_path / "out"
    with distributed.Client(cluster, set_as_default=False) as client:
        ours = set(client.run(os.getpid).values())
    killed: list[int] = []

    def kill(done: int, _total: int) -> None:
        if done == 2 and not killed:
            busy = {int(path.name.split(".")[1]) for path in folder.glob("*.begun")}
            killed.append(sorted(busy & ours)[0])
            os.kill(killed[0], signal.SIGKILL)

    report = matching(pairs, folder, progress=kill)
    assert killed
    assert (report.done, report.failed) == (6, [])
    assert_all_there(pairs, folder)
    assert set(states(folder).values()) == {"done"}
    assert not list(folder.glob(".*.part"))


def _deadly(pair: PairFiles, work: Order, recipe: str) -> Record:
    """Match a pair, but for one that kills whoever tries."""
    if pair.name == "left1":
        os.kill(os.getpid(), signal.SIGKILL)
    return match_files(pair, work, recipe)


def test_a_pair_that_kills_its_workers_fails_alone(
    pairs: list[PairFiles], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running_module, "match_files", _deadly)
    report = run(pairs, tmp_path / "out", workers=2, threads=1, retries=1, preset="fast")
    assert [(record.name, record.attempts) for record in report.failed] == [("left1", 2)]
    assert str(report.failed[0].reason).startswith("its worker died")
    assert report.done == 5
    assert_all_there([pairs[0], *pairs[2:]], tmp_path / "out")


def test_a_pair_that_takes_too_long_is_ended_and_fails_alone(
    pairs: list[PairFiles], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running_module, "match_files", sleepily)
    monkeypatch.setattr("phasestereo_large.processes._GRACE", 0.0)
    options: dict[str, Any] = {"workers": 2, "threads": 1, "retries": 0, "preset": "fast"}

    report = run(pairs, tmp_path / "out", time_limit=3, **options)
    assert [(record.name, record.reason) for record in report.failed] == [
        ("left1", "took longer than 3 s, and was ended")
    ]
    assert_all_there([pairs[0], *pairs[2:]], tmp_path / "out")


def test_a_match_that_takes_too_long_ends_by_itself(pairs: list[PairFiles], tmp_path: Path) -> None:
    record = match_files(pairs[0], order(tmp_path, seconds=1e-9), "recipe")
    assert (record.state, record.reason) == ("failed", "took longer than 1e-09 s")
    assert list(tmp_path.iterdir()) == []


def _open_ports() -> list[Any]:
    """Return the ports of this process and of those that it has started."""
    psutil = counterpart("psutil")

    us = psutil.Process()
    return [
        (process.name(), each.laddr)
        for process in (us, *us.children(recursive=True))
        for each in process.net_connections("all")
        if each.status == psutil.CONN_LISTEN or each.type == socket.SOCK_DGRAM
    ]


def test_processes_of_this_machine_cannot_be_reached(
    pairs: list[PairFiles], tmp_path: Path
) -> None:
    before = _open_ports()
    found: list[Any] = []

    run(
        pairs,
        tmp_path / "out",
        workers=2,
        preset="fast",
        progress=lambda *_: found.extend(_open_ports()),
    )

    assert [port for port in found if port not in before] == []
    assert_all_there(pairs, tmp_path / "out")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two authorities, and a certificate by each."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no openssl to make certificates with")

    folder = tmp_path_factory.mktemp("tls")
    for name in ("ours", "others"):
        for words in (
            f"req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN={name} -keyout {name}.ca.key "
            f"-out {name}.ca",
            f"req -newkey rsa:2048 -nodes -subj /CN=host -keyout {name}.key -out {name}.csr",
            f"x509 -req -days 2 -in {name}.csr -CA {name}.ca -CAkey {name}.ca.key "
            f"-CAcreateserial -out {name}.pem",
        ):
            subprocess.run(  # noqa: S603  # the openssl that is on the path
                [openssl, *words.split()], cwd=folder, check=True, capture_output=True
            )

    return folder


def test_a_stranger_is_refused_by_a_cluster_with_certificates(
    run: Callable[..., Run],
    images: Path,
    pairs: list[PairFiles],
    certificates: Path,
    tmp_path: Path,
) -> None:
    files = {name: [certificates / f"{name}.{end}" for end in ("ca", "pem", "key")]
             for name in ("ours", "others")}  # fmt: skip
    ca, cert, key = map(str, files["ours"])

    roles = {"tls_ca_file": ca}
    for role in ("scheduler", "worker", "client"):
        roles |= {f"tls_{role}_cert": cert, f"tls_{role}_key": key}

    with (
        counterpart("dask").config.set({"distributed.comm.timeouts.connect": "2s"}),
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=False,
            protocol="tls://",
            security=distributed.Security(require_encryption=True, **roles),
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        words = ["batch", images, "--num-disparities", COUNT, "--preset", "fast"]
        words += ["-o", tmp_path / "out", "--scheduler", cluster.scheduler_address]

        def match(name: str) -> Run:
            given = zip(("--tls-ca", "--tls-cert", "--tls-key"), files[name], strict=True)
            return run(*words, *(word for pair in given for word in pair))

        code, _, err = match("others")
        assert code == 1
        assert err.startswith("phasestereo: error: no scheduler at tls:")
        assert run(*words)[0] == 2  # tls without certificates
        assert match("ours")[0] == 0

    assert_all_there(pairs, tmp_path / "out")


def _full(pair: PairFiles, work: Order, recipe: str) -> Record:
    """Match the first pairs; find the disk full at another one until there is room."""
    if pair.name == "left3" and not (work.folder / "room").exists():
        raise FullDiskError(f"{pair.name}.tif cannot be written: No space left on device")
    return match_files(pair, work, recipe)


def test_a_full_disk_ends_the_run_which_goes_on_when_there_is_room(
    pairs: list[PairFiles],
    matching: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(running_module, "match_files", _full)
    message = "left3.tif cannot be written: No space left on device; what is finished is kept, "

    with pytest.raises(OSError, match=re.escape(message)):
        matching(pairs, tmp_path / "out")
    before = states(tmp_path / "out")
    assert "left3" not in before
    assert set(before.values()) <= {"done"}

    (tmp_path / "out/room").touch()
    report = matching(pairs, tmp_path / "out")
    assert (report.skipped, report.done, report.failed) == (len(before), 6 - len(before), [])
    assert_all_there(pairs, tmp_path / "out")


def _unloadable(pair: PairFiles, work: Order, recipe: str) -> Record:
    raise LookupError(f"{pair.name} {work.suffix} {recipe[:0]}")


def test_what_a_worker_cannot_run_is_recorded(
    pairs: list[PairFiles],
    matching: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(running_module, "match_files", _unloadable)
    report = matching(pairs[:1], tmp_path / "out", retries=0)
    assert str(report.failed[0].reason).startswith("the worker could not run it: LookupError(")


def test_few_pairs_are_under_way_at_a_time(
    pairs: list[PairFiles],
    cluster: Any,
    matching: Callable[..., Any],
    tmp_path: Path,
) -> None:
    most = 0
    many = [replace(pairs[0], name=f"pair{number}") for number in range(40)]

    def look(*_: int) -> None:
        nonlocal most
        most = max(most, len(cluster.scheduler.tasks))

    assert matching(many, tmp_path / "out", progress=look).done == 40
    assert 2 <= most <= 8


@pytest.mark.parametrize("at_work", [False, True], ids=["workers start", "workers match"])
def test_ctrl_c_is_reported_in_one_line_and_leaves_no_process(
    images: Path,
    tmp_path: Path,
    at_work: bool,  # noqa: FBT001 -- a parameter of a test
) -> None:
    rows = [f"{images}/left0.png,{images}/right0.png,pair{number}" for number in range(5000)]
    folder = tmp_path / "out"

    process = subprocess.Popen(  # noqa: S603  # our own interpreter on our own code
        [
            *(sys.executable, "-m", "phasestereo", "batch"),
            str(save_list(tmp_path, "\n".join(["left,right,name", *rows]))),
            *("--num-disparities", str(COUNT), "--preset", "fast", "-o", str(folder)),
        ],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a group of processes, all of which a terminal would interrupt
    )

    manifest = folder / "manifest.jsonl"
    least = 1 if at_work else 0  # bytes
    while process.poll() is None and not (manifest.exists() and manifest.stat().st_size >= least):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)

    out, err = process.communicate()  # ends when the last process has closed its end
    # Where Ctrl-C comes amid the `exec` of a text, as while dataclasses are imported, Python ends
    # itself by that signal though it was caught: 130 to shells, all the same.

    assert process.returncode in {130, -signal.SIGINT}

    assert (out, err) == ("", "phasestereo: interrupted\n")
    assert list(states(folder).values()).count("done") == len(states(folder))


def test_pairs_of_one_name_are_refused(pairs: list[PairFiles], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^got name 'left0' for "):
        run([pairs[0], pairs[0]], tmp_path / "out")
    with pytest.raises(ValueError, match=r"^got name '../left0'; accepts the name of a file"):
        run([replace(pairs[0], name="../left0")], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_is_for_one_run_at_a_time(
    pairs: list[PairFiles], matching: Callable[..., Any], tmp_path: Path
) -> None:
    def second(*_: int) -> None:
        with pytest.raises(OSError, match="another run is at work there"):
            run(pairs, tmp_path / "out", workers=1)

    assert matching(pairs[:1], tmp_path / "out", progress=second).done == 1


# Refusals


@pytest.mark.parametrize(
    ("error", "message", "options"),
    [
        (ValueError, r"^suffix: got '.png'; accepts '.pfm", {"suffix": ".png"}),
        (ValueError, r"^layers: got 'blur'; accepts flags, confidence, unc", {"layers": ["blur"]}),
        (ValueError, r"^layers: got 'confidence' with settings", {"layers": ["confidence"]}),
        (ValueError, r"^retries: got -1; accepts 0 or more", {"retries": -1}),
        (ValueError, r"^workers: got 0; accepts 1 or more", {"workers": 0}),
        (TypeError, r"^threads: got str; accepts an integer", {"threads": "2"}),
        (TypeError, r"^windo: no such setting", {"windo": 3}),
        (ValueError, r"^time_limit: got 0; accepts a positive", {"time_limit": 0}),
        (TypeError, r"^time_limit: got str; accepts a number", {"time_limit": "2"}),
        (ValueError, r"^security: got that without a scheduler", {"security": object()}),
        (
            ValueError,
            r"^workers: got a number beside a scheduler",
            {"workers": 2, "scheduler": "x"},
        ),
    ],
)
def test_wrong_arguments(
    error: type[Exception],
    message: str,
    options: dict[str, Any],
    pairs: list[PairFiles],
    tmp_path: Path,
) -> None:
    with pytest.raises(error, match=message):
        run(pairs, tmp_path / "out", **({"preset": "fast"} | options))


def test_a_scheduler_that_is_not_there(pairs: list[PairFiles], tmp_path: Path) -> None:
    dask = counterpart("dask")
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "200ms"}),
        pytest.raises(ConnectionError, match=r"^no scheduler at tcp://127.0.0.1:9: "),
    ):
        run(pairs, tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize("scheduler", ["foo://x:1", "tls://127.0.0.1:9"])
def test_a_wrong_scheduler_leaves_no_thread_of_a_client(
    pairs: list[PairFiles], tmp_path: Path, scheduler: str
) -> None:
    gc.collect()
    before = set(threading.enumerate())
    with pytest.raises(ValueError, match=rf"^scheduler: got '{scheduler}'; accepts an address"):
        run(pairs, tmp_path / "out", scheduler=scheduler)
    assert set(threading.enumerate()) == before


def test_workers_of_another_version_are_refused(
    pairs: list[PairFiles],
    matching: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ps._core, "__version__", "99.0")
    with pytest.raises(ValueError, match=r"^scheduler: worker tcp://.* has phasestereo .*99.0, as"):
        matching(pairs, tmp_path / "out")


@pytest.fixture
def mortal() -> Iterator[Any]:
    """Return a cluster of one worker that a test may close, after which nobody waits for it."""
    with (
        counterpart("dask").config.set({"distributed.comm.timeouts.connect": "500ms"}),
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        yield cluster


LOST = r"^the scheduler is lost; the same run again does what is missing \("


def test_a_scheduler_that_is_lost_ends_the_run_and_keeps_what_is_done(
    pairs: list[PairFiles],
    matching: Callable[..., Any],
    mortal: Any,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def lose(done: int, _total: int) -> None:
        if done == 2:
            mortal.close()

    caplog.handler.setLevel(logging.ERROR)
    with pytest.raises(ConnectionError, match=LOST):
        matching(pairs, tmp_path, scheduler=mortal.scheduler_address, progress=lose)

    assert [entry for entry in caplog.records if entry.name == "distributed.client"] == []
    assert list(states(tmp_path).values()) == ["done", "done"]


def _endlessly(_pair: PairFiles, work: Order, _recipe: str) -> None:
    (work.folder / "begun").touch()
    time.sleep(1000)


def test_a_scheduler_that_is_lost_while_all_wait(
    pairs: list[PairFiles],
    matching: Callable[..., Any],
    mortal: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(running_module, "match_files", _endlessly)

    def lose() -> None:
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
        mortal.close()

    thread = threading.Thread(target=lose)
    thread.start()
    with pytest.raises(ConnectionError, match=LOST):
        matching(pairs, tmp_path, scheduler=mortal.scheduler_address)
    thread.join()
    assert states(tmp_path) == {}


RECORD = Record(
    name="a", state="done", left="l", right="r", num_disparities=1, min_disparity=0, recipe="x",
    files={"a.tif": 3},
)  # fmt: skip
DAMAGE = {
    "no object": b"[1]",
    "cut": b'{"name": "left0", "state": "do',
    "another type": b'{"name": 3}',
    "no number": json.dumps(asdict(RECORD)).replace("null", "NaN").encode(),
    "too large a number": json.dumps(asdict(RECORD) | {"attempts": 10**30}).encode(),
    "deep": b"[" * 60_000,
    "deep inside": b'{"name": "a", "more": ' + b"[" * 30_000,
    "no text": b"\xff\xfe\x00",
    "a file elsewhere": json.dumps(asdict(RECORD) | {"files": {"../a.tif": 3}}).encode(),
    "an absolute file": json.dumps(asdict(RECORD) | {"files": {"/etc/passwd": 3}}).encode(),
    "an invalid state": json.dumps(asdict(RECORD) | {"state": "dune"}).encode(),
    "done without files": json.dumps(asdict(RECORD) | {"files": None}).encode(),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_line_of_a_manifest_is_set_apart_and_named(tmp_path: Path, kind: str) -> None:
    manifest, path = Manifest(tmp_path), tmp_path / "manifest.jsonl"
    manifest.add(RECORD)
    manifest.add(replace(RECORD, name="b"))
    manifest.close()

    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([lines[0], DAMAGE[kind], lines[1], b""]))
    with pytest.raises(ValueError, match=r"manifest.jsonl, line 2: no record of a batch: "):
        read_manifest(path)

    for is_mended in (False, True):
        manifest = Manifest(tmp_path)
        assert list(manifest.records) == ["a", "b"]
        assert len(manifest.damaged) == 1 - is_mended
        manifest.save([])
        manifest.save([])

    assert (tmp_path / "manifest.damaged").read_bytes() == DAMAGE[kind] + b"\n"
    assert list(read_manifest(path)) == ["a", "b"]


@pytest.mark.parametrize("is_appended", [False, True])
def test_a_record_that_does_not_fit_on_the_disk_ends_the_run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    is_appended: bool,  # noqa: FBT001 -- a parameter of a test
) -> None:
    device = Path("/dev/full")
    if not device.exists():
        pytest.skip("no /dev/full here")

    manifest = Manifest(tmp_path)
    if is_appended:
        (tmp_path / "manifest.jsonl").symlink_to(device)
        monkeypatch.setattr("phasestereo_large.records._last_line", lambda _: b"")
        with pytest.raises(OSError, match="No space left on device"):
            manifest.add(RECORD)
    else:
        full = "phasestereo_large.batch.manifest.replacing"
        monkeypatch.setattr(full, lambda *_, **__: device.open("wb"))
        manifest.records["a"] = RECORD
        with pytest.raises(OSError, match=r"manifest.jsonl cannot be written: No space left"):
            manifest.save(["a"])


def test_the_pair_of_a_damaged_line_is_matched_again(
    run: Callable[..., Run], cluster: Any, images: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    words = ["batch", images, "--num-disparities", COUNT, "--preset", "fast", "-o", folder]
    words += ["--scheduler", cluster.scheduler_address]
    assert run(*words)[0] == 0

    lines = (folder / "manifest.jsonl").read_bytes().splitlines()
    lines[3] = lines[3][:50]
    (folder / "manifest.jsonl").write_bytes(b"\n".join([*lines, b""]))

    code, out, err = run(*words)
    assert (code, out.split(",")[:2]) == (0, ["1 pair matched", " 5 there already"])
    assert err.startswith(f"phasestereo: {folder}/manifest.jsonl, line 4: no record of a batch: ")
    assert set(states(folder).values()) == {"done"}


def test_a_manifest_that_is_none_is_left_alone(pairs: list[PairFiles], tmp_path: Path) -> None:
    (tmp_path / "manifest.jsonl").write_text('{"name": "a"}\n')
    with pytest.raises(ValueError, match=r"manifest.jsonl, line 1: no record of a batch"):
        run(pairs, tmp_path)
    assert (tmp_path / "manifest.jsonl").read_text() == '{"name": "a"}\n'


def test_a_manifest_keeps_pairs_of_other_lists(
    pairs: list[PairFiles], matching: Callable[..., Any], tmp_path: Path
) -> None:
    matching(pairs[:2], tmp_path)
    matching(pairs[2:3], tmp_path)
    assert list(Manifest(tmp_path).records) == ["left2", "left0", "left1"]


def test_processors_are_shared_out(monkeypatch: pytest.MonkeyPatch) -> None:
    workers = SimpleNamespace(Workers=lambda _: SimpleNamespace(count=8))
    monkeypatch.setattr("phasestereo_large.batch.cluster._core", workers)
    assert share(None, None, 100) == (8, 1)
    assert share(None, None, 3) == (3, 2)
    assert share(2, None, 100) == (2, 4)
    assert share(None, 4, 100) == (2, 4)
    assert share(16, None, 100) == (16, 1)
    assert share(3, 5, 100) == (3, 5)
    assert share(None, None, 0) == (1, 8)


# The command


def test_the_command_does_it_and_says_so(
    run: Callable[..., Run], cluster: Any, images: Path, tmp_path: Path, pairs: list[PairFiles]
) -> None:
    words = ["batch", images, "--num-disparities", COUNT, "--preset", "fast", "-o", tmp_path / "o"]
    words += ["--scheduler", cluster.scheduler_address, "--layers", "flags"]

    code, out, err = run(*words)
    assert (code, err) == (0, "")
    assert out.startswith("6 pairs matched, 0 there already, 0 failed, ")
    assert out.endswith(f"wrote {tmp_path / 'o/manifest.jsonl'}\n")

    assert_all_there(pairs, tmp_path / "o")
    assert read_image(tmp_path / "o/left0.flags.tif").dtype == np.uint16

    code, out, err = run(*words, "--json")
    content = json.loads(out)
    assert (code, err) == (0, "")
    assert (content["done"], content["skipped"], content["failures"]) == (0, 6, [])
    assert content["settings"]["optimizer"] == "so"


def test_the_command_fails_if_a_pair_does(
    run: Callable[..., Run], cluster: Any, images: Path, tmp_path: Path
) -> None:
    rows = f"left,right\n{images}/left0.png,{images}/right0.png\n{images}/left1.png,nothing.png\n"
    words = ["batch", save_list(tmp_path, rows), "--num-disparities", COUNT, "--preset", "fast"]
    words += ["-o", tmp_path / "out", "--scheduler", cluster.scheduler_address, "--json"]

    code, out, err = run(*words)
    assert code == 1

    assert err.splitlines()[0] == (
        f"phasestereo: failed left1: {tmp_path}/nothing.png: No such file or directory"
    )
    assert err.splitlines()[1].startswith("phasestereo: error: 1 of 2 pairs failed; ")
    assert [failure["name"] for failure in json.loads(out)["failures"]] == ["left1"]


def test_wrong_command_lines(run: Callable[..., Run], images: Path, tmp_path: Path) -> None:
    code, _, err = run("batch", images, "-o", tmp_path / "out", "--num-disparities", "some")
    assert code == 2
    assert "--num-disparities" in err

    code, _, err = run("batch", tmp_path / "none.csv", "-o", tmp_path / "out")
    assert (code, err) == (
        1,
        f"phasestereo: error: {tmp_path}/none.csv: No such file or directory\n",
    )

    assert not (tmp_path / "out").exists()


def test_without_the_extra_it_says_what_installs_it(
    pairs: list[PairFiles], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, extra, options in (
        ("distributed", "dask", {"scheduler": "tcp://127.0.0.1:9"}),
        ("filelock", "batch", {}),
    ):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ImportError, match=rf"^{module} is .* 'phasestereo\[{extra}\]'$"):
            run(pairs, tmp_path, **options)  # type: ignore[arg-type]
