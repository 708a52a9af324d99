"""Streams of light fields on disk: what goes in comes out, in the same bytes however often writing was cut off."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.formats.registry import open_light_field
from mirrorcam.optics.light_field.io.frames import Frame, Lost, Video
from mirrorcam.optics.light_field.io.recording import Folders, Recording, Sink, about
from mirrorcam.optics.light_field.io.stream import record
from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields, ZarrSink
from tests.optics.layouts import faceted_parabola
from tests.optics.light_field.io.videos import damage, pictures, write_h264, write_mjpeg

COUNT = 20
DAMAGED = 7


def npz_folders() -> Folders:
    return Folders(lambda folder, light_field: save_npz(folder / "light_field.npz", light_field))


@pytest.fixture(scope="module")
def layout() -> Layout:
    """3 x 3 views of a small camera."""
    camera = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    return faceted_parabola(camera, DesignSpec(camera=camera), fill=0.9)


@pytest.fixture(scope="module")
def decoder(layout: Layout) -> Decoder:
    return Decoder(layout)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Video:
    """A webcam's video with one damaged frame."""
    path = write_mjpeg(tmp_path_factory.mktemp("video") / "a.avi", pictures(COUNT, 320, 192))
    damage(path, DAMAGED)
    return Video(path)


def begin(path: Path, decoder: Decoder, sink: Sink, **changes: Any) -> Recording:
    return Recording(path, about(decoder.views, {"sha256": "feed"}, **changes), sink)


def content(folder: Path) -> dict[str, bytes]:
    """The bytes of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@contextmanager
def files_no_longer_than(size: int) -> Iterator[None]:
    """Every file that grows past a size fails to be written, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(params=[ZarrSink, npz_folders], ids=["zarr", "folders"])
def new_sink(request: pytest.FixtureRequest) -> Callable[[], Sink]:
    return request.param


def test_a_recording_gives_back_every_light_field(tmp_path: Path, decoder: Decoder, video: Video) -> None:
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
    with pytest.raises(InputError, match=r"a.zarr: has 19 frames, expected no frame 19"):
        open_light_field(tmp_path / "a.zarr", frame=19)


def test_other_programs_find_the_arrays_by_name(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording)
    recording.finish()
    group = zarr.open_group(tmp_path / "a.zarr", mode="r")
    samples: Any = group["samples"]
    assert samples.metadata.dimension_names == ("frame", "t", "s", "v", "u", "c")
    assert samples.shape == (COUNT - 1, *decoder.weights.shape, 3)
    assert samples.chunks == (1, *decoder.weights.shape, 3)
    assert sorted(name for name, _ in group.arrays()) == ["number", "samples", "time_s", "weights"]
    views: Any = group.attrs["views"]
    assert np.array_equal(views["positions_mm"], decoder.views.positions_mm)
    assert group.attrs["lost"] == [[DAMAGED, "is damaged"]]


@pytest.mark.parametrize("stops", [[1], [7], [8, 9, 15]])
def test_however_often_it_is_cut_off_the_bytes_are_the_same(
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
    assert not last.complete
    record(decoder, video, last)
    last.finish()
    assert content(tmp_path / "cut") == content(tmp_path / "whole")
    assert begin(tmp_path / "cut", decoder, new_sink()).complete


def test_what_a_dying_process_leaves_half_written_is_written_anew(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink]
) -> None:
    whole = begin(tmp_path / "whole", decoder, new_sink())
    record(decoder, video, whole)
    whole.finish()
    record(decoder, video, begin(tmp_path / "cut", decoder, new_sink()), limit=6)
    partial = tmp_path / "cut.partial"
    journal = partial / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-9])  # the line of frame 5 breaks off
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


def test_a_beginning_can_be_looked_at(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    begun = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, begun, limit=9)
    begun.close()
    stored = StoredLightFields(tmp_path / "a.zarr.partial")
    assert stored.numbers == (0, 1, 2, 3, 4, 5, 6, 8)
    assert stored.lost == {7: "is damaged"}
    assert stored[7].samples.any()


