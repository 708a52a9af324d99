"""Recordings in Zarr: arrays by name, partial recordings, and damaged files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from mirrorcam.core.errors import InputError
from mirrorcam.core.video.video import Video
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.registry import open_light_field
from mirrorcam.optics.light_field.io.stream import record
from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields, ZarrSink
from tests.optics.light_field.io.conftest import COUNT, DAMAGED, begin


def test_other_programs_find_the_arrays_by_name(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording)
    recording.finish()
    group = zarr.open_group(tmp_path / "a.zarr", mode="r")
    samples: Any = group["samples"]
    assert samples.metadata.dimension_names == ("frame", "t", "s", "v", "u", "c")
    assert samples.shape == (COUNT - 1, *decoder.weights.shape, 3)
    assert samples.chunks == (1, *decoder.weights.shape, 3)
    names = ["number", "samples", "time_s", "weights", "x_mm", "y_mm", "z_mm"]
    assert sorted(name for name, _ in group.arrays()) == names
    views: Any = group.attrs["views"]
    assert np.array_equal(views["positions_mm"], decoder.views.positions_mm)
    assert group.attrs["lost"] == [[DAMAGED, "is damaged"]]


def test_a_partial_recording_can_be_read(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    begun = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, begun, limit=9)
    begun.close()
    stored = StoredLightFields(tmp_path / "a.zarr.partial")
    assert stored.numbers == (0, 1, 2, 3, 4, 5, 6, 8)
    assert stored.lost == {7: "is damaged"}
    assert stored[7].samples.any()


def test_folders_that_are_not_recordings_are_refused(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    with pytest.raises(InputError, match=r"nowhere.zarr: not a recording of light fields"):
        StoredLightFields(tmp_path / "nowhere.zarr")
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    with pytest.raises(InputError, match=r"other.zarr: not a recording of light fields"):
        open_light_field(tmp_path / "other.zarr")


def test_a_damaged_frame_is_refused(tmp_path: Path, decoder: Decoder, video: Video) -> None:
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


def test_arrays_that_do_not_agree_are_refused(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording, limit=4)
    recording.finish()
    for name, change, message in (
        ("samples", {"shape": [3, *decoder.weights.shape, 3]}, "samples for 3 frames, but numbers and times for 4"),
        ("number", {"shape": [3]}, "3 frame numbers and 4 times"),
        ("weights", {"data_type": "float64"}, "weights are float64 of shape"),
        ("number", {"data_type": "float64"}, "number is float64"),
        ("samples", {"shape": [4, 10**6, 10**6, 10**6, 10**6, 3]}, "with a chunk per frame"),
    ):
        path = tmp_path / "a.zarr" / name / "zarr.json"
        good = path.read_text(encoding="utf-8")
        path.write_text(json.dumps(json.loads(good) | change), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            StoredLightFields(tmp_path / "a.zarr")
        path.write_text(good, encoding="utf-8")
    number = tmp_path / "a.zarr" / "number" / "c" / "0"
    number.unlink()
    with pytest.raises(InputError, match="frame numbers do not increase"):
        StoredLightFields(tmp_path / "a.zarr")


def test_missing_weights_are_noticed(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    recording = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, recording, limit=1)
    recording.finish()
    chunks = sorted(file for file in (tmp_path / "a.zarr" / "weights" / "c").rglob("*") if file.is_file())
    chunks[-1].unlink()
    with pytest.raises(InputError, match=r"samples without weight|all weights are zero"):
        StoredLightFields(tmp_path / "a.zarr")[0]


def test_foreign_journals_are_refused(tmp_path: Path, decoder: Decoder, video: Video) -> None:
    begun = begin(tmp_path / "a.zarr", decoder, ZarrSink())
    record(decoder, video, begun, limit=3)
    begun.close()
    journal = tmp_path / "a.zarr.partial" / "journal.jsonl"
    first, *rest = journal.read_text(encoding="utf-8").splitlines()
    for lines, message in (
        ([], "not the journal of a recording"),
        (["[1]"], "journal.jsonl: "),
        ([first, '{"number": -1, "time_s": 0.0}'], "journal.jsonl: "),
        ([first, '{"number": 0, "time_s": "0"}'], "journal.jsonl: "),
        ([first, "[]"], "journal.jsonl: "),
        ([first, *reversed(rest)], "frame numbers do not increase"),
    ):
        journal.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            StoredLightFields(tmp_path / "a.zarr.partial")
