"""Sources and sinks of moving pictures: real files, written and read back by PyAV and OpenCV."""

from __future__ import annotations

import math
import zlib
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo import io
from phasestereo.io.pair import LayoutError, views_of
from phasestereo.result import Result
from phasestereo.settings import Settings
from phasestereo.views.picture import NEUTRAL, colorize
from phasestereo_live.video import FramePicture, VideoWriter, writing
from phasestereo_live.video.decoding import open_video
from phasestereo_live.video.folders import open_folders, open_rig
from phasestereo_live.video.sources import open_source
from phasestereo_live.video.streaming import Frame
from support import counterpart, hostile
from support.footage import INTRA, LOSSLESS, damage, film, pair, side_by_side

av = counterpart("av")
cv2 = counterpart("cv2")


if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo_live.video.capture import Capture, CaptureSource


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def outcome(capture: Capture[Any]) -> Any:
    """Return the frames of a capture, or its message."""
    try:
        return capture.take()
    except (OSError, ValueError) as error:
        return str(error)


def outcomes(source: CaptureSource[Any]) -> list[Any]:
    """Return the frames of a source's captures; their numbers have no gap."""
    found = []
    for index, capture in enumerate(source.captures):
        assert capture.index == index
        found.append(outcome(capture))
    source.close()
    return found


def failures(found: list[Any]) -> dict[int, str]:
    return {index: said for index, said in enumerate(found) if isinstance(said, str)}


# Decoding


def test_frames_arrive_as_they_were_filmed() -> None:
    pictures = side_by_side(5)
    source = open_video(film(Path("a.mkv"), pictures, **LOSSLESS))
    assert source.rate == 20
    np.testing.assert_array_equal(outcomes(source), pictures)


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"crf": "1"}),  # with frames that are decoded out of order
        ("a.avi", "libx264", {"crf": "1"}),  # which AVI has no times for
        ("a.h264", "libx264", {"crf": "1"}),  # and bare H.264 no times at all
        ("a.webm", "libvpx", {"auto-alt-ref": "1", "lag-in-frames": "8", "b": "4M"}),
        ("a.avi", "mpeg4", {"bf": "2", "b": "4M"}),
    ],
)
def test_every_frame_is_counted_once(name: str, codec: str, options: dict[str, str]) -> None:
    pictures = side_by_side(20)
    film(Path(name), pictures, codec=codec, pixels="yuv420p", options=options)

    found = outcomes(open_video(name))
    assert failures(found) == {}
    assert len(found) == 20

    for one, other in zip(found, pictures, strict=True):
        near = [abs(one.astype(int) - picture).mean() for picture in pictures]
        assert pictures[int(np.argmin(near))] is other


def test_gray_stays_gray_and_deep_pixels_stay_deep() -> None:
    deep = np.random.default_rng(0).integers(0, 2**16, (32, 48), np.uint16)
    film(Path("gray16.mkv"), [deep], codec="ffv1", pixels="gray16le", form="gray16le")
    np.testing.assert_array_equal(outcomes(open_video("gray16.mkv")), [deep])

    shallow = (deep >> 8).astype(np.uint8)
    film(Path("gray.mkv"), [shallow], codec="ffv1", pixels="gray", form="gray")
    np.testing.assert_array_equal(outcomes(open_video("gray.mkv")), [shallow])

    color = side_by_side(1)
    film(Path("ten.mkv"), color, codec="ffv1", pixels="yuv444p10le")

    (found,) = outcomes(open_video("ten.mkv"))
    assert found.dtype == np.uint16
    np.testing.assert_allclose(found / 257.0, color[0], atol=4)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_frames_are_turned_upright(turns: int) -> None:
    picture = side_by_side(1)[0]
    lying = np.ascontiguousarray(np.rot90(picture, -turns))
    film(Path("a.mov"), [lying], codec="png", pixels="rgb24", turned=90 * turns)
    np.testing.assert_array_equal(outcomes(open_video("a.mov")), [picture])