def test_something_else_is_never_written_over(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink]
) -> None:
    begun = begin(tmp_path / "a", decoder, new_sink())
    record(decoder, video, begun, limit=3)
    begun.close()
    before = content(tmp_path)
    with pytest.raises(InputError, match=r"a\.partial: begins something else, expected the same job again"):
        begin(tmp_path / "a", decoder, new_sink(), gain=[1.0])
    assert content(tmp_path) == before
    again = begin(tmp_path / "a", decoder, new_sink())
    record(decoder, video, again)
    again.finish()
    before = content(tmp_path)
    with pytest.raises(InputError, match=r"a: exists and holds something else, expected a new name"):
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


def test_a_disk_that_fills_up_keeps_what_is_whole(
    tmp_path: Path, decoder: Decoder, video: Video, new_sink: Callable[[], Sink]
) -> None:
    whole = begin(tmp_path / "whole", decoder, new_sink())
    record(decoder, video, whole)
    whole.finish()
    begun = begin(tmp_path / "cut", decoder, new_sink())
    record(decoder, video, begun, limit=5)
    with (
        files_no_longer_than(3000),
        pytest.raises(InputError, match=r"cannot be written: File too large; 5 frames before are whole, and") as caught,
    ):
        record(decoder, video, begun)
    assert "\n" not in str(caught.value)
    begun.close()
    again = begin(tmp_path / "cut", decoder, new_sink())
    assert again.entries.numbers == [0, 1, 2, 3, 4]
    record(decoder, video, again)
    again.finish()
    assert content(tmp_path / "cut") == content(tmp_path / "whole")


def test_a_video_of_which_nothing_can_be_used_leaves_nothing(tmp_path: Path, decoder: Decoder) -> None:
    path = write_mjpeg(tmp_path / "a.avi", pictures(2, 320, 192))
    damage(path, 0)
    damage(path, 1)
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, Video(path), recording)
    assert len(recording.entries.lost) == 2
    with pytest.raises(InputError, match=r"^a.zarr: not one frame could be decoded, expected at least one$"):
        recording.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["a.avi"]


def test_what_is_no_recording_is_refused(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    with pytest.raises(InputError, match=r"nowhere.zarr: "):
        StoredLightFields(tmp_path / "nowhere.zarr")
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    with pytest.raises(InputError, match=r"other.zarr: not a recording of light fields"):
        open_light_field(tmp_path / "other.zarr")


def test_a_frame_that_was_spoilt_on_disk_is_refused_not_made_up(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording, limit=4)
    recording.finish()
    chunks = [tmp_path / "a.zarr" / "samples" / "c" / str(number) / "0" / "0" / "0" / "0" / "0" for number in range(3)]
    chunks[0].unlink()
    chunks[1].write_bytes(chunks[1].read_bytes()[:50])
    stored = StoredLightFields(tmp_path / "a.zarr")
    with pytest.raises(InputError, match=r"a.zarr: frame 0 is missing, expected samples/c/0/0/0/0/0/0$"):
        stored[0]
    with pytest.raises(InputError, match=r"a.zarr: frame 1 cannot be read: "):
        stored[1]
    assert stored[2].samples.any()


def test_frames_after_the_limit_are_not_touched(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording, limit=4)
    record(decoder, video, recording, limit=4)
    assert recording.entries.numbers == [0, 1, 2, 3]


class Loop:
    """A video without end: the same frames again and again."""

    def __init__(self, video: Video, count: int) -> None:
        self.video, self.count = video, count

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        number = 0
        while True:
            for frame in self.video.frames():
                if number == self.count:
                    return
                assert isinstance(frame, Frame)
                yield replace(frame, number=number, time_s=number / 25)
                number += 1


def resident_mb() -> float:
    """Memory that the process holds, from the kernel."""
    return int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * resource.getpagesize() / 1e6


def test_memory_stays_flat(tmp_path: Path, parabola_layout: Layout) -> None:
    decoder = Decoder(parabola_layout)
    video = Video(write_h264(tmp_path / "a.mp4", pictures(30, 960, 540)))
    held: list[float] = []
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, Loop(video, 100), recording, on_frame=lambda done, _: held.append(resident_mb()))
    recording.finish()
    assert len(held) == 100
    # 50 frames of 1.6 MB, and as many light fields of about that size, would be 150 MB.
    assert max(held[75:]) - min(held[25:50]) < 30.0
