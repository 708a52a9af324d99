"""What formats state of themselves, and readers and writers of formats that know less than others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.light_field_format import (
    NOTHING,
    Assumed,
    Format,
    single,
    views_toml,
    without_depth,
)
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.io.formats.planes import plane

PATH = Path("a.npy")


def test_geometry_that_is_needed_is_given_or_its_key_and_file_are_named(tmp_path: Path) -> None:
    assumed = Assumed(rows=3, reference_depth_mm=np.inf, step_mm=0.5)
    assert assumed.need(PATH, "rows", "reference_depth_mm", "step_mm") == (3, np.inf, 0.5)
    for name in ("rows", "cols", "step_mm", "focal_px", "reference_depth_mm"):
        with pytest.raises(InputError, match=rf"^a\.npy: does not state its {name}: expected in a\.views\.toml$"):
            NOTHING.need(PATH, name)
    (tmp_path / "set").mkdir()
    with pytest.raises(InputError, match=r"set: does not state its cols, focal_px: expected in set/views\.toml$"):
        assumed.need(tmp_path / "set", "rows", "cols", "focal_px")


def test_what_is_not_given_is_taken_from_views_toml(tmp_path: Path) -> None:
    given = Assumed(rows=3, step_mm=0.5)
    assert given.completed(tmp_path) == given
    views_toml(tmp_path).write_text("cols = 4\nstep_mm = 2.0\nreference_depth_mm = inf\n", encoding="utf-8")
    assert given.completed(tmp_path) == Assumed(rows=3, cols=4, step_mm=0.5, reference_depth_mm=np.inf)


def test_formats_whose_ending_has_no_point_are_folders() -> None:
    for ending, is_folder in ((".npz", False), ("_tiles.png", False), ("_colmap", True)):
        known = Format(name="a", ending=ending, detect=Path.exists, write=lambda *_: None, read=None)
        assert known.is_folder is is_folder


def test_readers_of_one_light_field_give_contents_without_depth() -> None:
    light_field, asked = plane(1, 2, 0.0), []

    def read(path: Path, assumed: Assumed) -> LightField:
        asked.append((path, assumed))
        return light_field

    contents = single(read)(PATH, NOTHING)
    assert asked == [(PATH, NOTHING)]
    assert list(contents.frames) == [light_field]
    assert (contents.depth_mm, contents.depth_range_mm, contents.is_recording) == (None, None, False)


def test_writers_without_a_place_for_depth_leave_it_out() -> None:
    light_field, written = plane(1, 2, 0.0), []
    write = without_depth(lambda path, what: written.append((path, what)))
    write(PATH, light_field, np.ones((2, 2), np.float32))
    write(PATH, light_field, None)
    assert written == [(PATH, light_field)] * 2