def test_damaged_frames_are_lost_and_the_others_keep_their_numbers() -> None:
    pictures = side_by_side(10)

    whole = film(Path("a.mkv"), pictures, **INTRA)
    found = outcomes(open_video(damage(whole, Path("b.mkv"), {2, 3, 9})))
    assert set(failures(found)) == {2, 3, 9}
    assert all("damaged" in said for said in failures(found).values())

    expected = outcomes(open_video(whole))
    for index in set(range(10)) - {2, 3, 9}:
        np.testing.assert_array_equal(found[index], expected[index])


def test_frames_that_build_on_a_damaged_one_still_have_their_numbers() -> None:
    pictures = side_by_side(20)
    film(Path("a.mp4"), pictures, codec="libx264", pixels="yuv420p", options={"crf": "5"})
    found = outcomes(open_video(damage(Path("a.mp4"), Path("b.mp4"), {7, 8})))
    assert len(found) == 20
    assert failures(found)


@pytest.mark.parametrize("name", ["a.mkv", "a.avi"])
def test_truncated_video_gives_what_there_is(name: str) -> None:
    whole = film(Path(name), side_by_side(10), **INTRA)
    expected = outcomes(open_video(name))
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size * 6 // 10])
    found = outcomes(open_video(name))
    good = [one for one in found if not isinstance(one, str)]
    assert 2 <= len(good) < 10
    np.testing.assert_array_equal(good, expected[: len(good)])


