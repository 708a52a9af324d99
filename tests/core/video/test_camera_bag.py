"""Pictures of a camera in ROS 2 bags, in every encoding; bags are written by rosbags."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.core.video.camera_bag import _ENCODINGS, CameraBag
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video_files import open_video
from tests.core.video.camera_bags import START_NS, compressed, image, raw, write_bag
from tests.core.video.videos import number_in, pictures, write_h264
from tests.optics.light_field.io.bags import needs_rosbags

pytestmark = needs_rosbags
Picture = NDArray[np.uint8]
COUNT, WIDTH, HEIGHT = 5, 160, 96


def mosaic(picture: NDArray[Any], order: str) -> NDArray[Any]:
    """Samples of a colour filter array; the order is of the pixels (0, 0), (0, 1), (1, 0), (1, 1)."""
    samples = np.empty_like(picture[..., 0])
    for place, colour in enumerate(order):
        row, column = divmod(place, 2)
        samples[row::2, column::2] = picture[row::2, column::2, "rgb".index(colour)]
    return samples


def yuv422(picture: Picture, order: str) -> Picture:
    """Packed samples (h, w, 2) of BT.601, limited range; two pixels share their chroma."""
    red, green, blue = np.moveaxis(picture.astype(float), -1, 0)
    y = 16 + (65.481 * red + 128.553 * green + 24.966 * blue) / 255
    u = 128 + (-37.797 * red - 74.203 * green + 112.0 * blue) / 255
    v = 128 + (112.0 * red - 93.786 * green - 18.214 * blue) / 255
    chroma = np.empty_like(y)
    chroma[:, 0::2], chroma[:, 1::2] = ((c[:, 0::2] + c[:, 1::2]) / 2 for c in (u, v))
    pair = (y, chroma) if order == "yuyv" else (chroma, y)
    return np.asarray(np.stack(pair, axis=-1).round(), dtype=np.uint8)


def as_encoded(picture: Picture, encoding: str) -> NDArray[Any]:
    """Samples of a picture in an encoding, made without OpenCV."""
    name, wide = encoding.removesuffix("16").removesuffix("8"), encoding.endswith("16")
    samples: NDArray[Any] = picture.astype(np.uint16) * 257 if wide else picture
    if name.startswith("bayer_"):
        return mosaic(samples, name.removeprefix("bayer_"))
    if name == "mono":
        return np.ascontiguousarray(samples[..., 1])
    if encoding in ("yuyv", "yuv422_yuy2"):
        return yuv422(picture, "yuyv")
    if encoding in ("uyvy", "yuv422"):
        return yuv422(picture, "uyvy")
    opaque = np.full((*samples.shape[:2], 1), samples.dtype.type(200))
    return np.concatenate([samples[..., ["rgb".index(colour) for colour in name[:3]]], opaque][: len(name) - 2], axis=2)


def frames_of(path: Path | str) -> list[Frame]:
    frames = list(open_video(path).frames())
    assert all(isinstance(frame, Frame) for frame in frames)
    return [frame for frame in frames if isinstance(frame, Frame)]


@pytest.mark.parametrize("encoding", _ENCODINGS)
def test_pictures_of_every_encoding_are_rgb(tmp_path: Path, encoding: str) -> None:
    shown = pictures(3, WIDTH, HEIGHT)
    frames = frames_of(write_bag(tmp_path / "bag", [raw(as_encoded(each, encoding), encoding) for each in shown]))
    # Interpolated colours differ from the truth, most at the edge of the grey corner.
    tolerance = 6.0 if "bayer" in encoding else 3.0 if "yu" in encoding or encoding == "uyvy" else 0.0
    for frame, picture in zip(frames, shown, strict=True):
        expected = picture[..., [1, 1, 1]] if "mono" in encoding else picture
        assert frame.pixels.dtype == np.uint8
        error = np.abs(frame.pixels.astype(int) - expected)
        assert error.mean(axis=(0, 1)).max() <= tolerance
        assert number_in(frame.pixels) == frame.number


def test_times_and_numbers_are_those_of_the_messages(tmp_path: Path) -> None:
    shown = pictures(COUNT, WIDTH, HEIGHT)
    bag = CameraBag(write_bag(tmp_path / "bag", [raw(each, "rgb8") for each in shown], "SQLITE3"))
    assert (bag.width_px, bag.height_px, bag.count, bag.started_ns) == (WIDTH, HEIGHT, COUNT, START_NS)
    assert bag.rate_hz == pytest.approx(25.0)
    assert [frame.number for frame in bag.frames()] == list(range(COUNT))
    assert [frame.number for frame in bag.frames(after=2)] == [3, 4]
    times = [frame.time_s for frame in bag.frames() if isinstance(frame, Frame)]
    assert times == pytest.approx([0.04 * number for number in range(COUNT)])


def test_without_stamps_the_times_of_the_bag_count(tmp_path: Path) -> None:
    messages = [raw(each, "rgb8") for each in pictures(3, WIDTH, HEIGHT)]
    frames = frames_of(write_bag(tmp_path / "bag", messages, stamps=[0, 0, 0]))
    assert [frame.time_s for frame in frames] == pytest.approx([0.0, 0.04, 0.08])


def test_a_picture_that_is_not_later_than_the_last_is_lost(tmp_path: Path) -> None:
    messages = [raw(each, "rgb8") for each in pictures(3, WIDTH, HEIGHT)]
    bag = CameraBag(write_bag(tmp_path / "bag", messages, stamps=[5, 5, 9]))
    assert [(frame.number, type(frame)) for frame in bag.frames()] == [(0, Frame), (1, Lost), (2, Frame)]


@pytest.mark.parametrize(
    ("form", "suffix", "made"),
    [
        ("jpeg", ".jpg", lambda picture: picture),
        ("bgr8; jpeg compressed bgr8", ".jpg", lambda picture: picture),
        ("rgb8; png compressed bgr8", ".png", lambda picture: picture),
        ("bayer_grbg8; png compressed ", ".png", lambda picture: mosaic(picture, "grbg")),
        ("bayer_rggb8; jpeg compressed ", ".jpg", lambda picture: mosaic(picture, "rggb")),
        ("bayer_rggb8; jpeg compressed bgr8", ".jpg", lambda picture: picture),
    ],
)
def test_compressed_pictures_are_rgb(
    tmp_path: Path, form: str, suffix: str, made: Callable[[Picture], Picture]
) -> None:
    shown = pictures(2, WIDTH, HEIGHT)
    messages = [compressed(encoded_image(made(each), suffix), form) for each in shown]
    for frame, picture in zip(frames_of(write_bag(tmp_path / "bag", messages)), shown, strict=True):
        assert np.abs(frame.pixels.astype(int) - picture).mean() < 6.0
        assert number_in(frame.pixels) == frame.number


def test_rows_may_be_padded_and_samples_big_endian(tmp_path: Path) -> None:
    picture = pictures(1, WIDTH, HEIGHT)[0]
    samples = picture.astype(np.uint16) * 16 + 15  # of 12 bits
    kind = "sensor_msgs/msg/Image"
    for number, fields in enumerate((image(samples, "rgb16", 7, big=True), image(samples, "rgb16", 24))):
        bag = CameraBag(write_bag(tmp_path / str(number), [("/camera/image_raw", kind, fields)]))
        assert "the lowest 12" in str(bag.sample_bits)
        (frame,) = bag.frames()
        assert isinstance(frame, Frame)
        assert np.array_equal(frame.pixels, picture)


def test_of_several_cameras_one_is_named(tmp_path: Path) -> None:
    shown = pictures(2, WIDTH, HEIGHT)
    left, right = (raw(each, "rgb8", f"/{side}/image") for each, side in zip(shown, ("left", "right"), strict=True))
    folder = write_bag(tmp_path / "bag", [left, right])
    with pytest.raises(
        InputError, match=r"holds pictures of several topics, expected one of /left/image, /right/image, such as bag:/l"
    ):
        CameraBag(folder)
    with pytest.raises(InputError, match=r"bag: holds no pictures of /rear, expected one of /left/image, /right/image"):
        CameraBag(f"{folder}:/rear")
    (frame,) = frames_of(f"{folder}:/right/image")
    assert number_in(frame.pixels) == 1
    (file,) = folder.glob("*.mcap")
    (frame,) = frames_of(f"{file}:/left/image")
    assert number_in(frame.pixels) == 0


def test_damaged_pictures_are_lost(tmp_path: Path) -> None:
    shown = pictures(4, WIDTH, HEIGHT)
    whole = [encoded_image(each, ".jpg") for each in shown]
    small = encoded_image(shown[2][:48, :80], ".jpg")
    messages = [compressed(data, "jpeg") for data in (whole[0][:500], whole[1], small, whole[3][:-300])]
    bag = CameraBag(write_bag(tmp_path / "bag", messages))
    assert (bag.width_px, bag.height_px, bag.started_ns) == (WIDTH, HEIGHT, START_NS)
    frames = list(bag.frames())
    assert [type(frame) for frame in frames] == [Lost, Frame, Lost, Lost]
    assert isinstance(frames[2], Lost)
    assert "80x48" in frames[2].reason


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"encoding": "32FC1"},
            r"image_raw: encoding is '32FC1', expected one of rgb8, .*; none of the first 2",
        ),
        ({"height": 97}, r"a picture has 46080 bytes, expected 97 rows of 480"),
        ({"step": 100}, r"a picture has 160x96 px in rows of 100 bytes, expected at least 480"),
        ({"width": 2**31, "step": 2**32 - 1}, r"a picture has 2147483648x96 px"),
    ],
)
def test_pictures_that_contradict_themselves_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    fields = [image(each, "rgb8") | changes for each in pictures(2, WIDTH, HEIGHT)]
    messages = [("/camera/image_raw", "sensor_msgs/msg/Image", each) for each in fields]
    with pytest.raises(InputError, match=message) as refusal:
        CameraBag(write_bag(tmp_path / "bag", messages))
    assert "\n" not in str(refusal.value)


def test_a_bag_without_pictures_is_refused(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/camera/text", "std_msgs/msg/String", typestore=store)
        text = store.types["std_msgs/msg/String"](data="x")
        writer.write(topic, START_NS, store.serialize_cdr(text, "std_msgs/msg/String"))
    with pytest.raises(InputError, match=r"topics are /camera/text, expected one with pictures"):
        CameraBag(tmp_path / "bag")


def test_a_video_is_still_a_video(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    write_h264(path, pictures(3))
    assert len(frames_of(path)) == 3
