"""Streams of light fields on disk: round trips, and the same bytes after any interruptions of writing."""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.registry import open_light_field
from mirrorcam.optics.light_field.io.recording import Sink
from mirrorcam.optics.light_field.io.stream import record
from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields, ZarrSink
from tests.core.video.videos import damage, pictures, write_mjpeg
from tests.optics.light_field.io.conftest import COUNT, DAMAGED, begin, npz_folders


def content(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@contextmanager
def files_no_longer_than(size: int) -> Iterator[None]:
    """Let writing fail for files beyond a size, as on a full disk, but keep Python from writing parts of bytecode."""
    before, without_bytecode = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = without_bytecode


@pytest.fixture(params=[ZarrSink, npz_folders], ids=["zarr", "folders"])
def new_sink(request: pytest.FixtureRequest) -> Callable[[], Sink]:
    return request.param


def test_every_light_field_is_read_from_a_recording(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    counted: list[int] = []
    record(decoder, video, recording, on_frame=lambda done, _: counted.append(done))
    assert not (tmp_path / "a.zarr").exists()
    recording.finish()
    assert counted == list(range(1, COUNT + 1))
    assert [path.name for path in tmp_path.iterdir()] == ["a.zarr"]
    stored = StoredLightFields(tmp_path / "a.zarr")
    frames = {frame.number: frame for frame in video.frames() if isinstance(frame, Frame)}
    assert stored.numbers == tuple(frames) == (*range(DAMAGED), *range(DAMAGED + 1, COUNT))
    assert stored.times_s == tuple(frame.time_s for frame in frames.values())
    assert stored.lost == {DAMAGED: "is damaged"}
    assert len(stored) == COUNT - 1
    for number, found in zip(stored.numbers, stored, strict=True):
        expected = decoder.decode(frames[number].pixels)
        assert np.array_equal(found.samples, expected.samples)
        assert np.array_equal(found.weights, expected.weights)
        assert np.array_equal(found.positions_mm, expected.positions_mm)
        assert np.array_equal(found.matrices, expected.matrices)
        assert found.layout_identity == expected.layout_identity
    assert np.array_equal(stored[-1].samples, stored[COUNT - 2].samples)
    assert all(np.array_equal(found.samples, stored[2 + i].samples) for i, found in enumerate(stored[2:5]))
    with pytest.raises(IndexError, match="frame 19, expected one of 19"):
        stored[COUNT - 1]
    assert np.array_equal(open_light_field(tmp_path / "a.zarr", frame=3).samples, stored[3].samples)
    with pytest.raises(InputError, match=r"a.zarr: has 19 frames, but not frame 19"):
        open_light_field(tmp_path / "a.zarr", frame=19)


@pytest.mark.parametrize("stops", [[1], [7], [8, 9, 15]])
def test_the_bytes_do_not_depend_on_interruptions(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink], stops: list[int]
) -> None:
    whole = begin(tmp_path / "whole", decoder, new_sink())
    record(decoder, video, whole)
    whole.finish()
    for stop in stops:
        begun = begin(tmp_path / "cut", decoder, new_sink())
        record(decoder, video, begun, limit=stop)  # and then the process dies: nothing is closed
        assert len(begun.entries.numbers) + len(begun.entries.lost) == stop
    last = begin(tmp_path / "cut", decoder, new_sink())
    assert not last.is_complete
    record(decoder, video, last)
    last.finish()
    assert content(tmp_path / "cut") == content(tmp_path / "whole")
    assert begin(tmp_path / "cut", decoder, new_sink()).is_complete


def test_incomplete_frames_of_a_dying_process_are_rewritten(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink]
) -> None:
    whole = begin(tmp_path / "whole", decoder, new_sink())
    record(decoder, video, whole)
    whole.finish()
    record(decoder, video, begin(tmp_path / "cut", decoder, new_sink()), limit=6)
    partial = tmp_path / "cut.partial"
    journal = partial / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-9])  # the line of frame 5 is incomplete
    if (partial / "samples").exists():
        chunk = partial / "samples" / "c" / "5" / "0" / "0" / "0" / "0" / "0"
        chunk.write_bytes(chunk.read_bytes()[:100])
        chunk.with_suffix(".feed.partial").write_bytes(b"half")
    else:
        (partial / "000005" / "light_field.npz").write_bytes(b"half")
        (partial / "000006.partial").mkdir()
    again = begin(tmp_path / "cut", decoder, new_sink())
    assert again.entries.numbers == [0, 1, 2, 3, 4]
    record(decoder, video, again)
    again.finish()
    assert content(tmp_path / "cut") == content(tmp_path / "whole")