def test_what_is_no_video_is_refused() -> None:
    Path("text.mp4").write_text("no video")

    with pytest.raises(ValueError, match="^text.mp4: damaged, or no video"):
        open_video("text.mp4")

    with av.open("sound.mka", "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        sound.rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))

    with pytest.raises(ValueError, match="^sound.mka: there is no video"):
        open_video("sound.mka")


# Both views


def test_frames_of_more_pixels_than_a_picture_may_have_are_not_decoded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever the file says that they have."""
    content = hostile.png(640, 480, 0, zlib.compress(bytes(641 * 480)))
    with av.open("a.avi", "w") as file:
        stream = file.add_stream("png", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray"
        packet = av.Packet(content)
        packet.stream, packet.pts, packet.dts, packet.time_base = stream, 0, 0, Fraction(1, 10)
        file.mux(packet)

    (whole,) = outcomes(open_video("a.avi"))
    assert whole.shape == (480, 640)
    monkeypatch.setenv("PHASESTEREO_MAX_PIXELS", "307199")
    assert outcomes(open_video("a.avi")) == ["damaged (Invalid argument)"]


def test_halves() -> None:
    picture = np.arange(24).reshape(4, 6)
    left, right = views_of(picture, "side-by-side")
    assert (left.shape, right[0, 0]) == ((4, 3), 3)

    left, right = views_of(picture, "top-bottom")
    assert (left.shape, right[0, 0]) == ((2, 6), 12)

    with pytest.raises(LayoutError, match="needs two columns or more, got 1 x 4"):
        views_of(picture[:, :1], "side-by-side")
    with pytest.raises(LayoutError, match="needs two rows or more, got 6 x 1"):
        views_of(picture[:1], "top-bottom")


def test_two_videos_end_with_the_shorter_one() -> None:
    film(Path("l.mkv"), [pair(index)[0] for index in range(6)], **LOSSLESS)
    film(Path("r.mkv"), [pair(index)[1] for index in range(4)], **LOSSLESS)
    found = outcomes(open_source("l.mkv", "r.mkv"))
    assert failures(found) == {4: "the right view ends after 4 frames, the left one goes on"}
    for index in range(4):
        np.testing.assert_array_equal(found[index], pair(index))


# Folders


def write(path: str, value: int) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    io.write_image(path, np.full((2, 2), value, np.uint8))


def values(found: list[Any]) -> list[tuple[int, int]]:
    return [(int(left[0, 0]), int(right[0, 0])) for left, right in found]


def test_images_are_sorted_as_people_count_and_paired_by_name() -> None:
    for index in (2, 10, 1):
        write(f"l/frame{index}.png", index)
        write(f"r/frame{index}.bmp", 100 + index)

    write("l/frame11.png", 11)
    Path("l/notes.txt").write_text("no image")

    source = open_folders(Path("l"), Path("r"))
    assert source.length == 4

    found = outcomes(source)
    assert values(found[:3]) == [(1, 101), (2, 102), (10, 110)]
    assert set(failures(found)) == {3}
    assert "r/frame11" in found[3]


def test_images_without_common_names_are_paired_in_order() -> None:
    for index in range(9, 12):
        write(f"l/a{index}.png", index)
        write(f"r/b{index + 5}.png", 100 + index)
    assert values(outcomes(open_folders(Path("l"), Path("r")))) == [(9, 109), (10, 110), (11, 111)]
    write("r/b99.png", 0)
    with pytest.raises(ValueError, match=r"^right: got 4 images in r for 3 in l"):
        open_folders(Path("l"), Path("r"))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left/1.png", "right/1.png"),
        ("cam0/data/7.png", "cam1/data/7.png"),
        ("image_2/000000_10.png", "image_3/000000_10.png"),
        ("left_01.png", "right_01.png"),
        ("x_Left.png", "x_Right.png"),
        ("left01.png", "right01.png"),
    ],
)
def test_views_of_a_rig_are_found(left: str, right: str) -> None:
    write(f"rig/{left}", 1)
    write(f"rig/{right}", 2)
    assert values(outcomes(open_rig(Path("rig")))) == [(1, 2)]


def test_folder_that_is_no_rig_is_refused() -> None:
    write("some/a.png", 1)
    with pytest.raises(ValueError, match="^source: some has neither folders left and right"):
        open_rig(Path("some"))
    Path("empty").mkdir()
    with pytest.raises(ValueError, match="^empty: there is no image"):
        open_folders(Path("some"), Path("empty"))


# Cameras: OpenCV opens a video file just as it opens a camera, and reads it in the same way


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> dict[int, str]:
    """Return the video that each camera shows, by its number; there is no other camera."""
    shown: dict[int, str] = {}
    device = cv2.VideoCapture
    monkeypatch.setattr(cv2, "VideoCapture", lambda number: device(shown.get(number, "none.avi")))
    return shown


def test_cameras_give_pairs_in_rgb(plugged: dict[int, str]) -> None:
    film(Path("l.avi"), [pair(index)[0] for index in range(3)], **LOSSLESS)
    film(Path("r.avi"), [pair(index)[1] for index in range(3)], **LOSSLESS)
    plugged.update({0: "l.avi", 2: "r.avi"})
    source = open_source(0, 2)
    assert source.rate == 20
    found = outcomes(source)
    np.testing.assert_array_equal(found[:3], [pair(index) for index in range(3)])


def test_cameras_that_are_gone_end_the_source(plugged: dict[int, str]) -> None:
    film(Path("l.avi"), [pair(index)[0] for index in range(3)], **LOSSLESS)
    film(Path("r.avi"), [pair(index)[1] for index in range(2)], **LOSSLESS)
    plugged.update({0: "l.avi", 1: "r.avi"})

    source = open_source(0, 1)
    captures = list(source.captures)
    assert len(captures) == 2 + 5
    assert outcome(captures[2]) == "camera 1: gave no frame"
    assert outcome(captures[-1]).endswith("and is given up")

    times = [capture.time for capture in captures]
    assert all(time is not None for time in times)
    assert times == sorted(times, key=lambda time: time or 0)


def test_one_camera_may_deliver_both_views(plugged: dict[int, str]) -> None:
    plugged[4] = str(film(Path("a.avi"), side_by_side(2), **LOSSLESS))
    captures = open_source(4).captures
    np.testing.assert_array_equal(next(captures).take(), pair(0))


@pytest.mark.usefixtures("plugged")
def test_missing_camera_is_refused() -> None:
    with pytest.raises(OSError, match="^camera 3: cannot be opened"):
        open_source(3)


# What is meant


@pytest.mark.parametrize(
    ("source", "right", "layout", "error", "message"),
    [
        (3.5, None, None, TypeError, "source: got float"),
        (True, None, None, TypeError, "source: got bool"),
        ("a.mkv", 1, None, TypeError, "right: got int beside str"),
        (np.zeros((2, 2)), np.zeros((2, 2)), None, TypeError, "right: got ndarray"),
        (1, 1, None, ValueError, "right: got camera 1, which is the left one"),
        ("a.mkv", "a.mkv", "top-bottom", ValueError, "layout: got 'top-bottom' beside right"),
        ("a.mkv", None, "left-right", ValueError, "layout: got 'left-right'; accepts"),
        ("a.mkv", ".", None, ValueError, "right: got . beside a.mkv, a folder and a file"),
    ],
)
def test_other_sources_are_refused(
    source: Any, right: Any, layout: Any, error: type[Exception], message: str
) -> None:
    film(Path("a.mkv"), side_by_side(1), **LOSSLESS)
    with pytest.raises(error, match=f"^{message}"):
        open_source(source, right, layout=layout)


# Pictures


def frame(disparity: NDArray[np.float32], left: NDArray[Any]) -> Frame:
    flags = np.zeros(disparity.shape, np.uint16)
    return Frame(0, None, left, left, Result(disparity, flags, None, Settings(), {}))


def test_picture_is_the_left_image_beside_the_colors() -> None:
    disparity = np.random.default_rng(0).uniform(-2, 30, (20, 30)).astype(np.float32)
    disparity[3, 4] = np.nan
    left = np.random.default_rng(1).integers(0, 256, (20, 30, 3), np.uint8)

    picture = FramePicture(0, 24)(frame(disparity, left))
    np.testing.assert_array_equal(picture[:, :30], left)
    assert tuple(picture[3, 34]) == NEUTRAL

    expected = colorize(disparity, low=0, high=24).astype(int)
    assert abs(picture[:, 30:] - expected).max() <= 10  # one step of the colors at most


def test_gray_and_deep_images_are_shown_beside_the_colors() -> None:
    gray = np.arange(256, dtype=np.uint8).reshape(16, 16)
    disparity = np.zeros((16, 16), np.float32)
    for image in (gray, gray.astype(np.uint16) * 257):
        picture = FramePicture(0, 1)(frame(disparity, image))
        np.testing.assert_array_equal(picture[:, :16], np.dstack([gray] * 3))


def test_colors_need_a_range() -> None:
    with pytest.raises(ValueError, match="^low: got 4; accepts less than high"):
        FramePicture(4, 4)
    with pytest.raises(ValueError, match="^low: got 0 and high inf; accepts finite"):
        FramePicture(0, math.inf)


# Writing


def smooth(index: int, rows: int = 31, cols: int = 45) -> NDArray[np.uint8]:
    """Return a picture of odd size that coding hardly changes."""
    y, x = np.mgrid[:rows, :cols]
    return np.dstack([4 * x, 6 * y, 20 * index + 0 * x]).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", ["a.mp4", "a.mov", "a.mkv", "a.m4v", "A.MP4"])
def test_video_is_read_back_by_pyav_and_opencv(name: str) -> None:
    pictures = [smooth(index) for index in range(8)]
    with VideoWriter(name, rate=10) as writer:
        for picture in pictures:
            writer.write(picture)

    assert [path.name for path in Path().iterdir()] == [name]
    with av.open(name) as container:
        frames = list(container.decode(video=0))
    assert [item.time for item in frames] == pytest.approx([index / 10 for index in range(8)])
    assert (frames[0].width, frames[0].height) == (46, 32)

    capture = cv2.VideoCapture(name)
    assert round(capture.get(cv2.CAP_PROP_FPS)) == 10

    for item, picture in zip(frames, pictures, strict=True):
        there, bgr = capture.read()
        assert there
        for shown in (item.to_ndarray(format="rgb24"), bgr[:, :, ::-1]):
            inner = abs(shown[:28, :40].astype(int) - picture[:28, :40])
            assert inner.mean() < 6
    assert not capture.read()[0]


def test_times_are_kept() -> None:
    times = [100.0, 100.04, 100.5, 100.5, 100.2, 101.0]  # one is given twice, one goes back
    with VideoWriter("a.mp4") as writer:
        for index, time in enumerate(times):
            writer.write(smooth(index), time)
    with av.open("a.mp4") as container:
        found = [item.time for item in container.decode(video=0)]
    assert found == pytest.approx([0, 0.04, 0.5, 0.501, 0.502, 1.0], abs=1e-4)


def test_error_half_way_leaves_what_was_written() -> None:
    with pytest.raises(RuntimeError), VideoWriter("a.mp4") as writer:  # noqa: PT012 - the block is what is tested
        writer.write(smooth(0))
        writer.write(smooth(1))
        raise RuntimeError
    assert len(outcomes(open_video("a.mp4"))) == 2


def test_without_a_picture_an_earlier_file_stays() -> None:
    Path("a.mp4").write_text("precious")
    with VideoWriter("a.mp4"):
        pass
    assert Path("a.mp4").read_text() == "precious"
    assert len(list(Path().iterdir())) == 1


def test_picture_of_another_size_is_refused_and_the_rest_written() -> None:
    with VideoWriter("a.mkv") as writer:
        writer.write(smooth(0))
        with pytest.raises(ValueError, match="^picture: got 20 x 10 pixels; accepts 45 x 31"):
            writer.write(smooth(0, 10, 20))
        with pytest.raises(ValueError, match=r"^picture: got shape \(0, 45, 3\)"):
            writer.write(smooth(0)[:0])
        with pytest.raises(TypeError, match="^picture: got list"):
            writer.write(smooth(0).tolist())
        with pytest.raises(TypeError, match="^picture: got float64"):
            writer.write(np.zeros((31, 45, 3)))  # type: ignore[arg-type] # on purpose
        with pytest.raises(ValueError, match=r"^picture: got shape \(31, 45\)"):
            writer.write(np.zeros((31, 45), np.uint8))
        writer.write(smooth(1))

    assert len(outcomes(open_video("a.mkv"))) == 2


def test_times_that_are_none_are_refused_and_later_ones_kept() -> None:
    with VideoWriter("a.mkv") as writer:
        for time in (math.nan, math.inf):
            with pytest.raises(ValueError, match="^time: got (nan|inf); accepts finite"):
                writer.write(smooth(0), time)

        writer.write(smooth(0), 3.0)
        writer.write(smooth(1), 3.5)

    with av.open("a.mkv") as container:
        assert [frame.time for frame in container.decode(video=0)] == [0, 0.5]


def test_closed_video_takes_no_more() -> None:
    with VideoWriter("a.mkv") as writer:
        writer.write(smooth(0))
    with pytest.raises(ValueError, match="closed"):
        writer.write(smooth(1))
    assert [path.name for path in Path().iterdir()] == ["a.mkv"]


@pytest.mark.parametrize("rate", [0, math.inf])
def test_rates_that_are_none_are_refused(rate: float) -> None:
    with pytest.raises(ValueError, match=f"^rate: got {rate}"):
        VideoWriter("a.mp4", rate=rate)


def test_mpeg4_where_there_is_no_h264(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(writing._CODECS, "libx264")
    with VideoWriter("a.mp4", rate=float(Fraction(30000, 1001))) as writer:
        for index in range(5):
            writer.write(smooth(index))
    with av.open("a.mp4") as container:
        assert container.streams.video[0].codec_context.name == "mpeg4"
        assert len(list(container.decode(video=0))) == 5
