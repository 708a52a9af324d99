"""Files are whole or not there, and what is wrong with one is said in one line."""

from __future__ import annotations

import json
import os
import stat
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import Field

from mirrorcam.core.disk import files
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric, Value, Vector3
from tests.nightly import a_few


class Note(Value):
    """A small file."""

    text: str
    size_mm: float = Field(default=1.0, gt=0)
    point: Vector3 = Field(default_factory=lambda: np.zeros(3))


def refusal(call: Any, *arguments: Any) -> str:
    """The one line of the InputError that a call raises."""
    with pytest.raises(InputError) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("read", [files.read_bytes, files.read_json, files.stored_bytes, files.refuse_pointer])
def test_a_pointer_of_git_lfs_is_none_of_the_file(tmp_path: Path, read: Any) -> None:
    path = tmp_path / "a.json"
    path.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1000000\n")
    assert refusal(read, path) == f"{path}: is a Git LFS pointer, not the file itself: run `git lfs pull`"
    for other in (tmp_path, tmp_path / "none"):
        files.refuse_pointer(other)


def test_a_file_appears_complete_at_the_end(tmp_path: Path) -> None:
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


def test_paths_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    assert "cannot be written" in refusal(files.write_text, tmp_path / "file" / "note.txt", "x")
    assert "is a folder, expected a file" in refusal(files.write_text, tmp_path, "x")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert "is a device or a pipe, expected a file to write" in refusal(files.write_text, pipe, "x")
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("write", [files.write_text, files.write_json])
def test_a_name_with_a_null_character_is_refused(write: Any) -> None:
    assert "null" in refusal(write, Path("a\0b"), "x")


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
        ("note.json", '{"text": "a", "txt": 1}', "txt: not known, did you mean text?"),
        ("note.json", '{"text": "a", "size_mm": NaN}', "size_mm: Input should be a finite number"),
        ("note.json", '{"text": "a", "size_mm": 1e999}', "size_mm: Input should be a finite number"),
        ("note.json", '{"text": "a", "point": [0, NaN, 1]}', "point: holds a value that is NaN or infinite"),
        ("note.json", '{"text": "a", "point": [0, 1]}', "point: shape (2,), expected (3)"),
        ("note.json", '{"size_mm": -1, "nonsense": 1}', "nonsense: not known (and 2 more)"),
        ("note.json", '{"text": "a", "size_mm": "2"}', "size_mm: str, expected a number"),
        ("note.json", '{"text": "a", "size_mm": true}', "size_mm: bool, expected a number"),
        ("note.json", '{"text": 1}', "text: Input should be a valid string"),
        ("note.json", '{"text": "a", "point": [0, "1", 2]}', "point: not an array of numbers, expected shape (3)"),
        ("note.json", '{"text": "a", "point": [0, true, 2]}', "point: not an array of numbers, expected shape (3)"),
        ("note.json", '{"text": "a", "text": "b"}', "not valid JSON: the key 'text' appears twice"),
        ("note.json", '{"text": "a", "' + "x" * 5000 + '": 1}', " ... "),
        ("note.toml", "text = 1979-05-27", "expected numbers, strings and tables"),
        ("note.json", '{"size_mm": -1}', "text: Field required (and 1 more)"),
        ("note.json", "[1]", "Input should be an object"),
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
    assert len(line) <= len(str(path)) + 302


class Notes(Value):
    """A file of many notes."""

    listed: tuple[Note, ...] = ()
    named: dict[str, Note] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("data", "message"),
    a_few(
        2,
        [
            ({"listed": [0] * 200_000}, "listed.0: Input should be an object"),
            ({"listed": [{"text": "a"}] * 20_000 + [0] * 200_000}, "listed.20000: Input should be an object"),
            ({"named": {f"k{number}": 0 for number in range(200_000)}}, "named.k0: Input should be an object"),
            ({f"k{number}": 0 for number in range(200_000)}, "k0: not known (and 999 more)"),
            ({"listed": [{f"k{number}": 0 for number in range(200_000)}]}, "listed.0.k0: not known (and 1000 more)"),
        ],
    ),
)
def test_long_lists_and_tables_are_refused_by_their_first_items(data: Any, message: str) -> None:
    tracemalloc.start()
    try:
        assert refusal(files.model_from, Notes, "notes.json", data) == f"notes.json: {message}"
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


