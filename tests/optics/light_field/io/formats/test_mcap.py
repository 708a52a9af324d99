"""ROS 2 bags as a format: their detection, and single light fields written as one frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.disk.bags import is_bag
from mirrorcam.optics.light_field.io.formats.mcap import FORMAT, write_bag
from mirrorcam.optics.light_field.io.light_field_format import NOTHING
from tests.optics.light_field.io.bags import needs_rosbags
from tests.optics.light_field.io.formats.planes import plane


def test_bags_are_files_by_name_and_folders_by_content(tmp_path: Path) -> None:
    assert is_bag(tmp_path / "missing.mcap")
    assert is_bag(tmp_path / "A.MCAP")
    assert not is_bag(tmp_path)
    (tmp_path / "metadata.yaml").write_text("", encoding="utf-8")
    assert is_bag(tmp_path)


@needs_rosbags
def test_a_light_field_is_written_as_one_frame(tmp_path: Path) -> None:
    light_field = plane(2, 2, 1.0)
    write_bag(tmp_path / "a.mcap", light_field)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    assert FORMAT.read is not None
    contents = FORMAT.read(tmp_path / "a.mcap", NOTHING)
    assert contents.is_recording
    assert contents.times_s == [0.0]
    (found,) = contents.frames
    np.testing.assert_array_equal(found.samples, light_field.samples)
    np.testing.assert_array_equal(found.weights, light_field.weights)
