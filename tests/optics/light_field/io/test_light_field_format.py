"""What formats state of themselves, and readers and writers of formats that know less than others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Format, single, without_depth
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.io.formats.planes import plane

PATH = Path("a.npy")


def test_geometry_that_is_needed_is_given_or_its_option_is_named() -> None:
    assumed = Assumed(rows=3, reference_depth_mm=np.inf, step_mm=0.0)
    assert assumed.need("rows", PATH) == 3
    assert assumed.need("reference_depth_mm", PATH) == np.inf
    assert assumed.need("step_mm", PATH) == 0.0
    for name in ("rows", "cols", "step_mm", "focal_px", "reference_depth_mm"):
        with pytest.raises(InputError, match=rf"a\.npy: does not state its {name}, .* --{name.replace('_', '-')}$"):
            NOTHING.need(name, PATH)


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
