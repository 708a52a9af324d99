"""Pictures are read whole as they were written, or refused with what is wrong."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirrorcam.core.images import pictures
from mirrorcam.core.images.jpeg import DamagedPicture
from tests.core.disk.test_files import refusal
from tests.soon import soon


def picture() -> NDArray[np.uint8]:
    """A smooth picture (60, 90, 3) with different colours at its corners."""
    v, u = np.mgrid[:60, :90]
    return np.stack([u * 2, v * 4, 255 - u - v], axis=-1).astype(np.uint8)


def test_png_keeps_every_pixel_and_the_order_of_colours(tmp_path: Path) -> None:
    pictures.write_image(tmp_path / "a.png", picture())
    assert np.array_equal(pictures.read_image(tmp_path / "a.png"), picture())
    blue_green_red = cv2.imread(str(tmp_path / "a.png"))
    assert blue_green_red is not None
    assert np.array_equal(blue_green_red[..., ::-1], picture())
    grey = np.ascontiguousarray(picture()[..., 0])
    pictures.write_image(tmp_path / "b.png", grey)
    assert np.array_equal(pictures.read_image(tmp_path / "b.png", grey=True), grey)
    assert np.array_equal(pictures.read_image(tmp_path / "b.png"), np.repeat(grey[..., None], 3, axis=2))


def test_jpeg_keeps_the_order_of_colours(tmp_path: Path) -> None:
    pictures.write_image(tmp_path / "a.jpg", picture())
    error = np.abs(pictures.read_image(tmp_path / "a.jpg").astype(float) - picture())
    assert error.mean() < 3


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9, 0.999])
def test_truncated_images_are_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"a{suffix}"
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    pictures.write_image(path, noise)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(kept * len(raw))])
    assert refusal(pictures.read_image, path) == f"{path}: image is truncated"


@pytest.mark.parametrize("suffix", pictures.WRITTEN_ENDINGS)
def test_pictures_of_every_ending_are_written_and_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix.upper()}"
    assert pictures.is_picture(path)
    pictures.write_image(path, picture())
    assert np.abs(pictures.read_image(path).astype(float) - picture()).mean() < 3
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    assert "\n" not in refusal(pictures.read_image, path)


def test_other_files_are_no_pictures() -> None:
    assert not any(pictures.is_picture(Path(name)) for name in ("a.mp4", "png", "a.png.partial", "a"))
    assert all(pictures.is_picture(Path(name)) for name in ("a.png", "a.JPG", "a.tif", "a.TIFF", "a.bmp"))


def test_files_of_a_folder_that_are_left_out_are_counted_and_named(tmp_path: Path) -> None:
    for name in ("b.bmp", "a.tif"):
        Image.fromarray(picture()).save(tmp_path / name)
    for name in ("c.heic", "d.mp4", "notes.txt", "e", "board.toml", "truth.json", ".DS_Store", "Thumbs.db"):
        (tmp_path / name).write_text("x")
    lines: list[str] = []
    assert pictures.pictures_in([tmp_path], lines.append) == [tmp_path / "a.tif", tmp_path / "b.bmp"]
    assert lines == [f"{tmp_path}: 4 of 6 files left out: c.heic, d.mp4, e, ..."]
    for name in ("b.bmp", "a.tif"):
        (tmp_path / name).unlink()
    assert "holds no picture, but c.heic, d.mp4, e, ..., expected .png, " in refusal(pictures.pictures_in, [tmp_path])


def write_16_bits(path: Path, samples: NDArray[np.uint16]) -> Path:
    """Write samples (h, w) or (h, w, 3) in RGB as PNG or TIFF."""
    stored = samples if samples.ndim == 2 else samples[..., ::-1]
    path.write_bytes(cv2.imencode(path.suffix, np.ascontiguousarray(stored))[1].tobytes())
    return path


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("channels", [1, 3])
def test_pictures_of_16_bits_are_read_by_the_bits_in_use(suffix: str, bits: int, channels: int, tmp_path: Path) -> None:
    wanted = picture() if channels == 3 else picture()[..., 1]
    wanted[0, 0] = 255
    samples = (wanted.astype(np.uint16) << (bits - 8)) + (1 << (bits - 8)) - 1
    path = write_16_bits(tmp_path / f"a{suffix}", samples.astype(np.uint16))
    found = pictures.read_image(path)
    assert np.array_equal(found, wanted if channels == 3 else np.repeat(wanted[..., None], 3, axis=2))
    grey = pictures.read_image(path, grey=True)
    assert np.array_equal(grey, cv2.cvtColor(wanted, cv2.COLOR_RGB2GRAY) if channels == 3 else wanted)


def test_pictures_of_a_set_are_scaled_equally(tmp_path: Path) -> None:
    for number, largest in enumerate((300, 4095, 1000)):
        ramp = np.linspace(0, largest, 100).astype(np.uint16).reshape(10, 10)
        write_16_bits(tmp_path / f"{number}.png", ramp)
    pictures.write_image(tmp_path / "3.png", picture())
    lines: list[str] = []
    found = pictures.pictures_in([tmp_path], lines.append)
    assert [int(pictures.read_image(path, grey=True).max()) for path in found[:3]] == [300 >> 4, 255, 1000 >> 4]
    assert len(lines) == 1
    assert lines[0].startswith("3 pictures of 16 bits a channel, largest value 4095: the lowest 12 of these bits")
    assert pictures.line_on_bits(tmp_path) == lines[0]
    assert pictures.line_on_bits(tmp_path / "3.png") is None


def test_opacity_of_16_bits_is_scaled_as_colours_or_by_all_bits(tmp_path: Path) -> None:
    colours = (picture().astype(np.uint16) << 4) + 15
    opacity = np.full(colours.shape[:2], 4095, np.uint16)
    for stored in (opacity, opacity * 16 + 15):
        raw = cv2.imencode(".png", np.dstack([colours, stored]))[1].tobytes()
        (tmp_path / "a.png").write_bytes(raw)
        found = pictures.read_opacity(tmp_path / "a.png")
        assert found is not None
        assert (found == 255).all()


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_images_with_something_after_their_end_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    pictures.write_image(path, picture())
    raw = path.read_bytes()
    for appended in (b"a film that a phone appended" * 1000, bytes(4096)):
        path.write_bytes(raw + appended)
        assert pictures.read_image(path).shape == (60, 90, 3)


def test_the_end_of_a_thumbnail_is_not_the_end_of_the_photograph(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    pictures.write_image(path, picture()[:20, :20])
    thumbnail = path.read_bytes()
    pictures.write_image(path, picture())
    plain = path.read_bytes()
    raw = plain[:2] + b"\xff\xe1" + (2 + len(thumbnail)).to_bytes(2) + thumbnail + plain[2:]
    path.write_bytes(raw)
    assert np.abs(pictures.read_image(path).astype(float) - picture()).mean() < 3
    path.write_bytes(raw[:-40])
    assert refusal(pictures.read_image, path) == f"{path}: image is truncated"


@pytest.mark.parametrize("options", [[cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 2]])
def test_progressive_and_restarting_jpegs_are_read_and_refused_in_the_same_way(
    tmp_path: Path, options: list[int]
) -> None:
    path = tmp_path / "a.jpg"
    raw = cv2.imencode(".jpg", picture(), options)[1].tobytes()
    path.write_bytes(raw)
    assert pictures.read_image(path).shape == (60, 90, 3)
    path.write_bytes(raw[: len(raw) * 2 // 3])
    assert refusal(pictures.read_image, path) == f"{path}: image is truncated"


def test_a_png_with_a_broken_byte_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.png"
    pictures.write_image(path, np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8))
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 0xFF
    path.write_bytes(raw)
    assert "damaged, a checksum of its data is wrong" in refusal(pictures.read_image, path)
    assert "damaged, a checksum of its data is wrong" in refusal(pictures.read_opacity, path)
    assert capfd.readouterr() == ("", "")


def test_a_png_that_ends_before_its_data_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    pictures.write_image(path, picture())
    raw = path.read_bytes()
    path.write_bytes(raw[:-12] + b"\x00\x00\xff\xff" + raw[-8:])
    assert "damaged, a part of it is missing" in refusal(pictures.read_image, path)


def test_opacity_is_that_of_pictures_with_one(tmp_path: Path) -> None:
    opacity = np.arange(60 * 90, dtype=np.uint8).reshape(60, 90)
    Image.fromarray(np.dstack([picture(), opacity])).save(tmp_path / "a.png")
    Image.fromarray(np.dstack([opacity, opacity]), "LA").save(tmp_path / "grey.png")
    for name in ("a.png", "grey.png"):
        found = pictures.read_opacity(tmp_path / name)
        assert found is not None
        assert np.array_equal(found, opacity)
    for name in ("b.png", "b.jpg"):
        pictures.write_image(tmp_path / name, picture())
        assert pictures.read_opacity(tmp_path / name) is None


@pytest.mark.parametrize("content", [b"", b"hello", b"GIF89a"])
def test_files_that_are_not_images_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    assert "not an image that can be decoded, expected PNG, JPEG, TIFF or BMP" in refusal(pictures.read_image, path)


@pytest.mark.parametrize("kind", ["webp", "gif"])
def test_the_name_makes_no_picture_of_another_format(tmp_path: Path, kind: str) -> None:
    Image.fromarray(picture()).save(tmp_path / f"a.{kind}")
    (tmp_path / f"a.{kind}").rename(tmp_path / "a.jpg")
    assert "expected PNG, JPEG, TIFF or BMP" in refusal(pictures.read_image, tmp_path / "a.jpg")


@pytest.mark.parametrize("kind", ["png", "tiff", "bmp"])
def test_the_content_determines_the_format(tmp_path: Path, kind: str) -> None:
    Image.fromarray(picture()).save(tmp_path / f"b.{kind}")
    (tmp_path / f"b.{kind}").rename(tmp_path / "b.jpg")
    assert np.array_equal(pictures.read_image(tmp_path / "b.jpg"), picture())
    assert pictures.picture_size(tmp_path / "b.jpg") == (90, 60)


def test_a_header_without_a_size_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"IEND\xaeB`\x82")
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xd9")
    for name in ("a.png", "a.jpg"):
        assert "damaged, its header states no size" in refusal(pictures.read_image, tmp_path / name)


@pytest.mark.parametrize("size", [(60_000, 60_000), (30_000, 30_000), (2**31 - 1, 1), (12_001, 10_000)])
def test_sizes_are_judged_by_the_header_before_anything_is_decoded(size: tuple[int, int], tmp_path: Path) -> None:
    header = b"IHDR" + struct.pack(">IIBBBBB", *size, 1, 0, 0, 0, 0)
    ends = b"\x00\x00\x00\x00IEND\xaeB`\x82"
    png = b"\x89PNG\r\n\x1a\n\x00\x00\x00\r" + header + zlib.crc32(header).to_bytes(4) + ends
    (tmp_path / "a.png").write_bytes(png)
    with soon():
        assert refusal(pictures.read_image, tmp_path / "a.png").endswith(
            "px, expected a picture of at most 120 megapixels"
        )


def test_the_size_is_that_of_the_picture(tmp_path: Path) -> None:
    for name in ("a.png", "a.jpg"):
        pictures.write_image(tmp_path / name, picture())
        assert pictures.picture_size(tmp_path / name) == (90, 60)


def noisy(folder: Path) -> tuple[Path, bytes]:
    """A JPEG of 100 kB of compressed data."""
    path = folder / "noisy.jpg"
    random = np.random.default_rng(0)
    smooth = cv2.resize(random.integers(0, 255, (40, 60, 3)).astype(np.uint8), (640, 480))
    pictures.write_image(path, np.clip(smooth + random.normal(0, 6, smooth.shape), 0, 255).astype(np.uint8))
    return path, path.read_bytes()


@pytest.mark.parametrize("part", np.linspace(0.05, 0.9, 20))
def test_a_block_of_zeros_in_a_jpeg_is_seen(part: float, tmp_path: Path) -> None:
    path, raw = noisy(tmp_path)
    begin = int(part * len(raw))
    path.write_bytes(raw[:begin] + bytes(4096) + raw[begin + 4096 :])
    with pytest.raises(DamagedPicture, match=r"noisy\.jpg: damaged, "):
        pictures.read_image(path)


def test_zeros_of_a_uniform_picture_are_none_of_a_damaged_one(tmp_path: Path) -> None:
    """Huffman tables made for a uniform picture may give its blocks the code of zeros."""
    black = np.zeros((2000, 3000, 3), np.uint8)
    path = tmp_path / "black.jpg"
    path.write_bytes(cv2.imencode(".jpg", black, [cv2.IMWRITE_JPEG_OPTIMIZE, 1])[1].tobytes())
    assert bytes(256) in path.read_bytes()
    assert not pictures.read_image(path).any()


def test_what_the_decoder_warns_of_is_damage_and_is_not_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, raw = noisy(tmp_path)
    path.write_bytes(raw[: len(raw) // 2] + raw[len(raw) // 2 + 5000 :])
    with pytest.raises(DamagedPicture, match=r"noisy\.jpg: damaged, "):
        pictures.read_image(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("grey", [False, True])
def test_pixels_of_a_jpeg_are_those_of_opencv(grey: bool, tmp_path: Path) -> None:
    path, raw = noisy(tmp_path)
    flags = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR_RGB
    expected = cv2.imdecode(np.frombuffer(raw, np.uint8), flags)
    assert expected is not None
    assert np.array_equal(pictures.read_image(path, grey=grey), expected)


def test_the_orientation_is_stated_and_not_applied(tmp_path: Path) -> None:
    pictures.write_image(tmp_path / "plain.jpg", picture())
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(picture()).save(tmp_path / "turned.jpg", exif=exif)
    assert [pictures.orientation(tmp_path / name) for name in ("plain.jpg", "turned.jpg")] == [1, 6]
    assert pictures.read_image(tmp_path / "turned.jpg").shape == (60, 90, 3)


def test_an_image_of_an_unknown_suffix_is_not_written(tmp_path: Path) -> None:
    line = refusal(pictures.write_image, tmp_path / "a.xyz", picture())
    assert line == f"{tmp_path / 'a.xyz'}: not the suffix of an image format, expected .png or .jpg"
    assert list(tmp_path.iterdir()) == []


def test_photographs_of_a_phone_are_not_taken_for_truncated(two_mirror_photos: list[Path]) -> None:
    for path in two_mirror_photos:
        assert pictures.read_image(path).shape == (1470, 3264, 3)
