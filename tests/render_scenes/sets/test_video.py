"""Videos: equal pictures give equal bytes; the loss of H.264.

Which videos the frames of a set can make.
"""

from __future__ import annotations

import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.render_scenes.sets.video import as_key_frame, check_video, write_h264, write_mjpeg
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel

av = pytest.importorskip("av", reason="videos need the extra render")
ROOT_NODE = Path(__file__).parents[3]


def moving(count: int, size: tuple[int, int] = (96, 160)) -> list[NDArray[np.uint8]]:
    """Grey pictures of stripes that move by 2 px a frame, with noise."""
    x, random = np.arange(size[1]), np.random.default_rng(0)
    waves = [128.0 + 90.0 * np.sin((x - 2.0 * k) / 7.0) + random.normal(0.0, 3.0, size) for k in range(count)]
    return [np.clip(np.rint(wave), 0, 255).astype(np.uint8) for wave in waves]


@pytest.fixture
def pictures(tmp_path: Path) -> dict[str, list[Path]]:
    made: dict[str, list[Path]] = {"png": [], "jpg": []}
    for number, image in enumerate(moving(6)):
        for suffix, paths in made.items():
            paths.append(tmp_path / f"{number}.{suffix}")
            write_image(paths[-1], image)
    return made


def frames_of(path: Path) -> list[NDArray[np.uint8]]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


def test_an_avi_holds_the_jpeg_files_as_they_are(pictures: dict[str, list[Path]], tmp_path: Path) -> None:
    reported: list[int] = []
    write_mjpeg(tmp_path / "video.avi", pictures["jpg"], 29.97, reported.append)
    assert reported == [1, 2, 3, 4, 5, 6]
    with av.open(str(tmp_path / "video.avi")) as container:
        (stream,) = container.streams
        assert stream.codec_context.name == "mjpeg"
        assert stream.average_rate == Fraction(2997, 100)
        packets = [bytes(packet) for packet in container.demux(stream) if packet.size]
    assert packets == [path.read_bytes() for path in pictures["jpg"]]


def test_an_mp4_shows_the_pictures_at_their_rate(pictures: dict[str, list[Path]], tmp_path: Path) -> None:
    reported: list[int] = []
    write_h264(tmp_path / "video.mp4", pictures["png"], 25.0, 10, reported.append)
    assert reported == [1, 2, 3, 4, 5, 6]
    with av.open(str(tmp_path / "video.mp4")) as container:
        (stream,) = container.streams
        assert stream.codec_context.name == "h264"
        assert stream.average_rate == 25
        assert [frame.time for frame in container.decode(stream)] == pytest.approx([n / 25 for n in range(6)])
    shown = frames_of(tmp_path / "video.mp4")
    for got, image in zip(shown, moving(6), strict=True):
        # Black stays black and white white: the full range of 8 bits.
        assert np.abs(got.astype(int) - image).mean() < 1.5
        assert abs(got.astype(float).mean() - image.mean()) < 0.2
    assert np.ptp(np.stack(shown)) > 170


@pytest.mark.parametrize("rate_hz", [0.01, 23.976, 500.0])
def test_slow_and_fast_motions_keep_their_rate(rate_hz: float, pictures: dict[str, list[Path]], tmp_path: Path) -> None:
    write_mjpeg(tmp_path / "video.avi", pictures["jpg"], rate_hz, lambda count: None)
    write_h264(tmp_path / "video.mp4", pictures["png"], rate_hz, 20, lambda count: None)
    for name in ("video.avi", "video.mp4"):
        with av.open(str(tmp_path / name)) as container:
            times = [frame.time for frame in container.decode(video=0)]
        assert times == pytest.approx([number / rate_hz for number in range(6)], rel=1e-5)


def test_lower_quality_is_smaller_and_worse(pictures: dict[str, list[Path]], tmp_path: Path) -> None:
    sizes, errors = [], []
    for crf in (0, 15, 30, 45):
        path = tmp_path / f"{crf}.mp4"
        write_h264(path, pictures["png"], 25.0, crf, lambda count: None)
        sizes.append(path.stat().st_size)
        errors.append(np.mean([np.abs(a.astype(int) - b) for a, b in zip(frames_of(path), moving(6), strict=True)]))
    assert sizes == sorted(sizes, reverse=True)
    assert errors == sorted(errors)
    assert errors[0] == 0.0
    assert errors[-1] > 3.0


def test_colour_is_kept(tmp_path: Path) -> None:
    y, x = np.mgrid[:64, :64].astype(np.float64)
    image = np.stack([60 + 2 * x, 200 - 2 * y, 40 + x + y], axis=-1).astype(np.uint8)
    write_image(tmp_path / "0.png", image)
    write_h264(tmp_path / "video.mp4", [tmp_path / "0.png"], 25.0, 5, lambda count: None)
    with av.open(str(tmp_path / "video.mp4")) as container:
        (frame,) = container.decode(video=0)
    assert np.abs(frame.to_ndarray(format="rgb24").astype(int) - image).mean() < 3.0


