"""Downloads, from a server of the test's own: every collection, and all that can go wrong."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import re
import socket
import threading
import time
import tomllib
import zipfile
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo.io import write_disparity, write_image
from phasestereo_bench import downloads
from phasestereo_bench.datasets import find_scene, find_scenes
from phasestereo_bench.downloads import collections, download

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Answer = Callable[[BaseHTTPRequestHandler], None]

pytest.importorskip("pooch")
pytest.importorskip("filelock")

REGISTRY = tomllib.loads((files("phasestereo_bench") / "downloads.toml").read_text("utf-8"))
CALIBRATION = """cam0=[100 0 6; 0 100 1; 0 0 1]
cam1=[100 0 6; 0 100 1; 0 0 1]
doffs=0
baseline=100
width=12
height=2
ndisp=16
"""


# --- a site on this machine --------------------------------------------------------------------


class Site(ThreadingHTTPServer):
    """Answers with the bytes, or the answer, that a path has; remembers what was asked for."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.files: dict[str, bytes | Answer] = {}
        self.requests: list[str] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/mirror/"


class Handler(BaseHTTPRequestHandler):
    server: Site
    timeout = 10  # seconds; nothing of a test outlives it

    def do_GET(self) -> None:
        path = self.path.removeprefix("/mirror/")
        self.server.requests.append(path)
        content = self.server.files.get(path)
        if callable(content):
            content(self)
        elif content is None:
            self.send_error(404)
        else:
            send(self, content)

    def log_message(self, *_: object) -> None:
        """Keep quiet."""


def send(handler: BaseHTTPRequestHandler, content: bytes, *, length: int | None = None) -> None:
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(content) if length is None else length))
    handler.end_headers()
    handler.wfile.write(content)


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


@pytest.fixture
def site() -> Iterator[Site]:
    with Site() as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


# --- archives as the site has them -------------------------------------------------------------


def encoded(image: np.ndarray[Any, Any], suffix: str, folder: Path) -> bytes:
    path = folder / f"encoded{suffix}"
    (write_disparity if suffix == ".pfm" else write_image)(path, image)
    return path.read_bytes()


