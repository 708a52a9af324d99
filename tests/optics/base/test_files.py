"""Files are whole or not there, and what is wrong with one is said in one line."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import Field

from mirrorcam.optics.base import files
from mirrorcam.optics.base.values import InputError, Metric, Value, Vector3


class Note(Value):
    """A small file."""

    text: str
    size_mm: float = Field(default=1.0, gt=0)
    point: Vector3 = Field(default_factory=lambda: np.zeros(3))


def picture() -> NDArray[np.uint8]:
    """A smooth picture (60, 90, 3) with different colours at its corners."""
    v, u = np.mgrid[:60, :90]
    return np.stack([u * 2, v * 4, 255 - u - v], axis=-1).astype(np.uint8)


def refusal(call: Any, *arguments: Any) -> str:
    """The one line of the InputError that a call raises."""
    with pytest.raises(InputError) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_file_appears_whole_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "er" / "note.txt"
    with files.atomic(path) as temporary:
        assert temporary.parent == path.parent
        assert temporary.suffix == ".txt"
        temporary.write_text("half")
        assert not path.exists()
    assert path.read_text() == "half"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("raised", [RuntimeError, KeyboardInterrupt])
def test_a_failing_block_leaves_what_was_there(tmp_path: Path, raised: type[BaseException]) -> None:
    path = tmp_path / "note.txt"
    path.write_text("old")

    def interrupted() -> None:
        with files.atomic(path) as temporary:
            temporary.write_text("new, but only half of")
            raise raised

    with pytest.raises(raised):
        interrupted()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    path.unlink()
    with pytest.raises(raised):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_written_file_is_readable_by_others_as_any_file_is(tmp_path: Path) -> None:
    files.write_text(tmp_path / "ours.txt", "x")
    (tmp_path / "plain.txt").write_text("x")
    modes = {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("ours.txt", "plain.txt")}
    assert len(modes) == 1


def test_places_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    assert "cannot be written" in refusal(files.write_text, tmp_path / "file" / "note.txt", "x")
    assert "is a folder, expected a file" in refusal(files.write_text, tmp_path, "x")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_json_and_metrics_are_written_flat_and_without_nan(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    files.write_metrics(
        path, {"rms": Metric(value=0.1, unit="px", limit=0.2), "count": Metric(value=9, unit="mirrors")}
    )
    assert json.loads(path.read_text()) == {
        "rms": {"value": 0.1, "unit": "px", "limit": 0.2, "lower_is_better": True},
        "count": {"value": 9.0, "unit": "mirrors", "lower_is_better": True},
    }
    with pytest.raises(ValueError, match="not JSON compliant"):
        files.write_json(tmp_path / "nan.json", [float("nan")])
    assert not (tmp_path / "nan.json").exists()


def test_models_are_read_from_json_and_toml(tmp_path: Path) -> None:
    files.write_text(tmp_path / "note.json", '{"text": "a", "point": [1, 2, 3]}')
    files.write_text(tmp_path / "note.toml", 'text = "a"\npoint = [1, 2, 3]\n')
    from_json, from_toml = (files.read_model(Note, tmp_path / name) for name in ("note.json", "note.toml"))
    assert from_json == from_toml == Note(text="a", point=[1, 2, 3])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("note.json", '{"text": "a", "txt": 1}', "txt: Extra inputs are not permitted"),
        ("note.json", '{"text": "a", "size_mm": NaN}', "size_mm: Input should be a finite number"),
        ("note.json", '{"text": "a", "size_mm": 1e999}', "size_mm: Input should be a finite number"),
        ("note.json", '{"text": "a", "point": [0, NaN, 1]}', "point: holds a value that is NaN or infinite"),
        ("note.json", '{"text": "a", "point": [0, 1]}', "point: shape (2,), expected (3)"),
        ("note.json", '{"size_mm": -1}', "text: Field required (and 1 more)"),
        ("note.json", "[1]", "Input should be a valid dictionary"),
        ("note.json", '{"text": ', "not valid JSON"),
        ("note.json", "", "not valid JSON"),
        ("note.json", "[" * 100_000, "not valid JSON"),
        ("note.json", '{"size_mm": ' + "9" * 5000 + "}", "not valid JSON"),
        ("note.json", b"\xff\xfe\x00", "not valid JSON"),
        ("note.toml", "text = ", "not valid TOML"),
        ("note.toml", b"\xff\xfe\x00", "not valid TOML"),
    ],
)
def test_models_are_refused_in_one_line(tmp_path: Path, name: str, content: str | bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    line = refusal(files.read_model, Note, path)
    assert line.startswith(f"{path}: ")
    assert message in line


@pytest.mark.parametrize("read", [files.read_bytes, files.read_image, lambda path: files.read_model(Note, path)])
def test_what_is_not_a_file_is_refused(tmp_path: Path, read: Any) -> None:
    (tmp_path / "file").write_text("x")
    assert refusal(read, tmp_path / "none.json") == f"{tmp_path / 'none.json'}: no such file"
    assert refusal(read, tmp_path) == f"{tmp_path}: is a folder, expected a file"
    assert "Not a directory" in refusal(read, tmp_path / "file" / "none.json")


def test_png_keeps_every_pixel_and_the_order_of_colours(tmp_path: Path) -> None:
    files.write_image(tmp_path / "a.png", picture())
    assert np.array_equal(files.read_image(tmp_path / "a.png"), picture())
    blue_green_red = cv2.imread(str(tmp_path / "a.png"))
    assert blue_green_red is not None
    assert np.array_equal(blue_green_red[..., ::-1], picture())
    grey = np.ascontiguousarray(picture()[..., 0])
    files.write_image(tmp_path / "b.png", grey)
    assert np.array_equal(files.read_image(tmp_path / "b.png", grey=True), grey)
    assert np.array_equal(files.read_image(tmp_path / "b.png"), np.repeat(grey[..., None], 3, axis=2))


def test_jpeg_keeps_the_order_of_colours(tmp_path: Path) -> None:
    files.write_image(tmp_path / "a.jpg", picture())
    error = np.abs(files.read_image(tmp_path / "a.jpg").astype(float) - picture())
    assert error.mean() < 3


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9, 0.999])
def test_truncated_images_are_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"a{suffix}"
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    files.write_image(path, noise)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(kept * len(raw))])
    assert refusal(files.read_image, path) == f"{path}: image is truncated"


@pytest.mark.parametrize("suffix", files.PICTURE_ENDINGS)
def test_pictures_of_every_ending_are_written_and_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix.upper()}"
    assert files.is_picture(path)
    files.write_image(path, picture())
    assert np.abs(files.read_image(path).astype(float) - picture()).mean() < 3
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    assert "\n" not in refusal(files.read_image, path)


def test_other_files_are_no_pictures() -> None:
    assert not any(files.is_picture(Path(name)) for name in ("a.mp4", "png", "a.png.partial", "a"))


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_images_with_something_after_their_end_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    files.write_image(path, picture())
    path.write_bytes(path.read_bytes() + b"a film that a phone appended" * 1000)
    assert files.read_image(path).shape == (60, 90, 3)


def test_the_end_of_a_thumbnail_is_not_the_end_of_the_photograph(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    files.write_image(path, picture()[:20, :20])
    thumbnail = path.read_bytes()
    files.write_image(path, picture())
    plain = path.read_bytes()
    raw = plain[:2] + b"\xff\xe1" + (2 + len(thumbnail)).to_bytes(2) + thumbnail + plain[2:]
    path.write_bytes(raw)
    assert np.abs(files.read_image(path).astype(float) - picture()).mean() < 3
    path.write_bytes(raw[:-40])
    assert refusal(files.read_image, path) == f"{path}: image is truncated"


@pytest.mark.parametrize("options", [[cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 2]])
def test_progressive_and_restarting_jpegs_are_read_and_refused_alike(tmp_path: Path, options: list[int]) -> None:
    path = tmp_path / "a.jpg"
    raw = cv2.imencode(".jpg", picture(), options)[1].tobytes()
    path.write_bytes(raw)
    assert files.read_image(path).shape == (60, 90, 3)
    path.write_bytes(raw[: len(raw) * 2 // 3])
    assert refusal(files.read_image, path) == f"{path}: image is truncated"


def test_a_png_with_a_broken_byte_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    files.write_image(path, np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8))
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 0xFF
    path.write_bytes(raw)
    assert "not an image that can be decoded" in refusal(files.read_image, path)


@pytest.mark.parametrize("content", [b"", b"hello", b"GIF89a", b"\x89PNG\r\n\x1a\n" + b"IEND\xaeB`\x82"])
def test_what_is_no_image_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    assert "not an image that can be decoded, expected PNG, JPEG or WebP" in refusal(files.read_image, path)


@pytest.mark.parametrize("name", ["a.npz", "a", "a.light", "a.b.npz"])
def test_arrays_are_written_under_the_name_given(tmp_path: Path, name: str) -> None:
    files.write_npz(tmp_path / name, {"numbers": np.arange(3), "word": np.array("x")})
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with np.load(tmp_path / name, allow_pickle=False) as archive:
        assert archive["numbers"].tolist() == [0, 1, 2]
        assert str(archive["word"]) == "x"


def test_the_same_arrays_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        files.write_npz(tmp_path / name, {"numbers": np.arange(3.0)})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_an_image_of_an_unknown_suffix_is_not_written(tmp_path: Path) -> None:
    line = refusal(files.write_image, tmp_path / "a.xyz", picture())
    assert line == f"{tmp_path / 'a.xyz'}: no image format for this suffix, expected .png or .jpg"
    assert list(tmp_path.iterdir()) == []


def test_photographs_of_a_phone_are_not_taken_for_truncated(two_mirror_photos: list[Path]) -> None:
    for path in two_mirror_photos:
        assert files.read_image(path).shape == (1470, 3264, 3)