def test_tables_of_many_names_are_read() -> None:
    data = {"named": {f"k{number}": {"text": "a"} for number in range(20_000)}}
    assert len(files.model_from(Notes, "notes.json", data).named) == 20_000


@pytest.mark.parametrize("read", [files.read_bytes, files.read_json, lambda path: files.read_model(Note, path)])
def test_what_is_not_a_file_is_refused(tmp_path: Path, read: Any) -> None:
    (tmp_path / "file").write_text("x")
    assert refusal(read, tmp_path / "none.json") == f"{tmp_path / 'none.json'}: no such file"
    assert refusal(read, tmp_path) == f"{tmp_path}: is a folder, expected a file"
    assert "Not a directory" in refusal(read, tmp_path / "file" / "none.json")


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


@pytest.mark.parametrize("name", ["note.json", "note.toml"])
def test_a_byte_order_mark_is_skipped(tmp_path: Path, name: str) -> None:
    text = '{"text": "a"}' if name.endswith("json") else 'text = "a"'
    (tmp_path / name).write_text(text, encoding="utf-8-sig")
    assert files.read_model(Note, tmp_path / name).text == "a"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_devices_and_pipes_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", Path("/dev/zero"), Path("/dev/stdin")):
        if path.is_file():
            continue
        assert refusal(files.read_json, path) == f"{path}: is not a regular file, expected one"


@pytest.mark.skipif(sys.platform != "linux", reason="files whose size is not known are Linux's")
def test_a_file_whose_size_the_system_does_not_know_is_read_whole() -> None:
    path = Path("/proc/self/status")
    assert path.stat().st_size == 0
    assert b"\nPid:\t" in files.read_bytes(path)


def test_large_files_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "note.json"
    with path.open("wb") as stream:
        stream.truncate(10**12)
    assert refusal(files.read_json, path) == f"{path}: is larger than 1 MB, expected a smaller file"


@pytest.mark.parametrize(
    ("name", "inside"),
    [
        *((name, True) for name in ("a.png", "frames/0000.png", "link_inside", "a..b", "..a")),
        *((name, False) for name in ("", "..", "../a", "a/../../b", "/etc/passwd", "\\\\host\\a", "C:\\a", "C:a")),
        *((name, False) for name in ("link_outside", "link_outside/a", "a\\..\\..\\b", "a\x00b")),
    ],
)
def test_names_in_manifests_stay_in_their_folder(name: str, inside: bool, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "link_inside").symlink_to("a.png")
    (folder / "link_outside").symlink_to(tmp_path)
    assert files.is_inside(folder, name) == inside
    if inside:
        assert files.inside(folder, name) == folder / name
    else:
        assert "expected the name of a file in this folder" in refusal(files.inside, folder, name)


def test_numbered_names_are_never_those_of_something(tmp_path: Path) -> None:
    assert files.numbered(tmp_path / "none", "a", ".png") == tmp_path / "none" / "a_0001.png"
    (tmp_path / "a_0001.png").touch()
    (tmp_path / "a_0003.png").touch()
    assert files.numbered(tmp_path, "a", ".png").name == "a_0002.png"
    (tmp_path / "a_0002.png").mkdir()
    assert files.numbered(tmp_path, "a", ".png").name == "a_0004.png"
    assert files.numbered(tmp_path, "a", "").name == "a_0001"


@pytest.mark.parametrize("content", [None, "", "{", '{"size": "many"}', '{"unknown": 1}'])
def test_an_incomplete_record_is_none(content: str | None, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "record.json").write_text(content)
    assert files.read_record(Note, tmp_path / "record.json") is None


def test_what_is_no_record_of_a_readable_size_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "endless").symlink_to("/dev/zero")
    for name, reason in (
        ("folder", "is a folder"),
        ("fifo", "is not a regular file"),
        ("endless", "is not a regular file"),
    ):
        with pytest.raises(InputError, match=f"{name}: {reason}"):
            files.read_record(Note, tmp_path / name)