@pytest.fixture(scope="session")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return a small file of each kind: what an image or a truth holds does not matter here."""
    folder = tmp_path_factory.mktemp("encoded")
    color, gray = np.full((2, 12, 3), 9, np.uint8), np.full((2, 12), 24, np.uint8)
    kinds = {suffix: encoded(color, suffix, folder) for suffix in (".ppm", ".png")}
    kinds[".pgm"] = encoded(gray, ".pgm", folder)
    kinds["truth.png"] = encoded(gray, ".png", folder)
    kinds[".pfm"] = encoded(gray.astype(np.float32), ".pfm", folder)
    kinds[".txt"] = CALIBRATION.encode()
    return kinds


TRAINING = (
    "Adirondack ArtL Jadeplant Motorcycle MotorcycleE Piano PianoL Pipes Playroom Playtable "
    "PlaytableP Recycle Shelves Teddy Vintage"
)

# The files of a scene, by the first name that its collection, with the archive, begins with.
SCENE_FILES = {
    "2003-quarter": "im2.png im6.png disp2.png disp6.png",
    "2003": "im2.ppm im6.ppm disp2.pgm disp6.pgm",
    "2005": "view1.png view5.png disp1.png disp5.png",
    "2006": "view1.png view5.png disp1.png disp5.png",
    "2014": "im0.png im1.png im1E.png im1L.png disp0.pfm disp1.pfm calib.txt",
    "2021": "im0.png im1.png disp0.pfm disp1.pfm calib.txt",
    "MiddEval3-Q data": "im0.png im1.png calib.txt",
    "MiddEval3-H data": "im0.png im1.png calib.txt",
    "MiddEval3-F data": "im0.png im1.png calib.txt",
    "MiddEval3": "disp0GT.pfm mask0nocc.png",
}


def scene_folders(collection: str, key: str) -> list[str]:
    """Return the folders of the scenes that an archive of a collection holds."""
    if collection == "2021":
        return [f"data/scene{number}" for number in range(24)]
    if collection.startswith("MiddEval3"):
        training = [f"MiddEval3/training{collection[-1]}/{name}" for name in TRAINING.split()]
        tests = [f"MiddEval3/test{collection[-1]}/scene{number}" for number in range(15)]
        return training if key == "GT0" else training + tests
    name = key.rsplit("/", maxsplit=1)[-1]
    return [name + collection.removeprefix("2014") if collection.startswith("2014") else name]


def archive(contents: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as file:
        for name, content in contents.items():
            file.writestr(name, content)
    return stream.getvalue()


def official(
    collection: str, made_up: dict[str, bytes], real: Path | None = None
) -> dict[str, bytes]:
    """Return all files of a collection by path on the site, each scene real where there is one."""

    def content(folder: str, name: str) -> bytes:
        if real is not None:
            path = real / REGISTRY[collection]["into"] / folder / name
            if path.exists():
                found: bytes = path.read_bytes()
                return found
        is_truth = name.startswith(("disp", "mask")) and name.endswith(".png")
        return made_up["truth.png" if is_truth else Path(name).suffix]

    url, keys = REGISTRY[collection]["url"], REGISTRY[collection]["sha256"]
    if collection == "2001":
        return {url.format(key): content(*key.split("/")) for key in keys}
    archives = {}
    for key in keys:
        start = next(each for each in SCENE_FILES if f"{collection} {key}".startswith(each))
        archives[url.format(key)] = archive(
            {
                f"{folder}/{name}": content(folder, name)
                for folder in scene_folders(collection, key)
                for name in SCENE_FILES[start].split()
            }
        )
    return archives


ART = "data/scenes2005/ThirdSize/zip-2views/Art-2views.zip"
MOEBIUS = "data/scenes2005/ThirdSize/zip-2views/Moebius-2views.zip"


@pytest.fixture
def third(site: Site, made_up: dict[str, bytes]) -> Site:
    site.files.update(official("2005-third", made_up))
    return site


def left_behind(folder: Path) -> list[str]:
    return sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if not path.name.endswith(".lock")
    )


# --- what works --------------------------------------------------------------------------------


def test_the_registry_names_every_size_of_every_year() -> None:
    sizes = [f"{year}-{size}" for year in (2005, 2006) for size in ("third", "half", "full")]
    assert collections() == [
        "2001",
        *(f"2003-{size}" for size in ("quarter", "half", "full")),
        *sizes,
        "2014-perfect",
        "2014-imperfect",
        "2021",
        *(f"MiddEval3-{size}" for size in "QHF"),
    ]


def test_every_entry_of_the_registry_is_complete_and_honest() -> None:
    assert REGISTRY["base"] == "https://vision.middlebury.edu/stereo/"
    for name in collections():
        entry = REGISTRY[name]
        assert set(entry) == {"scenes", "url", "into", "verified", "sha256"}
        assert entry["url"].count("{}") == 1
        for sha256 in entry["sha256"].values():
            assert sha256 == "unknown" or len(bytes.fromhex(sha256)) == 32
            assert entry["verified"] or sha256 == "unknown"


@pytest.mark.parametrize("collection", collections())
def test_every_collection_is_fetched_and_found(
    site: Site, made_up: dict[str, bytes], tmp_path: Path, collection: str
) -> None:
    site.files.update(official(collection, made_up))
    folder = download(collection, tmp_path / "data", base_url=site.url)
    assert folder == tmp_path / "data" / collection
    assert site.requests == list(site.files)
    scenes = find_scenes(folder)
    assert len(scenes) == REGISTRY[collection]["scenes"]
    for scene in (scenes[0], scenes[-1]):
        pair = scene.load()
        assert pair.left.shape[:2] == (2, 12)
        assert (pair.truth is None) == (collection.startswith("MiddEval3") and "test" in str(scene))
    assert not [name for name in left_behind(tmp_path / "data") if ".part" in name]


@pytest.mark.parametrize(
    "scene",
    [
        ("2001", "tsukuba"),
        ("2001", "venus"),
        ("2003-quarter", "cones"),
        ("2005-third", "Art"),
        ("2006-third", "Aloe"),
        ("MiddEval3-Q", "MotorcycleE"),
    ],
)
def test_a_real_scene_arrives_as_it_is(
    site: Site, made_up: dict[str, bytes], data: Path, tmp_path: Path, scene: tuple[str, str]
) -> None:
    collection, name = scene
    site.files.update(official(collection, made_up, data / "middlebury"))
    folder = download(collection, tmp_path, base_url=site.url)
    pair = find_scene(folder, name).load()
    original = find_scene(data / "middlebury", name).load()
    assert (pair.name, pair.num_disparities) == (original.name, original.num_disparities)
    np.testing.assert_array_equal(pair.left, original.left)
    np.testing.assert_array_equal(pair.right, original.right)
    assert pair.truth is not None
    np.testing.assert_array_equal(pair.truth, original.truth)


def test_what_is_installed_is_not_asked_for_again(third: Site, tmp_path: Path) -> None:
    folder = download("2005-third", tmp_path, base_url=third.url)
    before = left_behind(tmp_path)
    third.requests.clear()
    assert download("2005-third", tmp_path, base_url=third.url) == folder
    assert download("2005-third", tmp_path, base_url="http://127.0.0.1:9/") == folder
    assert third.requests == []
    assert left_behind(tmp_path) == before


def test_a_download_that_works_is_silent(
    third: Site, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    logger = pytest.importorskip("pooch").get_logger()
    logger.addHandler(caplog.handler)
    try:
        download("2005-third", tmp_path, base_url=third.url)
    finally:
        logger.removeHandler(caplog.handler)
    assert caplog.records == []


def test_nothing_but_the_collection_and_its_hashes_stays(third: Site, tmp_path: Path) -> None:
    download("2005-third", tmp_path, base_url=third.url)
    top = {name for name in left_behind(tmp_path) if "/" not in name}
    assert top == {"2005-third", "2005-third.sha256.json"}
    recorded = json.loads((tmp_path / "2005-third.sha256.json").read_text())
    assert recorded == {
        path: hashlib.sha256(content).hexdigest()
        for path, content in third.files.items()
        if isinstance(content, bytes)
    }


def test_without_a_folder_it_goes_to_the_cache_of_the_user(
    third: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pooch.os_cache", lambda project: tmp_path / project)
    folder = download("2005-third", base_url=third.url)
    assert folder == tmp_path / "phasestereo" / "middlebury" / "2005-third"
    assert len(find_scenes(folder)) == 6


def test_the_site_is_the_official_one_unless_told_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def retrieve(url: str, *_: object, **__: object) -> None:
        asked.append(url)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pooch.retrieve", retrieve)
    with pytest.raises(OSError, match="No space left"):
        download("2005-third", tmp_path)
    assert asked == [f"https://vision.middlebury.edu/stereo/{ART}"]


def test_a_mirror_needs_no_slash_at_its_end(third: Site, tmp_path: Path) -> None:
    assert download("2005-third", tmp_path, base_url=third.url.rstrip("/")).is_dir()


def test_progress_grows_to_the_whole(third: Site, tmp_path: Path) -> None:
    third.files[ART] = archive({"Art/big": np.random.default_rng(1).bytes(300_000)})
    calls: list[tuple[int, int]] = []
    with pytest.raises(ValueError, match="5 scenes"):  # Art is not one: all were fetched even so
        download(
            "2005-third",
            tmp_path,
            base_url=third.url,
            progress=lambda done, total: calls.append((done, total)),
        )
    done, totals = zip(*calls, strict=True)
    assert len(set(totals)) == 1
    assert done[-1] == totals[0]
    assert list(done) == sorted(done)
    assert sum(number < totals[0] / 6 for number in done) >= 4  # within the first file


def test_an_interrupted_download_leaves_nothing_half_done(third: Site, tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done > total / 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        download("2005-third", tmp_path, base_url=third.url, progress=interrupt)
    assert not (tmp_path / "2005-third").exists()
    assert not [name for name in left_behind(tmp_path) if "tree" in name or "tmp" in name]
    download("2005-third", tmp_path, base_url=third.url)
    assert len(find_scenes(tmp_path / "2005-third")) == 6
    assert len(third.requests) == 7  # the fourth twice; the three before it had arrived


def test_what_a_killed_run_left_does_no_harm(third: Site, tmp_path: Path) -> None:
    draft = tmp_path / ".2005-third.part"
    (draft / "tree" / "scenes2005" / "ThirdSize" / "Half").mkdir(parents=True)
    (draft / "archives").mkdir()
    (draft / "archives" / "tmp12345").write_bytes(b"half of a file")
    (draft / "archives" / ART.replace("/", "-")).write_bytes(b"not what has the recorded hash")
    recorded = {ART: hashlib.sha256(third.files[ART]).hexdigest()}  # type: ignore[arg-type] # bytes
    (tmp_path / "2005-third.sha256.json").write_text(json.dumps(recorded))
    download("2005-third", tmp_path, base_url=third.url)
    assert {name for name in left_behind(tmp_path) if "/" not in name} == {
        "2005-third",
        "2005-third.sha256.json",
    }
    assert len(find_scenes(tmp_path / "2005-third")) == 6
    assert not [name for name in left_behind(tmp_path) if "Half" in name]


def test_of_downloads_at_the_same_time_one_fetches_and_the_others_wait(
    third: Site, tmp_path: Path
) -> None:
    slow = third.files[ART]
    assert isinstance(slow, bytes)

    def answer(handler: BaseHTTPRequestHandler) -> None:
        time.sleep(0.2)
        send(handler, slow)

    third.files[ART] = answer
    found: list[int] = []

    def run() -> None:
        found.append(len(find_scenes(download("2005-third", tmp_path, base_url=third.url))))

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [6, 6, 6, 6]
    assert len(third.requests) == 6


# --- what is refused ---------------------------------------------------------------------------


@contextmanager
def refused(folder: Path, error: type[Exception], match: str) -> Iterator[None]:
    """Expect an error, and that nothing stays after it but whole files to use another time."""
    with pytest.raises(error, match=match):
        yield
    whole = r"\.[\w-]+\.part(/archives(/data-.*)?)?|2005-third\.sha256\.json"
    assert not [name for name in left_behind(folder) if not re.fullmatch(whole, name)]


def test_an_unknown_collection_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="collection must be one of 2001, .*; got '2007'"):
        download("2007", tmp_path)
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize("url", ["file:///tmp", "vision.middlebury.edu", "", 3])
def test_a_base_that_is_not_http_is_refused(tmp_path: Path, url: Any) -> None:
    with pytest.raises(ValueError, match="base_url must start with http"):
        download("2001", tmp_path, base_url=url)
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize(("status", "reason"), [(404, "Not Found"), (500, "Internal Server Error")])
def test_a_refusing_server_is_quoted(third: Site, tmp_path: Path, status: int, reason: str) -> None:
    third.files[ART] = lambda handler: handler.send_error(status)
    with refused(
        tmp_path,
        OSError,
        rf"^cannot fetch http.*{ART} \(.*not verified.* answered {status} {reason}$",
    ):
        download("2005-third", tmp_path, base_url=third.url)
    assert left_behind(tmp_path) == []


def test_a_server_that_is_not_there_is_told(tmp_path: Path) -> None:
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))  # a port that nobody listens at, and nobody else takes
        url = f"http://127.0.0.1:{deaf.getsockname()[1]}"
        with refused(tmp_path, OSError, f"cannot fetch {url}/.*Connection refused"):
            download("2005-third", tmp_path, base_url=url)
    assert left_behind(tmp_path) == []


def test_a_silent_server_is_given_up(
    third: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = threading.Event()

    def answer(_: BaseHTTPRequestHandler) -> None:
        done.wait(10)

    third.files[ART] = answer
    monkeypatch.setattr(downloads, "_TIMEOUT", 0.1)
    with refused(tmp_path, OSError, "cannot fetch .* timed out"):
        download("2005-third", tmp_path, base_url=third.url)
    done.set()
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize("path", [ART, "data/scenes2001/data/venus/im2.ppm"])
def test_a_body_shorter_than_announced_is_noticed(
    site: Site, made_up: dict[str, bytes], tmp_path: Path, path: str
) -> None:
    collection = "2005-third" if path == ART else "2001"
    site.files.update(official(collection, made_up))
    whole = site.files[path]
    assert isinstance(whole, bytes)
    site.files[path] = lambda handler: send(handler, whole[:-5], length=len(whole))
    with refused(tmp_path, OSError, rf"cannot fetch .*{path}.*5 more expected"):
        download(collection, tmp_path, base_url=site.url)
    assert not [name for name in left_behind(tmp_path) if path.replace("/", "-") in name]
    site.files[path] = whole
    assert download(collection, tmp_path, base_url=site.url).is_dir()


@pytest.mark.parametrize("path", [ART, "data/scenes2001/data/tsukuba/scene1.row3.col3.ppm"])
def test_a_truncated_file_of_the_site_is_noticed(
    site: Site, made_up: dict[str, bytes], tmp_path: Path, path: str
) -> None:
    collection = "2005-third" if path == ART else "2001"
    site.files.update(official(collection, made_up))
    whole = site.files[path]
    assert isinstance(whole, bytes)
    site.files[path] = whole[:-5]
    with refused(tmp_path, ValueError, f"{path} sent a file that cannot be used"):
        download(collection, tmp_path, base_url=site.url)
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize("collection", ["2001", "2005-third"])
def test_a_web_page_is_not_an_archive(
    site: Site, made_up: dict[str, bytes], tmp_path: Path, collection: str
) -> None:
    site.files.update(official(collection, made_up))
    site.files[next(iter(site.files))] = b"\n<!DOCTYPE html><html><body>Log in first</body></html>"
    with refused(tmp_path, ValueError, "sent a web page instead of the file"):
        download(collection, tmp_path, base_url=site.url)
    assert left_behind(tmp_path) == []


def test_a_flipped_bit_in_an_archive_is_noticed(third: Site, tmp_path: Path) -> None:
    content = bytearray(archive({"Art/view1.png": bytes(range(256)) * 8}))
    content[60] ^= 1
    third.files[ART] = bytes(content)
    with refused(tmp_path, ValueError, "Art-2views.zip sent a file that cannot be used"):
        download("2005-third", tmp_path, base_url=third.url)
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize(
    "name", ["../evil", "Art/../../evil", "/evil", "C:\\evil", "..\\evil", "\\evil"]
)
def test_an_archive_that_would_write_elsewhere_is_refused(
    third: Site, tmp_path: Path, name: str
) -> None:
    third.files[ART] = archive({"Art/view1.png": b"", name: b"evil"})
    with refused(tmp_path, ValueError, "would be written elsewhere: .*evil"):
        download("2005-third", tmp_path, base_url=third.url)
    assert left_behind(tmp_path) == []


def test_an_archive_that_grows_absurdly_is_refused(third: Site, tmp_path: Path) -> None:
    third.files[ART] = archive(
        {f"Art/{name}": bytes(1 << 23) for name in range(9)}, zipfile.ZIP_DEFLATED
    )
    with refused(tmp_path, ValueError, r"said to have 75497472 bytes, more than 7\d{7}$"):
        download("2005-third", tmp_path, base_url=third.url)
    assert left_behind(tmp_path) == []


def test_an_archive_without_its_scene_is_not_installed(third: Site, tmp_path: Path) -> None:
    third.files[MOEBIUS] = archive({"Moebius/README.txt": b"moved"})
    with refused(tmp_path, ValueError, "for 2005-third has 5 scenes, not 6; it is not installed"):
        download("2005-third", tmp_path, base_url=third.url)
    assert left_behind(tmp_path) == []  # nor is it trusted from now on


def test_a_known_hash_is_checked(
    third: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = third.files[ART]
    assert isinstance(content, bytes)
    is_known = hashlib.sha256(content).hexdigest()
    for known in ("0" * 64, is_known):
        entry = downloads._registry()["2005-third"]
        entry.sha256["Art"] = known  # type: ignore[index] # a dict, which only the module may not change
        monkeypatch.setattr(downloads, "_registry", lambda entry=entry: {"2005-third": entry})
        if known == is_known:
            assert download("2005-third", tmp_path, base_url=third.url).is_dir()
        else:
            message = (
                f"expected {known} but got {is_known}.*The known hash is that of downloads.toml"
            )
            with refused(tmp_path, ValueError, message):
                download("2005-third", tmp_path, base_url=third.url)
            assert left_behind(tmp_path) == []


def test_a_hash_recorded_at_the_first_download_is_checked_at_the_next(
    third: Site, tmp_path: Path
) -> None:
    installed = download("2005-third", tmp_path, base_url=third.url)
    first, changed = third.files[ART], archive({"Art/view1.png": b"something else"})
    assert isinstance(first, bytes)
    for path in sorted(installed.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    installed.rmdir()
    third.files[ART] = changed
    expected, got = (hashlib.sha256(content).hexdigest() for content in (first, changed))
    with refused(
        tmp_path, ValueError, f"expected {expected} but got {got}.*that of .*2005-third.sha256.json"
    ):
        download("2005-third", tmp_path, base_url=third.url)
    assert left_behind(tmp_path) == ["2005-third.sha256.json"]
    third.files[ART] = first
    assert download("2005-third", tmp_path, base_url=third.url) == installed


@pytest.mark.parametrize("content", ["", "[]", "null", "{"])
def test_a_damaged_record_of_hashes_is_not_ignored(
    third: Site, tmp_path: Path, content: str
) -> None:
    (tmp_path / "2005-third.sha256.json").write_text(content)
    with refused(tmp_path, ValueError, "2005-third.sha256.json"):
        download("2005-third", tmp_path, base_url=third.url)
    assert third.requests == []


NO_SPACE = OSError(errno.ENOSPC, "No space left on device")


def write_half(_: object, __: str, output_file: str, ___: object) -> None:
    Path(output_file).write_bytes(b"half of it")
    raise NO_SPACE


def unpack_one(archive: zipfile.ZipFile, path: Path) -> None:
    archive.extract(archive.namelist()[0], path)
    raise NO_SPACE


@pytest.mark.parametrize(
    ("place", "fill"),
    [("pooch.HTTPDownloader.__call__", write_half), ("zipfile.ZipFile.extractall", unpack_one)],
)
def test_a_full_disk_is_told_and_cleaned_up(
    third: Site, tmp_path: Path, place: str, fill: Callable[..., None]
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place, fill)
        with refused(tmp_path, OSError, "No space left on device"):
            download("2005-third", tmp_path, base_url=third.url)
    assert not [name for name in left_behind(tmp_path) if "tree" in name or "tmp" in name]
    assert download("2005-third", tmp_path, base_url=third.url).is_dir()


def test_what_is_there_but_not_complete_is_told_and_left_alone(third: Site, tmp_path: Path) -> None:
    folder = download("2005-third", tmp_path, base_url=third.url)
    (folder / "scenes2005" / "ThirdSize" / "Art" / "view1.png").unlink()
    third.requests.clear()
    with pytest.raises(ValueError, match=r"2005-third has 5 scenes, not the 6 .*: remove it"):
        download("2005-third", tmp_path, base_url=third.url)
    assert third.requests == []
    assert len(find_scenes(folder)) == 5


def test_a_folder_that_cannot_be_made_is_told(third: Site, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        download("2005-third", tmp_path / "file", base_url=third.url)
    assert third.requests == []
