"""Properties of formats, and readers and writers of formats without depth or geometry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.light_field_format import (
    NOTHING,
    Assumed,
    Format,
    KnownDepth,
    StoredFrames,
    depthless_writer,
    single_reader,
    views_toml,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph
from tests.optics.light_field.io.formats.planes import plane

PATH = Path("a.npy")
COUNT = 5


def test_missing_geometry_is_named_by_key_and_file(tmp_path: Path) -> None:
    assumed = Assumed(rows=3, reference_depth_mm=np.inf, step_mm=0.5)
    assert assumed.need(PATH, "rows", "reference_depth_mm", "step_mm") == (3, np.inf, 0.5)
    for name in ("rows", "cols", "step_mm", "focal_px", "reference_depth_mm"):
        option = f"--{name.replace('_', '-')}"
        line = rf"^a\.npy: does not state its {name}: expected in a\.views\.toml, or as {option}$"
        with pytest.raises(InputError, match=line):
            NOTHING.need(PATH, name)
    (tmp_path / "set").mkdir()
    with pytest.raises(InputError, match=r"set: does not state its cols, focal_px: expected in set/views\.toml, or"):
        assumed.need(tmp_path / "set", "rows", "cols", "focal_px")


def test_missing_arguments_are_read_from_views_toml(tmp_path: Path) -> None:
    given = Assumed(rows=3, step_mm=0.5)
    assert given.complete(tmp_path) == given
    views_toml(tmp_path).write_text("cols = 4\nstep_mm = 2.0\nreference_depth_mm = inf\n", encoding="utf-8")
    assert given.complete(tmp_path) == Assumed(rows=3, cols=4, step_mm=0.5, reference_depth_mm=np.inf)


def test_formats_whose_ending_has_no_point_are_folders() -> None:
    for ending, is_folder in ((".npz", False), ("_tiles.png", False), ("_colmap", True)):
        known = Format(name="a", ending=ending, detect=Path.exists, write=lambda *_: None, read=None)
        assert known.is_folder is is_folder


def test_readers_of_one_light_field_give_contents_without_depth() -> None:
    light_field, asked = plane(1, 2, 0.0), []

    def read(path: Path, assumed: Assumed) -> LightField:
        asked.append((path, assumed))
        return light_field

    contents = single_reader(read)(PATH, NOTHING)
    assert asked == [(PATH, NOTHING)]
    assert list(contents.frames) == [light_field]
    assert (contents.depth_mm, contents.depth_range_mm, contents.is_recording) == (None, None, False)


def test_writers_of_formats_without_depth_omit_it() -> None:
    light_field, written = plane(1, 2, 0.0), []
    write = depthless_writer(lambda path, what: written.append((path, what)))
    write(PATH, light_field, KnownDepth(np.ones((2, 2), np.float32)))
    write(PATH, light_field, None)
    assert written == [(PATH, light_field)] * 2


class Frames(StoredFrames):
    """Frames identified by their numbers, and the numbers of those that were read."""

    def __init__(self, frame: LightField) -> None:
        self.path, self.read = Path("recording.zarr"), list[int]()
        self._one = frame

    def __len__(self) -> int:
        return COUNT

    def _frame(self, index: int) -> LightField:
        self.read.append(index)
        return replace(self._one, layout_identity=str(index))


@pytest.fixture
def frames() -> Frames:
    return Frames(photograph(grid_views(width_px=12, height_px=9), [Surface(500.0)])[0])


def test_indices_work_like_those_of_a_list_and_read_only_their_frames(frames: Frames) -> None:
    numbers = list(range(COUNT))
    for index in (0, 3, COUNT - 1, -1, -COUNT):
        assert frames[index].layout_identity == str(numbers[index])
    assert frames.read == [0, 3, 4, 4, 0]
    for part in (slice(1, 3), slice(None, None, -2), slice(-2, None), slice(3, 99), slice(4, 1)):
        frames.read.clear()
        assert [each.layout_identity for each in frames[part]] == [str(number) for number in numbers[part]]
        assert frames.read == numbers[part]


def test_frames_can_be_iterated(frames: Frames) -> None:
    assert [each.layout_identity for each in frames] == ["0", "1", "2", "3", "4"]
    assert [each.layout_identity for each in reversed(frames)] == ["4", "3", "2", "1", "0"]


@pytest.mark.parametrize("index", [COUNT, -COUNT - 1])
def test_other_indices_are_refused(frames: Frames, index: int) -> None:
    with pytest.raises(IndexError, match=rf"recording\.zarr: frame {index}, expected one of {COUNT}"):
        frames[index]
    assert not frames.read
