"""The page of ``phasestereo live --show``: what it answers, whom, and what it makes of frames."""

from __future__ import annotations

import http.client
import http.cookies
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import Calibration, read_image
from phasestereo_live.video.streaming import Failure, stream
from phasestereo_live.viewer import Display, Server
from phasestereo_live.viewer.diagnosing import diagnosing
from support import counterpart
from support.live_frames import COLS, COUNT, FAST, LEFT, RIGHT, ROWS, frame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray


for needed in ("jinja2", "matplotlib", "PIL"):
    counterpart(needed)


@pytest.fixture
def show(tmp_path: Path) -> Display:
    return Display(FAST, COUNT, tmp_path)


@pytest.fixture
def server(show: Display) -> Iterator[Server]:
    with Server(show) as opened:
        yield opened
        show.close()


class Answer:
    """What came back."""

    def __init__(self, response: http.client.HTTPResponse) -> None:
        self.status, self.headers, self.body = response.status, response.headers, response.read()

    def json(self) -> Any:
        return json.loads(self.body, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def request(
    server: Server, path: str, method: str = "GET", content: str | None = None, **headers: str
) -> Answer:
    """Ask the server for a path from the root."""
    host = server.address.split("/")[2]
    sent = {"Host": host} | {name.replace("_", "-"): value for name, value in headers.items()}
    connection = http.client.HTTPConnection(host, timeout=20)
    try:
        connection.request(method, path, content, sent)
        return Answer(connection.getresponse())
    finally:
        connection.close()


def let_in(server: Server) -> tuple[str, str]:
    """Return the room of the page, and the cookie, as a browser gets them for the address."""
    answer = request(server, "/" + server.address.split("/")[3])
    cookie = http.cookies.SimpleCookie(answer.headers["Set-Cookie"])["phasestereo"]
    assert (cookie["httponly"], cookie["samesite"]) == (True, "Strict")
    assert f'url={cookie["path"]}"' in answer.body.decode()
    return cookie["path"], f"phasestereo={cookie.value}"


def ask(server: Server, path: str, method: str = "GET", body: Any = None, **headers: str) -> Answer:
    """Ask the server as a browser would that was let in."""
    room, cookie = let_in(server)
    if method == "POST":
        headers.setdefault("Content_Type", "application/json")
    content = None if body is None else json.dumps(body)
    return request(server, room + path, method, content, **{"Cookie": cookie, **headers})


# Who is answered


@pytest.mark.parametrize("path", ["", "viewer.js", "state?after=-2", "frame"])
def test_only_who_was_let_in_is_answered(server: Server, show: Display, path: str) -> None:
    show.add(frame())
    assert ask(server, path).status == 200

    room, cookie = let_in(server)
    key = server.address.split("/")[3]
    assert min(len(key), len(room) - 2, len(cookie.split("=")[1])) >= 20
    refused = [
        request(server, room + path),
        request(server, room + path, Cookie=cookie[:-1]),
        request(server, room + path, Cookie="\x7f"),
        request(server, room + path, Cookie=f"phasestereo={key}"),
        request(server, f"/{key}/{path}", Cookie=cookie),
        request(server, f"/{path}", Cookie=cookie),
        request(server, f"/{key[:-1]}"),
    ]
    assert {(answer.status, answer.body) for answer in refused} == {(403, b"Forbidden\n")}


def test_only_this_machine_by_its_own_name_is_answered(server: Server) -> None:
    """A name that leads here, as DNS rebinding makes one, is another Host."""
    port = server.address.split(":")[2].split("/")[0]
    assert server.address.startswith("http://127.0.0.1:")
    assert ask(server, "", Host=f"localhost:{port}").status == 200
    for host in (f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{int(port) + 1}", ""):
        assert ask(server, "", Host=host).status == 403
        assert request(server, "/" + server.address.split("/")[3], Host=host).status == 403


def test_idle_connections_make_room_and_are_dropped(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phasestereo_live.viewer.server._Handler.timeout", 0.5)
    place = "127.0.0.1", int(server.address.split(":")[2].split("/")[0])
    threads = threading.active_count()

    idle = [socket.create_connection(place) for _ in range(1000)]
    assert threading.active_count() - threads <= 40
    assert ask(server, "").status == 200
    for one in idle:
        one.settimeout(20)
        assert one.recv(1) == b""
        one.close()


def test_pages_of_others_change_nothing(server: Server, show: Display) -> None:
    origin = server.address.rsplit("/", 1)[0]
    wanted = {"uniqueness": 7}

    refused = [
        ask(server, "settings", "POST", wanted, Origin="http://evil.example"),
        ask(server, "settings", "POST", wanted, Origin="null"),
        ask(server, "settings", "POST", wanted, Content_Type="text/plain"),
        ask(server, "settings", "POST", {"uniqueness": 7, "": "x" * 5000}),
        ask(server, "nothing", "POST", wanted),
        ask(server, "settings"),
        ask(server, "settings", "PUT", wanted),
    ]

    assert [answer.status for answer in refused] == [403, 403, 404, 413, 404, 404, 501]
    assert show.settings == FAST

    assert ask(server, "settings", "POST", wanted, Origin=origin).status == 200
    assert show.settings.uniqueness == 7


def test_answers_are_kept_by_nobody_and_load_nothing_foreign(server: Server) -> None:
    headers = ask(server, "").headers
    assert headers["Cache-Control"] == "no-store"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "Access-Control-Allow-Origin" not in headers

    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self'" in policy
    assert "http" not in policy


# What is shown


def test_news_come_as_soon_as_there_are_any(server: Server, show: Display) -> None:
    first = ask(server, "state?after=-1").json()
    assert first["frame"] is None

    given = frame(3)
    told = replace(given.result, summary=ps.Summary(1, 0, 0, 0, 0.6, 0.41, 0, 0, 0, np.nan))
    threading.Timer(0.2, show.add, [replace(given, result=told)]).start()
    response = ask(server, f"state?after={first['version']}").json()
    assert response["version"] > first["version"]

    shown = response["frame"]
    assert (shown["index"], shown["width"], shown["height"]) == (3, COLS, ROWS)
    assert shown["verdict"] == "about 41 % of the pixels are probably wrong"
    assert shown["trusted"] == round(100 * told.trusted.mean(), 1)


def test_a_frame_comes_with_its_geometry(server: Server, show: Display) -> None:
    assert ask(server, "frame").status == 400
    show.add(frame(4))
    assert geometry(ask(server, "frame")) == (4, None)
    assert json.loads(ask(server, "frame").body[4:].partition(b"}")[0] + b"}")["ends"] == [0, COUNT]
    show.know(Calibration.from_focal(100, 0.2, width=COLS + 1, height=ROWS), "m")
    show.add(frame(5))
    assert geometry(ask(server, "frame")) == (5, None), "of frames of another size"

    show.know(Calibration.from_focal(100, 0.2, width=COLS, height=ROWS), "m")
    show.add(frame(6))
    index, scene = geometry(ask(server, "frame"))
    assert (index, scene["scale"], scene["unit"]) == (6, 20, "m")


def geometry(answer: Answer) -> tuple[int, Any]:
    """Return the number of a frame, and what makes points of its pixels."""
    length = int.from_bytes(answer.body[:4], "little")
    head = json.loads(answer.body[4 : 4 + length])
    return head["index"], head["scene"]


def test_what_fails_is_said_and_counted(server: Server, show: Display) -> None:
    for index in range(3):
        show.fail(Failure(index, None, OSError("camera 1: gave no frame")))
    response = ask(server, "state?after=-1").json()
    assert response["failure"] == {"text": "camera 1: gave no frame", "times": 3}
    assert response["failed"] == 3
    show.fail(Failure(3, None, ValueError("right: got 4 rows")))
    assert ask(server, "state?after=-1").json()["failure"]["times"] == 1


def test_cameras_that_are_not_synchronized_are_reported(server: Server, show: Display) -> None:
    show.add(frame(0, 0.02))
    (note,) = ask(server, "state?after=-1").json()["notes"]
    assert note.startswith("the cameras are not synchronized: the right one comes 20 ms later")
    show.add(frame(1, 0.001))
    assert not ask(server, "state?after=-1").json()["notes"]


def test_findings_are_those_of_check_the_worst_first(show: Display) -> None:
    show.add(frame())
    thread = diagnosing(show)
    for version in range(100):
        state = show.wait(version, 0.2)
        if state["findings"]:
            break

    show.close()
    thread.join()

    expected = [[one.topic, one.severity, one.sentence] for one in ps.check(LEFT, RIGHT).findings]
    assert sorted(state["findings"]) == sorted(expected)

    order = [["warning", "note", "ok"].index(severity) for _, severity, _ in state["findings"]]
    assert order == sorted(order)


# What can be done


def test_settings_change_the_coming_frames(server: Server, show: Display) -> None:
    pairs = iter([(LEFT, RIGHT)] * 2)
    with stream(pairs, num_disparities=COUNT, settings=FAST) as frames:
        show.follow(frames.change)

        show.add(next(frames))
        wanted = {"p1": 1.5, "p2": 9, "uniqueness": 20, "speckle_size": 30, "fill": 0}
        answer = ask(server, "settings", "POST", wanted | {"num_disparities": 8})
        assert (answer.status, answer.json()) == (200, {})
        found = next(frames).result

    assert (found.settings.p1, found.settings.p2) == (1.5, 9.0)
    assert (found.settings.uniqueness, found.settings.speckle_size) == (20, 30)
    assert not found.settings.fill
    assert found.search is not None
    assert found.search.num_disparities == 8

    response = ask(server, "state?after=-1").json()["settings"]
    assert response == wanted | {"num_disparities": 8}


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"p1": -1}, "p1: got -1; accepts 0 to 100"),
        ({"p1": "9"}, "p1: got str; accepts a number"),
        ({"fill": True}, "fill: got bool; accepts a number"),
        ({"window": 5}, "window: is not a setting; accepts p1"),
        ({"num_disparities": 500}, "num_disparities: got 500"),
        ([1], "settings: got list; accepts an object"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    server: Server, show: Display, wanted: Any, message: str
) -> None:
    with stream(iter([(LEFT, RIGHT)] * 2), num_disparities=COUNT, settings=FAST) as frames:
        show.follow(frames.change)
        show.add(next(frames))

        answer = ask(server, "settings", "POST", wanted)
        assert answer.status == 400
        assert answer.json()["error"].startswith(message)
        assert next(frames).result.settings == FAST
    assert show.settings == FAST


@pytest.mark.parametrize("body", ['{"p1": 1' + "0" * 400 + "}", "[" * 4000, '{"p1": 1e999}'])
def test_numbers_and_nesting_beyond_all_use_get_an_answer(
    server: Server, show: Display, body: str
) -> None:
    with stream(iter([(LEFT, RIGHT)] * 2), num_disparities=COUNT, settings=FAST) as frames:
        show.follow(frames.change)
        room, cookie = let_in(server)
        headers = {"Cookie": cookie, "Content_Type": "application/json"}
        assert request(server, room + "settings", "POST", body, **headers).status == 400


def test_a_pair_is_saved_with_its_report(server: Server, show: Display, tmp_path: Path) -> None:
    assert ask(server, "save", "POST").json() == {"error": "there is no pair to save yet"}

    show.add(frame(7))
    for stem in ("pair-000007", "pair-000007-2"):
        response = ask(server, "save", "POST").json()
        names = [f"{stem}-left.png", f"{stem}-right.png", f"{stem}.html"]
        assert response == {"saved": names, "folder": str(tmp_path)}
        np.testing.assert_array_equal(read_image(tmp_path / names[0]), LEFT)
        np.testing.assert_array_equal(read_image(tmp_path / names[1]), RIGHT)
        assert "16 disparities searched" in (tmp_path / names[2]).read_text("utf-8")

    assert len(list(tmp_path.iterdir())) == 6
    alone = [f"pair-000007-3-{side}.png" for side in ("left", "right")]
    assert ask(server, "save", "POST", body=False).json()["saved"] == alone
    assert len(list(tmp_path.iterdir())) == 8


def test_the_run_can_be_ended(server: Server, show: Display) -> None:
    assert ask(server, "close", "POST").status == 200
    assert show.closed
    assert ask(server, "state?after=99").json()["closed"] is True


# The command


def live(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, str, list[Any]]:
    """Run ``phasestereo live`` in this thread while another one looks at the page, then ends it."""
    cli = pytest.importorskip("phasestereo.cli")

    home = pytest.importorskip("phasestereo_live.cli.show")
    looked: list[Any] = []
    look: list[threading.Thread] = []

    class Watched(Server):
        def __enter__(self) -> Watched:
            super().__enter__()
            look.append(threading.Thread(target=watch, args=[self]))
            look[0].start()
            return self

    def watch(server: Server) -> None:
        state: dict[str, Any] = {"version": -1, "ended": ""}
        while not state["ended"]:
            state = ask(server, f"state?after={state['version']}").json()
            looked.append(state)
        looked.append(geometry(ask(server, "frame"))[1])
        ask(server, "close", "POST")

    monkeypatch.setattr(home, "Server", Watched)
    code = cli.run(["live", *arguments])
    look[0].join()
    return code, capsys.readouterr().err, looked


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with folders left and right of three frames."""
    monkeypatch.chdir(tmp_path)
    for side, image in (("left", LEFT), ("right", RIGHT)):
        Path(side).mkdir()
        for index in range(3):
            ps.io.write_image(f"{side}/{index}.png", image)
    return tmp_path


SEARCH = ("--num-disparities", str(COUNT), "--preset", "fast")


@pytest.mark.parametrize("option", [(), ("--show",)])
def test_live_shows_frames_until_it_is_ended(
    rig: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    option: tuple[str, ...],
) -> None:
    """Without an output it is what live does."""
    code, err, looked = live(monkeypatch, capsys, "left", "right", *option, *SEARCH)
    assert code == 0
    assert "phasestereo: look at http://127.0.0.1:" in err

    assert looked[-2]["frame"]["index"] == 2
    assert looked[-2]["ended"].startswith("no more frames come")
    assert sorted(path.name for path in rig.iterdir()) == ["left", "right"]


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are seen in /proc")
@pytest.mark.usefixtures("rig")
def test_no_command_line_and_no_environment_has_a_secret(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A browser that only waits stands for one: what /proc says of it, others may read."""
    browsers: list[subprocess.Popen[bytes]] = []
    seen: list[str] = []

    def visit(url: str) -> None:
        waiting = [sys.executable, "-c", "print(flush=True); input()", url]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        browsers.append(subprocess.Popen(waiting, **pipes))  # type: ignore[call-overload]  # noqa: S603
        browsers[0].stdout.readline()  # type: ignore[union-attr]  # it runs
        home = Path("/proc") / str(browsers[0].pid)
        seen.extend((home / name).read_text() for name in ("cmdline", "environ"))
        link = Path(url.removeprefix("file://"))
        seen.extend([link.read_text("utf-8"), oct(link.stat().st_mode & 0o777)])
        seen.append(oct(link.parent.stat().st_mode & 0o777))

    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setattr("webbrowser.open", visit)
    code, err, _ = live(monkeypatch, capsys, "left", "right", *SEARCH)
    browsers[0].communicate(b"\n")

    address = re.search(r"http://127\.0\.0\.1:\d+/(\S{20,})", err)
    assert code == 0
    assert address is not None
    command, environment, link, mode, folder_mode = seen
    assert "viewer.html" in command
    assert address[1] not in command + environment
    assert (address[0] in link, mode, folder_mode) == (True, "0o600", "0o700")
    assert not Path(re.search("file://([^\0]*)", command)[1]).exists()  # type: ignore[index]


# Prints what a user reads of processes and a file, and what the server says to who has nothing.
SNOOPING = """
for file in /proc/[0-9]*/cmdline /proc/[0-9]*/environ "$1"; do cat "$file" 2>/dev/null; done
exec 3<>"/dev/tcp/127.0.0.1/$2"
printf 'GET / HTTP/1.1\\r\\nHost: 127.0.0.1:%s\\r\\nConnection: close\\r\\n\\r\\n' "$2" >&3
cat <&3
"""


@pytest.mark.skipif(
    not (hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("bash")),
    reason="only root becomes another user",
)
def test_another_user_of_the_machine_learns_nothing(show: Display) -> None:
    with tempfile.TemporaryDirectory(prefix="phasestereo-") as home, Server(show) as server:
        link = server.write_link(Path(home) / "viewer.html")
        _, _, host, key = server.address.split("/")
        room, cookie = let_in(server)

        def learned(user: int) -> str:
            program = ["bash", "-c", SNOOPING, "bash", str(link), host.partition(":")[2]]
            done = subprocess.run(  # noqa: S603 -- ours
                program, user=user, group=user, extra_groups=(), cwd="/", capture_output=True,
                check=True, timeout=30,
            )  # fmt: skip
            return done.stdout.decode(errors="replace")

        ours, theirs = learned(0), learned(65_534)

    secrets = key, room.strip("/"), cookie.partition("=")[2]
    assert (key in ours, [one for one in secrets if one in theirs]) == (True, [])
    assert "403 Forbidden" in theirs


def test_frames_of_another_size_are_said_and_do_not_end_the_run(
    rig: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ps.io.write_image(rig / "right/1.png", RIGHT[:-2])
    code, err, looked = live(monkeypatch, capsys, "left", "right", "--show", *SEARCH)
    assert code == 0
    assert "skipped frame 1: right: got" in err
    assert any(
        (state["failure"] or {}).get("text", "").startswith("right: got") for state in looked[:-1]
    )
    assert (looked[-2]["frame"]["index"], looked[-2]["failed"]) == (2, 1)


def test_a_wrong_calibration_is_reported_once_and_at_once(
    rig: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = "[100 0 45; 0 100 30; 0 0 1]"
    lines = [f"cam0={camera}", f"cam1={camera}", "doffs=0", "baseline=120", f"width={2 * COLS}"]
    (rig / "calib.txt").write_text("\n".join([*lines, f"height={ROWS}"]))
    more = "--calib", "calib.txt", *SEARCH

    _, err, looked = live(monkeypatch, capsys, "left", "right", "--show", *more)
    assert err.count("calibration: got that of 180 x 60 pixels") == 1
    assert looked[-2]["notes"][0].endswith("there are no depths")
    assert looked[-1] is None

    (rig / "calib.txt").write_text("\n".join([*lines[:4], f"width={COLS}", f"height={ROWS}"]))
    _, err, looked = live(monkeypatch, capsys, "left", "right", "--show", *more)
    assert looked[-1]["unit"] == "mm"
    assert "calibration" not in err


def test_a_camera_that_stops_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is opened again, and its frames go on with their numbers."""
    cv2 = counterpart("cv2")
    opened: list[int] = []
    monkeypatch.setattr("phasestereo_live.video.cameras.sleep", lambda _: None)

    class Camera:
        """Delivers two frames each time that it is opened."""

        def __init__(self, number: int) -> None:
            self.open(number)

        def open(self, number: int) -> None:
            self.left = 2
            opened.append(number)

        def grab(self) -> bool:
            self.left -= 1
            return self.left >= 0

        def retrieve(self) -> tuple[bool, NDArray[np.uint8]]:
            return True, np.zeros((4, 8, 3), np.uint8)

        def isOpened(self) -> bool:  # noqa: N802 - its name in OpenCV
            return True

        def set(self, *_: object) -> None: ...

        def release(self) -> None: ...

        def get(self, _: object) -> float:
            return 30.0

    monkeypatch.setattr(cv2, "VideoCapture", Camera)

    failures: list[Failure] = []
    settings: dict[str, Any] = {"num_disparities": 2, "preset": "fast"}

    with stream(0, 1, patience=None, on_error=failures.append, **settings) as frames:
        found = [next(frames) for _ in range(4)]
    assert [one.index for one in found] == [0, 1, 7, 8]
    assert all(one.apart is not None and one.apart >= 0 for one in found)
    assert [str(failure.error) for failure in failures] == ["camera 0: gave no frame"] * 5
    assert opened == [0, 1, 0, 1]

    with stream(0, 1, on_error=failures.append, **settings) as frames:
        assert len(list(frames)) == 2
    assert str(failures[-1].error) == "camera 0: gave no frame, and is given up"