ENCODE = """
import hashlib, sys
from pathlib import Path
import numpy as np
from mirrorcam.core.images.pictures import read_image
from mirrorcam.render_scenes.sets.video import as_key_frame, write_h264, write_mjpeg
folder = Path(sys.argv[1])
png, jpg = sorted(folder.glob("*.png")), sorted(folder.glob("*.jpg"))
write_mjpeg(folder / "a.avi", jpg, 30.0, lambda n: None)
write_h264(folder / "a.mp4", png, 30.0, 20, lambda n: None)
key = as_key_frame(read_image(png[0], grey=True), 30)
print([hashlib.sha256(c).hexdigest() for c in ((folder / "a.avi").read_bytes(), (folder / "a.mp4").read_bytes(), key)])
"""


def test_the_bytes_do_not_depend_on_what_lay_in_memory(tmp_path: Path) -> None:
    # Enough pictures, large enough, to let x264 look at memory that it has not written, where its settings allow that.
    for number, image in enumerate(moving(20, (270, 480))):
        write_image(tmp_path / f"{number:02d}.png", image)
        write_image(tmp_path / f"{number:02d}.jpg", image)
    found = []
    for fill in ("0", "85", "170"):
        # glibc fills allocated memory with this byte; elsewhere these are three ordinary runs.
        done = subprocess.run(
            [sys.executable, "-c", ENCODE, str(tmp_path)],
            env=os.environ | {"MALLOC_PERTURB_": fill, "PYTHONPATH": str(ROOT_NODE)},
            capture_output=True,
            encoding="utf-8",
            check=True,
        )
        found.append(done.stdout)
    assert found[0].count("'") == 6
    assert len(set(found)) == 1


def test_a_key_frame_is_what_a_video_of_one_picture_shows(tmp_path: Path) -> None:
    image = moving(1)[0]
    write_image(tmp_path / "0.png", image)
    write_h264(tmp_path / "video.mp4", [tmp_path / "0.png"], 30.0, 33, lambda count: None)
    np.testing.assert_array_equal(as_key_frame(image, 33), frames_of(tmp_path / "video.mp4")[0])
    np.testing.assert_array_equal(as_key_frame(image, 0), image)


def test_a_picture_that_cannot_be_read_leaves_no_video(pictures: dict[str, list[Path]], tmp_path: Path) -> None:
    write_bytes(pictures["png"][3], b"not a picture")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"3\.png: not an image"):
        write_h264(tmp_path / "video.mp4", pictures["png"], 25.0, 20, lambda count: None)
    with pytest.raises(InputError, match="no such file"):
        write_mjpeg(tmp_path / "video.avi", [*pictures["jpg"], tmp_path / "9.jpg"], 25.0, lambda count: None)
    assert sorted(tmp_path.iterdir()) == before


def test_a_key_frame_of_colours_keeps_them() -> None:
    x, y = np.meshgrid(np.arange(160), np.arange(96))
    image = np.stack([60 + x, 200 - y, 40 + x // 2 + y], axis=-1).astype(np.uint8)
    found = as_key_frame(image, 10).astype(float)
    assert found.shape == image.shape
    assert np.abs(found - image).mean() < 2.0


EVEN = Camera.c920()
ODD = EVEN.replaced(width_px=1919)


def refused(settings: RenderSettings, camera: Camera, rate_hz: float | None) -> str:
    """The message about a video; empty if it is accepted."""
    try:
        check_video(settings, camera, rate_hz)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("settings", "camera", "rate_hz", "complaint"),
    [
        (RenderSettings(video="mp4"), EVEN, None, "video mp4"),
        (RenderSettings(video="avi", sensor=SENSORS["ideal"]), EVEN, 30.0, "video avi"),
        (RenderSettings(video="mp4"), ODD, 30.0, "H.264: a sensor of 1919 x 1080 pixels, expected even numbers"),
        (RenderSettings(sensor=SensorModel(h264_crf=20)), ODD, None, "H.264: a sensor of 1919 x 1080 pixels"),
    ],
)
def test_videos_that_cannot_be_encoded_are_refused(
    settings: RenderSettings, camera: Camera, rate_hz: float | None, complaint: str
) -> None:
    assert refused(settings, camera, rate_hz).startswith(complaint)


@pytest.mark.parametrize(
    ("settings", "camera", "rate_hz"),
    [
        (RenderSettings(), ODD, None),
        (RenderSettings(video="avi"), ODD, 30.0),
        (RenderSettings(video="mp4"), EVEN, 30.0),
    ],
)
def test_others_are_not_refused(settings: RenderSettings, camera: Camera, rate_hz: float | None) -> None:
    assert refused(settings, camera, rate_hz) == ""