def test_other_files_are_never_overwritten(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink]
) -> None:
    begun = begin(tmp_path / "a", decoder, new_sink())
    record(decoder, video, begun, limit=3)
    begun.close()
    before = content(tmp_path)
    with pytest.raises(InputError, match=r"a\.partial: is the beginning of a different job, repeat the same job"):
        begin(tmp_path / "a", decoder, new_sink(), gain=[1.0])
    assert content(tmp_path) == before
    again = begin(tmp_path / "a", decoder, new_sink())
    record(decoder, video, again)
    again.finish()
    before = content(tmp_path)
    with pytest.raises(InputError, match=r"a: exists and holds something else, give a new name"):
        begin(tmp_path / "a", decoder, new_sink(), gain=[1.0])
    (tmp_path / "b.partial").mkdir()
    (tmp_path / "b.partial" / "thesis.tex").write_text("years", encoding="utf-8")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "thesis.tex").write_text("years", encoding="utf-8")
    with pytest.raises(InputError, match=r"b\.partial: exists, expected the beginning of b or nothing"):
        begin(tmp_path / "b", decoder, new_sink())
    with pytest.raises(InputError, match=r"c: "):
        begin(tmp_path / "c", decoder, new_sink())
    assert content(tmp_path) == before | {
        "b.partial/thesis.tex": b"years",
        "c/thesis.tex": b"years",
    }


def test_complete_frames_are_kept_on_a_full_disk(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink]
) -> None:
    whole = begin(tmp_path / "whole", decoder, new_sink())
    record(decoder, video, whole)
    whole.finish()
    begun = begin(tmp_path / "cut", decoder, new_sink())
    record(decoder, video, begun, limit=5)
    with (
        files_no_longer_than(3000),
        pytest.raises(
            InputError, match=r"cannot be written: File too large; 5 frames written so far are complete"
        ) as caught,
    ):
        record(decoder, video, begun)
    assert "\n" not in str(caught.value)
    begun.close()
    again = begin(tmp_path / "cut", decoder, new_sink())
    assert again.entries.numbers == [0, 1, 2, 3, 4]
    record(decoder, video, again)
    again.finish()
    assert content(tmp_path / "cut") == content(tmp_path / "whole")


def test_a_video_without_usable_frames_leaves_no_files(tmp_path: Path, decoder: Decoder) -> None:
    path = write_mjpeg(tmp_path / "a.avi", pictures(2, 320, 192))
    damage(path, 0)
    damage(path, 1)
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, Video(path), recording)
    assert len(recording.entries.lost) == 2
    with pytest.raises(InputError, match=r"^a.zarr: no frame could be decoded, expected at least one$"):
        recording.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["a.avi"]


def test_a_foreign_folder_keeps_its_journal(tmp_path: Path, decoder: Decoder, new_sink: Callable[[], Sink]) -> None:
    (tmp_path / "clip").mkdir()
    (tmp_path / "clip" / "journal.jsonl").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="clip: "):
        begin(tmp_path / "clip", decoder, new_sink())
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="file: "):
        begin(tmp_path / "file", decoder, new_sink())
    assert content(tmp_path) == {"clip/journal.jsonl": b"mine", "file": b"mine"}


@pytest.mark.parametrize("place", ["clip.partial", "clip.partial/samples", "clip.partial/000001", "clip"])
def test_nothing_is_written_through_a_link(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink], place: str
) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    begun = begin(tmp_path / "clip", decoder, new_sink())
    record(decoder, video, begun, limit=1)
    begun.close()
    if (tmp_path / place).exists():
        (tmp_path / place).rename(tmp_path / "moved")
    (tmp_path / place).symlink_to(theirs)
    with pytest.raises(InputError, match=f"{place}: is a link"):
        begin(tmp_path / "clip", decoder, new_sink())
    assert content(theirs) == {}


@pytest.mark.parametrize(
    "line", ["3", "null", '{"number": "../x", "time_s": 0.0}', '{"number": -1, "time_s": 0.0}', '{"number": 1}', "[]"]
)
def test_a_foreign_journal_is_refused(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink], line: str
) -> None:
    begun = begin(tmp_path / "clip", decoder, new_sink())
    record(decoder, video, begun, limit=1)
    begun.close()
    with (tmp_path / "clip.partial" / "journal.jsonl").open("a") as journal:
        journal.write(f"{line}\n")
    with pytest.raises(InputError, match=r"journal\.jsonl: "):
        begin(tmp_path / "clip", decoder, new_sink())


@pytest.mark.parametrize(
    "text", ["[]", "{}", '{"frames": 3, "lost": []}', '{"frames": [{}], "lost": []}', '{"frames": [']
)
def test_a_foreign_index_is_refused(tmp_path: Path, decoder: Decoder, text: str) -> None:
    (tmp_path / "clip").mkdir()
    (tmp_path / "clip" / "frames.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"frames\.json: "):
        begin(tmp_path / "clip", decoder, npz_folders())
